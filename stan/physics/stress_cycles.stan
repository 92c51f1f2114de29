/**
 * What the dashpot adds to the compliance under stress cycles sigma_m + sigma_0 sin(omega t).
 *
 * Its loss compliance is B/omega with the fluidity
 *
 *   B = 1/(pi sigma_0) * integral over 0..2 pi of rate(sigma_m + sigma_0 sin x) sin(x) dx,
 *
 * which depends on the stresses, not on the frequency. Rates are those of a frozen microstructure:
 * B is the product of the rate factor, d^-p, and a number of the stresses and the stress exponent,
 * whose logarithm these functions return. Needs physics/parameters.stan,
 * physics/flow_law.stan, physics/environment.stan, physics/composite_law.stan and
 * physics/dashpot_mechanisms.stan.
 */

/**
 * ln of B over rate factor and d^-p without a median stress (F = 1): sigma_0^(n-1) times
 * 2/sqrt(pi) Gamma(n/2 + 1)/Gamma(n/2 + 3/2).
 */
real log_fluidity_about_zero(real stress_exponent, real amplitude) {
  return (stress_exponent - 1) * log(amplitude) + log(2) - 0.5 * log(pi())
         + lgamma(0.5 * stress_exponent + 1) - lgamma(0.5 * stress_exponent + 1.5);
}

/**
 * The same about any median stress, for power law and hyperbolic sine (F = 1).
 *
 * @param breakdown_stress sigma_L, Pa; 0: power law
 * @param sine, weight nodes and weights of the integral over half a period, from lowest to
 *   highest stress, times 2/pi
 */
real log_fluidity_about(real median_stress, real amplitude, real stress_exponent,
                        real breakdown_stress, data vector sine, data vector weight) {
  real log_peak = log(power_law_stress(median_stress + amplitude, breakdown_stress, 1,
                                       stress_exponent));
  real total = 0;
  for (j in 1 : num_elements(sine)) {
    total += weight[j] * sine[j]
             * signed_power(power_law_stress(median_stress + amplitude * sine[j],
                                             breakdown_stress, 1, stress_exponent),
                            log_peak, stress_exponent, 0);
  }
  return stress_exponent * log_peak + log(total) - log(amplitude);
}

/**
 * The same for any stresses.
 *
 * @param amplitude sigma_0, Pa; 0: so small that it was not said, which a linear dashpot
 *   (n = 1) has no use for
 */
real log_fluidity_of_stress(real median_stress, real amplitude, real stress_exponent,
                            real breakdown_stress, data vector sine, data vector weight) {
  if (amplitude == 0) {
    return 0;
  }
  if (median_stress == 0 && breakdown_stress == 0) {
    return log_fluidity_about_zero(stress_exponent, amplitude);
  }
  return log_fluidity_about(median_stress, amplitude, stress_exponent, breakdown_stress, sine,
                            weight);
}

/**
 * ln of B of a dashpot with further mechanisms side by side. Rates under a given stress add,
 * whatever their stress exponents.
 *
 * @param log_first ln of B of the first mechanism
 * @param grain_size m
 * @param temperature true one, K
 * @param sine, weight see log_fluidity_about()
 */
real log_fluidity_of_all(real log_first, real median_stress, real amplitude, real grain_size,
                         vector parameter, real temperature, data vector sine,
                         data vector weight) {
  real log_total = log_first;
  for (k in 1 : n_further_mechanisms(mechanisms_act(parameter))) {
    log_total = log_sum_exp(log_total,
                            log_fluidity_of_stress(median_stress, amplitude,
                                                   parameter[mechanism_numbers(k)[2]], 0,
                                                   sine, weight)
                            + log_further_rate(k, 1, grain_size, parameter, temperature));
  }
  return log_total;
}
