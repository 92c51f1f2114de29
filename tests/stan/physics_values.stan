// Values of the constitutive functions and of the densities of residuals and priors, for tests.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/environment.stan
#include physics/kelvin_laws.stan
#include physics/relaxation.stan
#include physics/composite_law.stan
#include physics/dashpot_mechanisms.stan
#include physics/stress_cycles.stan
#include physics/microstructure.stan
#include statistics/residuals.stan
#include statistics/priors.stan
}
data {
  real<lower=0> temperature;
  real<lower=0> initial_grain_size;
  real<lower=0> strain_rate;
  real stress_exponent;
  real grain_size_exponent;
  real activation_enthalpy;
  real beta;
  int<lower=0> n_stresses;
  vector[n_stresses] stress;
  real<lower=0> grain_size;
  real<lower=0> fabric_factor;
  real<lower=0> steady_state;
  real<lower=0> critical_strain;
  int<lower=0> n_path_strains;
  vector[n_path_strains] path_strain;
  int<lower=1> n;
  vector[n] strain;
  array[n] int segment;
  vector[n] residual;
  real<lower=0> stress_noise;
  real<lower=0> correlation_strain;
  real<lower=0> correlated_share;
  int<lower=0> n_replications;
  real<lower=0> viscosity;
  real<lower=0> kelvin_stress_exponent;
  real kelvin_activation_enthalpy;
  real<lower=0> reference_stress;
  real<lower=0> reference_temperature;
  int<lower=0> n_driving;
  vector[n_driving] driving_stress;
  int prior_family;
  // Fluidity of the dashpot under stress cycles.
  int<lower=0> n_cycles;
  vector[n_cycles] median_stress;
  vector[n_cycles] amplitude;
  vector[n_cycles] cyclic_exponent;
  vector[n_cycles] breakdown_stress;
  int<lower=0> n_nodes;
  array[n_cycles] matrix[n_nodes, 2] node; // rows of 0 behind those of a case
  // Compliance of the Kelvin part.
  int<lower=0> n_rows;
  vector<lower=0>[n_rows] angular_frequency; // rad/s
  vector<lower=0>[n_rows] row_temperature; // K
  vector<lower=0>[n_rows] row_grain_size; // m
  array[n_rows] vector[n_parameters()] parameter;
}
transformed data {
  // Here a refusal stops the program.
  real density_of_prior = prior_log_density(2, prior_family, 3, 0.5, 1, 4,
                                            prior_log_mass(prior_family, 3, 0.5, 1, 4));
}
generated quantities {
  vector[n_stresses] dashpot_rate;
  real prior_density = density_of_prior;
  vector[n_stresses] preferred_grain_size; // by the piezometer
  real log_s0 = log_reference_stress(strain_rate, initial_grain_size, temperature,
                                     stress_exponent, grain_size_exponent, activation_enthalpy,
                                     beta);
  real rate_at_reference_stress
    = dashpot_strain_rate(exp(log_s0), initial_grain_size, 1, stress_exponent,
                          grain_size_exponent,
                          log_rate_factor(activation_enthalpy, beta, temperature));
  real activation_enthalpy_back
    = activation_enthalpy_from_flow(log(strain_rate), log_s0, initial_grain_size, temperature,
                                    stress_exponent, grain_size_exponent, beta);
  real log_rate_at_reference_stress = log_flow_rate(exp(log_s0), initial_grain_size, temperature,
                                                    stress_exponent, grain_size_exponent,
                                                    activation_enthalpy, beta);
  real beta_back = beta_from_flow(log(strain_rate), log_s0, initial_grain_size, temperature,
                                  stress_exponent, grain_size_exponent, activation_enthalpy);
  vector[n_path_strains] grain_size_at;
  vector[n_path_strains] grain_size_rate; // 1/s, at strain_rate
  vector[n_path_strains] grain_size_rate_reversed; // at -strain_rate
  vector[n_path_strains] log_relative_grain_size;
  for (i in 1 : n_stresses) {
    dashpot_rate[i] = dashpot_strain_rate(stress[i], grain_size, fabric_factor, stress_exponent,
                                          grain_size_exponent,
                                          log_rate_factor(activation_enthalpy, beta,
                                                          temperature));
    preferred_grain_size[i] = piezometer_grain_size(stress[i], 0.015, 1.33, 1e6);
  }
  for (i in 1 : n_path_strains) {
    grain_size_at[i] = microstructure_at(path_strain[i], initial_grain_size, steady_state,
                                         critical_strain);
    grain_size_rate[i] = microstructure_rate(grain_size_at[i], steady_state, critical_strain,
                                             strain_rate);
    grain_size_rate_reversed[i] = microstructure_rate(grain_size_at[i], steady_state,
                                                      critical_strain, -strain_rate);
    log_relative_grain_size[i] = log_relative_microstructure(path_strain[i],
                                                             1
                                                             - steady_state
                                                               / initial_grain_size,
                                                             1 / critical_strain);
  }
  matrix[n, 2] log_densities // given those before, and given all others
    = log_densities_of_residuals(residual, stress_noise, 1, strain, segment, correlation_strain,
                                 correlated_share);
  array[n_replications] vector[n] replicated;
  vector[n_driving] kelvin_rate;
  vector[n_cycles] log_fluidity;
  vector[n_cycles] log_fluidity_by_nodes;
  matrix[n_rows, 2] compliance; // storage and loss, 1/Pa
  for (i in 1 : n_replications) {
    replicated[i] = residuals_rng(strain, segment, stress_noise, correlation_strain,
                                  correlated_share);
  }
  for (i in 1 : n_driving) {
    kelvin_rate[i] = linear_driving_stress(driving_stress[i], i_kelvin_stress_exponent(),
                                           kelvin_stress_exponent, -log(reference_stress))
                     / (viscosity
                        * exp(log_thermal_slowing(kelvin_activation_enthalpy, temperature,
                                                  reference_temperature)));
  }
  for (i in 1 : n_cycles) {
    log_fluidity[i] = log_fluidity_of_stress(median_stress[i], amplitude[i], cyclic_exponent[i],
                                             breakdown_stress[i], node[i][ : , 1],
                                             node[i][ : , 2]);
    log_fluidity_by_nodes[i] = log_fluidity_about(median_stress[i], amplitude[i],
                                                  cyclic_exponent[i], breakdown_stress[i],
                                                  node[i][ : , 1], node[i][ : , 2]);
  }
  for (i in 1 : n_rows) {
    compliance[i] = kelvin_compliance([log(angular_frequency[i])
                                       + log_relaxation_time(parameter[i], row_temperature[i],
                                                             row_grain_size[i])]',
                                      parameter[i])[1];
  }
}
