/**
 * Plain coordinates: every free parameter mapped to the whole real line, one by one.
 *
 * One of them is replaced: data fix one point of the flow law tightly while n, p, Q_M and beta
 * stay broad along the surface through it. So the logarithm of the stress at a given rate, or of
 * the rate at a given stress, is sampled in place of Q_M (or of beta, where Q_M is fixed). The
 * prior is still that of Q_M (or beta), evaluated on the value that follows, and the Jacobian is
 * that of the whole map: the posterior is the same one.
 */

/**
 * A parameter within its bounds from a real number u.
 *
 * Two finite bounds: lower + (upper - lower) inv_logit(u). Only a lower one:
 * lower + scale exp(u). None: shift + scale u.
 */
real bounded_from_real(real u, data real shift, data real scale, data real lower_bound,
                       data real upper_bound) {
  if (is_inf(lower_bound)) {
    return shift + scale * u;
  }
  if (is_inf(upper_bound)) {
    return lower_bound + scale * exp(u);
  }
  return lower_bound + (upper_bound - lower_bound) * inv_logit(u);
}

/**
 * The real number u of a parameter: bounded_from_real() inverted.
 *
 * A value outside the bounds counts as one within them by a thousandth of their distance.
 */
real real_from_bounded(real value, data real shift, data real scale, data real lower_bound,
                       data real upper_bound) {
  if (is_inf(lower_bound)) {
    return (value - shift) / scale;
  }
  if (is_inf(upper_bound)) {
    return log(fmax(value - lower_bound, 1e-3 * scale) / scale);
  }
  return logit(fmin(fmax((value - lower_bound) / (upper_bound - lower_bound), 1e-3), 0.999));
}

/**
 * ln of the derivative of bounded_from_real() with respect to u.
 */
real log_slope_of_bounded(real u, data real scale, data real lower_bound,
                          data real upper_bound) {
  if (is_inf(lower_bound)) {
    return log(scale);
  }
  if (is_inf(upper_bound)) {
    return log(scale) + u;
  }
  return log(upper_bound - lower_bound) + log_inv_logit(u) + log1m_inv_logit(u);
}

/**
 * Put Q_M (6) or beta (7) in the place of the point of the flow law.
 *
 * @param parameter vector whose entry `replaced_parameter` holds ln(stress / Pa) or ln(rate s)
 * @param replaced_parameter 6, 7, or 0 where no parameter is replaced
 * @param samples_stress 1: the stress at the rate exp(given) is sampled, 0: the rate at the
 *   stress exp(given)
 * @param given ln(rate s) or ln(stress / Pa)
 */
vector resolve_flow(vector parameter, data int replaced_parameter, data int samples_stress,
                    data real given, data real initial_grain_size, data real temperature) {
  vector[num_elements(parameter)] resolved = parameter;
  if (replaced_parameter > 0) {
    real sampled = parameter[replaced_parameter];
    real log_rate = samples_stress ? given : sampled;
    real log_stress = samples_stress ? sampled : given;
    if (replaced_parameter == 6) {
      resolved[6] = activation_enthalpy_from_flow(log_rate, log_stress, initial_grain_size,
                                                  temperature, parameter[4], parameter[5],
                                                  parameter[7]);
    } else {
      resolved[7] = beta_from_flow(log_rate, log_stress, initial_grain_size, temperature,
                                   parameter[4], parameter[5], parameter[6]);
    }
  }
  return resolved;
}

/**
 * ln |d(replaced parameter)/d(ln stress)|, or by ln rate.
 *
 * @param parameter resolved parameters
 */
real log_slope_of_replaced(vector parameter, data int replaced_parameter,
                           data int samples_stress, data real temperature) {
  real log_slope = 0;
  if (replaced_parameter == 6) {
    log_slope -= log(1 / (gas_constant() * temperature) - parameter[7]);
  } else if (replaced_parameter == 7) {
    log_slope -= log(parameter[6]);
  }
  if (replaced_parameter > 0 && samples_stress) {
    log_slope += log(parameter[4]);
  }
  return log_slope;
}

/**
 * Physical parameters at given plain coordinates.
 *
 * @param coordinate real numbers, one for each free parameter
 * @param parameter_of_coordinate index of the parameter that each coordinate stands for
 * @param shift, scale, lower_bound, upper_bound of each coordinate's quantity, SI (ln Pa or
 *   ln 1/s for the point of the flow law)
 * @param fixed_value parameter vector; entries that have a coordinate are overwritten, and those
 *   shared with another test (functions/pooling.stan) have their values
 * @param replaced_parameter, samples_stress, given see resolve_flow()
 * @return parameters in the order of functions/parameters.stan, then ln |d parameter/d
 *   coordinate|
 */
vector parameters_from_plain(vector coordinate, data array[] int parameter_of_coordinate,
                             data vector shift, data vector scale, data vector lower_bound,
                             data vector upper_bound, vector fixed_value,
                             data int replaced_parameter, data int samples_stress,
                             data real given, data real initial_grain_size,
                             data real temperature) {
  vector[n_parameters()] parameter = fixed_value;
  real log_jacobian = 0;
  for (i in 1 : num_elements(coordinate)) {
    parameter[parameter_of_coordinate[i]] = bounded_from_real(coordinate[i], shift[i],
                                                              scale[i], lower_bound[i],
                                                              upper_bound[i]);
    log_jacobian += log_slope_of_bounded(coordinate[i], scale[i], lower_bound[i],
                                         upper_bound[i]);
  }
  parameter = resolve_flow(parameter, replaced_parameter, samples_stress, given,
                           initial_grain_size, temperature);
  log_jacobian += log_slope_of_replaced(parameter, replaced_parameter, samples_stress,
                                        temperature);
  return append_row(parameter, log_jacobian);
}
