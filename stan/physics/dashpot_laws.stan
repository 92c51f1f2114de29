/**
 * Laws of the dashpot. Each is the power law of physics/flow_law.stan at another stress, and has a
 * stress of its own, a parameter that is 0 in all other laws. A law is named by the place of that
 * parameter (physics/parameters.stan), the power law by 0. Needs both files, and
 * physics/environment.stan; physics/dashpot_mechanisms.stan for the rate of the whole dashpot.
 */

/**
 * ln(S_0/Pa) at given parameters: log_reference_stress() of physics/flow_law.stan.
 *
 * @param parameter in the order of physics/parameters.stan
 * @param temperature stated, K
 */
real log_reference_stress_at(vector parameter, data real strain_rate,
                             data real initial_grain_size, data real temperature) {
  real at_temperature = true_temperature(parameter, temperature);
  real n = parameter[i_stress_exponent()];
  return log_reference_stress(strain_rate, initial_grain_size, at_temperature, n,
                              parameter[i_grain_size_exponent()],
                              parameter[i_activation_enthalpy()], parameter[i_beta()])
         - log_environment(parameter, at_temperature, environment_numbers(1)) / n;
}

/** ln(flow rate s) at given parameters: log_flow_rate() of physics/flow_law.stan. */
real log_flow_rate_at(real stress, data real initial_grain_size, data real temperature,
                      vector parameter) {
  real at_temperature = true_temperature(parameter, temperature);
  return log_flow_rate(stress, initial_grain_size, at_temperature,
                       parameter[i_stress_exponent()], parameter[i_grain_size_exponent()],
                       parameter[i_activation_enthalpy()], parameter[i_beta()])
         + log_environment(parameter, at_temperature, environment_numbers(1));
}

/** Stresses of the laws beside the power law. */
array[] int dashpot_stresses() { return {i_breakdown_stress(), i_threshold_stress()}; }

/** Law of the dashpot at given parameters. */
int dashpot_law(vector parameter) {
  for (law in dashpot_stresses()) {
    if (parameter[law] != 0) {
      return law;
    }
  }
  return 0;
}

/** Place of a law among dashpot_stresses(); 0: the power law. */
int place_of_dashpot_law(real law) {
  for (place in 1 : size(dashpot_stresses())) {
    if (dashpot_stresses()[place] == law) {
      return place;
    }
  }
  return 0;
}

/** Stress of the law's own, Pa; 0 of the power law. */
real dashpot_stress(vector parameter, data int law) { return law > 0 ? parameter[law] : 0; }

/**
 * What a stress has above a threshold, sgn(stress) max(|stress| - threshold, 0).
 *
 * A power of it with n > 1 has a continuous slope. With n = 1 the slope jumps at the threshold, but
 * the rate does not, so sensitivities of a solution have no jump there.
 */
real stress_above(real stress, real threshold) {
  if (stress > threshold) {
    return stress - threshold;
  }
  return stress < -threshold ? stress + threshold : 0;
}

/**
 * Stress at which a power law creeps as fast as the dashpot does at a stress, all in one unit.
 *
 * @param law of dashpot_law()
 * @param law_stress of dashpot_stress()
 * @param fabric_factor F
 * @param stress_exponent n
 */
real equivalent_stress(real stress, real law, real law_stress, real fabric_factor,
                       real stress_exponent) {
  if (law == i_breakdown_stress()) {
    return power_law_stress(stress, law_stress, fabric_factor, stress_exponent);
  }
  if (law == i_threshold_stress()) {
    return stress_above(stress, law_stress);
  }
  return stress;
}

/** Stress that sources of dislocations take at a grain size (m), Pa; 0 without dislocations. */
real source_stress_at(vector parameter, real grain_size) {
  return parameter[i_reference_backstress()] > 0
         ? parameter[i_source_stress()] * parameter[i_kelvin_reference_grain_size()] / grain_size
         : 0;
}

/**
 * Strain rate of the dashpot, 1/s.
 *
 * @param stress, backstress Pa
 * @param grain_size m
 * @param parameter in the order of physics/parameters.stan
 * @param temperature true one, K
 */
real dashpot_rate_at(real stress, real backstress, real grain_size, real fabric_factor,
                     vector parameter, real temperature) {
  int law = dashpot_law(parameter);
  int act = mechanisms_act(parameter);
  real n = parameter[i_stress_exponent()];
  real reference = parameter[i_reference_backstress()];
  real source = source_stress_at(parameter, grain_size);
  real first
    = dashpot_strain_rate(equivalent_stress(stress - backstress - source, law,
                                            law > 0 ? parameter[law] : 0, fabric_factor, n),
                          grain_size, fabric_factor, n, parameter[i_grain_size_exponent()],
                          log_rate_factor_at(parameter, temperature))
      * (reference > 0 ? square(backstress / reference) : 1);
  vector[n_further_mechanisms(act)] further;
  for (k in 1 : num_elements(further)) {
    further[k] = signed_power(stress, 0, parameter[mechanism_numbers(k)[2]],
                              log_further_rate(k, 1, grain_size, parameter, temperature));
  }
  return act == 0 ? first : rate_of_mechanisms(first, further, act);
}
