// The paper's form of the model as printed: six states in SI, time as the independent variable,
// ode_bdf with its default tolerances, parameters declared in SI within their priors' bounds.
// The baseline of the benchmarks; not for fits.
// It reads the data of loading_history.stan for one test at constant rate. With rate steps its
// solution is right, but CVODES often cannot start the sensitivities of the later legs at the default
// absolute tolerance.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/microstructure.stan
#include statistics/priors.stan
#include statistics/priors_of_test.stan
  /**
   * Rates of [stress (Pa), kelvin strain, elastic strain, dashpot strain, grain size (m), fabric
   * factor] at imposed strain rate (Maor et al., Eqs. 1-4).
   *
   * @param time s
   */
  vector six_state_rhs(real time, vector state, data real strain_rate, data real temperature,
                       real maxwell_modulus, real kelvin_modulus, real kelvin_viscosity,
                       real stress_exponent, real grain_size_exponent, real activation_enthalpy,
                       real beta, real steady_state_grain_size, real steady_state_fabric_factor,
                       real critical_strain_grain_size, real critical_strain_fabric) {
    real kelvin_rate = (state[1] - kelvin_modulus * state[2]) / kelvin_viscosity;
    real dashpot_rate = dashpot_strain_rate(state[1], state[5], state[6], stress_exponent,
                                            grain_size_exponent,
                                            log_rate_factor(activation_enthalpy, beta,
                                                            temperature));
    real elastic_rate = strain_rate - kelvin_rate - dashpot_rate;
    vector[6] rate;
    rate[1] = maxwell_modulus * elastic_rate;
    rate[2] = kelvin_rate;
    rate[3] = elastic_rate;
    rate[4] = dashpot_rate;
    rate[5] = microstructure_rate(state[5], steady_state_grain_size, critical_strain_grain_size,
                                  strain_rate);
    rate[6] = microstructure_rate(state[6], steady_state_fabric_factor, critical_strain_fabric,
                                  strain_rate);
    return rate;
  }
}
data {
#include data/tests.stan
#include data/loading_history.stan
#include data/priors.stan
}
transformed data {
  array[n_tests] vector[n_parameters()] prior_mass
    = prior_log_masses(prior_family, prior_location, prior_scale, prior_lower, prior_upper);
  int n_legs = leg_end[2];
  int n_points = point_end[2];
  array[n_legs + 1] real leg_time; // start of each leg, and the end of the test, s
  array[output_end[2]] real time; // of outputs, s
  leg_time[1] = 0;
  {
    int before = 0;
    for (k in 1 : n_legs) {
      leg_time[k + 1] = leg_time[k] + leg[k, 2];
      for (i in before + 1 : before + n_outputs_in_leg[k]) {
        time[i] = leg_time[k] + output_time_in_leg[i] * leg[k, 2];
      }
      before += n_outputs_in_leg[k];
    }
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
  real<lower=prior_lower[1][i_steady_state_grain_size()],
       upper=prior_upper[1][i_steady_state_grain_size()]> steady_state_grain_size;
  real<lower=prior_lower[1][i_steady_state_fabric_factor()],
       upper=prior_upper[1][i_steady_state_fabric_factor()]> steady_state_fabric_factor;
  real<lower=prior_lower[1][i_critical_strain_grain_size()],
       upper=prior_upper[1][i_critical_strain_grain_size()]> critical_strain_grain_size;
  real<lower=prior_lower[1][i_critical_strain_fabric()],
       upper=prior_upper[1][i_critical_strain_fabric()]> critical_strain_fabric;
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
  parameter[i_steady_state_grain_size()] = steady_state_grain_size;
  parameter[i_steady_state_fabric_factor()] = steady_state_fabric_factor;
  parameter[i_critical_strain_grain_size()] = critical_strain_grain_size;
  parameter[i_critical_strain_fabric()] = critical_strain_fabric;
  parameter[i_stress_noise()] = stress_noise;
  lprior = test_prior_log_density(parameter, prior_family[1], prior_location[1],
                                  prior_scale[1], prior_lower[1], prior_upper[1],
                                  prior_mass[1], has_flow_law_prior[1], flow_law_mean,
                                  flow_law_factor, flow_law_conditions);
}
model {
  target += lprior;
  if (use_likelihood) {
    vector[6] state = [0, 0, 0, 0, initial_grain_size[1], 1]';
    vector[output_end[2]] stress;
    vector[n_points] stress_model;
    int before = 0;
    for (k in 1 : n_legs) {
      int n = n_outputs_in_leg[k];
      array[n + 1] vector[6] solution = ode_bdf(six_state_rhs, state, leg_time[k],
        append_array(time[before + 1 : before + n], leg_time[k + 1 : k + 1]), leg[k, 4],
        temperature[1], maxwell_modulus, kelvin_modulus, kelvin_viscosity, stress_exponent,
        grain_size_exponent, activation_enthalpy, beta, steady_state_grain_size,
        steady_state_fabric_factor, critical_strain_grain_size, critical_strain_fabric);
      for (i in 1 : n) {
        stress[before + i] = solution[i][1];
      }
      state = solution[n + 1];
      before += n;
    }
    for (i in 1 : n_points) {
      stress_model[i] = stress[output_of_point[i]];
    }
    target += normal_lpdf(response_observed | stress_model, stress_noise);
  }
}
