// The paper's form of the model as printed: six states in SI, time as the independent variable,
// ode_bdf with its default tolerances, parameters declared in SI within their priors' bounds.
// The judge of constant_rate.stan in tests and the baseline of the benchmarks; not for fits.
// It reads the same data as constant_rate.stan. With rate steps its solution is right, but CVODES
// often cannot start the sensitivities of the later segments at the default absolute tolerance.
functions {
#include functions/parameters.stan
#include functions/flow_law.stan
#include functions/microstructure.stan
#include functions/priors.stan
#include functions/six_state_dynamics.stan
}
data {
#include data/constant_rate_experiment.stan
#include data/priors.stan
}
transformed data {
  vector[n_parameters()] prior_mass;
  array[n_segments] real segment_time; // start of each segment, s
  array[n_strains] real time; // s
  for (k in 1 : n_parameters()) {
    prior_mass[k] = prior_log_mass(prior_family[k], prior_location[k], prior_scale[k],
                                   prior_lower[k], prior_upper[k]);
  }
  segment_time[1] = 0;
  for (k in 2 : n_segments) {
    segment_time[k] = segment_time[k - 1]
                      + (segment_start[k] - segment_start[k - 1]) / segment_rate[k - 1];
  }
  {
    int k = 1;
    int n_left = n_strains_in_segment[1];
    for (i in 1 : n_strains) {
      while (n_left == 0) {
        k += 1;
        n_left = n_strains_in_segment[k];
      }
      time[i] = segment_time[k] + (strain[i] - segment_start[k]) / segment_rate[k];
      n_left -= 1;
    }
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
  real<lower=prior_lower[8], upper=prior_upper[8]> steady_state_grain_size;
  real<lower=prior_lower[9], upper=prior_upper[9]> steady_state_fabric_factor;
  real<lower=prior_lower[10], upper=prior_upper[10]> critical_strain_grain_size;
  real<lower=prior_lower[11], upper=prior_upper[11]> critical_strain_fabric;
  real<lower=prior_lower[12], upper=prior_upper[12]> stress_noise;
}
transformed parameters {
  real lprior = joint_prior_log_density([maxwell_modulus, kelvin_modulus, kelvin_viscosity,
                                         stress_exponent, grain_size_exponent,
                                         activation_enthalpy, beta, steady_state_grain_size,
                                         steady_state_fabric_factor,
                                         critical_strain_grain_size, critical_strain_fabric,
                                         stress_noise]', prior_family, prior_location,
                                        prior_scale, prior_lower, prior_upper, prior_mass)
                + flow_law_prior_log_density([maxwell_modulus, kelvin_modulus, kelvin_viscosity,
                                              stress_exponent, grain_size_exponent,
                                              activation_enthalpy, beta]', flow_law_mean,
                                             flow_law_factor, flow_law_conditions);
}
model {
  target += lprior;
  if (use_likelihood) {
    vector[6] state = [0, 0, 0, 0, initial_grain_size, 1]';
    vector[n_strains] stress;
    vector[n_points] stress_model;
    int first = 1;
    for (k in 1 : n_segments) {
      int last = first + n_strains_in_segment[k] - 1;
      if (last >= first) {
        array[n_strains_in_segment[k]] vector[6] solution = ode_bdf(six_state_rhs, state,
          segment_time[k], time[first : last], segment_rate[k], temperature, maxwell_modulus,
          kelvin_modulus, kelvin_viscosity, stress_exponent, grain_size_exponent,
          activation_enthalpy, beta, steady_state_grain_size, steady_state_fabric_factor,
          critical_strain_grain_size, critical_strain_fabric);
        for (i in first : last) {
          stress[i] = solution[i - first + 1][1];
        }
        state = solution[n_strains_in_segment[k]];
      }
      first = last + 1;
    }
    for (i in 1 : n_points) {
      stress_model[i] = stress[strain_of_point[i]];
    }
    target += normal_lpdf(stress_observed | stress_model, stress_noise);
  }
}
