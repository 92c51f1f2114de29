/**
 * The paper's own form for an oscillating test: states in SI, time as the independent variable.
 */

/**
 * Rates of [stress (Pa), kelvin strain, elastic strain, dashpot strain, grain size (m)] at an
 * imposed oscillating strain rate (Maor et al., Eqs. 1, 2 and 5; F = 1).
 *
 * @param time since origin, s: at the default tolerance CVODES starts with steps so short that a
 *   clock far from zero does not see them
 * @param origin on the record's clock, s
 * @param period s
 * @param sine, cosine, background amplitudes: `harmonics` of oscillating_rate()
 * @param piezometer d_1 (m), exponent and stress floor (Pa)
 */
vector six_state_oscillation_rhs(real time, vector state, data real origin, data real period,
                                 data vector sine, data vector cosine, data vector background,
                                 data vector background_range, data real first_tau,
                                 data real temperature, data vector piezometer,
                                 real maxwell_modulus, real kelvin_modulus,
                                 real kelvin_viscosity, real stress_exponent,
                                 real grain_size_exponent, real activation_enthalpy,
                                 real beta, real critical_strain_grain_size) {
  real strain_rate = oscillating_rate((origin + time) / period,
                                      append_row(append_row(sine, cosine), background)',
                                      num_elements(sine), background_range, first_tau)
                     / period;
  real kelvin_rate = (state[1] - kelvin_modulus * state[2]) / kelvin_viscosity;
  real dashpot_rate = dashpot_strain_rate(state[1], state[5], 1, stress_exponent,
                                          grain_size_exponent,
                                          log_rate_factor(activation_enthalpy, beta,
                                                          temperature));
  real elastic_rate = strain_rate - kelvin_rate - dashpot_rate;
  vector[5] rate;
  rate[1] = maxwell_modulus * elastic_rate;
  rate[2] = kelvin_rate;
  rate[3] = elastic_rate;
  rate[4] = dashpot_rate;
  // Ahead of the record grains keep their size.
  rate[5] = origin + time < first_tau * period
            ? 0
            : microstructure_rate(state[5], piezometer_grain_size(state[1], piezometer[1],
                                                        piezometer[2], piezometer[3]),
                                  critical_strain_grain_size, strain_rate);
  return rate;
}
