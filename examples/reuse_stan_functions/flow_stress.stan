// Flow stress of ice after a given strain at any strain rate, for many draws of the parameters:
// a program of your own that uses the flow law and the microstructure of pyburgers.
//
// Once elastic and Kelvin strains have settled, the dashpot carries the whole imposed rate; grain
// size and fabric are what the strain has made of them.
functions {
#include physics/flow_law.stan
#include physics/microstructure.stan
}
data {
  int<lower=1> n_draws;
  vector[n_draws] stress_exponent;
  vector[n_draws] grain_size_exponent;
  vector[n_draws] activation_enthalpy; // J/mol
  vector[n_draws] beta; // mol/J
  vector[n_draws] steady_state_grain_size; // m
  vector[n_draws] steady_state_fabric_factor;
  vector[n_draws] critical_strain_grain_size;
  vector[n_draws] critical_strain_fabric;
  int<lower=1> n_rates;
  vector<lower=0>[n_rates] strain_rate; // 1/s
  real<lower=0> path_strain;
  real<lower=0> initial_grain_size; // m
  real<lower=0> temperature; // K
}
generated quantities {
  matrix[n_draws, n_rates] flow_stress; // Pa
  for (i in 1 : n_draws) {
    real grain_size = microstructure_at(path_strain, initial_grain_size,
                                        steady_state_grain_size[i],
                                        critical_strain_grain_size[i]);
    real fabric_factor = microstructure_at(path_strain, 1, steady_state_fabric_factor[i],
                                           critical_strain_fabric[i]);
    for (j in 1 : n_rates) {
      flow_stress[i, j] = fabric_factor
                          * exp(log_reference_stress(strain_rate[j], grain_size, temperature,
                                                     stress_exponent[i],
                                                     grain_size_exponent[i],
                                                     activation_enthalpy[i], beta[i]));
    }
  }
}
