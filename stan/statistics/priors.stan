/**
 * Prior distributions chosen by data.
 *
 * family 0: fixed (no density), 1: uniform on [lower, upper], 2: normal truncated to
 * [lower, upper] (bounds may be infinite; a half-normal is location 0, lower 0),
 * 3: lognormal with median `location` and standard deviation `scale` of the logarithm,
 * 4: part of the joint prior of the flow law (flow_law_prior_log_density), only bounds here.
 */

/** ln of the mass that truncation leaves; a constant of the data, computed once. */
real prior_log_mass(data int family, data real location, data real scale, data real lower_bound,
                    data real upper_bound) {
  if (family == 2) {
    return log(Phi((upper_bound - location) / scale) - Phi((lower_bound - location) / scale));
  }
  if (family == 1) {
    return log(upper_bound - lower_bound);
  }
  return 0;
}

/** Normalised log density of one parameter, SI units; minus infinity outside its support. */
real prior_log_density(real value, data int family, data real location, data real scale,
                       data real lower_bound, data real upper_bound, data real log_mass) {
  if (family == 0) {
    return 0;
  }
  if (value < lower_bound || value > upper_bound) {
    return negative_infinity();
  }
  if (family == 4) {
    return 0;
  }
  if (family == 1) {
    return -log_mass;
  }
  if (family == 2) {
    return normal_lpdf(value | location, scale) - log_mass;
  }
  if (family == 3) {
    return lognormal_lpdf(value | log(location), scale);
  }
  reject("prior family: found ", family, ", expected a number from 0 to 4");
}

/** ln of the mass that truncation leaves, of every parameter of every test. */
array[] vector prior_log_masses(data array[,] int family, data array[] vector location,
                                data array[] vector scale, data array[] vector lower_bound,
                                data array[] vector upper_bound) {
  array[size(location)] vector[rows(location[1])] log_mass;
  for (e in 1 : size(location)) {
    for (k in 1 : rows(location[e])) {
      log_mass[e][k] = prior_log_mass(family[e, k], location[e][k], scale[e][k],
                                      lower_bound[e][k], upper_bound[e][k]);
    }
  }
  return log_mass;
}

/** Log density of independent priors of a whole parameter vector. */
real joint_prior_log_density(vector parameter, data array[] int family, data vector location,
                             data vector scale, data vector lower_bound, data vector upper_bound,
                             data vector log_mass) {
  real total = 0;
  for (k in 1 : num_elements(parameter)) {
    total += prior_log_density(parameter[k], family[k], location[k], scale[k], lower_bound[k],
                               upper_bound[k], log_mass[k]);
  }
  return total;
}

/**
 * Log density of a joint prior of the flow law, on n, p, Q_M and beta: a normal of n, p,
 * ln(flow rate s) at given conditions, and beta.
 *
 * @param mean of the four quantities
 * @param factor lower Cholesky factor of their covariance
 * @param conditions temperature (K), stress (Pa) and grain size (m) of the flow rate
 */
real flow_law_prior_log_density(real stress_exponent, real grain_size_exponent,
                                real activation_enthalpy, real beta, data vector mean,
                                data matrix factor, data vector conditions) {
  real log_rate = log_flow_rate(conditions[2], conditions[3], conditions[1], stress_exponent,
                                grain_size_exponent, activation_enthalpy, beta);
  return multi_normal_cholesky_lpdf([stress_exponent, grain_size_exponent, log_rate, beta]' |
                                    mean, factor)
         + log(1 / (gas_constant() * conditions[1]) - beta); // |d ln(rate)/d Q_M|
}
