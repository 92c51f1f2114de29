/**
 * Backstress of the dashpot, which flows by the stress less the backstress:
 *
 *   d sigma_b/dt = H (v - |v| sigma_b/sigma_max) - r sgn(sigma_b) sigma_max |sigma_b/sigma_max|^m,
 *
 * v the rate of the dashpot. Flow stores backstress with the modulus H and recovers it (dynamic
 * recovery, up to the limit sigma_max); r is the rate of static recovery at that limit. Without
 * recovery a linear dashpot with a backstress is a Kelvin element of the modulus H. Needs
 * physics/parameters.stan, physics/flow_law.stan and physics/environment.stan.
 */

/** Whether the dashpot has a backstress. */
int has_backstress(vector parameter) { return parameter[i_hardening_modulus()] != 0; }

/** Whether the dashpot has a backstress in some test. */
int any_backstress(array[] vector parameter) {
  for (own in parameter) {
    if (has_backstress(own)) {
      return 1;
    }
  }
  return 0;
}

/**
 * Rate of the backstress, in any units that belong together.
 *
 * @param flow_rate v
 * @param modulus, limit, recovery, exponent H, sigma_max, r and m
 */
real backstress_rate(real backstress, real flow_rate, real modulus, real limit, real recovery,
                     real exponent) {
  return modulus * (flow_rate - fmax(flow_rate, -flow_rate) * backstress / limit)
         - limit * recovery * signed_power(backstress, log(limit), exponent, 0);
}

/**
 * Complex compliance of a linear dashpot whose backstress recovers in proportion to itself, under
 * small cycles about zero stress. Dynamic recovery is of second order there.
 *
 * @param frequency omega, rad/s
 * @param fluidity strain rate over stress, 1/(Pa s)
 * @param modulus, recovery H (Pa) and r (1/s); H = 0: fluidity/omega is the loss
 * @return [J1, J2], 1/Pa
 */
row_vector backstress_compliance(data real frequency, real fluidity, real modulus, real recovery) {
  real decay = recovery + fluidity * modulus;
  return fluidity / (square(frequency) + square(decay))
         * [fluidity * modulus, (square(frequency) + recovery * decay) / frequency];
}

/** Rate of static recovery, r exp[-(Q_r/R)(1/T - 1/T_0)] and the factor of its environment. */
real recovery_rate_at(vector parameter, real temperature, real reference_temperature) {
  return parameter[i_recovery_rate()]
         * exp(log_environment(parameter, temperature, environment_numbers(5))
               - parameter[i_recovery_activation_enthalpy()] / gas_constant()
                 * (1 / temperature - 1 / reference_temperature));
}
