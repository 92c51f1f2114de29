/**
 * Flow law of the dashpot, a power law (Maor et al., Eq. 1) or the hyperbolic sine that it is the
 * beginning of, and the reference stress of the power law.
 *
 * Everything is SI: stress Pa, grain size m, temperature K, strain rate 1/s,
 * activation enthalpy Q_M J/mol, beta = ln(A)/Q_M mol/J with A in Pa^-n m^p s^-1.
 */

/** Gas constant R, J/(mol K) (CODATA 2018). */
real gas_constant() { return 8.314462618; }

/**
 * ln of the thermally activated rate factor, Q_M (beta - 1/(R T)).
 *
 * @param activation_enthalpy Q_M, J/mol
 * @param beta ln(A)/Q_M, mol/J
 * @param temperature T, K
 * @return ln of A exp(-Q_M/(R T)), A in Pa^-n m^p s^-1
 */
real log_rate_factor(real activation_enthalpy, real beta, real temperature) {
  return activation_enthalpy * (beta - 1 / (gas_constant() * temperature));
}

/**
 * Power law that is odd in its argument, sgn(x) |x/unit|^exponent exp(log_factor).
 *
 * The sign function and the absolute value are not printed in Eq. 1; they keep the law odd in
 * stress where an oscillating test changes sign.
 */
real signed_power(real x, real log_unit, real exponent, real log_factor) {
  if (x > 0) {
    return exp(exponent * (log(x) - log_unit) + log_factor);
  }
  if (x < 0) {
    return -exp(exponent * (log(-x) - log_unit) + log_factor);
  }
  return 0;
}

/**
 * Stress over F sigma_L above which the rate of the hyperbolic sine grows no more: its n-th power is
 * e^650 there, which leaves room for the rate factor.
 */
real largest_sine_argument(real stress_exponent) { return 650 / fmax(stress_exponent, 1); }

/**
 * Stress at which a power law creeps as fast as the hyperbolic sine does at a stress:
 * F sigma_L sinh[stress/(F sigma_L)], all in one unit.
 *
 * In place of the stress in dashpot_strain_rate() it gives [sigma_L sinh(|stress|/(F sigma_L))]^n
 * (Garofalo's law; n = 1: Eq. 2). Of stresses beyond reason it is that of largest_sine_argument(),
 * so that a trial step of the solver does not overflow.
 *
 * @param breakdown_stress sigma_L; 0: power-law creep has no end, and the stress is returned
 * @param fabric_factor F
 * @param stress_exponent n
 */
real power_law_stress(real stress, real breakdown_stress, real fabric_factor,
                      real stress_exponent) {
  if (breakdown_stress == 0) {
    return stress;
  }
  {
    real largest = largest_sine_argument(stress_exponent);
    return fabric_factor * breakdown_stress
           * sinh(fmax(fmin(stress / (fabric_factor * breakdown_stress), largest), -largest));
  }
}

/**
 * Strain rate of the dashpot, sgn(stress) (|stress|/F)^n d^-p exp[Q_M (beta - 1/(R T))].
 *
 * @param stress sigma, Pa
 * @param grain_size d, m
 * @param fabric_factor F, 1 = isotropic
 * @param stress_exponent n
 * @param grain_size_exponent p
 * @param log_factor value of log_rate_factor()
 * @return strain rate, 1/s
 */
real dashpot_strain_rate(real stress, real grain_size, real fabric_factor, real stress_exponent,
                         real grain_size_exponent, real log_factor) {
  return signed_power(stress / fabric_factor, 0, stress_exponent,
                      log_factor - grain_size_exponent * log(grain_size));
}

/**
 * ln of the reference stress S_0 at which undeformed material (F = 1, d = d_0) flows at the
 * imposed rate: S_0^n = strain_rate d_0^p exp[-Q_M (beta - 1/(R T))].
 *
 * @return ln(S_0 / Pa)
 */
real log_reference_stress(real strain_rate, real initial_grain_size, real temperature,
                          real stress_exponent, real grain_size_exponent,
                          real activation_enthalpy, real beta) {
  return (log(strain_rate) + grain_size_exponent * log(initial_grain_size)
          - log_rate_factor(activation_enthalpy, beta, temperature))
         / stress_exponent;
}

/**
 * ln of the rate at which undeformed material (F = 1, d = d_0) flows at a given stress.
 *
 * @return ln(strain rate s)
 */
real log_flow_rate(real stress, real initial_grain_size, real temperature, real stress_exponent,
                   real grain_size_exponent, real activation_enthalpy, real beta) {
  return stress_exponent * log(stress) - grain_size_exponent * log(initial_grain_size)
         + log_rate_factor(activation_enthalpy, beta, temperature);
}

/**
 * Q_M for which undeformed material flows at a given rate under a given stress.
 *
 * |d Q_M / d log_rate| = 1 / (1/(R T) - beta), |d Q_M / d log_stress| = n times that.
 *
 * @param log_rate ln(strain rate s)
 * @param log_stress ln(stress / Pa)
 */
real activation_enthalpy_from_flow(real log_rate, real log_stress, real initial_grain_size,
                                   real temperature, real stress_exponent,
                                   real grain_size_exponent, real beta) {
  return (log_rate + grain_size_exponent * log(initial_grain_size)
          - stress_exponent * log_stress)
         / (beta - 1 / (gas_constant() * temperature));
}

/**
 * beta for which undeformed material flows at a given rate under a given stress.
 *
 * |d beta / d log_rate| = 1 / Q_M, |d beta / d log_stress| = n times that.
 */
real beta_from_flow(real log_rate, real log_stress, real initial_grain_size, real temperature,
                    real stress_exponent, real grain_size_exponent, real activation_enthalpy) {
  return (log_rate + grain_size_exponent * log(initial_grain_size)
          - stress_exponent * log_stress)
         / activation_enthalpy
         + 1 / (gas_constant() * temperature);
}
