// The paper's form of the oscillating test as printed: states in SI, time as the independent
// variable, ode_bdf with its default tolerances, parameters declared in SI within their priors'
// bounds. The baseline of the benchmarks; not for fits. It reads the data of one test; parameters
// that the equations lack keep their fixed values.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/environment.stan
#include physics/composite_law.stan
#include physics/dashpot_mechanisms.stan
#include physics/dashpot_laws.stan
#include physics/kelvin_laws.stan
#include physics/microstructure.stan
#include statistics/priors.stan
#include statistics/priors_of_test.stan
#include solvers/radau_leg.stan
#include kinds/forced_oscillation_dynamics.stan
  /**
   * Rates of [stress (Pa), kelvin strain, elastic strain, dashpot strain, grain size (m)] at an
   * imposed oscillating strain rate (Maor et al., Eqs. 1, 2 and 5; F = 1).
   *
   * @param time since origin, s: at the default tolerance CVODES starts with steps so short that a
   *   clock far from zero does not see them
   * @param origin on the record's clock, s
   * @param period s
   * @param sine, cosine, background amplitudes: `harmonics` of oscillating_rate()
   * @param piezometer d_1 (m), exponent and stress floor (Pa)
   */
  vector six_state_oscillation_rhs(real time, vector state, data real origin, data real period,
                                   data vector sine, data vector cosine, data vector background,
                                   data vector background_range, data real first_tau,
                                   data real temperature, data vector piezometer,
                                   real maxwell_modulus, real kelvin_modulus,
                                   real kelvin_viscosity, real stress_exponent,
                                   real grain_size_exponent, real activation_enthalpy,
                                   real beta, real critical_strain_grain_size) {
    real strain_rate = oscillating_rate((origin + time) / period,
                                        append_row(append_row(sine, cosine), background)',
                                        num_elements(sine), background_range, first_tau)
                       / period;
    real kelvin_rate = (state[1] - kelvin_modulus * state[2]) / kelvin_viscosity;
    real dashpot_rate = dashpot_strain_rate(state[1], state[5], 1, stress_exponent,
                                            grain_size_exponent,
                                            log_rate_factor(activation_enthalpy, beta,
                                                            temperature));
    real elastic_rate = strain_rate - kelvin_rate - dashpot_rate;
    vector[5] rate;
    rate[1] = maxwell_modulus * elastic_rate;
    rate[2] = kelvin_rate;
    rate[3] = elastic_rate;
    rate[4] = dashpot_rate;
    // Ahead of the record grains keep their size.
    rate[5] = origin + time < first_tau * period
              ? 0
              : microstructure_rate(state[5], piezometer_grain_size(state[1], piezometer[1],
                                                          piezometer[2], piezometer[3]),
                                    critical_strain_grain_size, strain_rate);
    return rate;
  }
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
  lprior = test_prior_log_density(parameter, prior_family[1], prior_location[1],
                                  prior_scale[1], prior_lower[1], prior_upper[1],
                                  prior_mass[1], has_flow_law_prior[1], flow_law_mean,
                                  flow_law_factor, flow_law_conditions);
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
