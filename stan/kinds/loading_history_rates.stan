/**
 * Rates of the Burgers model along a leg of a loading history: what strain-driven and
 * stress-driven legs have in common.
 *
 * A leg is a part of a test over which strain or stress is linear in time. Time runs from 0 to 1
 * over its duration D, and all states are O(1):
 *
 *   y = stress/S,  z = E_K kelvin_strain/S,  x = dashpot_strain/e,  g = path_strain/e,  u = d/d_0,
 *   b = backstress/S,
 *
 * with S a stress and e a strain of the test (data), path_strain = integral of |strain rate| of the
 * specimen. In the unit e/D of strain rates,
 *
 *   v_K = (S/(E_K e)) dz/dt,  dz/dt = (D E_K/eta_K) q,  q = y - z,
 *   v_d = v_0 sgn(y) (|y|/F)^n (d/d_0)^-p,
 *
 * v_0 the rate of the undeformed dashpot at stress S. With a power-law Kelvin element its linear
 * driving stress stands for q (physics/kelvin_laws.stan), with another law of the dashpot
 * (physics/dashpot_laws.stan) the equivalent stress for y in v_d. A backstress (physics/hardening.stan)
 * leaves y - b of y there, one of dislocations y - b - (sigma_d/S) (d/d_0)^-1. A further mechanism (physics/dashpot_mechanisms.stan) has the rate
 * v_k = v_k0 sgn(y) |y|^n_k (d/d_0)^-p_k, v_k0 that at stress S. A Kelvin part with many relaxation times
 * (physics/relaxation.stan) is a sum of elements, each with a z_k of its own:
 *
 *   dz_k/dt = c_k (D E_K/eta_K) (y - z_k),  z = sum of w_k z_k.
 *
 * What the solver needs stands in one vector, at places h_NAME(). Only what a free parameter
 * changes is handed to it as varying, because every varying number costs it sensitivities; the
 * rest, as the whole microstructure where it is constant, is data.
 */

int n_history_rates() { return 27 + n_relaxation_numbers(); }

int h_log_dashpot_rate() { return 1; } // ln v_0
int h_stress_exponent() { return 2; } // n
int h_grain_size_exponent() { return 3; } // p
int h_kelvin_decay() { return 4; } // D E_K/eta_K
int h_kelvin_compliance() { return 5; } // S/(E_K e)
int h_spring_compliance() { return 6; } // S/(E_M e)
int h_apparatus_compliance() { return 7; } // C S/e
int h_grain_size_deficit() { return 8; } // 1 - d_ss/d_0
int h_grain_size_decay() { return 9; } // e/epsilon_c1
int h_fabric_deficit() { return 10; } // 1 - F_ss
int h_fabric_decay() { return 11; } // e/epsilon_c2
int h_kelvin_law() { return 12; } // parameter of a Kelvin element that is not linear
int h_dashpot_stress() { return 13; } // of another law than the power law (physics/dashpot_laws.stan), over S
int h_stress_scale() { return 14; } // S, Pa
int h_hardening() { return 15; } // H e/S, and the other numbers of backstress_rate() behind it
int h_backstress_limit() { return 16; } // sigma_max/S
int h_recovery() { return 17; } // D r
int h_recovery_exponent() { return 18; } // m
int h_source_stress() { return 19; } // sigma_d/S at d_0
int h_boundary_recovery() { return 20; } // c_r
int h_reference_backstress() { return 21; } // sigma_0/S
int h_log_further_rate(int k) { return 19 + 3 * k; } // ln v_k0 of the second (1) and the third; or 0
int h_further_stress_exponent(int k) { return 20 + 3 * k; } // n_k
int h_further_grain_size_exponent(int k) { return 21 + 3 * k; } // p_k
int h_relaxation() { return 28; } // the first of relaxation_numbers()

/** Places in the constants of a test, which are data. */
int n_history_constants() { return 10; }

int c_stress_scale() { return 1; } // S as the load cell reads it, Pa
int c_strain_scale() { return 2; } // e
int c_kelvin_reference() { return 3; } // q_0, Pa
int c_piezometer() { return 4; } // d_1/d_0; 0: the grain size has a steady state of its own
int c_piezometer_exponent() { return 5; }
int c_piezometer_stress_floor() { return 6; } // Pa
int c_dashpot_law() { return 7; } // of dashpot_law()
int c_kelvin_law() { return 8; } // of kelvin_law_at()
int c_hardening() { return 9; } // of hardening_law()
int c_mechanisms() { return 10; } // of mechanisms_act()

/** Constants of a test: see their places. */
vector history_constants(data vector constant, data real initial_grain_size,
                         data real stress_scale, data real strain_scale,
                         data int kelvin_law) {
  return [stress_scale, strain_scale, constant[i_kelvin_reference_stress()],
          constant[i_piezometer_reference_grain_size()] / initial_grain_size,
          constant[i_piezometer_exponent()], constant[i_piezometer_stress_floor()],
          dashpot_law(constant), kelvin_law, hardening_law(constant),
          mechanisms_act(constant)]';
}

/** Compliances in the units of the states: S/(E_K e), S/(E_M e), C S/e. */
vector history_compliances(vector parameter, data vector test) {
  real stress_scale = test[c_stress_scale()] / stress_reading_factor(parameter);
  return [stress_scale / (parameter[i_kelvin_modulus()] * test[c_strain_scale()]),
          stress_scale / (parameter[i_maxwell_modulus()] * test[c_strain_scale()]),
          parameter[i_apparatus_compliance()] * test[c_stress_scale()] / test[c_strain_scale()]]';
}

/**
 * What a leg is solved with: see the places of its numbers.
 *
 * @param parameter in the order of physics/parameters.stan
 * @param constant parameters that are never inferred, at their places in the same order
 * @param duration D, s
 * @param temperature of the leg as stated, K
 * @param test constants of the test, see their places. All stresses of a history are readings of the
 *   load cell, and so is the scale in them; the unit S of the states is the stress behind it
 */
vector history_rates(vector parameter, data vector constant, data real duration,
                     data real temperature, data real initial_grain_size, data vector test) {
  real strain_scale = test[c_strain_scale()];
  real stress_scale = test[c_stress_scale()] / stress_reading_factor(parameter);
  vector[3] compliance = history_compliances(parameter, test);
  real at_temperature = true_temperature(parameter, temperature);
  real kelvin_viscosity = kelvin_viscosity_at(parameter, at_temperature,
                                              constant[i_kelvin_reference_temperature()]);
  vector[2] log_further = rep_vector(0, 2);
  real log_coarser = log(initial_grain_size / constant[i_kelvin_reference_grain_size()]);
  for (k in 1 : n_further_mechanisms(test[c_mechanisms()])) {
    log_further[k] = log_further_rate(k, stress_scale, initial_grain_size, parameter,
                                      at_temperature)
                     + log(duration / strain_scale);
  }
  return append_row(
         [log_flow_rate_at(stress_scale, initial_grain_size, temperature, parameter)
          + log(duration / strain_scale),
          parameter[i_stress_exponent()], parameter[i_grain_size_exponent()],
          duration * parameter[i_kelvin_modulus()] / kelvin_viscosity
          * exp(-parameter[i_kelvin_grain_size_exponent()] * log_coarser),
          compliance[1], compliance[2], compliance[3],
          1 - parameter[i_steady_state_grain_size()] / initial_grain_size,
          strain_scale / parameter[i_critical_strain_grain_size()],
          1 - parameter[i_steady_state_fabric_factor()],
          strain_scale / parameter[i_critical_strain_fabric()],
          kelvin_law_number(parameter, test[c_kelvin_law()]),
          dashpot_stress(parameter, dashpot_law(constant)) / stress_scale, stress_scale,
          parameter[i_hardening_modulus()] * strain_scale / stress_scale,
          parameter[i_backstress_limit()] / stress_scale,
          duration * recovery_rate_at(parameter, at_temperature,
                                      constant[i_kelvin_reference_temperature()]),
          parameter[i_recovery_exponent()],
          source_stress_at(parameter, initial_grain_size) / stress_scale,
          parameter[i_boundary_recovery()],
          parameter[i_reference_backstress()] / stress_scale, log_further[1],
          parameter[i_second_stress_exponent()], parameter[i_second_grain_size_exponent()],
          log_further[2], parameter[i_third_stress_exponent()],
          parameter[i_third_grain_size_exponent()]]',
         relaxation_numbers(parameter));
}

/**
 * Places of the numbers above that some free parameter changes.
 *
 * @param is_free of each parameter, whether it is inferred in any test
 * @param element elements of the Kelvin part (history_elements())
 * @param hardening of any_hardening()
 * @param n_further of most_further_mechanisms()
 */
array[] int varying_rates(data array[] int is_free, data matrix element, data int hardening,
                          data int n_further) {
  array[n_history_rates()] int varies = rep_array(0, n_history_rates());
  int n_varying = 0;
  varies[h_log_dashpot_rate()]
    = max(append_array(is_free[{i_stress_exponent(), i_grain_size_exponent(),
                                i_activation_enthalpy(), i_beta(), i_temperature_error(),
                                i_stress_calibration_error()}],
                       is_free[environment_numbers(1)]));
  varies[h_stress_exponent()] = is_free[i_stress_exponent()];
  varies[h_grain_size_exponent()] = is_free[i_grain_size_exponent()];
  varies[h_kelvin_decay()]
    = max(is_free[append_array(environment_numbers(4),
                               {i_kelvin_modulus(), i_kelvin_viscosity(),
                                i_kelvin_activation_enthalpy(), i_kelvin_grain_size_exponent(),
                                i_temperature_error()})]);
  varies[h_kelvin_compliance()] = max(is_free[{i_kelvin_modulus(),
                                               i_stress_calibration_error()}]);
  varies[h_spring_compliance()] = max(is_free[{i_maxwell_modulus(),
                                               i_stress_calibration_error()}]);
  varies[h_apparatus_compliance()] = is_free[i_apparatus_compliance()];
  varies[h_grain_size_deficit()] = is_free[i_steady_state_grain_size()];
  varies[h_grain_size_decay()] = is_free[i_critical_strain_grain_size()];
  varies[h_fabric_deficit()] = is_free[i_steady_state_fabric_factor()];
  varies[h_fabric_decay()] = is_free[i_critical_strain_fabric()];
  varies[h_kelvin_law()] = max(is_free[kelvin_law_parameters()]);
  varies[h_stress_scale()] = is_free[i_stress_calibration_error()];
  varies[h_dashpot_stress()] = max(is_free[append_array(dashpot_stresses(),
                                                        {i_stress_calibration_error()})]);
  if (hardening) {
    varies[h_hardening()] = max(is_free[{i_hardening_modulus(), i_stress_calibration_error()}]);
    varies[h_backstress_limit()] = max(is_free[{i_backstress_limit(),
                                                i_stress_calibration_error()}]);
    varies[h_recovery()]
      = max(is_free[append_array(environment_numbers(5),
                                 {i_recovery_rate(), i_recovery_activation_enthalpy(),
                                  i_temperature_error()})]);
    varies[h_recovery_exponent()] = is_free[i_recovery_exponent()];
  }
  if (hardening > 1) {
    varies[h_source_stress()] = max(is_free[{i_source_stress(), i_stress_calibration_error()}]);
    varies[h_boundary_recovery()] = is_free[i_boundary_recovery()];
    varies[h_reference_backstress()] = is_free[i_stress_calibration_error()];
  }
  for (k in 1 : n_further) {
    array[5] int number = mechanism_numbers(k);
    varies[h_log_further_rate(k)]
      = max(is_free[append_array(append_array(number, environment_numbers(k + 1)),
                                 {i_temperature_error(), i_stress_calibration_error()})]);
    varies[h_further_stress_exponent(k)] = is_free[number[2]];
    varies[h_further_grain_size_exponent(k)] = is_free[number[3]];
  }
  varies[h_relaxation() : ] = relaxation_numbers_vary(is_free, element);
  n_varying = sum(varies);
  {
    array[n_varying] int places;
    int found = 0;
    for (k in 1 : n_history_rates()) {
      if (varies[k]) {
        found += 1;
        places[found] = k;
      }
    }
    return places;
  }
}

/** Place of each number among the varying ones, 0 where it does not vary. */
array[] int place_among(data array[] int varying) {
  array[n_history_rates()] int place = rep_array(0, n_history_rates());
  for (k in 1 : size(varying)) {
    place[varying[k]] = k;
  }
  return place;
}

/**
 * A number that a leg is solved with.
 *
 * @param which its place
 * @param varying the numbers that vary
 * @param place of each among them, 0 where it does not vary
 * @param fixed all numbers at given parameters; those that vary have no effect
 */
real history_rate(data int which, vector varying, data array[] int place, data vector fixed) {
  return place[which] == 0 ? fixed[which] : varying[place[which]];
}

/** Whether a number may differ from a value without effect. */
int in_use(data int which, data array[] int place, data vector fixed, data real without_effect) {
  return place[which] > 0 || fixed[which] != without_effect;
}

/**
 * Decay c_k D E_K/eta_K and compliance w_k of each element of the Kelvin part.
 *
 * @return (n, 2)
 */
matrix history_elements(data matrix element, vector varying, data array[] int place,
                        data vector fixed) {
  int n = rows(element);
  real decay = history_rate(h_kelvin_decay(), varying, place, fixed);
  vector[n_relaxation_numbers()] number;
  matrix[n, 2] elements;
  if (n == 1) {
    elements[1] = [decay, 1];
    return elements;
  }
  for (k in 1 : n_relaxation_numbers()) {
    number[k] = history_rate(h_relaxation() + k - 1, varying, place, fixed);
  }
  elements = relaxation_elements(element, number);
  elements[ : , 1] *= decay;
  return elements;
}

/**
 * dz/dt of each element of the Kelvin part.
 *
 * @param z of each
 * @param elements of history_elements()
 */
vector history_kelvin_rates(real y, vector z, matrix elements, vector varying,
                            data array[] int place, data vector fixed, data vector test) {
  if (test[c_kelvin_law()] > 0) {
    return [elements[1, 1]
            * linear_driving_stress(y - z[1], test[c_kelvin_law()],
                                    history_rate(h_kelvin_law(), varying, place, fixed),
                                    log(history_rate(h_stress_scale(), varying, place, fixed)
                                        / test[c_kelvin_reference()]))]';
  }
  return elements[ : , 1] .* (y - z);
}

/**
 * z under a linear Kelvin element after a time t under y = y_0 + r t.
 *
 * @param start z at t = 0
 * @param decay per unit time
 */
real linear_kelvin_strain(real t, real start, real y_0, real r, real decay) {
  real gone = -expm1(-decay * t);
  real settling = start + (y_0 - start) * gone;
  return r == 0 ? settling : settling + r * (t - gone / decay);
}

/**
 * z_k of a sum of elements: as linear_kelvin_strain().
 *
 * @param elements of history_elements()
 */
vector linear_kelvin_strains(real t, vector start, real y_0, real r, matrix elements) {
  vector[num_elements(start)] z;
  for (k in 1 : num_elements(start)) {
    z[k] = linear_kelvin_strain(t, start[k], y_0, r, elements[k, 1]);
  }
  return z;
}

/** Number of z_k that a leg follows beside z: none where the Kelvin part is one element. */
int n_summed(data matrix element) { return rows(element) > 1 ? rows(element) : 0; }

/** z of the Kelvin part, from that of each element and history_elements(). */
real kelvin_sum(vector z, matrix elements) {
  return num_elements(z) == 1 ? z[1] : dot_product(elements[ : , 2], z);
}

/** z of each element of the Kelvin part at a row of states. */
vector kelvin_states(row_vector state, data matrix element) {
  return rows(element) > 1 ? to_vector(state[7 : ]) : to_vector(state[2 : 2]);
}

/**
 * ln(d/d_0).
 *
 * @param g path strain over e
 * @param u d/d_0 where the grain size follows a piezometer; elsewhere it has no effect
 */
real log_history_grain_size(real g, real u, vector varying, data array[] int place,
                            data vector fixed, data vector test) {
  if (test[c_piezometer()] > 0) {
    return log(u);
  }
  return in_use(h_grain_size_deficit(), place, fixed, 0)
         ? log_relative_microstructure(g,
                                       history_rate(h_grain_size_deficit(), varying, place, fixed),
                                       history_rate(h_grain_size_decay(), varying, place, fixed))
         : 0;
}

/** Stress that the sources of dislocations take, over S. */
real history_source_stress(real log_grain_size, vector varying, data array[] int place,
                           data vector fixed) {
  return history_rate(h_source_stress(), varying, place, fixed) * exp(-log_grain_size);
}

/**
 * Rates of the dashpot and of its first mechanism, v_d and v_1.
 *
 * @param b backstress, 0 without one
 * @param g, u of log_history_grain_size()
 */
vector history_dashpot_rates(real y, real b, real g, real u, vector varying,
                             data array[] int place, data vector fixed, data vector test) {
  real log_grain_size = log_history_grain_size(g, u, varying, place, fixed, test);
  real log_fabric = 0;
  real flow_stress = y - b;
  real first;
  if (in_use(h_fabric_deficit(), place, fixed, 0)) {
    log_fabric
      = log_relative_microstructure(g,
                                    history_rate(h_fabric_deficit(), varying, place, fixed),
                                    history_rate(h_fabric_decay(), varying, place, fixed));
  }
  if (test[c_hardening()] > 1) {
    flow_stress -= history_source_stress(log_grain_size, varying, place, fixed);
  }
  if (test[c_dashpot_law()] > 0) {
    flow_stress = equivalent_stress(flow_stress, test[c_dashpot_law()],
                                    history_rate(h_dashpot_stress(), varying, place, fixed),
                                    exp(log_fabric),
                                    history_rate(h_stress_exponent(), varying, place, fixed));
  }
  first = signed_power(flow_stress, log_fabric,
                       history_rate(h_stress_exponent(), varying, place, fixed),
                       history_rate(h_log_dashpot_rate(), varying, place, fixed)
                       - history_rate(h_grain_size_exponent(), varying, place, fixed)
                         * log_grain_size);
  if (test[c_hardening()] > 1) {
    first *= square(b / history_rate(h_reference_backstress(), varying, place, fixed));
  }
  if (test[c_mechanisms()] > 0) {
    vector[n_further_mechanisms(test[c_mechanisms()])] further;
    for (k in 1 : num_elements(further)) {
      further[k]
        = signed_power(y, 0, history_rate(h_further_stress_exponent(k), varying, place, fixed),
                       history_rate(h_log_further_rate(k), varying, place, fixed)
                       - history_rate(h_further_grain_size_exponent(k), varying, place, fixed)
                         * log_grain_size);
    }
    return [rate_of_mechanisms(first, further, test[c_mechanisms()]), first]';
  }
  return [first, first]';
}

/** du/dt of a grain size that follows a piezometer, at a rate of the path strain in e/D. */
real history_grain_growth(real y, real u, real path_rate, vector varying,
                          data array[] int place, data vector fixed, data vector test) {
  return path_rate * history_rate(h_grain_size_decay(), varying, place, fixed)
         * (piezometer_grain_size(history_rate(h_stress_scale(), varying, place, fixed) * y,
                                  test[c_piezometer()], test[c_piezometer_exponent()],
                                  test[c_piezometer_stress_floor()])
            - u);
}

/** db/dt of a backstress that the first mechanism stores; g and u as in history_dashpot_rates(). */
real history_backstress_rate(real b, real g, real u, real first_rate, vector varying,
                             data array[] int place, data vector fixed, data vector test) {
  real modulus = history_rate(h_hardening(), varying, place, fixed);
  real limit = history_rate(h_backstress_limit(), varying, place, fixed);
  real recovery = history_rate(h_recovery(), varying, place, fixed);
  real exponent = history_rate(h_recovery_exponent(), varying, place, fixed);
  if (test[c_hardening()] > 1) {
    return dislocation_backstress_rate(
             b, first_rate, modulus, limit, recovery, exponent,
             history_rate(h_reference_backstress(), varying, place, fixed),
             history_source_stress(log_history_grain_size(g, u, varying, place, fixed, test), varying,
                                   place, fixed),
             history_rate(h_boundary_recovery(), varying, place, fixed));
  }
  return backstress_rate(b, first_rate, modulus, limit, recovery, exponent);
}

/** Magnitude; of 0 with the slope 0. */
real magnitude(real x) {
  return x < 0 ? -x : (x > 0 ? x : 0);
}
