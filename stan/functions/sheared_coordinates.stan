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
 *   compliance, the ratio of strain to stress as a complex number.
 * - beta by what n and p imply: the flow rate fixes Q_M (beta - 1/(R T)), and both factors have
 *   normal priors. Where n and p move that product, beta and Q_M take their most probable share.
 *
 * The last is for normal priors of beta and Q_M. The flow rate is stretched besides: where the
 * dashpot carries next to nothing its logarithm is as wide as the prior, where it carries much the
 * rate itself is what data fix. The multiples can be large, so that the flow rate is not shifted at
 * the mode, for which the stretch is made. Parameters stand in the order of
 * functions/parameters.stan.
 */

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

/**
 * Derivative of rough_growth() by epsilon_c1.
 */
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
  return flow_slope[1] * (parameter[4] - flow_reference[1])
         + flow_slope[2] * (parameter[5] - flow_reference[2])
         + flow_slope[3]
           * (parameter[5] * rough_growth(parameter[10], growth_limit, path_strain)
              - flow_reference[2] * rough_growth(flow_reference[3], growth_limit, path_strain));
}

/**
 * Compliance of a power-law dashpot at the fundamental of an oscillating stress.
 *
 * Mean over a cycle of the rate times sin(theta), times 2/amplitude (the describing function),
 * over the angular frequency.
 *
 * @param rate_at_scale strain rate at the stress `stress_scale`
 * @param bias, amplitude of the stress, Pa
 * @return 1/Pa
 */
real dashpot_compliance(real rate_at_scale, real stress_exponent, data real stress_scale,
                        data real bias, data real amplitude, data real period) {
  int n_angles = 24;
  real total = 0;
  for (i in 1 : n_angles) {
    real angle = 2 * pi() * (i - 0.5) / n_angles;
    total += sin(angle)
             * scaled_dashpot_rate((bias + amplitude * sin(angle)) / stress_scale,
                                   stress_exponent, 0);
  }
  return rate_at_scale * 2 * total / (n_angles * amplitude) * period / (2 * pi());
}

/**
 * E_K and eta_K of the Kelvin element that has what is left of the observed compliance.
 *
 * Both parts of what is left are kept positive: they follow 1 - x down to small values and fade
 * from there on.
 *
 * @param compliance observed storage and loss compliance, 1/Pa
 * @param dashpot value of dashpot_compliance()
 */
vector kelvin_left_over(real maxwell_modulus, real dashpot, data vector compliance,
                        data real period) {
  real storage = compliance[1] * log1p_exp(8 * (1 - 1 / (maxwell_modulus * compliance[1]))) / 8;
  real loss = compliance[2] * log1p_exp(8 * (1 - dashpot / compliance[2])) / 8;
  return [storage, loss * period / (2 * pi())]' / (square(storage) + square(loss));
}

/**
 * Deviation of beta from its prior mean, in its standard deviations, that is most probable where
 * the flow law passes through a given point.
 *
 * Linear in the deviation of Q_M (beta - 1/(R T)) from its value at the prior means.
 *
 * @param log_rate, log_stress the point: ln(rate s) and ln(stress / Pa)
 * @param location, scale means and standard deviations of the priors
 */
real probable_beta(real log_rate, real stress_exponent, real grain_size_exponent,
                   data real log_stress, data real initial_grain_size, data real temperature,
                   data vector location, data vector scale) {
  real exponent = log_rate + grain_size_exponent * log(initial_grain_size)
                  - stress_exponent * log_stress;
  real slope_of_enthalpy = scale[6] * (location[7] - 1 / (gas_constant() * temperature));
  real slope_of_beta = scale[7] * location[6];
  return slope_of_beta * (exponent - log_rate_factor(location[6], location[7], temperature))
         / (square(slope_of_enthalpy) + square(slope_of_beta));
}

/**
 * Shifts at given plain coordinates, one for each.
 *
 * n, p and E_M are not shifted; epsilon_c1 needs p; the flow rate needs n, p and epsilon_c1; the
 * others need these.
 *
 * @param plain coordinates
 * @param coordinate_of position of each parameter among the coordinates, 0 where fixed
 * @param shift, scale, lower_bound, upper_bound of the plain coordinates
 * @param replaced_parameter 6 or 7: the flow rate is sampled in place of Q_M or of beta
 * @param prior_location, prior_scale of the parameters; a fixed one has its value as location
 * @param flow_slope, flow_reference see flow_shift()
 * @param record stress of the flow rate (Pa), bias and amplitude of the stress (Pa), storage and
 *   loss compliance (1/Pa), period (s), growth_limit, path_strain, d_0 (m), temperature (K)
 */
vector shears(vector plain, data array[] int coordinate_of, data vector shift, data vector scale,
              data vector lower_bound, data vector upper_bound, data int replaced_parameter,
              data vector prior_location, data vector prior_scale, data vector flow_slope,
              data vector flow_reference, data vector record) {
  vector[num_elements(plain)] shifts = rep_vector(0, num_elements(plain));
  vector[n_parameters()] parameter = prior_location;
  int flow = coordinate_of[replaced_parameter];
  real log_rate = shift[flow] + scale[flow] * plain[flow];
  for (k in {1, 4, 5, 10}) {
    if (coordinate_of[k] > 0) {
      int i = coordinate_of[k];
      parameter[k] = bounded_from_real(plain[i], shift[i], scale[i], lower_bound[i],
                                       upper_bound[i]);
    }
  }
  if (coordinate_of[10] > 0 && coordinate_of[5] > 0) {
    shifts[coordinate_of[10]] = log(parameter[5]);
  }
  shifts[flow] = flow_shift(parameter, flow_slope, flow_reference, record[7], record[8])
                 / scale[flow];
  if (replaced_parameter == 6 && coordinate_of[7] > 0) {
    shifts[coordinate_of[7]] = probable_beta(log_rate, parameter[4], parameter[5],
                                             log(record[1]), record[9], record[10],
                                             prior_location, prior_scale);
  }
  if (coordinate_of[2] > 0 && coordinate_of[3] > 0) {
    real log_typical_rate = log_rate
                            - parameter[5]
                              * rough_growth(parameter[10], record[7], record[8]);
    real dashpot = dashpot_compliance(exp(log_typical_rate), parameter[4], record[1],
                                      record[2], record[3], record[6]);
    vector[2] kelvin = kelvin_left_over(parameter[1], dashpot, record[4 : 5], record[6]);
    for (k in 2 : 3) {
      int i = coordinate_of[k];
      shifts[i] = real_from_bounded(kelvin[k - 1], shift[i], scale[i], lower_bound[i],
                                    upper_bound[i]);
    }
  }
  return shifts;
}

/**
 * ln of the flow rate from which on the stretched coordinate is the rate and not its logarithm:
 * that of a dashpot with a tenth of the observed loss compliance.
 *
 * @param flow_reference, record see shears()
 */
real log_rate_scale(data vector flow_reference, data vector record) {
  return log(0.1 * record[5]
             / dashpot_compliance(1, flow_reference[1], record[1], record[2], record[3],
                                  record[6]))
         + flow_reference[2] * rough_growth(flow_reference[3], record[7], record[8]);
}

/**
 * Plain coordinates at given sheared ones, and ln |d plain/d sheared|.
 *
 * Each pass puts one more link of the chain of shifts right: epsilon_c1, the flow rate, the rest.
 *
 * @param arguments as those of shears()
 */
vector plain_from_sheared(vector sheared, data array[] int coordinate_of, data vector shift,
                          data vector scale, data vector lower_bound, data vector upper_bound,
                          data int replaced_parameter, data vector prior_location,
                          data vector prior_scale, data vector flow_slope,
                          data vector flow_reference, data vector record) {
  int flow = coordinate_of[replaced_parameter];
  real rate = log1p_exp(sheared[flow]); // over the scale
  vector[num_elements(sheared)] unshifted = sheared;
  vector[num_elements(sheared)] plain;
  unshifted[flow] = (log_rate_scale(flow_reference, record) + log(rate) - shift[flow])
                    / scale[flow];
  plain = unshifted;
  for (pass in 1 : 3) {
    plain = unshifted
            + shears(plain, coordinate_of, shift, scale, lower_bound, upper_bound,
                     replaced_parameter, prior_location, prior_scale, flow_slope,
               flow_reference, record);
  }
  return append_row(plain, log_inv_logit(sheared[flow]) - log(rate) - log(scale[flow]));
}

/**
 * Sheared coordinates at given plain ones: plain_from_sheared() inverted.
 */
vector sheared_from_plain(vector plain, data array[] int coordinate_of, data vector shift,
                          data vector scale, data vector lower_bound, data vector upper_bound,
                          data int replaced_parameter, data vector prior_location,
                          data vector prior_scale, data vector flow_slope,
                          data vector flow_reference, data vector record) {
  int flow = coordinate_of[replaced_parameter];
  vector[num_elements(plain)] sheared
    = plain
      - shears(plain, coordinate_of, shift, scale, lower_bound, upper_bound,
               replaced_parameter, prior_location, prior_scale, flow_slope,
                     flow_reference, record);
  {
    real rate = exp(shift[flow] + scale[flow] * sheared[flow]
                    - log_rate_scale(flow_reference, record));
    sheared[flow] = rate + log1m_exp(-rate); // ln(exp(rate) - 1)
  }
  return sheared;
}
