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
 * c_r sigma_d/sigma_0 as much. Needs physics/dashpot_laws.stan.
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
 * Complex compliance of a dashpot under small cycles, in which its backstress is stored and recovers
 * in proportion to itself. Dynamic recovery is of second order about zero stress.
 *
 * @param frequency omega, rad/s
 * @param fluidity derivative of the strain rate by the stress, 1/(Pa s)
 * @param storage, recovery 1/s: a linear dashpot has fluidity H, and r; without storage
 *   fluidity/omega is the loss
 * @return [J1, J2], 1/Pa
 */
row_vector backstress_compliance(data real frequency, real fluidity, real storage, real recovery) {
  real decay = recovery + storage;
  return fluidity / (square(frequency) + square(decay))
         * [storage, (square(frequency) + recovery * decay) / frequency];
}

/** Rate of static recovery, r exp[-(Q_r/R)(1/T - 1/T_0)] and the factor of its environment. */
real recovery_rate_at(vector parameter, real temperature, real reference_temperature) {
  return parameter[i_recovery_rate()]
         * exp(log_environment(parameter, temperature, environment_numbers(5))
               - parameter[i_recovery_activation_enthalpy()] / gas_constant()
                 * (1 / temperature - 1 / reference_temperature));
}

/**
 * Dislocations at a stress and a backstress, F = 1: rate of flow v, its derivative by the stress, rate
 * of the backstress, and its derivatives by v and by the backstress.
 *
 * @param numbers log_rate_factor_at(), r at the temperature, and sigma_d at the grain size
 */
vector dislocation_rates(real stress, real backstress, data real grain_size, vector parameter,
                         vector numbers) {
  real n = parameter[i_stress_exponent()];
  real breakdown = parameter[i_breakdown_stress()];
  real reference = parameter[i_reference_backstress()];
  real modulus = parameter[i_hardening_modulus()];
  real limit = parameter[i_backstress_limit()];
  real exponent = parameter[i_recovery_exponent()];
  real boundary = parameter[i_boundary_recovery()];
  real driving = stress - backstress - numbers[3];
  real rate = square(backstress / reference)
              * dashpot_strain_rate(power_law_stress(driving, breakdown, 1, n), grain_size, 1, n,
                                    parameter[i_grain_size_exponent()], numbers[1]);
  real steepness = breakdown == 0 ? 1 / driving : 1 / (breakdown * tanh(driving / breakdown));
  real per_flow = modulus * (1 + numbers[3] / backstress - backstress / limit);
  real ratio = backstress / reference;
  real loss_slope = numbers[2]
                    * (exponent * ratio ^ (exponent - 1)
                       + 3 * boundary * numbers[3] * square(ratio) / reference);
  return [rate, n * rate * steepness,
          dislocation_backstress_rate(backstress, rate, modulus, limit, numbers[2], exponent,
                                      reference, numbers[3], boundary),
          per_flow, -modulus * rate * (numbers[3] / square(backstress) + 1 / limit) - loss_slope]';
}

/**
 * Dislocations under small cycles about their steady state at a stress (Hein et al. 2025).
 *
 * Halving finds the steady backstress without derivatives, Newton steps of its equation give them.
 *
 * @param stress median, Pa
 * @param temperature, reference_temperature T and T_0, K
 * @return fluidity, storage and recovery of backstress_compliance(); no fluidity where sources take
 *   the whole stress
 */
vector dislocation_response(data real stress, data real grain_size, vector parameter,
                            data real temperature, real reference_temperature) {
  vector[3] numbers = [log_rate_factor_at(parameter, temperature),
                       recovery_rate_at(parameter, temperature, reference_temperature),
                       source_stress_at(parameter, grain_size)]';
  real span = stress - numbers[3];
  real low = 0;
  real high = 1;
  real backstress;
  vector[5] rates;
  if (span <= 0) {
    return rep_vector(0, 3);
  }
  for (i in 1 : 40) {
    real middle = 0.5 * (low + high);
    if (dislocation_rates(stress, middle * span, grain_size, parameter, numbers)[3] > 0) {
      low = middle;
    } else {
      high = middle;
    }
  }
  backstress = 0.5 * (low + high) * span;
  rates = dislocation_rates(stress, backstress, grain_size, parameter, numbers);
  for (i in 1 : 2) {
    real slope = rates[4] * (2 * rates[1] / backstress - rates[2]) + rates[5];
    backstress -= rates[3] / slope;
    rates = dislocation_rates(stress, backstress, grain_size, parameter, numbers);
  }
  return [rates[2], (rates[2] - 2 * rates[1] / backstress) * rates[4], -rates[5]]';
}
