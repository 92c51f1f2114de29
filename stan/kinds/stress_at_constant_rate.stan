/**
 * Stress along a test from rest at one strain rate: a loading history of one leg, at parameters that
 * nothing is inferred of.
 */

/** As stress_at_constant_rate(), of a leg and constants of a test; time is counted over the leg. */
vector stress_along_leg(vector parameter, data vector constant, data array[] real time,
                        data matrix leg, data vector test, data real initial_grain_size,
                        data real tolerance, data int max_num_steps) {
  return test[c_stress_scale()]
         * history_states(parameter, constant,
                          linspaced_int_array(n_history_rates(), 1, n_history_rates()), leg,
                          fixed_rates(constant, leg, initial_grain_size, test), test,
                          [[is_only_element(), 0, 1]], time, {size(time)}, initial_grain_size, 0,
                          tolerance, max_num_steps)[ : , 1];
}

/**
 * Stress at strains, Pa.
 *
 * @param parameter, constant see history_states()
 * @param strain increasing and positive
 * @param strain_rate 1/s
 * @param stress_scale that the stress is in proportion to, Pa
 * @param initial_grain_size m
 * @param temperature stated, K
 * @param kelvin_law of kelvin_law_at()
 */
vector stress_at_constant_rate(vector parameter, data vector constant, data array[] real strain,
                               data real strain_rate, data real stress_scale,
                               data real initial_grain_size, data real temperature,
                               data int kelvin_law, data real tolerance,
                               data int max_num_steps) {
  return stress_along_leg(parameter, constant,
                          to_array_1d(to_vector(strain) / strain[size(strain)]),
                          [[0, strain[size(strain)] / strain_rate, 0, strain_rate, temperature]],
                          history_constants(constant, initial_grain_size, stress_scale,
                                            strain[size(strain)], kelvin_law),
                          initial_grain_size, tolerance, max_num_steps);
}
