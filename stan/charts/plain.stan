/**
 * Plain coordinates: every free parameter mapped to the whole real line, one by one.
 *
 * One of them is replaced: data fix one point of the flow law tightly while n, p, Q_M and beta
 * stay broad along the surface through it. So the logarithm of the stress at a given rate, or of
 * the rate at a given stress, is sampled in place of Q_M (or of beta, where Q_M is fixed). The
 * prior is still that of Q_M (or beta), evaluated on the value that follows, and the Jacobian is
 * that of the whole map: the posterior is the same one.
 *
 * What a coordinate stands for is a row of numbers, its quantity: shift, scale, lower and upper
 * bound, SI (ln Pa or ln 1/s for the point of the flow law).
 */

/** Places in the row of a quantity. */
int i_shift() { return 1; }

int i_scale() { return 2; }

int i_lower() { return 3; }

int i_upper() { return 4; }

/**
 * A parameter within its bounds from a real number u.
 *
 * Two finite bounds: lower + (upper - lower) inv_logit(u). Only a lower one:
 * lower + scale exp(u). None: shift + scale u.
 */
real bounded_from_real(real u, data row_vector quantity) {
  if (is_inf(quantity[i_lower()])) {
    return quantity[i_shift()] + quantity[i_scale()] * u;
  }
  if (is_inf(quantity[i_upper()])) {
    return quantity[i_lower()] + quantity[i_scale()] * exp(u);
  }
  return quantity[i_lower()] + (quantity[i_upper()] - quantity[i_lower()]) * inv_logit(u);
}

/** x where it is well above a least value, which it nears smoothly from above as x falls. */
real kept_above(real x, data real least) {
  return least * (1 + log1p_exp(x / least - 1));
}

/** Share of the distance of two bounds by which a value is kept above the lower one. */
real least_above_lower() { return 1e-3; }

/** The same below the upper one, where data can ask for more than the bound allows. */
real least_below_upper() { return 0.05; }

/**
 * The real number u of a parameter: bounded_from_real() inverted, but for values near the bounds
 * and beyond them. These are kept within smoothly, the nearer to a bound (by the logarithm) the
 * further they are beyond it.
 */
real real_from_bounded(real value, data row_vector quantity) {
  if (is_inf(quantity[i_lower()])) {
    return (value - quantity[i_shift()]) / quantity[i_scale()];
  }
  if (is_inf(quantity[i_upper()])) {
    return log(kept_above((value - quantity[i_lower()]) / quantity[i_scale()],
                          least_above_lower()));
  }
  real place = (value - quantity[i_lower()]) / (quantity[i_upper()] - quantity[i_lower()]);
  return log(kept_above(place, least_above_lower()))
         - log(kept_above(1 - place, least_below_upper()));
}

/** ln of the derivative of bounded_from_real() with respect to u. */
real log_slope_of_bounded(real u, data row_vector quantity) {
  if (is_inf(quantity[i_lower()])) {
    return log(quantity[i_scale()]);
  }
  if (is_inf(quantity[i_upper()])) {
    return log(quantity[i_scale()]) + u;
  }
  return log(quantity[i_upper()] - quantity[i_lower()]) + log_inv_logit(u) + log1m_inv_logit(u);
}

/**
 * ln(x) at x + ln(x)/width: of an x that data fix where it is well above 1, while below they leave
 * its logarithm as wide as `width`.
 *
 * Newton's method for u + exp(u) = width stretched + ln(width) with u = ln(width x), from a
 * start that is above the root and off by less than 1.
 */
real log_from_stretched(real stretched, data real width) {
  real total = width * stretched + log(width);
  real u = total > 1 ? log(total) : total;
  for (i in 1 : 6) {
    u -= (u + exp(u) - total) / (1 + exp(u));
  }
  return u - log(width);
}

/**
 * Put Q_M or beta in the place of the point of the flow law.
 *
 * @param parameter vector whose entry `replaced_parameter` holds ln(stress / Pa) or ln(rate s)
 * @param replaced_parameter place of Q_M or beta, or 0 where no parameter is replaced
 * @param samples_stress 1: the stress at the rate exp(given) is sampled, 0: the rate at the
 *   stress exp(given)
 * @param given ln(rate s) or ln(stress / Pa)
 * @param temperature stated; the point of the flow law is that at the true one
 * @return parameters, then ln |d(replaced parameter)/d(ln stress or ln rate)|
 */
vector resolve_flow(vector parameter, data int replaced_parameter, data int samples_stress,
                    data real given, data real initial_grain_size, data real temperature) {
  vector[num_elements(parameter)] resolved = parameter;
  real log_slope = 0;
  if (replaced_parameter > 0) {
    real n = parameter[i_stress_exponent()];
    real p = parameter[i_grain_size_exponent()];
    real at_temperature = true_temperature(parameter, temperature);
    real sampled = parameter[replaced_parameter];
    // Of the same material without pressure, water and melt.
    real log_rate = (samples_stress ? given : sampled)
                    - log_environment(parameter, at_temperature, environment_numbers(1));
    real log_stress = samples_stress ? sampled : given;
    if (replaced_parameter == i_activation_enthalpy()) {
      real beta = parameter[i_beta()];
      resolved[replaced_parameter] = activation_enthalpy_from_flow(log_rate, log_stress,
                                                                   initial_grain_size,
                                                                   at_temperature, n, p, beta);
      log_slope = -log(1 / (gas_constant() * at_temperature) - beta);
    } else {
      real activation_enthalpy = parameter[i_activation_enthalpy()];
      resolved[replaced_parameter] = beta_from_flow(log_rate, log_stress, initial_grain_size,
                                                    at_temperature, n, p, activation_enthalpy);
      log_slope = -log(activation_enthalpy);
    }
    if (samples_stress) {
      log_slope += log(n);
    }
  }
  return append_row(resolved, log_slope);
}

/**
 * Physical parameters of a test at given plain coordinates.
 *
 * @param plain real numbers, one for each parameter of the test's own
 * @param own_parameter place of the parameter that each of them stands for
 * @param quantity a row for each of them
 * @param given parameter vector; entries that have a coordinate are overwritten
 * @return parameters in the order of physics/parameters.stan, then ln |d parameter/d plain|
 */
vector parameters_from_plain(vector plain, data array[] int own_parameter, data matrix quantity,
                             vector given, data int replaced_parameter,
                             data int samples_stress, data real given_flow,
                             data real initial_grain_size, data real temperature) {
  int last = num_elements(given) + 1;
  vector[last] mapped;
  vector[last - 1] parameter = given;
  real log_jacobian = 0;
  for (i in 1 : num_elements(plain)) {
    parameter[own_parameter[i]] = bounded_from_real(plain[i], quantity[i]);
    log_jacobian += log_slope_of_bounded(plain[i], quantity[i]);
  }
  mapped = resolve_flow(parameter, replaced_parameter, samples_stress, given_flow,
                        initial_grain_size, temperature);
  mapped[last] += log_jacobian;
  return mapped;
}
