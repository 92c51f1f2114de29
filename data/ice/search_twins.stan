// Stress along tests at one strain rate for many candidates at once: where each peaks, how high,
// and what is left at the end. Written for search_twins.py.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/dashpot_laws.stan
#include physics/kelvin_laws.stan
#include physics/microstructure.stan
#include solvers/radau_leg.stan
#include kinds/constant_rate_dynamics.stan
}
data {
  int<lower=1> n_candidates;
  matrix[n_candidates, n_parameters()] parameter; // SI, one row each
  int<lower=1> n_strains;
  array[n_strains] real<lower=0> strain; // increasing; the last two give the slope at the end
  real<lower=0> strain_rate; // 1/s
  real<lower=0> initial_grain_size; // m
  real<lower=0> temperature; // K
  real<lower=0> tolerance;
}
generated quantities {
  vector[n_candidates] peak_stress; // Pa
  vector[n_candidates] peak_strain;
  vector[n_candidates] final_stress; // Pa
  vector[n_candidates] final_slope; // d ln(stress)/d strain at the end
  for (i in 1 : n_candidates) {
    array[n_strains] vector[2] state
      = constant_rate_solution(parameter[i]', to_vector(parameter[i]), strain, {n_strains}, {0.0},
                               {strain_rate}, initial_grain_size, temperature, 0, 0, tolerance,
                               100000);
    int top = 1;
    for (k in 2 : n_strains) {
      top = state[k][1] > state[top][1] ? k : top;
    }
    peak_stress[i] = state[top][1];
    peak_strain[i] = strain[top];
    final_stress[i] = state[n_strains][1];
    final_slope[i] = log(state[n_strains][1] / state[n_strains - 1][1])
                     / (strain[n_strains] - strain[n_strains - 1]);
  }
}
