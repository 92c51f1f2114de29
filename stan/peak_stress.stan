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
#include physics/parameters.stan
#include physics/flow_law.stan
#include statistics/priors.stan
#include charts/plain.stan

  // The parameters of a table: four of the flow law's, and the scatter.
  int n_of_table() { return 5; }
  int t_stress_exponent() { return 1; }
  int t_grain_size_exponent() { return 2; }
  int t_activation_enthalpy() { return 3; }
  int t_beta() { return 4; }
  int t_rate_scatter() { return 5; }

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
  // Priors of n, p, Q_M, beta and the scatter; families as in statistics/priors.stan.
  array[n_of_table()] int<lower=0, upper=3> prior_family;
  vector[n_of_table()] prior_location;
  vector[n_of_table()] prior_scale;
  vector[n_of_table()] prior_lower;
  vector[n_of_table()] prior_upper;
  // Coordinates (charts/plain.stan): one for each free parameter.
  int<lower=0, upper=n_of_table()> n_coordinates;
  array[n_coordinates] int<lower=1, upper=n_of_table()> own_parameter;
  matrix[n_coordinates, 4] quantity; // SI; ln(rate s) for the flow rate
  int<lower=0, upper=n_of_table()> replaced_parameter; // Q_M, beta, or 0: none
  // Conditions at which generated quantities report the flow rate, apart from the observed ones.
  int<lower=0> n_grid;
  vector<lower=0>[n_grid] grid_temperature; // K
  vector<lower=0>[n_grid] grid_stress; // Pa
  vector<lower=0>[n_grid] grid_grain_size; // m
}
transformed data {
  vector[n_points] log_rate_observed = log(strain_rate);
  vector[n_points] stress_variance = square(relative_stress_uncertainty);
  vector[n_of_table()] prior_mass
    = prior_log_masses({prior_family}, {prior_location}, {prior_scale}, {prior_lower},
                       {prior_upper})[1];
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
    vector[n_of_table()] parameter = prior_location;
    for (i in 1 : n_coordinates) {
      parameter[own_parameter[i]] = bounded_from_real(coordinate[i], quantity[i]);
      log_jacobian += log_slope_of_bounded(coordinate[i], quantity[i]);
    }
    stress_exponent = parameter[t_stress_exponent()];
    grain_size_exponent = parameter[t_grain_size_exponent()];
    if (replaced_parameter == t_activation_enthalpy()) {
      parameter[replaced_parameter] = activation_enthalpy_from_flow(
        parameter[replaced_parameter], log(mean_stress), mean_grain_size, mean_temperature,
        stress_exponent, grain_size_exponent, parameter[t_beta()]);
      log_jacobian -= log(1 / (gas_constant() * mean_temperature) - parameter[t_beta()]);
    } else if (replaced_parameter == t_beta()) {
      parameter[replaced_parameter] = beta_from_flow(
        parameter[replaced_parameter], log(mean_stress), mean_grain_size, mean_temperature,
        stress_exponent, grain_size_exponent, parameter[t_activation_enthalpy()]);
      log_jacobian -= log(parameter[t_activation_enthalpy()]);
    }
    lprior = joint_prior_log_density(parameter, prior_family, prior_location, prior_scale,
                                     prior_lower, prior_upper, prior_mass);
    activation_enthalpy = parameter[t_activation_enthalpy()];
    beta = parameter[t_beta()];
    rate_scatter = parameter[t_rate_scatter()];
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
