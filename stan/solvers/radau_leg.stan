/**
 * States along a leg of a Burgers model, by Radau IIA of order 5.
 *
 * This file stands for a build without C++: the method never converges, so ode_bdf_tol solves all.
 * A build with the include path with_cpp/ ahead of this one takes solvers/radau_leg.stan there,
 * which declares the function alone; its body is with_cpp/solvers/radau_leg.hpp.
 *
 * Symbols, units and the order of states are those of kinds/loading_history_legs.stan; behind the
 * others there is z, of a stress-driven leg too.
 *
 * @param law what drives the leg (0 strain, 1 stress, 2 force, 3 oscillating strain), place of the
 *   dashpot's law among dashpot_stresses(), that of the Kelvin element's among kelvin_law_parameters(),
 *   and the places of g, u and b among the states, from 0; -1: no state. Then how mechanisms of the
 *   dashpot act (mechanisms_act()), and of an oscillation the numbers of harmonics and of
 *   coefficients of its background
 * @param known y or f at the start, r, e, and of the piezometer d_1/d_0, m and its floor (Pa); of an
 *   oscillation also the starts of leg and record, and middle and half of the record, in periods
 * @param time since the start, not decreasing
 * @param tolerance relative and absolute
 * @param start states at the start; those of linear elements come last
 * @param argument the first 13 numbers of kinds/loading_history_rates.stan, ln(S/q_0), S (Pa), g at
 *   the start (where strain only grows, less what the load has stretched), the seven numbers of a
 *   backstress, the three of each of two further mechanisms, the decays, then the weights, of
 *   linear elements, and the amplitudes of an oscillation over e
 * @return array over time of the states; NaN where the method does not converge
 */
array[] vector radau_leg(data array[] int law, data array[] real known, data array[] real time,
                         data real tolerance, vector start, vector argument) {
  array[size(time)] vector[num_elements(start)] states;
  for (i in 1 : size(time)) {
    states[i] = rep_vector(not_a_number(), num_elements(start));
  }
  return states;
}
