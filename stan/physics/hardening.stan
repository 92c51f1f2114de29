/**
 * Backstress of the dashpot, which flows by the stress less the backstress:
 *
 *   d sigma_b/dt = H (v - |v| sigma_b/sigma_max) - r sgn(sigma_b) sigma_max |sigma_b/sigma_max|^m,
 *
 * v the rate of the dashpot. Flow stores backstress with the modulus H and recovers it (dynamic
 * recovery, up to the limit sigma_max); r is the rate of static recovery at that limit. Without
 * recovery a linear dashpot with a backstress is a Kelvin element of the modulus H.
 *
 * The backstress of dislocations (Breithaupt et al. 2023) is above 0 from the start. It goes with the
 * root of their density, to which the rate of flow is proportional, and their sources take a stress
 * sigma_d that goes with 1/d:
 *
 *   v = (sigma_b/sigma_0)^2 times the flow law at sigma - sigma_b - sigma_d,
 *   d sigma_b/dt = H [v (1 + sigma_d/sigma_b) - |v| sigma_b/sigma_max]
 *                  - r [sigma_0 (sigma_b/sigma_0)^m + c_r sigma_d (sigma_b/sigma_0)^3].
 *
 * r is the rate of recovery along pipes at sigma_0 there, where grain boundaries recover
 * c_r sigma_d/sigma_0 as much. Needs physics/parameters.stan, physics/flow_law.stan and
 * physics/environment.stan.
 */

/** Whether the dashpot has a backstress. */
int has_backstress(vector parameter) { return parameter[i_hardening_modulus()] != 0; }

/** Law of the hardening: 0 none, 1 a backstress, 2 that of dislocations. */
int hardening_law(vector parameter) {
  return has_backstress(parameter) ? 1 + (parameter[i_reference_backstress()] > 0) : 0;
}

/** The largest of hardening_law() over tests. */
int any_hardening(array[] vector parameter) {
  int law = 0;
  for (own in parameter) {
    law = max(law, hardening_law(own));
  }
  return law;
}

/**
 * Rate of a backstress, in any units that belong together.
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
 * Rate of the backstress of dislocations, as backstress_rate(), and
 *
 * @param reference, source, boundary sigma_0, sigma_d at the grain size of now, and c_r
 */
real dislocation_backstress_rate(real backstress, real flow_rate, real modulus, real limit,
                                 real recovery, real exponent, real reference, real source,
                                 real boundary) {
  return modulus
         * (flow_rate * (1 + source / backstress) - fmax(flow_rate, -flow_rate) * backstress / limit)
         - recovery
           * (reference * signed_power(backstress, log(reference), exponent, 0)
              + boundary * source * (backstress / reference) ^ 3);
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
