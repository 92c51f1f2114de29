/**
 * The paper's own form: six states in SI with time as the independent variable.
 */

/**
 * Rates of [stress (Pa), kelvin strain, elastic strain, dashpot strain, grain size (m), fabric
 * factor] at imposed strain rate (Maor et al., Eqs. 1-4).
 *
 * @param time s
 */
vector six_state_rhs(real time, vector state, data real strain_rate, data real temperature,
                     real maxwell_modulus, real kelvin_modulus, real kelvin_viscosity,
                     real stress_exponent, real grain_size_exponent, real activation_enthalpy,
                     real beta, real steady_state_grain_size, real steady_state_fabric_factor,
                     real critical_strain_grain_size, real critical_strain_fabric) {
  real kelvin_rate = (state[1] - kelvin_modulus * state[2]) / kelvin_viscosity;
  real dashpot_rate = dashpot_strain_rate(state[1], state[5], state[6], stress_exponent,
                                          grain_size_exponent,
                                          log_rate_factor(activation_enthalpy, beta,
                                                          temperature));
  real elastic_rate = strain_rate - kelvin_rate - dashpot_rate;
  vector[6] rate;
  rate[1] = maxwell_modulus * elastic_rate;
  rate[2] = kelvin_rate;
  rate[3] = elastic_rate;
  rate[4] = dashpot_rate;
  rate[5] = microstructure_rate(state[5], steady_state_grain_size, critical_strain_grain_size,
                                strain_rate);
  rate[6] = microstructure_rate(state[6], steady_state_fabric_factor, critical_strain_fabric,
                                strain_rate);
  return rate;
}
