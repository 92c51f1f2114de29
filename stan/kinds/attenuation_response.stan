/**
 * Attenuation and modulus of the circuit under small or large stress cycles, microstructure
 * frozen: the closed form of docs/model.md, for axial and for shear cycles.
 *
 * Parameters are axial. Strain that keeps the volume has three times the axial compliance in
 * shear, whatever the mechanism; elastic strain has 1/G = 2 (1 + nu)/E, or 1/G = 3/E - 1/(3 K).
 * A row of `conversion` says which holds: 1/modulus = c_1/E_M - c_2, other compliances times c_3.
 */

/**
 * ln of the fluidity (axial, 1/(Pa s)) in every reading: of the dashpot and of its first mechanism;
 * and storage and recovery of the first one's backstress (1/s, physics/hardening.stan), as columns.
 *
 * @param regime of every reading, from 1
 * @param median_stress, amplitude of every regime, axial equivalents, Pa
 * @param node_end, node nodes of every regime: columns sine and weight
 */
matrix log_fluidity(vector parameter, data vector temperature, data real grain_size,
                    data array[] int regime, data vector median_stress,
                    data vector amplitude, data array[] int node_end, data matrix node) {
  vector[num_elements(amplitude)] of_stress;
  vector[num_elements(temperature)] all;
  vector[num_elements(temperature)] first;
  vector[num_elements(temperature)] log_factor;
  matrix[num_elements(temperature), 2] memory = rep_matrix(0, num_elements(temperature), 2);
  int hardening = hardening_law(parameter);
  for (r in 1 : num_elements(amplitude)) {
    array[node_end[r + 1] - node_end[r]] int here = part(node_end, r);
    of_stress[r] = log_fluidity_of_stress(median_stress[r], amplitude[r],
                                          parameter[i_stress_exponent()],
                                          parameter[i_breakdown_stress()], node[here, 1],
                                          node[here, 2]);
  }
  for (i in 1 : num_elements(temperature)) {
    log_factor[i] = log_rate_factor_at(parameter, temperature[i]);
  }
  first = of_stress[regime] + log_factor
          - parameter[i_grain_size_exponent()] * log(grain_size);
  for (i in 1 : num_elements(temperature)) {
    if (hardening == 1) {
      memory[i] = [exp(first[i]) * parameter[i_hardening_modulus()],
                   recovery_rate_at(parameter, temperature[i],
                                    parameter[i_kelvin_reference_temperature()])];
    } else if (hardening > 1 && i > 1 && temperature[i] == temperature[i - 1]
               && regime[i] == regime[i - 1]) {
      first[i] = first[i - 1];
      memory[i] = memory[i - 1];
    } else if (hardening > 1) {
      vector[3] response
        = dislocation_response(median_stress[regime[i]], grain_size, parameter, temperature[i],
                               parameter[i_kelvin_reference_temperature()]);
      first[i] = log(response[1]);
      memory[i] = [response[2], response[3]];
    }
  }
  all = first;
  if (mechanisms_act(parameter) > 0) {
    for (i in 1 : num_elements(temperature)) {
      int r = regime[i];
      array[node_end[r + 1] - node_end[r]] int here = part(node_end, r);
      all[i] = log_fluidity_of_all(first[i], median_stress[r], amplitude[r], grain_size,
                                   parameter, temperature[i], node[here, 1], node[here, 2]);
    }
  }
  return append_col(append_col(all, first), memory);
}

/** ln of the longest relaxation time of the Kelvin part in every reading, ln s. */
vector log_relaxation_times(vector parameter, data vector temperature, data real grain_size) {
  vector[num_elements(temperature)] log_time;
  for (i in 1 : num_elements(temperature)) {
    log_time[i] = log_relaxation_time(parameter, temperature[i], grain_size);
  }
  return log_time;
}

/**
 * ln(tan delta), then ln(modulus / Pa), of every reading; the modulus is 1/|J|.
 *
 * @param frequency angular, rad/s
 * @param log_of_fluidity of log_fluidity()
 */
vector log_tan_delta_and_modulus(vector parameter, data vector frequency,
                                 data vector temperature, data real grain_size,
                                 data vector conversion, matrix log_of_fluidity) {
  int n = num_elements(frequency);
  matrix[n, 2] kelvin
    = kelvin_compliance(log(frequency)
                        + log_relaxation_times(parameter, temperature, grain_size), parameter);
  vector[n] storage = conversion[1] ./ maxwell_modulus_at(parameter, temperature)
                      - conversion[2] + conversion[3] * kelvin[ : , 1];
  vector[n] loss = conversion[3] * (kelvin[ : , 2] + exp(log_of_fluidity[ : , 1]) ./ frequency);
  if (has_backstress(parameter)) {
    for (i in 1 : n) {
      row_vector[2] dashpot
        = backstress_compliance(frequency[i], exp(log_of_fluidity[i, 2]),
                                log_of_fluidity[i, 3], log_of_fluidity[i, 4]);
      storage[i] += conversion[3] * dashpot[1];
      loss[i] += conversion[3] * (dashpot[2] - exp(log_of_fluidity[i, 2]) / frequency[i]);
    }
  }
  return append_row(log(loss) - log(storage), -0.5 * log(square(storage) + square(loss)));
}

/** ln of the largest share of the loss compliance that the dashpot carries in a row of a table. */
real largest_log_dashpot_share(vector parameter, data vector frequency, data vector temperature,
                               data real grain_size, data vector conversion,
                               data array[] int regime, data vector median_stress,
                               data vector amplitude, data array[] int node_end,
                               data matrix node) {
  int n = num_elements(frequency);
  matrix[n, 4] log_of_fluidity = log_fluidity(parameter, temperature, grain_size, regime,
                                              median_stress, amplitude, node_end, node);
  vector[2 * n] both = log_tan_delta_and_modulus(parameter, frequency, temperature, grain_size,
                                                 conversion, log_of_fluidity);
  vector[n] log_loss = head(both, n) - 0.5 * log1p_exp(2 * head(both, n)) - tail(both, n);
  return max(log(conversion[3]) + log_of_fluidity[ : , 1] - log(frequency) - log_loss);
}

/**
 * Centre (first half) and standard deviation (second half) of the logarithms of readings.
 *
 * A reading of tan delta = Q with a stated error e is about hypot(Q, e), which is Q unless the
 * error drowns it, and its logarithm has the error e/hypot(Q, e): near those of |Q + e z| for a
 * standard normal z. Scatter comes on top. The stated error of a modulus is that of its logarithm.
 *
 * @param log_reading of the model
 * @param quantity of each: 1 tan delta, 2 modulus
 * @param stated_error of tan delta itself, and of ln(modulus)
 */
vector log_reading_law(vector parameter, vector log_reading, data array[] int quantity,
                       data vector stated_error) {
  int n = num_elements(log_reading);
  vector[2] scatter = [parameter[i_attenuation_scatter()], parameter[i_modulus_scatter()]]';
  vector[n] centre = log_reading;
  vector[n] stated = stated_error;
  for (i in 1 : n) {
    if (quantity[i] == 1 && stated_error[i] > 0) {
      centre[i] = 0.5 * log_sum_exp(2 * log_reading[i], 2 * log(stated_error[i]));
      stated[i] = stated_error[i] * exp(-centre[i]);
    }
  }
  return append_row(centre, sqrt(square(scatter[quantity]) + square(stated)));
}

/**
 * log_reading_law() of the readings of a table.
 *
 * @param frequency, temperature, regime of every row
 * @param reading which each is, among ln(tan delta) of rows and then ln(modulus) of rows
 * @param quantity, stated_error of each reading
 */
vector table_reading_law(vector parameter, data vector frequency, data vector temperature,
                         data real grain_size, data vector conversion,
                         data array[] int regime, data vector median_stress,
                         data vector amplitude, data array[] int node_end, data matrix node,
                         data array[] int reading, data array[] int quantity,
                         data vector stated_error) {
  vector[2 * num_elements(frequency)] of_rows
    = log_tan_delta_and_modulus(parameter, frequency, temperature, grain_size, conversion,
                                log_fluidity(parameter, temperature, grain_size, regime,
                                             median_stress, amplitude, node_end, node));
  return log_reading_law(parameter, of_rows[reading], quantity, stated_error);
}

/** Log density of one reading, or of what it says where it is an upper limit. */
real log_reading_density(data real observed, data int is_limit, real centre, real spread) {
  return is_limit ? normal_lcdf(observed | centre, spread)
         : normal_lpdf(observed | centre, spread);
}

/** Log density of every reading of a table. */
vector log_reading_densities(data vector observed, data array[] int is_limit, vector law) {
  int n = num_elements(observed);
  vector[n] log_density;
  for (i in 1 : n) {
    log_density[i] = log_reading_density(observed[i], is_limit[i], law[i], law[n + i]);
  }
  return log_density;
}
