// The paper's form of the oscillating test as printed: states in SI, time as the independent
// variable, ode_bdf with its default tolerances, parameters declared in SI within their priors'
// bounds. The judge of forced_oscillation.stan in tests and the baseline of the benchmarks; not
// for fits. It reads the data of one test; parameters that the equations lack keep their fixed values.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/dashpot_laws.stan
#include physics/kelvin_element.stan
#include physics/microstructure.stan
#include statistics/priors.stan
#include kinds/forced_oscillation_dynamics.stan
#include reference/six_state_oscillation_dynamics.stan
}
data {
#include data/tests.stan
#include data/forced_oscillation.stan
#include data/priors.stan
}
transformed data {
  array[n_tests] vector[n_parameters()] prior_mass
    = prior_log_masses(prior_family, prior_location, prior_scale, prior_lower, prior_upper);
  int n_points = point_end[2];
  vector[3] piezometer = prior_location[1][{i_piezometer_reference_grain_size(),
                                            i_piezometer_exponent(),
                                            i_piezometer_stress_floor()}];
  array[n_points] real time; // since the start of the record, s
  for (i in 1 : n_points) {
    time[i] = (tau[i] - first_tau[1]) * period[1];
  }
}
parameters {
  real<lower=prior_lower[1][i_maxwell_modulus()],
       upper=prior_upper[1][i_maxwell_modulus()]> maxwell_modulus;
  real<lower=prior_lower[1][i_kelvin_modulus()],
       upper=prior_upper[1][i_kelvin_modulus()]> kelvin_modulus;
  real<lower=prior_lower[1][i_kelvin_viscosity()],
       upper=prior_upper[1][i_kelvin_viscosity()]> kelvin_viscosity;
  real<lower=prior_lower[1][i_stress_exponent()],
       upper=prior_upper[1][i_stress_exponent()]> stress_exponent;
  real<lower=prior_lower[1][i_grain_size_exponent()],
       upper=prior_upper[1][i_grain_size_exponent()]> grain_size_exponent;
  real<lower=prior_lower[1][i_activation_enthalpy()],
       upper=prior_upper[1][i_activation_enthalpy()]> activation_enthalpy;
  real<lower=prior_lower[1][i_beta()],
       upper=prior_upper[1][i_beta()]> beta;
  real<lower=prior_lower[1][i_critical_strain_grain_size()],
       upper=prior_upper[1][i_critical_strain_grain_size()]> critical_strain_grain_size;
  real<lower=prior_lower[1][i_stress_noise()],
       upper=prior_upper[1][i_stress_noise()]> stress_noise;
}
transformed parameters {
  vector[n_parameters()] parameter = prior_location[1];
  real lprior;
  parameter[i_maxwell_modulus()] = maxwell_modulus;
  parameter[i_kelvin_modulus()] = kelvin_modulus;
  parameter[i_kelvin_viscosity()] = kelvin_viscosity;
  parameter[i_stress_exponent()] = stress_exponent;
  parameter[i_grain_size_exponent()] = grain_size_exponent;
  parameter[i_activation_enthalpy()] = activation_enthalpy;
  parameter[i_beta()] = beta;
  parameter[i_critical_strain_grain_size()] = critical_strain_grain_size;
  parameter[i_stress_noise()] = stress_noise;
  lprior = joint_prior_log_density(parameter, prior_family[1], prior_location[1],
                                   prior_scale[1], prior_lower[1], prior_upper[1],
                                   prior_mass[1]);
  if (has_flow_law_prior[1]) {
    lprior += flow_law_prior_log_density(stress_exponent, grain_size_exponent,
                                         activation_enthalpy, beta, flow_law_mean,
                                         flow_law_factor, flow_law_conditions);
  }
}
model {
  target += lprior;
  if (use_likelihood) {
    vector[5] start = [start_stress[1], start_stress[1] / kelvin_modulus,
                       start_stress[1] / maxwell_modulus, 0, initial_grain_size[1]]';
    // Spin-up and record are one integration each: the grain size has a corner between them.
    vector[5] spun_up = ode_bdf(six_state_oscillation_rhs, start, 0,
                                {(first_tau[1] - start_tau[1]) * period[1]},
                                start_tau[1] * period[1], period[1], strain_sine[1],
                                strain_cosine[1], background[1], background_range[1],
                                first_tau[1], temperature[1], piezometer, maxwell_modulus,
                                kelvin_modulus, kelvin_viscosity, stress_exponent,
                                grain_size_exponent, activation_enthalpy, beta,
                                critical_strain_grain_size)[1];
    array[n_points] vector[5] solution = ode_bdf(six_state_oscillation_rhs, spun_up,
      0, time, first_tau[1] * period[1], period[1], strain_sine[1], strain_cosine[1],
      background[1], background_range[1], first_tau[1], temperature[1], piezometer,
      maxwell_modulus, kelvin_modulus, kelvin_viscosity, stress_exponent, grain_size_exponent,
      activation_enthalpy, beta, critical_strain_grain_size);
    vector[n_points] stress_model = to_vector(solution[ : , 1]);
    stress_model -= trend_shape * (trend_fit' * (stress_model - stress_observed));
    target += normal_lpdf(stress_observed | stress_model, stress_noise * relative_noise);
  }
}
