// Densities and random values of the residuals, and the element behind a Kelvin viscosity.
functions {
#include functions/flow_law.stan
#include functions/kelvin_element.stan
#include functions/residuals.stan
}
data {
  int<lower=1> n;
  vector[n] strain;
  vector[n] residual;
  real<lower=0> stress_noise;
  real<lower=0> correlation_strain;
  int<lower=0> n_replications;
  real<lower=0> viscosity;
  real<lower=0> kelvin_stress_exponent;
  real kelvin_activation_enthalpy;
  real<lower=0> temperature;
  real<lower=0> reference_stress;
  real<lower=0> reference_temperature;
  int<lower=0> n_driving;
  vector[n_driving] driving_stress;
}
generated quantities {
  vector[n] log_density = residual_log_densities(residual, stress_noise, strain,
                                                 correlation_strain);
  vector[n] log_density_given_others
    = residual_log_densities_given_others(residual, stress_noise, strain, correlation_strain);
  array[n_replications] vector[n] replicated;
  real log_rate_factor_of_kelvin = log_kelvin_rate_factor(viscosity, kelvin_stress_exponent,
                                                          kelvin_activation_enthalpy,
                                                          reference_stress,
                                                          reference_temperature);
  vector[n_driving] kelvin_rate;
  for (i in 1 : n_replications) {
    replicated[i] = residuals_rng(strain, stress_noise, correlation_strain);
  }
  for (i in 1 : n_driving) {
    kelvin_rate[i] = linear_driving_stress(driving_stress[i], kelvin_stress_exponent,
                                           -log(reference_stress))
                     / kelvin_viscosity_at(viscosity, kelvin_activation_enthalpy, temperature,
                                           reference_temperature);
  }
}
