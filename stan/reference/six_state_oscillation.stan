// The paper's form of the oscillating test as printed: states in SI, time as the independent
// variable, ode_bdf with its default tolerances, parameters declared in SI within their priors'
// bounds. The judge of forced_oscillation.stan in tests and the baseline of the benchmarks; not
// for fits. It reads the same data; parameters that the equations lack keep their fixed values.
functions {
#include functions/parameters.stan
#include functions/flow_law.stan
#include functions/kelvin_element.stan
#include functions/microstructure.stan
#include functions/priors.stan
#include functions/forced_oscillation_dynamics.stan
#include functions/six_state_oscillation_dynamics.stan
}
data {
#include data/forced_oscillation_experiment.stan
#include data/priors.stan
}
transformed data {
  vector[n_parameters()] prior_mass;
  array[n_points] real time; // since the start of the record, s
  for (k in 1 : n_parameters()) {
    prior_mass[k] = prior_log_mass(prior_family[k], prior_location[k], prior_scale[k],
                                   prior_lower[k], prior_upper[k]);
  }
  for (i in 1 : n_points) {
    time[i] = (tau[i] - first_tau) * period;
  }
}
parameters {
  real<lower=prior_lower[1], upper=prior_upper[1]> maxwell_modulus;
  real<lower=prior_lower[2], upper=prior_upper[2]> kelvin_modulus;
  real<lower=prior_lower[3], upper=prior_upper[3]> kelvin_viscosity;
  real<lower=prior_lower[4], upper=prior_upper[4]> stress_exponent;
  real<lower=prior_lower[5], upper=prior_upper[5]> grain_size_exponent;
  real<lower=prior_lower[6], upper=prior_upper[6]> activation_enthalpy;
  real<lower=prior_lower[7], upper=prior_upper[7]> beta;
  real<lower=prior_lower[10], upper=prior_upper[10]> critical_strain_grain_size;
  real<lower=prior_lower[12], upper=prior_upper[12]> stress_noise;
}
transformed parameters {
  real lprior = joint_prior_log_density([maxwell_modulus, kelvin_modulus, kelvin_viscosity,
                                         stress_exponent, grain_size_exponent,
                                         activation_enthalpy, beta, prior_location[8],
                                         prior_location[9], critical_strain_grain_size,
                                         prior_location[11], stress_noise]', prior_family,
                                        prior_location, prior_scale, prior_lower, prior_upper,
                                        prior_mass)
                + flow_law_prior_log_density([maxwell_modulus, kelvin_modulus, kelvin_viscosity,
                                              stress_exponent, grain_size_exponent,
                                              activation_enthalpy, beta]', flow_law_mean,
                                             flow_law_factor, flow_law_conditions);
}
model {
  target += lprior;
  if (use_likelihood) {
    vector[5] start = [start_stress, start_stress / kelvin_modulus,
                       start_stress / maxwell_modulus, 0, initial_grain_size]';
    // Spin-up and record are one integration each: the grain size has a corner between them.
    vector[5] spun_up = ode_bdf(six_state_oscillation_rhs, start, 0,
                                {(first_tau - start_tau) * period},
                                start_tau * period, period, strain_sine, strain_cosine,
                                background, background_middle, background_half, first_tau,
                                temperature, maxwell_modulus, kelvin_modulus,
                                kelvin_viscosity, stress_exponent, grain_size_exponent,
                                activation_enthalpy, beta, critical_strain_grain_size)[1];
    array[n_points] vector[5] solution = ode_bdf(six_state_oscillation_rhs, spun_up,
      0, time, first_tau * period, period, strain_sine, strain_cosine, background,
      background_middle, background_half, first_tau, temperature, maxwell_modulus,
      kelvin_modulus, kelvin_viscosity, stress_exponent, grain_size_exponent,
      activation_enthalpy, beta, critical_strain_grain_size);
    vector[n_points] stress_model;
    for (i in 1 : n_points) {
      stress_model[i] = solution[i][1];
    }
    stress_model -= trend_shape * (trend_fit * stress_model);
    target += normal_lpdf(stress_observed | stress_model, stress_noise * relative_noise);
  }
}
