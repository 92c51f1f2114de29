// Flow law from a table of tests at constant strain rate, of which the peak stress is known.
//
// The rate is imposed and the stress is measured. At its peak a test is weaker than undeformed
// material, by the softening s = ln(S_0/peak stress): S_0 is the stress at which undeformed
// material flows at the imposed rate (Maor, Hansen, Jerolmack and Goldsby, Eq. 1 with F = 1 and
// d = d_0; physics/flow_law.stan). With x the distances from the mean conditions of the table in
// ln(strain rate), ln(peak stress) and ln(grain size),
//
//   ln(peak stress) = ln S_0 - s + scatter,
//   s = h_1 + h_2 x_rate + h_3 x_stress + h_4 x_grain_size,
//
// and [ln h_1, h_2/h_1, ln(h_3/h_1), h_4/h_1] is normal about values linear in ln n and ln p, as
// the priors of a curve have it by simulation (peaks.stan). The scatter, between tests, is that of
// the stress; its known relative uncertainty u adds the variance u^2.
//
// All values are SI. In place of Q_M, or of beta where Q_M cannot be replaced, what the table fixes
// is sampled: ln(flow rate) at the mean conditions plus n h_1, which is about the mean of ln(strain
// rate), whatever the softening. The priors are still those of Q_M and beta.
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
  int t_stress_scatter() { return 5; }

#include statistics/softening.stan

  /**
   * ln(peak stress/Pa), which the softening depends on and which depends on the softening.
   *
   * @param log_reference ln(S_0/Pa)
   * @param softening value of softening_at()
   * @param rate_shift, grain_size_shift of the logarithms from the mean conditions
   */
  vector log_peak_stress(vector log_reference, vector softening, data vector rate_shift,
                         data vector grain_size_shift, data real mean_stress) {
    real mean_log_stress = log(mean_stress);
    return mean_log_stress
           + (log_reference - mean_log_stress - softening[h_mean()]
              - softening[h_rate()] * rate_shift
              - softening[h_grain_size()] * grain_size_shift)
             / (1 + softening[h_stress()]);
  }

  /**
   * ln(rate s) at which the peak has a given stress: log_peak_stress() solved for the rate.
   *
   * @param log_rate ln(rate s) at which undeformed material flows at the stress
   * @param stress_shift, grain_size_shift of the logarithms from the mean conditions
   */
  real log_rate_of_peak(real log_rate, real stress_exponent, vector softening,
                        data real stress_shift, data real grain_size_shift,
                        data real mean_log_rate) {
    // ln S_0 = ln(stress) + (ln(rate) - log_rate)/n
    real missing = softening[h_mean()] + softening[h_stress()] * stress_shift
                   + softening[h_grain_size()] * grain_size_shift
                   - softening[h_rate()] * mean_log_rate;
    return (log_rate + stress_exponent * missing)
           / (1 - stress_exponent * softening[h_rate()]);
  }
}
data {
  int<lower=1> n_points;
  vector<lower=0>[n_points] temperature; // K
  vector<lower=0>[n_points] stress; // at the peak, Pa
  vector<lower=0>[n_points] strain_rate; // 1/s
  vector<lower=0>[n_points] grain_size; // at the start, m
  vector<lower=0>[n_points] relative_stress_uncertainty; // 0: only the scatter
  real<lower=0> mean_temperature; // K, harmonic mean
  real<lower=0> mean_stress; // Pa, geometric mean
  real<lower=0> mean_strain_rate; // 1/s, geometric mean
  real<lower=0> mean_grain_size; // m, geometric mean
  int<lower=0, upper=1> use_likelihood; // 0: prior only
  // Priors of n, p, Q_M, beta and the scatter; families as in statistics/priors.stan.
  array[n_of_table()] int<lower=0, upper=3> prior_family;
  vector[n_of_table()] prior_location;
  vector[n_of_table()] prior_scale;
  vector[n_of_table()] prior_lower;
  vector[n_of_table()] prior_upper;
  // Prior of the softening, see softening_at().
  matrix[n_softening(), 3] softening_coefficients;
  vector[2] softening_centre; // ln n, ln p
  matrix[n_softening(), n_softening()] softening_factor;
  // Coordinates (charts/plain.stan): one for each free parameter.
  int<lower=0, upper=n_of_table()> n_coordinates;
  array[n_coordinates] int<lower=1, upper=n_of_table()> own_parameter;
  matrix[n_coordinates, 4] quantity; // SI; ln(rate s) for the flow rate
  int<lower=0, upper=n_of_table()> replaced_parameter; // Q_M, beta, or 0: none
  // Conditions at which generated quantities report rates, apart from the observed ones.
  int<lower=0> n_grid;
  vector<lower=0>[n_grid] grid_temperature; // K
  vector<lower=0>[n_grid] grid_stress; // Pa
  vector<lower=0>[n_grid] grid_grain_size; // m
}
transformed data {
  vector[n_points] log_stress = log(stress);
  vector[n_points] rate_shift = log(strain_rate) - log(mean_strain_rate);
  vector[n_points] grain_size_shift = log(grain_size) - log(mean_grain_size);
  vector[n_of_table()] prior_mass
    = prior_log_masses({prior_family}, {prior_location}, {prior_scale}, {prior_lower},
                       {prior_upper})[1];
}
parameters {
  vector[n_coordinates] coordinate;
  vector[n_softening()] softening_coordinate;
}
transformed parameters {
  real stress_exponent;
  real grain_size_exponent;
  real activation_enthalpy;
  real beta;
  real stress_scatter; // standard deviation of ln(peak stress)
  real reference_flow_rate; // at the mean conditions, 1/s
  vector[n_softening()] softening;
  vector[n_points] log_stress_model; // without scatter
  vector[n_points] deviation; // of ln(peak stress)
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
    softening = softening_at(softening_coordinate, stress_exponent, grain_size_exponent,
                             softening_coefficients, softening_centre, softening_factor);
    if (replaced_parameter > 0) {
      parameter[replaced_parameter] -= stress_exponent * softening[h_mean()];
    }
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
    stress_scatter = parameter[t_stress_scatter()];
  }
  reference_flow_rate = exp(log_flow_rate(mean_stress, mean_grain_size, mean_temperature,
                                          stress_exponent, grain_size_exponent,
                                          activation_enthalpy, beta));
  {
    vector[n_points] log_reference;
    for (i in 1 : n_points) {
      log_reference[i] = log_reference_stress(strain_rate[i], grain_size[i], temperature[i],
                                              stress_exponent, grain_size_exponent,
                                              activation_enthalpy, beta);
    }
    log_stress_model = log_peak_stress(log_reference, softening, rate_shift, grain_size_shift,
                                       mean_stress);
  }
  deviation = sqrt(square(stress_scatter) + square(relative_stress_uncertainty));
}
model {
  target += lprior + log_jacobian;
  target += std_normal_lpdf(softening_coordinate);
  if (use_likelihood) {
    target += normal_lpdf(log_stress | log_stress_model, deviation);
  }
}
generated quantities {
  real peak_softening = softening[h_mean()]; // ln(S_0/peak stress) at the mean conditions
  // ln(flow rate s) at the mean conditions of another test of the same scatter
  real log_flow_rate_of_test = log(reference_flow_rate)
                               + stress_exponent * normal_rng(0, stress_scatter);
  vector[n_points] log_lik; // of ln(peak stress)
  vector[n_points] log_stress_replicated;
  vector[n_grid] grid_strain_rate; // at which undeformed material flows, 1/s
  vector[n_grid] grid_peak_strain_rate; // at which the stress is that of the peak, 1/s
  for (i in 1 : n_points) {
    log_lik[i] = normal_lpdf(log_stress[i] | log_stress_model[i], deviation[i]);
    log_stress_replicated[i] = normal_rng(log_stress_model[i], deviation[i]);
  }
  for (i in 1 : n_grid) {
    real log_rate = log_flow_rate(grid_stress[i], grid_grain_size[i], grid_temperature[i],
                                  stress_exponent, grain_size_exponent, activation_enthalpy,
                                  beta);
    grid_strain_rate[i] = exp(log_rate);
    grid_peak_strain_rate[i]
      = exp(log_rate_of_peak(log_rate, stress_exponent, softening,
                             log(grid_stress[i]) - log(mean_stress),
                             log(grid_grain_size[i]) - log(mean_grain_size),
                             log(mean_strain_rate)));
  }
}
