/**
 * Stress and strain along a loading history: legs over which strain or stress is linear in time
 * (loading_history_legs.stan), one after the other. The solver restarts at every leg, and its state
 * is carried over; a jump of the stress at the start of a stress-driven leg jumps the elastic
 * strain, and the path strain by as much.
 */

/** Places in what is known of a leg. */
int l_driven() { return 1; } // by strain 0, by stress 1, by a force over the first area 2
int l_duration() { return 2; } // s
int l_start_stress() { return 3; } // or force, Pa; no effect where strain is imposed
int l_rate() { return 4; } // Pa/s or 1/s
int l_temperature() { return 5; } // K

/** What each leg is solved with at given parameters, which are data. */
array[] vector fixed_rates(data vector parameter, data matrix leg, data real initial_grain_size,
                           data vector test) {
  array[rows(leg)] vector[n_history_rates()] fixed;
  for (k in 1 : rows(leg)) {
    fixed[k] = history_rates(parameter, parameter, leg[k, l_duration()],
                             leg[k, l_temperature()], initial_grain_size, test);
  }
  return fixed;
}

/**
 * States along a test that starts at rest, with the backstress of its dislocations.
 *
 * @param parameter in the order of physics/parameters.stan
 * @param constant parameters that are never inferred, at their places in the same order, and those
 *   that no test infers; the others in it have no effect
 * @param varying places of what varies (varying_rates())
 * @param fixed what each leg is solved with at `constant` (fixed_rates())
 * @param test constants of the test (history_constants())
 * @param element elements of the Kelvin part (history_elements())
 * @param time of each output since the start of its leg over its duration, from 0 to 1
 * @param n_in_leg number of outputs in each leg, one leg after the other
 * @param initial_grain_size d_0, m
 * @param solver 0: ode_bdf_tol; 1: radau_leg() (solvers/radau_leg.stan), and ode_bdf_tol where that
 *   does not converge
 * @return a row of states for each output (loading_history_legs.stan)
 */
matrix history_states(vector parameter, data vector constant, data array[] int varying,
                      data matrix leg, data array[] vector fixed, data vector test,
                      data matrix element, data array[] real time, data array[] int n_in_leg,
                      data real initial_grain_size, data int solver,
                      data real tolerance, data int max_num_steps) {
  array[n_history_rates()] int place = place_among(varying);
  int n_states = 6 + n_summed(element);
  matrix[size(time), n_states] solution;
  real initial_backstress = parameter[i_initial_backstress()] * stress_reading_factor(parameter)
                            / test[c_stress_scale()];
  row_vector[n_states] state = append_col([0, 0, 0, 0, 1, initial_backstress],
                                          rep_row_vector(0, n_summed(element)));
  int before = 0;
  for (k in 1 : rows(leg)) {
    int n = n_in_leg[k];
    vector[n_history_rates()] every
      = history_rates(parameter, constant, leg[k, l_duration()], leg[k, l_temperature()],
                      initial_grain_size, test);
    matrix[n + 1, n_states] states;
    if (leg[k, l_driven()] > 0) {
      real y_0 = leg[k, l_driven()] == 2
                 ? stress_under_force(state, leg[k, l_start_stress()] / test[c_stress_scale()],
                                      every[varying], place, fixed[k], test)
                 : leg[k, l_start_stress()] / test[c_stress_scale()];
      real jump = every[h_spring_compliance()] * magnitude(y_0 - state[1]);
      if (test[c_piezometer()] > 0) {
        state[5] = microstructure_at(jump, state[5],
                                     piezometer_grain_size(every[h_stress_scale()] * y_0,
                                                           test[c_piezometer()],
                                                           test[c_piezometer_exponent()],
                                                           test[c_piezometer_stress_floor()]),
                                     1 / every[h_grain_size_decay()]);
      }
      state[1] = y_0;
      state[4] += jump;
      if (leg[k, l_driven()] == 2) {
        states = force_driven_leg(state, time[before + 1 : before + n],
                                  leg[k, l_start_stress()] / test[c_stress_scale()],
                                  leg[k, l_rate()] * leg[k, l_duration()] / test[c_stress_scale()],
                                  every[varying], place, fixed[k], test, element, solver, tolerance,
                                  max_num_steps);
      } else {
        states = stress_driven_leg(state, time[before + 1 : before + n],
                                   leg[k, l_start_stress()] / test[c_stress_scale()],
                                   leg[k, l_rate()] * leg[k, l_duration()]
                                   / test[c_stress_scale()],
                                   every[varying], place, fixed[k], test, element, solver, tolerance,
                                   max_num_steps);
      }
    } else {
      states = strain_driven_leg(state, time[before + 1 : before + n],
                                 leg[k, l_rate()] * leg[k, l_duration()]
                                 / test[c_strain_scale()],
                                 every[varying], place, fixed[k], test, element, solver, tolerance,
                                 max_num_steps);
    }
    for (i in 1 : n) {
      solution[before + i] = states[i];
    }
    state = states[n + 1];
    before += n;
  }
  return solution;
}

/**
 * Stress (Pa) as it is read, and strain, that of the apparatus included, as columns.
 *
 * @param states of history_states()
 */
matrix history_response(matrix states, vector parameter, data vector test) {
  vector[3] compliance = history_compliances(parameter, test);
  return append_col(test[c_stress_scale()] * states[ : , 1],
                    test[c_strain_scale()]
                    * (compliance[1] * states[ : , 2]
                       + (compliance[2] + compliance[3]) * states[ : , 1] + states[ : , 3]));
}

/**
 * Stress, strains and microstructure along a test.
 *
 * @param states of history_states()
 * @return columns: stress as read (Pa), strain (that of the apparatus included), Kelvin strain, path
 *   strain of the specimen, dashpot strain, d/d_0 (1 where it follows no piezometer), rate of the
 *   Kelvin strain (1/s), backstress (Pa)
 */
matrix history_solution(matrix states, vector parameter, data vector constant,
                        data array[] int varying, data matrix leg, data array[] vector fixed,
                        data vector test, data matrix element, data array[] int n_in_leg,
                        data real initial_grain_size) {
  array[n_history_rates()] int place = place_among(varying);
  real strain_scale = test[c_strain_scale()];
  real kelvin = history_compliances(parameter, test)[1];
  matrix[rows(states), 8] solution;
  int before = 0;
  solution[ : , 1 : 2] = history_response(states, parameter, test);
  solution[ : , 3] = strain_scale * kelvin * states[ : , 2];
  solution[ : , 4] = strain_scale * states[ : , 4];
  solution[ : , 5] = strain_scale * states[ : , 3];
  solution[ : , 6] = states[ : , 5];
  solution[ : , 8] = test[c_stress_scale()] / stress_reading_factor(parameter) * states[ : , 6];
  for (k in 1 : rows(leg)) {
    vector[size(varying)] rates
      = history_rates(parameter, constant, leg[k, l_duration()], leg[k, l_temperature()],
                      initial_grain_size, test)[varying];
    matrix[rows(element), 2] elements = history_elements(element, rates, place, fixed[k]);
    for (i in before + 1 : before + n_in_leg[k]) {
      solution[i, 7]
        = strain_scale / leg[k, l_duration()] * kelvin
          * dot_product(elements[ : , 2],
                        history_kelvin_rates(states[i, 1], kelvin_states(states[i], element),
                                             elements, rates, place, fixed[k], test));
    }
    before += n_in_leg[k];
  }
  return solution;
}

/**
 * Grain size (m) and fabric factor, as columns.
 *
 * @param path_strain of the specimen
 * @param relative_grain_size d/d_0 where it follows a piezometer; elsewhere it has no effect
 */
matrix history_microstructure(vector path_strain, vector relative_grain_size, vector parameter,
                              data vector test, data real initial_grain_size) {
  matrix[size(path_strain), 2] microstructure;
  for (i in 1 : size(path_strain)) {
    microstructure[i, 1]
      = initial_grain_size
        * (test[c_piezometer()] > 0
           ? relative_grain_size[i]
           : microstructure_at(path_strain[i], 1,
                               parameter[i_steady_state_grain_size()] / initial_grain_size,
                               parameter[i_critical_strain_grain_size()]));
    microstructure[i, 2] = microstructure_at(path_strain[i], 1,
                                             parameter[i_steady_state_fabric_factor()],
                                             parameter[i_critical_strain_fabric()]);
  }
  return microstructure;
}

/**
 * Grain size (m) and fabric factor of sections, as columns.
 *
 * @param states of history_states()
 * @param output of each section, its row of states; 0: its path strain is given
 * @param path_strain of sections without a row; of the others it has no effect
 */
matrix section_microstructure(matrix states, data array[] int output, data vector path_strain,
                              vector parameter, data vector test,
                              data real initial_grain_size) {
  vector[size(output)] path = path_strain;
  vector[size(output)] relative_grain_size = rep_vector(1, size(output));
  for (i in 1 : size(output)) {
    if (output[i] > 0) {
      path[i] = test[c_strain_scale()] * states[output[i], 4];
      relative_grain_size[i] = states[output[i], 5];
    }
  }
  return history_microstructure(path, relative_grain_size, parameter, test, initial_grain_size);
}

/**
 * Strain rate (1/s), that of the apparatus included.
 *
 * @param state a row of history_solution()
 * @param leg that it lies in
 * @param grain_size m
 */
real history_strain_rate(row_vector state, data row_vector leg, vector parameter, real grain_size,
                         real fabric_factor) {
  if (leg[l_driven()] == 0) {
    return leg[l_rate()];
  }
  real factor = stress_reading_factor(parameter);
  real elastic = 1 / (factor * parameter[i_maxwell_modulus()]);
  real stress_rate = leg[l_rate()];
  real inelastic = state[7]
                   + dashpot_rate_at(state[1] / factor, state[8], grain_size, fabric_factor, parameter,
                                     true_temperature(parameter, leg[l_temperature()]));
  if (leg[l_driven()] == 2) {
    // The area changes with the strain of the specimen.
    stress_rate = (leg[l_rate()] * exp(-state[3] - state[5] - elastic * state[1])
                   - state[1] * inelastic)
                  / (1 + elastic * state[1]);
  }
  return stress_rate * (elastic + parameter[i_apparatus_compliance()]) + inelastic;
}

/**
 * Readings: stress (Pa), or strain with the offset of its zero.
 *
 * @param is_strain of each reading: 1 or 0
 */
vector history_readings(matrix response, data array[] int is_strain, vector parameter) {
  vector[rows(response)] readings;
  for (i in 1 : rows(response)) {
    readings[i] = is_strain[i] ? response[i, 2] + parameter[i_strain_offset()] : response[i, 1];
  }
  return readings;
}

/** Standard deviation of the residual of each reading, Pa or 1. */
vector reading_noise(data array[] int is_strain, vector parameter) {
  vector[size(is_strain)] noise;
  for (i in 1 : size(is_strain)) {
    noise[i] = parameter[is_strain[i] ? i_strain_noise() : i_stress_noise()];
  }
  return noise * residual_over_noise(parameter);
}

/** Whether a parameter has a coordinate in any test: one of a test's own, or a pooled one. */
array[] int free_in_any_test(data array[] int own_parameter, data array[] int pooled_parameter) {
  array[n_parameters()] int is_free = rep_array(0, n_parameters());
  for (k in 1 : size(own_parameter)) {
    is_free[own_parameter[k]] = 1;
  }
  for (k in 1 : size(pooled_parameter)) {
    is_free[pooled_parameter[k]] = 1;
  }
  return is_free;
}
