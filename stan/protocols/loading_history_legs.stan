/**
 * States along a leg of a loading history (loading_history_rates.stan): [y, z, x, g, u] at given
 * times and, last, at the end.
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
 * Right-hand side of a strain-driven leg.
 *
 * @param state [y, z], then u where the grain size follows a piezometer, then g where the
 *   apparatus is compliant
 * @param start_path g at the start of the leg
 * @param rate r
 * @param varying, place, fixed, test see loading_history_rates.stan
 */
vector strain_driven_rhs(real t, vector state, real start_path, vector varying, data real rate,
                         data array[] int place, data vector fixed, data vector test) {
  int n_states = num_elements(state);
  int compliant = in_use(h_apparatus_compliance(), place, fixed, 0);
  real apparatus = history_rate(h_apparatus_compliance(), varying, place, fixed);
  real path = compliant ? state[n_states] : start_path + magnitude(rate) * t;
  real u = test[c_piezometer()] > 0 ? state[3] : 1;
  real z_rate = history_kelvin_rate(state[1], state[2], varying, place, fixed, test);
  real y_rate = (rate - history_rate(h_kelvin_compliance(), varying, place, fixed) * z_rate
                 - history_dashpot_rate(state[1], path, u, varying, place, fixed, test))
                / (history_rate(h_spring_compliance(), varying, place, fixed) + apparatus);
  real path_rate = magnitude(rate - apparatus * y_rate);
  vector[n_states] slope;
  slope[1 : 2] = [y_rate, z_rate]';
  if (test[c_piezometer()] > 0) {
    slope[3] = history_grain_growth(state[1], u, path_rate, varying, place, fixed, test);
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
 * @param start [z, g] at the start of the leg
 * @param y_0, rate y at the start, and r
 */
vector stress_driven_rhs(real t, vector state, vector start, vector varying, data real y_0,
                         data real rate, data array[] int place, data vector fixed,
                         data vector test) {
  int n_states = num_elements(state);
  int solves_kelvin = in_use(h_kelvin_stress_exponent(), place, fixed, 1);
  real y = y_0 + rate * t;
  real z = solves_kelvin
           ? state[3]
           : linear_kelvin_strain(t, start[1], y_0, rate,
                                  history_rate(h_kelvin_decay(), varying, place, fixed));
  real u = test[c_piezometer()] > 0 ? state[n_states] : 1;
  real z_rate = history_kelvin_rate(y, z, varying, place, fixed, test);
  real x_rate = history_dashpot_rate(y, start[2] + state[2], u, varying, place, fixed, test);
  real path_rate
    = magnitude(history_rate(h_spring_compliance(), varying, place, fixed) * rate
                + history_rate(h_kelvin_compliance(), varying, place, fixed) * z_rate + x_rate);
  vector[n_states] slope;
  slope[1 : 2] = [x_rate, path_rate]';
  if (solves_kelvin) {
    slope[3] = z_rate;
  }
  if (test[c_piezometer()] > 0) {
    slope[n_states] = history_grain_growth(y, u, path_rate, varying, place, fixed, test);
  }
  return slope;
}

/**
 * States along a strain-driven leg.
 *
 * @param start [y, z, x, g, u]
 * @param at_rest 1: the test starts with this leg, and start is known
 * @param time from 0 to 1, not decreasing
 * @param rate r
 * @return array over times, and the end
 */
array[] vector strain_driven_leg(vector start, data int at_rest, data array[] real time,
                                 data real rate, vector varying, data array[] int place,
                                 data vector fixed, data vector test, data real tolerance,
                                 data int max_num_steps) {
  int has_grains = test[c_piezometer()] > 0;
  int compliant = in_use(h_apparatus_compliance(), place, fixed, 0);
  int n_states = 2 + has_grains + compliant;
  real kelvin = history_rate(h_kelvin_compliance(), varying, place, fixed);
  real elastic = history_rate(h_spring_compliance(), varying, place, fixed)
                 + history_rate(h_apparatus_compliance(), varying, place, fixed);
  int n_at_start = first_after(time, 0) - 1;
  int n = size(time) + 1 - n_at_start;
  array[n] vector[n_states] solved;
  array[size(time) + 1] vector[5] states;
  if (at_rest) {
    // The initial state is literal: constant to the solver, no sensitivities to it.
    solved = ode_bdf_tol(strain_driven_rhs,
                         append_row(rep_vector(0, 2),
                                    append_row(rep_vector(1, has_grains),
                                               rep_vector(0, compliant))),
                         0, append_array(time[n_at_start + 1 : ], {1.0}), tolerance, tolerance,
                         max_num_steps, 0.0, varying, rate, place, fixed, test);
  } else {
    solved = ode_bdf_tol(strain_driven_rhs,
                         append_row(start[1 : 2],
                                    append_row(segment(start, 5, has_grains),
                                               segment(start, 4, compliant))),
                         0, append_array(time[n_at_start + 1 : ], {1.0}), tolerance, tolerance,
                         max_num_steps, start[4], varying, rate, place, fixed, test);
  }
  for (i in 1 : n_at_start) {
    states[i] = start;
  }
  for (i in 1 : n) {
    real t = i < n ? time[n_at_start + i] : 1;
    vector[5] state = start;
    state[1 : 2] = solved[i][1 : 2];
    state[3] += rate * t - kelvin * (state[2] - start[2]) - elastic * (state[1] - start[1]);
    state[4] = compliant ? solved[i][n_states] : start[4] + magnitude(rate) * t;
    if (has_grains) {
      state[5] = solved[i][3];
    }
    states[n_at_start + i] = state;
  }
  return states;
}

/**
 * States along a stress-driven leg: as strain_driven_leg(), and
 *
 * @param start [y, z, x, g, u] after the jump of the stress, if there is one
 * @param y_0, rate y at the start, and r
 */
array[] vector stress_driven_leg(vector start, data int at_rest, data array[] real time,
                                 data real y_0, data real rate, vector varying,
                                 data array[] int place, data vector fixed, data vector test,
                                 data real tolerance, data int max_num_steps) {
  int has_grains = test[c_piezometer()] > 0;
  int solves_kelvin = in_use(h_kelvin_stress_exponent(), place, fixed, 1);
  int n_states = 2 + solves_kelvin + has_grains;
  int n_at_start = first_after(time, 0) - 1;
  int n = size(time) + 1 - n_at_start;
  array[n] vector[n_states] solved;
  array[size(time) + 1] vector[5] states;
  // A jump of the stress at the start moves the grain size of a piezometer.
  if (!has_grains && (at_rest || !solves_kelvin)) {
    solved = ode_bdf_tol(stress_driven_rhs,
                         rep_vector(0, 2 + solves_kelvin), 0,
                         append_array(time[n_at_start + 1 : ], {1.0}), tolerance, tolerance,
                         max_num_steps, start[{2, 4}], varying, y_0, rate, place, fixed, test);
  } else {
    solved = ode_bdf_tol(stress_driven_rhs,
                         append_row(rep_vector(0, 2),
                                    append_row(segment(start, 2, solves_kelvin),
                                               segment(start, 5, has_grains))),
                         0, append_array(time[n_at_start + 1 : ], {1.0}), tolerance, tolerance,
                         max_num_steps, start[{2, 4}], varying, y_0, rate, place, fixed, test);
  }
  for (i in 1 : n_at_start) {
    states[i] = start;
  }
  for (i in 1 : n) {
    real t = i < n ? time[n_at_start + i] : 1;
    vector[5] state = start;
    state[1] = y_0 + rate * t;
    state[2] = solves_kelvin
               ? solved[i][3]
               : linear_kelvin_strain(t, start[2], y_0, rate,
                                      history_rate(h_kelvin_decay(), varying, place, fixed));
    state[3 : 4] += solved[i][1 : 2];
    if (has_grains) {
      state[5] = solved[i][n_states];
    }
    states[n_at_start + i] = state;
  }
  return states;
}
