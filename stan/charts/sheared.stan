/**
 * Sheared coordinates for oscillating tests: the plain ones, some shifted by what others imply.
 *
 * A shift by a function of other coordinates changes no volume; only the stretch of the flow rate
 * adds to the Jacobian of the plain coordinates. What is shifted, each with the reason:
 *
 * - epsilon_c1 by ln p: data see the hardening by grain growth, about p/epsilon_c1.
 * - The flow rate by multiples of n, of p and of p ln(d/d_0), half way through the record: what
 *   data see is a mean over stresses around the one at which the flow rate is defined, and over
 *   grain sizes after the one at the start. The multiples come from the curvature of the
 *   likelihood at the posterior mode.
 * - E_K and eta_K by what the other elements leave to the Kelvin element of the observed
 *   compliance, the ratio of strain to stress as a complex number. What the dashpot takes follows
 *   from solutions at the mode with other flow rates: a bias that relaxes depends on them too.
 * - beta by what n and p imply: the flow rate fixes Q_M (beta - 1/(R T)), and both factors have
 *   normal priors. Where n and p move that product, beta and Q_M take their most probable share.
 *
 * The last is for normal priors of beta and Q_M. The flow rate is stretched besides: where the
 * dashpot carries next to nothing its logarithm is as wide as the prior, where it carries much (a
 * tenth of the loss or more) the rate itself is what data fix. Where they fix it less well than
 * that, it counts by itself only from the width that they leave to it on. The multiples can be
 * large, so that the flow rate is not shifted at the mode, for which the stretch is made.
 * Parameters stand in the order of physics/parameters.stan.
 */

/** Places in a record: what the shifts want to know of a test. */
int n_record() { return 11; } // logarithms of the dashpot's loss compliance follow
int r_flow_stress() { return 1; } // stress of the flow rate, Pa
int r_storage_compliance() { return 2; } // 1/Pa
int r_loss_compliance() { return 3; } // 1/Pa
int r_period() { return 4; } // s
int r_growth_limit() { return 5; } // piezometer's mean grain size over d_0, less 1
int r_path_strain() { return 6; } // half of the record's
int r_grain_size() { return 7; } // d_0, m
int r_temperature() { return 8; } // stated, K
int r_first_log_rate() { return 9; } // of the dashpot's loss compliances
int r_log_rate_step() { return 10; } // between them
int r_log_rate_scale() { return 11; } // from which on the coordinate is the flow rate itself

/**
 * ln(d/d_0) half way through a record, roughly: the piezometer's grain size is taken as constant.
 *
 * @param growth_limit piezometer's grain size over d_0, less 1
 * @param path_strain half of the record's
 */
real rough_growth(real critical_strain_grain_size, data real growth_limit,
                  data real path_strain) {
  return log_relative_microstructure(path_strain, -growth_limit, 1 / critical_strain_grain_size);
}

/** Derivative of rough_growth() by epsilon_c1. */
real rough_growth_slope(real critical_strain_grain_size, data real growth_limit,
                        data real path_strain) {
  real left = exp(-path_strain / critical_strain_grain_size);
  return -growth_limit * left * path_strain / square(critical_strain_grain_size)
         / (1 + growth_limit * (1 - left));
}

/**
 * Shift of ln(flow rate s).
 *
 * @param parameter only n, p and epsilon_c1 are used
 * @param flow_slope derivatives of the ln(flow rate s) that fits best by n, p and p ln(d/d_0)
 * @param flow_reference n, p and epsilon_c1 where there is no shift
 */
real flow_shift(vector parameter, data vector flow_slope, data vector flow_reference,
                data real growth_limit, data real path_strain) {
  return flow_slope[1] * (parameter[i_stress_exponent()] - flow_reference[1])
         + flow_slope[2] * (parameter[i_grain_size_exponent()] - flow_reference[2])
         + flow_slope[3]
           * (parameter[i_grain_size_exponent()]
              * rough_growth(parameter[i_critical_strain_grain_size()], growth_limit, path_strain)
              - flow_reference[2] * rough_growth(flow_reference[3], growth_limit, path_strain));
}

/**
 * Loss compliance of the dashpot in a record: between solutions, and beyond them, its logarithm is
 * linear in that of the flow rate.
 *
 * @param log_rate ln(flow rate s) without its shift
 * @return 1/Pa
 */
real dashpot_compliance(real log_rate, data vector record) {
  int n_solutions = num_elements(record) - n_record();
  vector[n_solutions] solution = tail(record, n_solutions);
  real place = (log_rate - record[r_first_log_rate()]) / record[r_log_rate_step()];
  int k = 1;
  while (k < n_solutions - 1 && place > k) {
    k += 1;
  }
  return exp(solution[k] + (place - k + 1) * (solution[k + 1] - solution[k]));
}

/** Share of the observed compliance that is left to the Kelvin element at least. */
real least_left_over() { return 0.1; }

/**
 * E_K and eta_K of the Kelvin element that has what is left of the observed compliance.
 *
 * Both parts are kept above a tenth of the observed ones: what is left would fade to nothing within
 * a small change of the flow rate, and the data want no such element there.
 *
 * @param compliance observed storage and loss compliance, 1/Pa
 */
vector kelvin_left_over(real maxwell_modulus, real dashpot, data vector compliance,
                        data real period) {
  real storage = compliance[1] * kept_above(1 - 1 / (maxwell_modulus * compliance[1]),
                                              least_left_over());
  real loss = compliance[2] * kept_above(1 - dashpot / compliance[2], least_left_over());
  return [storage, loss * period / (2 * pi())]' / (square(storage) + square(loss));
}

/**
 * Deviation of beta from its prior mean, in its standard deviations, that is most probable where
 * the flow law passes through a given point.
 *
 * Linear in the deviation of Q_M (beta - 1/(R T)) from its value at the prior means.
 *
 * @param log_rate, log_stress the point: ln(rate s) and ln(stress / Pa)
 * @param enthalpy, beta means and standard deviations of the priors of Q_M and beta
 */
real probable_beta(real log_rate, real stress_exponent, real grain_size_exponent,
                   data real log_stress, data real initial_grain_size, real temperature,
                   data vector enthalpy, data vector beta) {
  real exponent = log_rate + grain_size_exponent * log(initial_grain_size)
                  - stress_exponent * log_stress;
  real slope_of_enthalpy = enthalpy[2] * (beta[1] - 1 / (gas_constant() * temperature));
  real slope_of_beta = beta[2] * enthalpy[1];
  return slope_of_beta * (exponent - log_rate_factor(enthalpy[1], beta[1], temperature))
         / (square(slope_of_enthalpy) + square(slope_of_beta));
}

/**
 * Shifts at given plain coordinates, one for each of a test's own ones.
 *
 * n, p, E_M, the error of the temperature and the numbers of the environment are not shifted;
 * epsilon_c1 needs p; the flow rate needs n, p and epsilon_c1; the others need these.
 *
 * @param plain coordinates
 * @param given values of the parameters that are not the test's own; other entries have no effect
 * @param place of each parameter among the test's own ones, 0 where it is none of them
 * @param quantity a row for each of them (charts/plain.stan)
 * @param replaced_parameter Q_M or beta: the flow rate is sampled in its place; 0: it is given
 * @param location, scale of the priors
 */
vector shears(vector plain, vector given, data array[] int place, data matrix quantity,
              data int replaced_parameter, data vector location, data vector scale,
              data vector flow_slope, data vector flow_reference, data vector record) {
  int flow = replaced_parameter == 0 ? 0 : place[replaced_parameter];
  vector[num_elements(plain)] shifts = rep_vector(0, num_elements(plain));
  vector[num_elements(given)] parameter = given;
  real n;
  real p;
  real log_rate;
  for (k in {i_maxwell_modulus(), i_stress_exponent(), i_grain_size_exponent(),
             i_critical_strain_grain_size(), i_temperature_error(), i_activation_volume(),
             i_water_exponent(), i_melt_factor(), i_kelvin_activation_volume(),
             i_kelvin_water_exponent(), i_kelvin_melt_factor()}) {
    if (place[k] > 0) {
      parameter[k] = bounded_from_real(plain[place[k]], quantity[place[k]]);
    }
  }
  n = parameter[i_stress_exponent()];
  p = parameter[i_grain_size_exponent()];
  if (place[i_critical_strain_grain_size()] > 0 && place[i_grain_size_exponent()] > 0) {
    shifts[place[i_critical_strain_grain_size()]] = log(p);
  }
  if (flow > 0) {
    log_rate = quantity[flow, i_shift()] + quantity[flow, i_scale()] * plain[flow];
    shifts[flow] = flow_shift(parameter, flow_slope, flow_reference, record[r_growth_limit()],
                              record[r_path_strain()])
                   / quantity[flow, i_scale()];
  } else {
    log_rate = log_flow_rate_at(record[r_flow_stress()], record[r_grain_size()],
                                record[r_temperature()], parameter);
  }
  if (replaced_parameter == i_activation_enthalpy() && place[i_beta()] > 0) {
    real at_temperature = true_temperature(parameter, record[r_temperature()]);
    shifts[place[i_beta()]] = probable_beta(
      log_rate - log_environment(parameter, at_temperature, environment_numbers(1)), n, p,
      log(record[r_flow_stress()]), record[r_grain_size()], at_temperature,
      [location[i_activation_enthalpy()], scale[i_activation_enthalpy()]]',
      [location[i_beta()], scale[i_beta()]]');
  }
  if (place[i_kelvin_modulus()] > 0 && place[i_kelvin_viscosity()] > 0) {
    array[2] int i = place[{i_kelvin_modulus(), i_kelvin_viscosity()}];
    real unshifted = log_rate
                     - flow_shift(parameter, flow_slope, flow_reference,
                                  record[r_growth_limit()], record[r_path_strain()]);
    vector[2] kelvin = kelvin_left_over(parameter[i_maxwell_modulus()],
                                        dashpot_compliance(unshifted, record),
                                        record[r_storage_compliance() : r_loss_compliance()],
                                        record[r_period()]);
    kelvin[2] *= exp(log_environment(parameter,
                                     true_temperature(parameter, record[r_temperature()]),
                                     environment_numbers(4)));
    for (k in 1 : 2) {
      shifts[i[k]] = real_from_bounded(kelvin[k], quantity[i[k]]);
    }
  }
  return shifts;
}

/**
 * Plain coordinates at given sheared ones, and ln |d plain/d sheared|.
 *
 * Each pass puts one more link of the chain of shifts right: epsilon_c1, the flow rate, the rest.
 */
vector plain_from_sheared(vector sheared, vector given, data array[] int place,
                          data matrix quantity, data int replaced_parameter,
                          data vector location, data vector scale, data vector flow_slope,
                          data vector flow_reference, data vector record) {
  vector[num_elements(sheared)] unshifted = sheared;
  vector[num_elements(sheared)] plain;
  real log_jacobian = 0;
  if (replaced_parameter > 0) {
    int flow = place[replaced_parameter];
    real rate = log1p_exp(sheared[flow]); // over the scale
    unshifted[flow] = (record[r_log_rate_scale()] + log(rate) - quantity[flow, i_shift()])
                      / quantity[flow, i_scale()];
    log_jacobian = log_inv_logit(sheared[flow]) - log(rate) - log(quantity[flow, i_scale()]);
  }
  plain = unshifted;
  for (pass in 1 : 3) {
    plain = unshifted
            + shears(plain, given, place, quantity, replaced_parameter, location, scale,
                     flow_slope, flow_reference, record);
  }
  return append_row(plain, log_jacobian);
}

/** Sheared coordinates at given plain ones: plain_from_sheared() inverted. */
vector sheared_from_plain(vector plain, vector given, data array[] int place,
                          data matrix quantity, data int replaced_parameter,
                          data vector location, data vector scale, data vector flow_slope,
                          data vector flow_reference, data vector record) {
  vector[num_elements(plain)] sheared
    = plain
      - shears(plain, given, place, quantity, replaced_parameter, location, scale, flow_slope,
               flow_reference, record);
  if (replaced_parameter > 0) {
    int flow = place[replaced_parameter];
    real rate = exp(quantity[flow, i_shift()] + quantity[flow, i_scale()] * sheared[flow]
                    - record[r_log_rate_scale()]);
    sheared[flow] = rate + log1m_exp(-rate); // ln(exp(rate) - 1)
  }
  return sheared;
}
