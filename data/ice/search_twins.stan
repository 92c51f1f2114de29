// Stress along tests at one strain rate for many candidates at once: where each peaks, how high,
// and what is left at the end. Written for search_twins.py.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/environment.stan
#include physics/composite_law.stan
#include physics/dashpot_mechanisms.stan
#include physics/dashpot_laws.stan
#include physics/kelvin_laws.stan
#include physics/relaxation.stan
#include physics/microstructure.stan
#include solvers/radau_leg.stan
#include physics/hardening.stan
#include kinds/loading_history_rates.stan
#include kinds/loading_history_legs.stan
#include kinds/loading_history_dynamics.stan
#include kinds/stress_at_constant_rate.stan
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
    vector[n_strains] stress
      = stress_at_constant_rate(parameter[i]', parameter[i]', strain, strain_rate,
                                exp(log_reference_stress_at(parameter[i]', strain_rate,
                                                            initial_grain_size, temperature)),
                                initial_grain_size, temperature, 0, tolerance, 100000);
    int top = 1;
    for (k in 2 : n_strains) {
      top = stress[k] > stress[top] ? k : top;
    }
    peak_stress[i] = stress[top];
    peak_strain[i] = strain[top];
    final_stress[i] = stress[n_strains];
    final_slope[i] = log(stress[n_strains] / stress[n_strains - 1])
                     / (strain[n_strains] - strain[n_strains - 1]);
  }
}
