/**
 * States along a leg of a loading history (loading_history_rates.stan): y, z, x, g, u and b as columns,
 * at given times and, in the last row, at the end; behind them, where the Kelvin part is a sum of
 * elements, its z_k.
 *
 * Strain driven, at the rate r in the unit e/D, the solver follows y, where they are needed u, b and
 * g, and z_k:
 *
 *   dy/dt = (r - v_K - v_d)/(S/(E_M e) + C S/e).
 *
 * The strain that is imposed includes that of the apparatus, C stress; the path strain is the
 * specimen's, which is known in advance where the apparatus is rigid. In a hold it stands still:
 * the microstructure does not change while stress relaxes.
 *
 * Stress driven, y = y_0 + r t with r in the unit S/D, it follows x, g and, where they are needed,
 * u, b and z:
 *
 *   dx/dt = v_d,  dg/dt = |(S/(E_M e)) r + v_K + v_d|.
 *
 * x and g are counted from the start of the leg; a linear Kelvin element has a closed form. While
 * strain only grows, the path strain grows with it and is known from the others, so that radau_leg()
 * follows x alone, and b where it is needed:
 *
 *   g = g_0 + (S/(E_M e)) (y - y_0) + (S/(E_K e)) (z - z_0) + x.
 *
 * That is so under a load that does not fall, from a Kelvin part that it still strains. Dislocations
 * that a test starts with can push back.
 *
 * Force driven, the true stress follows from the strain s of the specimen, in the unit e: at constant
 * volume y = f exp(-e s), with f = f_0 + r t the force over the first area. The solver follows s, g,
 * where they are needed u and b, and z_k:
 *
 *   ds/dt = [(S/(E_M e)) r exp(-e s) + v_K + v_d]/[1 + (S/E_M) y],  dg/dt = |ds/dt|.
 */

/**
 * States along a leg by radau_leg(); NaN if another solver is wanted or the method does not converge.
 *
 * @param driven by strain 0, by stress 1, by force 2
 * @param state places of g, u and b among the states, from 0; -1: no state
 * @param y_0, rate y or f at the start, and r
 * @param start states at the start, those of the elements last
 * @param start_path g at the start (solvers/radau_leg.stan)
 * @param elements of history_elements()
 */
array[] vector fast_history_leg(data int driven, data array[] int state, data array[] real time,
                                data real y_0, data real rate, vector start, real start_path,
                                matrix elements, vector varying, data array[] int place,
                                data vector fixed, data vector test, data int solver,
                                data real tolerance) {
  array[size(time)] vector[num_elements(start)] states;
  if (solver == 1) {
    vector[num_elements(start)] from = start;
    int n_linear = test[c_kelvin_law()] == 0 ? rows(elements) : 0;
    int act = 0; // of mechanisms_act()
    vector[29] argument;
    for (k in 0 : 7) {
      act += test[c_mechanisms()] > k;
    }
    for (k in 1 : 13) {
      argument[k] = history_rate(k, varying, place, fixed);
    }
    argument[15] = history_rate(h_stress_scale(), varying, place, fixed);
    argument[14] = log(argument[15] / test[c_kelvin_reference()]);
    argument[16] = start_path;
    for (k in 1 : 13) {
      argument[16 + k] = history_rate(h_hardening() + k - 1, varying, place, fixed);
    }
    return radau_leg({driven, place_of_dashpot_law(test[c_dashpot_law()]),
                      place_of_kelvin_law(test[c_kelvin_law()]), state[1], state[2], state[3],
                      act},
                     {y_0, rate, test[c_strain_scale()], test[c_piezometer()],
                      test[c_piezometer_exponent()], test[c_piezometer_stress_floor()]},
                     time, tolerance, from,
                     append_row(argument, head(to_vector(elements), 2 * n_linear)));
  }
  for (i in 1 : size(time)) {
    states[i] = rep_vector(not_a_number(), num_elements(start));
  }
  return states;
}

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
 * Right-hand side of a strain-driven leg.
 *
 * @param state y, then u where the grain size follows a piezometer, b where there is a backstress, g
 *   where the apparatus is compliant, and z of each element
 * @param start_path g at the start of the leg
 * @param rate r
 */
vector strain_driven_rhs(real t, vector state, real start_path, vector varying, data real rate,
                         data array[] int place, data vector fixed, data vector test,
                         data matrix element) {
  int n_states = num_elements(state);
  int n_kelvin = rows(element);
  int compliant = in_use(h_apparatus_compliance(), place, fixed, 0);
  int place_of_b = n_states - n_kelvin - compliant;
  real apparatus = history_rate(h_apparatus_compliance(), varying, place, fixed);
  real path = compliant ? state[place_of_b + 1] : start_path + magnitude(rate) * t;
  real u = test[c_piezometer()] > 0 ? state[2] : 1;
  real b = test[c_hardening()] > 0 ? state[place_of_b] : 0;
  vector[2] x_rates = history_dashpot_rates(state[1], b, path, u, varying, place, fixed, test);
  matrix[n_kelvin, 2] elements = history_elements(element, varying, place, fixed);
  vector[n_kelvin] z_rates = history_kelvin_rates(state[1], tail(state, n_kelvin), elements,
                                                  varying, place, fixed, test);
  real z_rate = dot_product(elements[ : , 2], z_rates);
  real y_rate = (rate - history_rate(h_kelvin_compliance(), varying, place, fixed) * z_rate
                 - x_rates[1])
                / (history_rate(h_spring_compliance(), varying, place, fixed) + apparatus);
  real path_rate = magnitude(rate - apparatus * y_rate);
  vector[n_states] slope;
  slope[1] = y_rate;
  slope[n_states - n_kelvin + 1 : n_states] = z_rates;
  if (test[c_piezometer()] > 0) {
    slope[2] = history_grain_growth(state[1], u, path_rate, varying, place, fixed, test);
  }
  if (test[c_hardening()] > 0) {
    slope[place_of_b] = history_backstress_rate(b, path, u, x_rates[2], varying, place, fixed,
                                                test);
  }
  if (compliant) {
    slope[place_of_b + 1] = path_rate;
  }
  return slope;
}

/**
 * Right-hand side of a stress-driven leg.
 *
 * @param state [x, g] since the start of the leg, then u where the grain size follows a piezometer,
 *   b where there is a backstress, and z where the Kelvin element is no linear one
 * @param start_path, start_kelvin g, and z of each element, at the start of the leg
 * @param y_0, rate y at the start, and r
 */
vector stress_driven_rhs(real t, vector state, real start_path, vector start_kelvin,
                         vector varying, data real y_0, data real rate, data array[] int place, data vector fixed,
                         data vector test, data matrix element) {
  int n_states = num_elements(state);
  int n_kelvin = rows(element);
  int solves_kelvin = test[c_kelvin_law()] > 0;
  real y = y_0 + rate * t;
  matrix[n_kelvin, 2] elements = history_elements(element, varying, place, fixed);
  vector[n_kelvin] z = solves_kelvin
                       ? tail(state, 1)
                       : linear_kelvin_strains(t, start_kelvin, y_0, rate, elements);
  int hardens = test[c_hardening()] > 0;
  int place_of_b = n_states - solves_kelvin;
  real u = test[c_piezometer()] > 0 ? state[3] : 1;
  real b = hardens ? state[place_of_b] : 0;
  real z_rate
    = dot_product(elements[ : , 2],
                  history_kelvin_rates(y, z, elements, varying, place, fixed, test));
  vector[2] x_rates = history_dashpot_rates(y, b, start_path + state[2], u, varying, place, fixed,
                                            test);
  real path_rate
    = magnitude(history_rate(h_spring_compliance(), varying, place, fixed) * rate
                + history_rate(h_kelvin_compliance(), varying, place, fixed) * z_rate
                + x_rates[1]);
  vector[n_states] slope;
  slope[1 : 2] = [x_rates[1], path_rate]';
  if (solves_kelvin) {
    slope[n_states] = z_rate; // of one element
  }
  if (test[c_piezometer()] > 0) {
    slope[3] = history_grain_growth(y, u, path_rate, varying, place, fixed, test);
  }
  if (hardens) {
    slope[place_of_b] = history_backstress_rate(b, start_path + state[2], u, x_rates[2], varying, place, fixed,
                                                test);
  }
  return slope;
}

/** Whether strain only grows in a stress-driven leg: see the head of this file. */
int strain_only_grows(vector start_kelvin, data real y_0, data real rate) {
  return y_0 >= 0 && rate >= 0 && max(start_kelvin) <= y_0;
}

/**
 * States along a strain-driven leg.
 *
 * @param start a row of states
 * @param time from 0 to 1, not decreasing
 * @param rate r
 * @return rows over times, and the end
 */
matrix strain_driven_leg(row_vector start, data array[] real time, data real rate, vector varying,
                         data array[] int place, data vector fixed, data vector test,
                         data matrix element, data int solver, data real tolerance,
                         data int max_num_steps) {
  int has_grains = test[c_piezometer()] > 0;
  int compliant = in_use(h_apparatus_compliance(), place, fixed, 0);
  int n_kelvin = rows(element);
  int hardens = test[c_hardening()] > 0;
  int n_states = 1 + n_kelvin + has_grains + hardens + compliant;
  matrix[n_kelvin, 2] elements = history_elements(element, varying, place, fixed);
  real kelvin = history_rate(h_kelvin_compliance(), varying, place, fixed);
  real elastic = history_rate(h_spring_compliance(), varying, place, fixed)
                 + history_rate(h_apparatus_compliance(), varying, place, fixed);
  int n_at_start = first_after(time, 0) - 1;
  int n = size(time) + 1 - n_at_start;
  array[n] real after_start = append_array(time[n_at_start + 1 : ], {1.0});
  vector[n_states] from
    = append_row(append_row(start[1],
                            to_vector(segment(start, 6 - has_grains, has_grains + hardens))),
                 append_row(to_vector(segment(start, 4, compliant)),
                            kelvin_states(start, element)));
  array[n] vector[n_states] solved
    = fast_history_leg(0, {compliant ? 1 + has_grains + hardens : -1, has_grains ? 1 : -1,
                           hardens ? 1 + has_grains : -1},
                       append_array(time[n_at_start + 1 : ], {1.0}), 0, rate, from,
                       compliant ? 0 : start[4], elements, varying, place, fixed, test, solver,
                       tolerance);
  matrix[size(time) + 1, num_elements(start)] states;
  if (is_nan(solved[1][1])) {
    solved = ode_bdf_tol(strain_driven_rhs, from, 0, after_start, tolerance, tolerance,
                         max_num_steps, start[4], varying, rate, place, fixed, test, element);
  }
  for (i in 1 : n_at_start) {
    states[i] = start;
  }
  for (i in 1 : n) {
    int at = n_at_start + i;
    states[at, 1] = solved[i][1];
    states[at, 2] = kelvin_sum(tail(solved[i], n_kelvin), elements);
    if (compliant) {
      states[at, 4] = solved[i][2 + has_grains + hardens];
    }
    states[at, 5] = has_grains ? solved[i][2] : start[5];
    states[at, 6] = hardens ? solved[i][2 + has_grains] : 0;
    if (n_summed(element) > 0) {
      states[at, 7 : ] = to_row_vector(tail(solved[i], n_kelvin));
    }
  }
  states[n_at_start + 1 : , 3]
    = start[3] + rate * to_vector(after_start)
      - kelvin * (states[n_at_start + 1 : , 2] - start[2])
      - elastic * (states[n_at_start + 1 : , 1] - start[1]);
  if (!compliant) {
    states[n_at_start + 1 : , 4] = start[4] + magnitude(rate) * to_vector(after_start);
  }
  return states;
}

/**
 * States along a stress-driven leg: as strain_driven_leg(), and
 *
 * @param start a row of states, after the jump of the stress, if there is one
 * @param y_0, rate y at the start, and r
 */
matrix stress_driven_leg(row_vector start, data array[] real time, data real y_0, data real rate,
                         vector varying, data array[] int place, data vector fixed,
                         data vector test, data matrix element, data int solver,
                         data real tolerance, data int max_num_steps) {
  int has_grains = test[c_piezometer()] > 0;
  int solves_kelvin = test[c_kelvin_law()] > 0;
  int n_kelvin = rows(element);
  vector[n_kelvin] start_kelvin = kelvin_states(start, element);
  int hardens = test[c_hardening()] > 0;
  int grows = !has_grains && !solves_kelvin && test[c_hardening()] < 2
              && strain_only_grows(start_kelvin, y_0, rate);
  int n_others = (grows ? 1 : 2) + has_grains + hardens;
  real spring = history_rate(h_spring_compliance(), varying, place, fixed);
  real kelvin = history_rate(h_kelvin_compliance(), varying, place, fixed);
  matrix[n_kelvin, 2] elements = history_elements(element, varying, place, fixed);
  real before = start[4] - spring * y_0 - kelvin * start[2]; // g_0 less what the load has stretched
  int n_at_start = first_after(time, 0) - 1;
  int n = size(time) + 1 - n_at_start;
  array[n] real after_start = append_array(time[n_at_start + 1 : ], {1.0});
  vector[n_others + n_kelvin] from
    = append_row(append_row(rep_vector(0, grows ? 1 : 2),
                            to_vector(segment(start, 6 - has_grains, has_grains + hardens))),
                 start_kelvin);
  array[n] vector[n_others + n_kelvin] solved
    = fast_history_leg(1, {grows ? -1 : 1, has_grains ? 2 : -1, hardens ? n_others - 1 : -1},
                       append_array(time[n_at_start + 1 : ], {1.0}), y_0, rate, from,
                       grows ? before : start[4], elements, varying, place, fixed, test, solver,
                       tolerance);
  matrix[size(time) + 1, num_elements(start)] states;
  if (is_nan(solved[1][1])) {
    int n_left = 2 + has_grains + hardens + solves_kelvin;
    vector[n_left] left_from
      = append_row(rep_vector(0, 2), segment(from, grows ? 2 : 3, n_left - 2));
    array[n] vector[n_left] left
      = ode_bdf_tol(stress_driven_rhs, left_from, 0, after_start, tolerance, tolerance,
                    max_num_steps, start[4], start_kelvin, varying, y_0, rate, place, fixed, test,
                    element);
    for (i in 1 : n) {
      vector[n_left] own = left[i];
      solved[i] = append_row(append_row(own[1], tail(head(own, n_left - solves_kelvin),
                                                     n_others - 1)),
                             solves_kelvin
                             ? tail(own, 1)
                             : linear_kelvin_strains(after_start[i], start_kelvin, y_0, rate,
                                                     elements));
    }
  }
  for (i in 1 : n_at_start) {
    states[i] = start;
  }
  for (i in 1 : n) {
    int at = n_at_start + i;
    states[at, 1] = y_0 + rate * after_start[i];
    states[at, 2] = kelvin_sum(tail(solved[i], n_kelvin), elements);
    states[at, 3] = start[3] + solved[i][1];
    if (!grows) {
      states[at, 4] = start[4] + solved[i][2];
    }
    states[at, 5] = has_grains ? solved[i][3] : start[5];
    states[at, 6] = hardens ? solved[i][n_others] : 0;
    if (n_summed(element) > 0) {
      states[at, 7 : ] = to_row_vector(tail(solved[i], n_kelvin));
    }
  }
  if (grows) {
    states[n_at_start + 1 : , 4]
      = before - start[3] + spring * states[n_at_start + 1 : , 1]
        + kelvin * states[n_at_start + 1 : , 2] + states[n_at_start + 1 : , 3];
  }
  return states;
}

/** Strain of the specimen over e, without that of the apparatus, at a row of states. */
real specimen_strain(row_vector state, vector varying, data array[] int place,
                     data vector fixed) {
  return history_rate(h_spring_compliance(), varying, place, fixed) * state[1]
         + history_rate(h_kelvin_compliance(), varying, place, fixed) * state[2] + state[3];
}

/**
 * y at once under a force: y = f exp[-e (s + S/(E_M e) (y - y_before))].
 *
 * @param state a row of states before the force
 * @param force f
 */
real stress_under_force(row_vector state, data real force, vector varying,
                        data array[] int place, data vector fixed, data vector test) {
  real spring = history_rate(h_spring_compliance(), varying, place, fixed);
  real stretched = test[c_strain_scale()] * spring;
  real inelastic = specimen_strain(state, varying, place, fixed) - spring * state[1];
  return lambert_w0(stretched * force * exp(-test[c_strain_scale()] * inelastic)) / stretched;
}

/**
 * Right-hand side of a force-driven leg.
 *
 * @param state [s, g], then u where the grain size follows a piezometer, b where there is a
 *   backstress, and z of each element
 * @param force, rate f at the start, and r
 */
vector force_driven_rhs(real t, vector state, vector varying, data real force, data real rate,
                        data array[] int place, data vector fixed, data vector test,
                        data matrix element) {
  int n_states = num_elements(state);
  int n_kelvin = rows(element);
  real spring = history_rate(h_spring_compliance(), varying, place, fixed);
  real area = exp(-test[c_strain_scale()] * state[1]); // the first one over that of now
  real y = (force + rate * t) * area;
  int place_of_b = n_states - n_kelvin;
  real u = test[c_piezometer()] > 0 ? state[3] : 1;
  real b = test[c_hardening()] > 0 ? state[place_of_b] : 0;
  vector[2] x_rates = history_dashpot_rates(y, b, state[2], u, varying, place, fixed, test);
  matrix[n_kelvin, 2] elements = history_elements(element, varying, place, fixed);
  vector[n_kelvin] z_rates
    = history_kelvin_rates(y, tail(state, n_kelvin), elements, varying, place, fixed, test);
  vector[n_states] slope;
  slope[place_of_b + 1 : n_states] = z_rates;
  slope[1] = (spring * rate * area
              + history_rate(h_kelvin_compliance(), varying, place, fixed)
                * dot_product(elements[ : , 2], z_rates)
              + x_rates[1])
             / (1 + test[c_strain_scale()] * spring * y);
  slope[2] = magnitude(slope[1]);
  if (test[c_piezometer()] > 0) {
    slope[3] = history_grain_growth(y, u, slope[2], varying, place, fixed, test);
  }
  if (test[c_hardening()] > 0) {
    slope[place_of_b] = history_backstress_rate(b, state[2], u, x_rates[2], varying, place, fixed,
                                                test);
  }
  return slope;
}

/**
 * States along a force-driven leg: as strain_driven_leg(), and
 *
 * @param start a row of states, after the jump of the stress, if there is one
 * @param force, rate f at the start, and r
 */
matrix force_driven_leg(row_vector start, data array[] real time, data real force, data real rate,
                        vector varying, data array[] int place, data vector fixed,
                        data vector test, data matrix element, data int solver,
                        data real tolerance, data int max_num_steps) {
  int has_grains = test[c_piezometer()] > 0;
  int n_kelvin = rows(element);
  matrix[n_kelvin, 2] elements = history_elements(element, varying, place, fixed);
  int n_at_start = first_after(time, 0) - 1;
  int n = size(time) + 1 - n_at_start;
  array[n] real after_start = append_array(time[n_at_start + 1 : ], {1.0});
  int hardens = test[c_hardening()] > 0;
  int n_states = n_kelvin + 2 + has_grains + hardens;
  vector[n_states] from = append_row(append_row(specimen_strain(start, varying, place, fixed),
                                                to_vector(segment(start, 4, 1 + has_grains))),
                                     append_row(to_vector(segment(start, 6, hardens)),
                                                kelvin_states(start, element)));
  array[n] vector[n_states] solved
    = fast_history_leg(2, {1, has_grains ? 2 : -1, hardens ? 2 + has_grains : -1},
                       append_array(time[n_at_start + 1 : ], {1.0}), force, rate, from, 0, elements,
                       varying, place, fixed, test, solver, tolerance);
  matrix[size(time) + 1, num_elements(start)] states;
  if (is_nan(solved[1][1])) {
    solved = ode_bdf_tol(force_driven_rhs, from, 0, after_start, tolerance, tolerance,
                         max_num_steps, varying, force, rate, place, fixed, test, element);
  }
  for (i in 1 : n_at_start) {
    states[i] = start;
  }
  for (i in 1 : n) {
    int at = n_at_start + i;
    states[at] = start;
    states[at, 1] = (force + rate * after_start[i]) * exp(-test[c_strain_scale()] * solved[i][1]);
    states[at, 2] = kelvin_sum(tail(solved[i], n_kelvin), elements);
    states[at, 3] = 0;
    states[at, 3] = solved[i][1] - specimen_strain(states[at], varying, place, fixed);
    states[at, 4 : 4 + has_grains]
      = to_row_vector(segment(solved[i], 2, 1 + has_grains));
    states[at, 6] = hardens ? solved[i][3 + has_grains] : 0;
    if (n_summed(element) > 0) {
      states[at, 7 : ] = to_row_vector(tail(solved[i], n_kelvin));
    }
  }
  return states;
}
