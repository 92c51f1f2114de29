// Readings and log densities of a test at many sets of parameters, by any solver.
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

  /** Parameters at coordinates, of which that of Q_M is ln(flow rate) at a stress. */
  vector parameters_at(vector coordinate, data vector base, data array[] int free,
                       data vector unit, data real stress, data real initial_grain_size,
                       data real temperature) {
    vector[n_parameters()] parameter = base;
    real log_rate = log_flow_rate_at(stress, initial_grain_size, temperature, base);
    parameter[free] += unit .* coordinate;
    for (j in 1 : size(free)) {
      if (free[j] == i_activation_enthalpy()) {
        log_rate += coordinate[j];
      }
    }
    parameter[i_activation_enthalpy()]
      = activation_enthalpy_from_flow(log_rate, log(stress), initial_grain_size,
                                      true_temperature(parameter, temperature),
                                      parameter[i_stress_exponent()],
                                      parameter[i_grain_size_exponent()], parameter[i_beta()]);
    return parameter;
  }
}
data {
  int<lower=1> n_sets;
  matrix[n_sets, n_parameters()] parameter;
  int<lower=1> n_free;
  array[n_free] int<lower=1> free;
  vector[n_free] unit;
  real temperature;
  real initial_grain_size;
  int kelvin_law;
  int<lower=1> n_elements;
  matrix[n_elements, 3] element;
  int<lower=1> n_outputs;
  matrix[n_sets, n_outputs] observed;
  matrix[n_sets, n_outputs] noise;
  real stress_scale;
  real strain_scale;
  array[n_outputs] real time;
  int<lower=0> n_legs;
  matrix[n_legs, 5] leg;
  array[n_legs] int n_in_leg;
  array[n_outputs] int is_strain;
  real tolerance;
  int max_num_steps;
  int solver;
}
transformed data {
  array[n_parameters()] int is_free = rep_array(0, n_parameters());
  for (k in free) {
    is_free[k] = 1;
  }
  int hardening = hardening_law(parameter[1]');
  int n_further = n_further_mechanisms(mechanisms_act(parameter[1]'));
  array[size(varying_rates(is_free, element, hardening, n_further))] int varying
    = varying_rates(is_free, element, hardening, n_further);
}
parameters {
  vector[n_sets * n_free] coordinate;
}
transformed parameters {
  matrix[n_sets, n_outputs] response;
  for (i in 1 : n_sets) {
    vector[n_parameters()] x = parameters_at(segment(coordinate, (i - 1) * n_free + 1, n_free),
                                             parameter[i]', free, unit, stress_scale,
                                             initial_grain_size, temperature);
    response[i] = history_readings(
      history_response(history_states(x, parameter[i]', varying, leg,
                                      fixed_rates(parameter[i]', leg, initial_grain_size,
                                                  history_constants(parameter[i]',
                                                                    initial_grain_size,
                                                                    stress_scale, strain_scale,
                                                                    kelvin_law)),
                                      history_constants(parameter[i]', initial_grain_size,
                                                        stress_scale, strain_scale, kelvin_law),
                                      element, time, n_in_leg, initial_grain_size, solver,
                                      tolerance, max_num_steps),
                       x,
                       history_constants(parameter[i]', initial_grain_size, stress_scale,
                                         strain_scale, kelvin_law)),
      is_strain, x)';
  }
}
model {
  target += -0.5 * sum(square((observed - response) ./ noise));
}
generated quantities {
  vector[n_sets] log_density;
  for (i in 1 : n_sets) {
    log_density[i] = -0.5 * sum(square((observed[i] - response[i]) ./ noise[i]));
  }
}
