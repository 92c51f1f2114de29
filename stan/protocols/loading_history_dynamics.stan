/**
 * Stress and strain along a loading history: legs over which strain or stress is linear in time
 * (loading_history_legs.stan), one after the other. The solver restarts at every leg, and its state
 * is carried over; a jump of the stress at the start of a stress-driven leg jumps the elastic
 * strain, and the path strain by as much.
 */

/** Places in what is known of a leg. */
int l_is_stress_driven() { return 1; } // 1 or 0
int l_duration() { return 2; } // s
int l_start_stress() { return 3; } // Pa; no effect where strain is imposed
int l_rate() { return 4; } // Pa/s or 1/s
int l_temperature() { return 5; } // K

/** What each leg is solved with at given parameters, which are data. */
array[] vector fixed_rates(data vector parameter, data matrix leg, data real initial_grain_size,
                           data real stress_scale, data real strain_scale) {
  array[rows(leg)] vector[n_history_rates()] fixed;
  for (k in 1 : rows(leg)) {
    fixed[k] = history_rates(parameter, parameter, leg[k, l_duration()],
                             leg[k, l_temperature()], initial_grain_size, stress_scale,
                             strain_scale);
  }
  return fixed;
}

/**
 * Stress, strains and microstructure along a test that starts at rest.
 *
 * @param parameter in the order of physics/parameters.stan
 * @param constant parameters that are never inferred, at their places in the same order, and those
 *   that no test infers; the others in it have no effect
 * @param varying places of what varies (varying_rates())
 * @param leg a row for each leg, see the places above
 * @param fixed what each leg is solved with at `constant` (fixed_rates())
 * @param test constants of the test (history_constants())
 * @param element elements of the Kelvin part (history_elements())
 * @param time of each output since the start of its leg over its duration, from 0 to 1
 * @param n_in_leg number of outputs in each leg, one leg after the other
 * @param initial_grain_size d_0, m
 * @return array over outputs of [stress as read (Pa), strain (that of the apparatus included), Kelvin
 *   strain, path strain of the specimen, dashpot strain, d/d_0 (1 where it follows no piezometer),
 *   rate of the Kelvin strain (1/s)]
 */
array[] vector history_solution(vector parameter, data vector constant,
                                data array[] int varying, data matrix leg,
                                data array[] vector fixed, data vector test,
                                data matrix element, data array[] real time, data array[] int n_in_leg,
                                data real initial_grain_size, data real tolerance,
                                data int max_num_steps) {
  array[n_history_rates()] int place = place_among(varying);
  real stress_scale = test[c_stress_scale()];
  real strain_scale = test[c_strain_scale()];
  array[size(time)] vector[7] solution;
  int n_states = 5 + n_summed(element);
  vector[n_states] state = append_row([0, 0, 0, 0, 1]', rep_vector(0, n_summed(element)));
  int before = 0;
  for (k in 1 : rows(leg)) {
    int n = n_in_leg[k];
    vector[n_history_rates()] every
      = history_rates(parameter, constant, leg[k, l_duration()], leg[k, l_temperature()],
                      initial_grain_size, test[c_stress_scale()], test[c_strain_scale()]);
    real kelvin = every[h_kelvin_compliance()];
    real elastic = every[h_spring_compliance()] + every[h_apparatus_compliance()];
    matrix[rows(element), 2] elements = history_elements(element, every[varying], place, fixed[k]);
    array[n + 1] vector[n_states] states;
    if (leg[k, l_is_stress_driven()] > 0) {
      real y_0 = leg[k, l_start_stress()] / stress_scale;
      real jump = every[h_spring_compliance()] * magnitude(y_0 - state[1]);
      if (test[c_piezometer()] > 0) {
        state[5] = microstructure_at(jump, state[5],
                                     piezometer_grain_size(leg[k, l_start_stress()],
                                                           test[c_piezometer()],
                                                           test[c_piezometer_exponent()],
                                                           test[c_piezometer_stress_floor()]),
                                     1 / every[h_grain_size_decay()]);
      }
      state[1] = y_0;
      state[4] += jump;
      states = stress_driven_leg(state, k == 1, time[before + 1 : before + n],
                                 leg[k, l_start_stress()] / test[c_stress_scale()],
                                 leg[k, l_rate()] * leg[k, l_duration()]
                                 / test[c_stress_scale()],
                                 every[varying], place, fixed[k], test, element, tolerance,
                                 max_num_steps);
    } else {
      states = strain_driven_leg(state, k == 1, time[before + 1 : before + n],
                                 leg[k, l_rate()] * leg[k, l_duration()]
                                 / test[c_strain_scale()],
                                 every[varying], place, fixed[k], test, element, tolerance,
                                 max_num_steps);
    }
    for (i in 1 : n) {
      solution[before + i]
        = [stress_scale * states[i][1],
           strain_scale
           * (elastic * states[i][1] + kelvin * states[i][2] + states[i][3]),
           strain_scale * kelvin * states[i][2], strain_scale * states[i][4],
           strain_scale * states[i][3], states[i][5],
           strain_scale / leg[k, l_duration()] * kelvin
           * dot_product(elements[ : , 2],
                         history_kelvin_rates(states[i][1], kelvin_states(states[i], element),
                                              elements, every[varying], place, fixed[k],
                                              test))]';
    }
    state = states[n + 1];
    before += n;
  }
  return solution;
}

/**
 * Strain rate (1/s), that of the apparatus included.
 *
 * @param state of a solution, see history_solution()
 * @param leg that it lies in
 * @param grain_size m
 */
real history_strain_rate(vector state, data row_vector leg, vector parameter, real grain_size,
                         real fabric_factor) {
  real factor = stress_reading_factor(parameter);
  if (leg[l_is_stress_driven()] == 0) {
    return leg[l_rate()];
  }
  return leg[l_rate()]
         * (1 / (factor * parameter[i_maxwell_modulus()]) + parameter[i_apparatus_compliance()])
         + state[7]
         + dashpot_strain_rate(power_law_stress(state[1] / factor, parameter[i_breakdown_stress()],
                                                fabric_factor),
                               grain_size, fabric_factor, parameter[i_stress_exponent()],
                               parameter[i_grain_size_exponent()],
                               log_rate_factor(parameter[i_activation_enthalpy()],
                                               parameter[i_beta()],
                                               true_temperature(parameter,
                                                                leg[l_temperature()])));
}

/**
 * Readings of a solution: stress (Pa), or strain with the offset of its zero.
 *
 * @param solution at the readings, see history_solution()
 * @param is_strain of each reading: 1 or 0
 */
vector history_readings(array[] vector solution, data array[] int is_strain, vector parameter) {
  vector[size(solution)] readings;
  for (i in 1 : size(solution)) {
    readings[i] = is_strain[i] ? solution[i][2] + parameter[i_strain_offset()] : solution[i][1];
  }
  return readings;
}

/** Standard deviation of the residual of each reading, Pa or 1. */
vector reading_noise(data array[] int is_strain, vector parameter) {
  vector[size(is_strain)] noise;
  for (i in 1 : size(is_strain)) {
    noise[i] = parameter[is_strain[i] ? i_strain_noise() : i_stress_noise()];
  }
  return noise;
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
