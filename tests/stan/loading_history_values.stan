// Solutions of loading histories at given parameters, for tests.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/environment.stan
#include physics/composite_law.stan
#include physics/dashpot_mechanisms.stan
#include physics/dashpot_laws.stan
#include physics/hardening.stan
#include physics/kelvin_laws.stan
#include physics/relaxation.stan
#include physics/microstructure.stan
#include solvers/radau_leg.stan
#include kinds/loading_history_rates.stan
#include kinds/loading_history_legs.stan
#include kinds/loading_history_dynamics.stan
}
data {
  int<lower=0> n_legs;
  int<lower=0> n_times;
  vector[n_parameters()] parameter;
  matrix[n_legs, 5] leg;
  array[n_times] real time;
  array[n_legs] int n_in_leg;
  real initial_grain_size;
  real stress_scale;
  real strain_scale;
  real tolerance;
  int n_elements;
  matrix[n_elements, 3] element;
}
transformed data {
  vector[n_history_constants()] test
    = history_constants(parameter, initial_grain_size, stress_scale, strain_scale,
                        kelvin_law_at(parameter));
  array[n_legs] vector[n_history_rates()] fixed
    = fixed_rates(parameter, leg, initial_grain_size, test);
}
generated quantities {
  matrix[n_times, 8] solution
    = history_solution(history_states(parameter, parameter, rep_array(0, 0), leg, fixed, test,
                                      element, time, n_in_leg, initial_grain_size, 0, tolerance,
                                      1000000),
                       parameter, parameter, rep_array(0, 0), leg, fixed, test, element, n_in_leg,
                       initial_grain_size);
}
