/**
 * ln(S_0/Pa) at given parameters: log_reference_stress() of physics/flow_law.stan.
 *
 * @param parameter in the order of physics/parameters.stan
 * @param temperature stated, K
 */
real log_reference_stress_at(vector parameter, data real strain_rate,
                             data real initial_grain_size, data real temperature) {
  return log_reference_stress(strain_rate, initial_grain_size,
                              true_temperature(parameter, temperature),
                              parameter[i_stress_exponent()],
                              parameter[i_grain_size_exponent()],
                              parameter[i_activation_enthalpy()], parameter[i_beta()]);
}
