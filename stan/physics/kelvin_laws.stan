/**
 * Laws of the dashpot of the Kelvin element: linear, or a power law (Masuti and Barbot 2021, Earth Planets
 * Space 73:208),
 *
 *   d(kelvin strain)/dt = A_K sgn(q) |q|^n_K exp(-Q_K/(R T)),  q = stress - E_K kelvin_strain.
 *
 * A_K alone is nothing that data or priors fix: it changes by many powers of ten with n_K and Q_K.
 * The parameter is the effective viscosity q/rate, eta_K, at a reference driving stress q_0 and a
 * reference temperature T_0:
 *
 *   d(kelvin strain)/dt = (q_0/eta_K) sgn(q) |q/q_0|^n_K exp[-(Q_K/R)(1/T - 1/T_0)].
 *
 * n_K = 1 and Q_K = 0 is the linear element of the paper, whatever q_0 and T_0. A law is named by
 * the place of its parameter, whose standard value makes it linear; the linear law by 0. Needs
 * physics/parameters.stan, physics/environment.stan, and physics/flow_law.stan for R.
 */

/** Parameters of the laws beside the linear one. */
array[] int kelvin_law_parameters() { return {i_kelvin_stress_exponent()}; }

/** Law of the element at given parameters. */
int kelvin_law_at(vector parameter) {
  for (law in kelvin_law_parameters()) {
    if (parameter[law] != (law == i_kelvin_stress_exponent() ? 1 : 0)) {
      return law;
    }
  }
  return 0;
}

/** Place of a law among kelvin_law_parameters(); 0: the linear law. */
int place_of_kelvin_law(real law) {
  for (place in 1 : size(kelvin_law_parameters())) {
    if (kelvin_law_parameters()[place] == law) {
      return place;
    }
  }
  return 0;
}

/** Value of the law's parameter; 0 of the linear law. */
real kelvin_law_number(vector parameter, data real law) {
  for (place in kelvin_law_parameters()) {
    if (place == law) {
      return parameter[place];
    }
  }
  return 0;
}

/**
 * How much slower the element is at a temperature than at the reference temperature, logarithm.
 *
 * @param activation_enthalpy Q_K, J/mol
 */
real log_thermal_slowing(real activation_enthalpy, real temperature, real reference_temperature) {
  return activation_enthalpy / gas_constant() * (1 / temperature - 1 / reference_temperature);
}

/** The same of the Kelvin part at given parameters, in their environment. */
real log_kelvin_slowing(vector parameter, real temperature, real reference_temperature) {
  return log_thermal_slowing(parameter[i_kelvin_activation_enthalpy()], temperature,
                             reference_temperature)
         - log_environment(parameter, temperature, environment_numbers(4));
}

/** How much slower the element is at a grain size (m) than at the reference grain size, logarithm. */
real log_kelvin_coarsening(vector parameter, real grain_size) {
  return parameter[i_kelvin_grain_size_exponent()]
         * log(grain_size / parameter[i_kelvin_reference_grain_size()]);
}

/**
 * Effective viscosity at a temperature and in an environment, at the driving stress q_0.
 *
 * @param parameter in the order of physics/parameters.stan; eta_K is that at the reference temperature
 * @return Pa s
 */
real kelvin_viscosity_at(vector parameter, real temperature, data real reference_temperature) {
  return parameter[i_kelvin_viscosity()]
         * exp(log_kelvin_slowing(parameter, temperature, reference_temperature));
}

/** The power law: q |q/q_0|^(n_K - 1), see linear_driving_stress(). */
real power_law_driving_stress(real driving_stress, real stress_exponent, real log_unit) {
  real magnitude = driving_stress < 0 ? -driving_stress : driving_stress;
  if (magnitude == 0) {
    return 0;
  }
  return driving_stress * exp((stress_exponent - 1) * (log(magnitude) + log_unit));
}

/**
 * Driving stress at which a linear element of the viscosity eta_K creeps as fast as the element
 * does at the driving stress q, both in some unit U.
 *
 * @param driving_stress q/U
 * @param law of kelvin_law_at()
 * @param law_number value of the law's parameter
 * @param log_unit ln(U/q_0)
 */
real linear_driving_stress(real driving_stress, real law, real law_number, real log_unit) {
  if (law == i_kelvin_stress_exponent()) {
    return power_law_driving_stress(driving_stress, law_number, log_unit);
  }
  return driving_stress;
}
