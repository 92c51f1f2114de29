// Flow law from a table of tests, one point (temperature, stress, strain rate, grain size) each:
// undeformed material flows at the imposed rate under the peak stress (Maor, Hansen, Jerolmack and
// Goldsby, Eq. 1 with F = 1 and d = d_0), so that
//
//   ln(strain rate) = n ln(stress) - p ln(grain size) + Q_M (beta - 1/(R T)) + scatter.
//
// A known relative uncertainty u of a stress adds the variance (n u)^2: first order in u.
//
// All values are SI. The logarithm of the flow rate at the mean conditions of the table is sampled
// in place of Q_M, or of beta where Q_M cannot be replaced: the table fixes it tightly, and it is
// nearly independent of n and p. The priors are still those of Q_M and beta.
functions {
#include functions/parameters.stan
#include functions/flow_law.stan
#include functions/priors.stan
#include functions/coordinates.stan

  /**
   * ln(strain rate s) of every point, see log_flow_rate().
   */
  vector log_flow_rates(data vector stress, data vector grain_size, data vector temperature,
                        real stress_exponent, real grain_size_exponent,
                        real activation_enthalpy, real beta) {
    int n = num_elements(stress);
    vector[n] log_rate;
    for (i in 1 : n) {
      log_rate[i] = log_flow_rate(stress[i], grain_size[i], temperature[i], stress_exponent,
                                  grain_size_exponent, activation_enthalpy, beta);
    }
    return log_rate;
  }
}
data {
  int<lower=1> n_points;
  vector<lower=0>[n_points] temperature; // K
  vector<lower=0>[n_points] stress; // Pa
  vector<lower=0>[n_points] strain_rate; // 1/s
  vector<lower=0>[n_points] grain_size; // m
  vector<lower=0>[n_points] relative_stress_uncertainty; // 0: the stress is known exactly
  real<lower=0> mean_temperature; // K, harmonic mean
  real<lower=0> mean_stress; // Pa, geometric mean
  real<lower=0> mean_grain_size; // m, geometric mean
  int<lower=0, upper=1> use_likelihood; // 0: prior only
  // Priors of n, p, Q_M, beta and the scatter; families as in functions/priors.stan.
  array[5] int<lower=0, upper=3> prior_family;
  vector[5] prior_location;
  vector[5] prior_scale;
  vector[5] prior_lower;
  vector[5] prior_upper;
  // Coordinates (functions/coordinates.stan): one for each free parameter.
  int<lower=0, upper=5> n_coordinates;
  array[n_coordinates] int<lower=1, upper=5> parameter_of_coordinate;
  vector[n_coordinates] quantity_shift; // SI; ln(rate s) for the flow rate
  vector[n_coordinates] quantity_scale;
  vector[n_coordinates] quantity_lower;
  vector[n_coordinates] quantity_upper;
  int<lower=0, upper=4> replaced_parameter; // 3: Q_M, 4: beta, 0: none
  // Conditions at which generated quantities report the flow rate, apart from the observed ones.
  int<lower=0> n_grid;
  vector<lower=0>[n_grid] grid_temperature; // K
  vector<lower=0>[n_grid] grid_stress; // Pa
  vector<lower=0>[n_grid] grid_grain_size; // m
}
transformed data {
  vector[n_points] log_rate_observed = log(strain_rate);
  vector[n_points] stress_variance = square(relative_stress_uncertainty);
  vector[5] prior_mass;
  for (k in 1 : 5) {
    prior_mass[k] = prior_log_mass(prior_family[k], prior_location[k], prior_scale[k],
                                   prior_lower[k], prior_upper[k]);
  }
}
parameters {
  vector[n_coordinates] coordinate;
}
transformed parameters {
  real stress_exponent;
  real grain_size_exponent;
  real activation_enthalpy;
  real beta;
  real rate_scatter; // standard deviation of ln(strain rate)
  real reference_flow_rate; // at the mean conditions, 1/s
  real lprior; // log density of the priors on the physical parameters
  real log_jacobian = 0; // ln |d(physical parameters)/d(coordinates)|
  {
    vector[5] parameter = prior_location;
    for (i in 1 : n_coordinates) {
      parameter[parameter_of_coordinate[i]] = bounded_from_real(coordinate[i], quantity_shift[i],
                                                                quantity_scale[i],
                                                                quantity_lower[i],
                                                                quantity_upper[i]);
      log_jacobian += log_slope_of_bounded(coordinate[i], quantity_scale[i], quantity_lower[i],
                                           quantity_upper[i]);
    }
    if (replaced_parameter == 3) {
      parameter[3] = activation_enthalpy_from_flow(parameter[3], log(mean_stress),
                                                   mean_grain_size, mean_temperature,
                                                   parameter[1], parameter[2], parameter[4]);
      log_jacobian -= log(1 / (gas_constant() * mean_temperature) - parameter[4]);
    } else if (replaced_parameter == 4) {
      parameter[4] = beta_from_flow(parameter[4], log(mean_stress), mean_grain_size,
                                    mean_temperature, parameter[1], parameter[2], parameter[3]);
      log_jacobian -= log(parameter[3]);
    }
    lprior = joint_prior_log_density(parameter, prior_family, prior_location, prior_scale,
                                     prior_lower, prior_upper, prior_mass);
    stress_exponent = parameter[1];
    grain_size_exponent = parameter[2];
    activation_enthalpy = parameter[3];
    beta = parameter[4];
    rate_scatter = parameter[5];
  }
  reference_flow_rate = exp(log_flow_rate(mean_stress, mean_grain_size, mean_temperature,
                                          stress_exponent, grain_size_exponent,
                                          activation_enthalpy, beta));
}
model {
  target += lprior + log_jacobian;
  if (use_likelihood) {
    target += normal_lpdf(log_rate_observed |
                          log_flow_rates(stress, grain_size, temperature, stress_exponent,
                                         grain_size_exponent, activation_enthalpy, beta),
                          sqrt(square(rate_scatter)
                               + square(stress_exponent) * stress_variance));
  }
}
generated quantities {
  vector[n_points] log_lik; // of ln(strain rate)
  vector[n_points] log_rate_replicated;
  vector[n_grid] grid_strain_rate; // 1/s
  {
    vector[n_points] log_rate = log_flow_rates(stress, grain_size, temperature, stress_exponent,
                                               grain_size_exponent, activation_enthalpy, beta);
    vector[n_points] deviation = sqrt(square(rate_scatter)
                                      + square(stress_exponent) * stress_variance);
    for (i in 1 : n_points) {
      log_lik[i] = normal_lpdf(log_rate_observed[i] | log_rate[i], deviation[i]);
      log_rate_replicated[i] = normal_rng(log_rate[i], deviation[i]);
    }
  }
  grid_strain_rate = exp(log_flow_rates(grid_stress, grid_grain_size, grid_temperature,
                                        stress_exponent, grain_size_exponent,
                                        activation_enthalpy, beta));
}
