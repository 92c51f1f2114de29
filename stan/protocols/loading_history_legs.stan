/**
 * States along a leg of a loading history (loading_history_rates.stan): [y, z, x, g, u] at given
 * times and, last, at the end; behind them, where the Kelvin part is a sum of elements, its z_k.
 *
 * Strain driven, at the rate r in the unit e/D, the solver follows y, z and, where they are needed,
 * u and g:
 *
 *   dy/dt = (r - v_K - v_d)/(S/(E_M e) + C S/e).
 *
 * The strain that is imposed includes that of the apparatus, C stress; the path strain is the
 * specimen's, which is known in advance where the apparatus is rigid. In a hold it stands still:
 * the microstructure does not change while stress relaxes.
 *
 * Stress driven, y = y_0 + r t with r in the unit S/D, it follows x, g and, where they are needed,
 * z and u:
 *
 *   dx/dt = v_d,  dg/dt = |(S/(E_M e)) r + v_K + v_d|.
 *
 * x and g are counted from the start of the leg, so that its solver starts from numbers that are
 * data; a linear Kelvin element has a closed form.
 */

/** Place of the first time after another, or one more than there are. */
int first_after(data array[] real time, data real other) {
  for (i in 1 : size(time)) {
    if (time[i] > other) {
      return i;
    }
  }
  return size(time) + 1;
}

/**
 * z under a linear Kelvin element after a time t under y = y_0 + r t.
 *
 * @param start z at t = 0
 * @param decay per unit time
 */
real linear_kelvin_strain(real t, real start, real y_0, real r, real decay) {
  real gone = -expm1(-decay * t);
  return start + (y_0 - start) * gone + r * (t - gone / decay);
}

/**
 * z_k of a sum of elements: as linear_kelvin_strain().
 *
 * @param elements of history_elements()
 */
vector linear_kelvin_strains(real t, vector start, real y_0, real r, matrix elements) {
  vector[num_elements(start)] z;
  for (k in 1 : num_elements(start)) {
    z[k] = linear_kelvin_strain(t, start[k], y_0, r, elements[k, 1]);
  }
  return z;
}

/** Number of z_k that a leg follows beside z: none where the Kelvin part is one element. */
int n_summed(data matrix element) { return rows(element) > 1 ? rows(element) : 0; }

/** z of each element of the Kelvin part at the states of a leg. */
vector kelvin_states(vector state, data matrix element) {
  return rows(element) > 1 ? state[6 : ] : state[2 : 2];
}

/**
 * Right-hand side of a strain-driven leg.
 *
 * @param state [y, z] or, of a sum of elements, [y, z_k], then u where the grain size follows a piezometer, then g where the
 *   apparatus is compliant
 * @param start_path g at the start of the leg
 * @param rate r
 * @param varying, place, fixed, test, element see loading_history_rates.stan
 */
vector strain_driven_rhs(real t, vector state, real start_path, vector varying, data real rate,
                         data array[] int place, data vector fixed, data vector test,
                         data matrix element) {
  int n_states = num_elements(state);
  int n_kelvin = rows(element);
  int compliant = in_use(h_apparatus_compliance(), place, fixed, 0);
  real apparatus = history_rate(h_apparatus_compliance(), varying, place, fixed);
  real path = compliant ? state[n_states] : start_path + magnitude(rate) * t;
  real u = test[c_piezometer()] > 0 ? state[2 + n_kelvin] : 1;
  matrix[n_kelvin, 2] elements = history_elements(element, varying, place, fixed);
  vector[n_kelvin] z_rates = history_kelvin_rates(state[1], segment(state, 2, n_kelvin), elements,
                                                  varying, place, fixed, test);
  real z_rate = dot_product(elements[ : , 2], z_rates);
  real y_rate = (rate - history_rate(h_kelvin_compliance(), varying, place, fixed) * z_rate
                 - history_dashpot_rate(state[1], path, u, varying, place, fixed, test))
                / (history_rate(h_spring_compliance(), varying, place, fixed) + apparatus);
  real path_rate = magnitude(rate - apparatus * y_rate);
  vector[n_states] slope;
  slope[1] = y_rate;
  slope[2 : n_kelvin + 1] = z_rates;
  if (test[c_piezometer()] > 0) {
    slope[2 + n_kelvin] = history_grain_growth(state[1], u, path_rate, varying, place, fixed,
                                               test);
  }
  if (compliant) {
    slope[n_states] = path_rate;
  }
  return slope;
}

/**
 * Right-hand side of a stress-driven leg.
 *
 * @param state [x, g] since the start of the leg, then z where the Kelvin element is no linear one,
 *   then u where the grain size follows a piezometer
 * @param start_path, start_kelvin g, and z of each element, at the start of the leg
 * @param y_0, rate y at the start, and r
 */
vector stress_driven_rhs(real t, vector state, real start_path, vector start_kelvin,
                         vector varying, data real y_0, data real rate, data array[] int place, data vector fixed,
                         data vector test, data matrix element) {
  int n_states = num_elements(state);
  int n_kelvin = rows(element);
  int solves_kelvin = in_use(h_kelvin_stress_exponent(), place, fixed, 1);
  real y = y_0 + rate * t;
  matrix[n_kelvin, 2] elements = history_elements(element, varying, place, fixed);
  vector[n_kelvin] z = solves_kelvin
                       ? rep_vector(state[3], 1)
                       : linear_kelvin_strains(t, start_kelvin, y_0, rate, elements);
  real u = test[c_piezometer()] > 0 ? state[n_states] : 1;
  real z_rate
    = dot_product(elements[ : , 2],
                  history_kelvin_rates(y, z, elements, varying, place, fixed, test));
  real x_rate = history_dashpot_rate(y, start_path + state[2], u, varying, place, fixed, test);
  real path_rate
    = magnitude(history_rate(h_spring_compliance(), varying, place, fixed) * rate
                + history_rate(h_kelvin_compliance(), varying, place, fixed) * z_rate + x_rate);
  vector[n_states] slope;
  slope[1 : 2] = [x_rate, path_rate]';
  if (solves_kelvin) {
    slope[3] = z_rate; // of one element
  }
  if (test[c_piezometer()] > 0) {
    slope[n_states] = history_grain_growth(y, u, path_rate, varying, place, fixed, test);
  }
  return slope;
}

/**
 * States along a strain-driven leg.
 *
 * @param start [y, z, x, g, u], and z_k of a sum of elements
 * @param at_rest 1: the test starts with this leg, and start is known
 * @param time from 0 to 1, not decreasing
 * @param rate r
 * @return array over times, and the end
 */
array[] vector strain_driven_leg(vector start, data int at_rest, data array[] real time,
                                 data real rate, vector varying, data array[] int place,
                                 data vector fixed, data vector test, data matrix element,
                                 data real tolerance, data int max_num_steps) {
  int has_grains = test[c_piezometer()] > 0;
  int compliant = in_use(h_apparatus_compliance(), place, fixed, 0);
  int n_kelvin = rows(element);
  int n_states = 1 + n_kelvin + has_grains + compliant;
  vector[n_kelvin] weight = history_elements(element, varying, place, fixed)[ : , 2];
  real kelvin = history_rate(h_kelvin_compliance(), varying, place, fixed);
  real elastic = history_rate(h_spring_compliance(), varying, place, fixed)
                 + history_rate(h_apparatus_compliance(), varying, place, fixed);
  int n_at_start = first_after(time, 0) - 1;
  int n = size(time) + 1 - n_at_start;
  array[n] vector[n_states] solved;
  array[size(time) + 1] vector[num_elements(start)] states;
  if (at_rest) {
    // The initial state is literal: constant to the solver, no sensitivities to it.
    solved = ode_bdf_tol(strain_driven_rhs,
                         append_row(rep_vector(0, 1 + n_kelvin),
                                    append_row(rep_vector(1, has_grains),
                                               rep_vector(0, compliant))),
                         0, append_array(time[n_at_start + 1 : ], {1.0}), tolerance, tolerance,
                         max_num_steps, 0.0, varying, rate, place, fixed, test, element);
  } else {
    solved = ode_bdf_tol(strain_driven_rhs,
                         append_row(append_row(start[1], kelvin_states(start, element)),
                                    append_row(segment(start, 5, has_grains),
                                               segment(start, 4, compliant))),
                         0, append_array(time[n_at_start + 1 : ], {1.0}), tolerance, tolerance,
                         max_num_steps, start[4], varying, rate, place, fixed, test, element);
  }
  for (i in 1 : n_at_start) {
    states[i] = start;
  }
  for (i in 1 : n) {
    real t = i < n ? time[n_at_start + i] : 1;
    vector[num_elements(start)] state = start;
    vector[n_kelvin] z = segment(solved[i], 2, n_kelvin);
    state[1 : 2] = [solved[i][1], dot_product(weight, z)]';
    if (n_summed(element) > 0) {
      state[6 : ] = z;
    }
    state[3] += rate * t - kelvin * (state[2] - start[2]) - elastic * (state[1] - start[1]);
    state[4] = compliant ? solved[i][n_states] : start[4] + magnitude(rate) * t;
    if (has_grains) {
      state[5] = solved[i][2 + n_kelvin];
    }
    states[n_at_start + i] = state;
  }
  return states;
}

/**
 * States along a stress-driven leg: as strain_driven_leg(), and
 *
 * @param start [y, z, x, g, u], and z_k of a sum of elements, after the jump of the stress, if there is one
 * @param y_0, rate y at the start, and r
 */
array[] vector stress_driven_leg(vector start, data int at_rest, data array[] real time,
                                 data real y_0, data real rate, vector varying,
                                 data array[] int place, data vector fixed, data vector test,
                                 data matrix element, data real tolerance,
                                 data int max_num_steps) {
  int has_grains = test[c_piezometer()] > 0;
  int solves_kelvin = in_use(h_kelvin_stress_exponent(), place, fixed, 1);
  int n_states = 2 + solves_kelvin + has_grains;
  int n_kelvin = rows(element);
  matrix[n_kelvin, 2] elements = history_elements(element, varying, place, fixed);
  int n_at_start = first_after(time, 0) - 1;
  int n = size(time) + 1 - n_at_start;
  array[n] vector[n_states] solved;
  array[size(time) + 1] vector[num_elements(start)] states;
  // What is known is literal: constant to the solver, no sensitivities to it. A jump of the stress
  // at the start moves the grain size of a piezometer.
  if (!has_grains && at_rest) {
    solved = ode_bdf_tol(stress_driven_rhs,
                         rep_vector(0, 2 + solves_kelvin), 0,
                         append_array(time[n_at_start + 1 : ], {1.0}), tolerance, tolerance,
                         max_num_steps, start[4], rep_vector(0, n_kelvin), varying, y_0, rate,
                         place, fixed, test, element);
  } else if (!has_grains && !solves_kelvin) {
    solved = ode_bdf_tol(stress_driven_rhs,
                         rep_vector(0, 2), 0,
                         append_array(time[n_at_start + 1 : ], {1.0}), tolerance, tolerance,
                         max_num_steps, start[4], kelvin_states(start, element), varying, y_0,
                         rate, place, fixed, test, element);
  } else {
    solved = ode_bdf_tol(stress_driven_rhs,
                         append_row(rep_vector(0, 2),
                                    append_row(segment(start, 2, solves_kelvin),
                                               segment(start, 5, has_grains))),
                         0, append_array(time[n_at_start + 1 : ], {1.0}), tolerance, tolerance,
                         max_num_steps, start[4], kelvin_states(start, element), varying, y_0,
                         rate, place, fixed, test, element);
  }
  for (i in 1 : n_at_start) {
    states[i] = start;
  }
  for (i in 1 : n) {
    real t = i < n ? time[n_at_start + i] : 1;
    vector[num_elements(start)] state = start;
    vector[n_kelvin] z
      = solves_kelvin
        ? rep_vector(solved[i][3], 1)
        : linear_kelvin_strains(t, kelvin_states(start, element), y_0, rate, elements);
    state[1 : 2] = [y_0 + rate * t, dot_product(elements[ : , 2], z)]';
    if (n_summed(element) > 0) {
      state[6 : ] = z;
    }
    state[3 : 4] += solved[i][1 : 2];
    if (has_grains) {
      state[5] = solved[i][n_states];
    }
    states[n_at_start + i] = state;
  }
  return states;
}
