/**
 * Pressure, water and melt: the factor that a rate of the material has in the environment of a test.
 * Needs physics/parameters.stan and physics/flow_law.stan.
 */

/** Water fugacity (Pa) at which rates are given, as at no pressure and no melt. */
real reference_water_fugacity() { return 1e6; }

/**
 * ln of the factor of a rate by pressure, water and melt, -P V_M/(R T) + r_f ln(f/f_1) + alpha_phi phi
 * (Hirth and Kohlstedt 2003, Eq. 1).
 *
 * @param parameter in the order of physics/parameters.stan
 * @param temperature true one, K
 * @param numbers places of V_M, r_f and alpha_phi of the rate
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

/**
 * Places of the numbers for log_environment().
 *
 * @param rate 1: the flow law, 2 and 3: the further mechanisms, 4: the Kelvin part, 5: recovery
 */
array[] int environment_numbers(data int rate) {
  int first = i_activation_volume() + 3 * (rate - 1);
  return {first, first + 1, first + 2};
}

/** log_rate_factor() at given parameters, in their environment. */
real log_rate_factor_at(vector parameter, real temperature) {
  return log_rate_factor(parameter[i_activation_enthalpy()], parameter[i_beta()], temperature)
         + log_environment(parameter, temperature, environment_numbers(1));
}
