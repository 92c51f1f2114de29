/**
 * Pressure, water and melt: the factor that a mechanism of the dashpot has in the environment of a
 * test. Needs physics/parameters.stan and physics/flow_law.stan.
 */

/** Water fugacity (Pa) at which the rate of a mechanism is given, as at no pressure and no melt. */
real reference_water_fugacity() { return 1e6; }

/**
 * ln of the factor of a rate by pressure, water and melt, -P V_M/(R T) + r_f ln(f/f_1) + alpha_phi phi
 * (Hirth and Kohlstedt 2003, Eq. 1).
 *
 * @param parameter in the order of physics/parameters.stan
 * @param temperature true one, K
 * @param numbers places of V_M, r_f and alpha_phi of the mechanism
 */
real log_environment(vector parameter, real temperature, data array[] int numbers) {
  real pressure = parameter[i_pressure()];
  real fugacity = parameter[i_water_fugacity()];
  real melt = parameter[i_melt_fraction()];
  if (pressure == 0 && melt == 0 && fugacity == reference_water_fugacity()) {
    return 0;
  }
  return parameter[numbers[2]] * log(fugacity / reference_water_fugacity())
         + parameter[numbers[3]] * melt
         - pressure * parameter[numbers[1]] / (gas_constant() * temperature);
}

/** Numbers of a mechanism of the dashpot for log_environment(); 1: the flow law. */
array[] int environment_numbers(data int mechanism) {
  int first = {i_activation_volume(), i_second_activation_volume(),
               i_third_activation_volume()}[mechanism];
  return {first, first + 1, first + 2};
}

/** log_rate_factor() at given parameters, in their environment. */
real log_rate_factor_at(vector parameter, real temperature) {
  return log_rate_factor(parameter[i_activation_enthalpy()], parameter[i_beta()], temperature)
         + log_environment(parameter, temperature, environment_numbers(1));
}
