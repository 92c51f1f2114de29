// Nonlinear Burgers model of one test at an imposed oscillating strain rate: Maxwell spring and
// power-law dashpot in series with a Kelvin-Voigt element, grain size following a piezometer
// (Maor, Hansen, Jerolmack and Goldsby, Eqs. 1, 2 and 5).
//
// All values are SI. Priors, fixed parameters, solver tolerances and the likelihood switch are
// data, as in constant_rate.stan.
functions {
#include functions/parameters.stan
#include functions/flow_law.stan
#include functions/kelvin_element.stan
#include functions/microstructure.stan
#include functions/priors.stan
#include functions/coordinates.stan
#include functions/residuals.stan
#include functions/forced_oscillation_dynamics.stan
#include functions/sheared_coordinates.stan
}
data {
#include data/forced_oscillation_experiment.stan
#include data/priors.stan
#include data/coordinates.stan
#include data/sheared.stan
#include data/solver.stan
  // Times (in periods) at which generated quantities report the solution, apart from the
  // observed ones.
  int<lower=0> n_grid;
  array[n_grid] real<lower=first_tau> grid_tau;
  matrix[n_grid, n_trend] grid_trend_shape; // as trend_shape, at these times
}
transformed data {
  // The Kelvin element is linear where n_K is fixed at 1.
  int power_law_kelvin = prior_family[13] != 0 || prior_location[13] != 1;
  vector[n_parameters()] prior_mass;
  array[n_parameters()] int coordinate_of; // position among the coordinates, 0 where fixed
  // Observed times and grid in one series, which generated quantities solve at once.
  array[n_points + n_grid] real every_tau = append_array(tau, grid_tau);
  array[n_points + n_grid] int order = sort_indices_asc(every_tau);
  vector[10] record = [stress_scale, start_stress, stress_amplitude, storage_compliance,
                       loss_compliance, period, 0, typical_path_strain, initial_grain_size,
                       temperature]'; // see shears()
  for (i in 1 : n_points) {
    // Mean of the grain size that the observed stresses want, over d_0, less 1.
    record[7] += (piezometer_grain_size(stress_observed[i]) / initial_grain_size - 1) / n_points;
  }
  for (k in 1 : n_parameters()) {
    prior_mass[k] = prior_log_mass(prior_family[k], prior_location[k], prior_scale[k],
                                   prior_lower[k], prior_upper[k]);
  }
  for (k in 1 : n_parameters()) {
    coordinate_of[k] = 0;
  }
  for (i in 1 : n_coordinates) {
    coordinate_of[parameter_of_coordinate[i]] = i;
  }
}
parameters {
  vector[n_coordinates] coordinate;
}
transformed parameters {
  real maxwell_modulus;
  real kelvin_modulus;
  real kelvin_viscosity;
  real stress_exponent;
  real grain_size_exponent;
  real activation_enthalpy;
  real beta;
  real steady_state_grain_size;
  real steady_state_fabric_factor;
  real critical_strain_grain_size;
  real critical_strain_fabric;
  real stress_noise;
  real kelvin_stress_exponent;
  real kelvin_activation_enthalpy;
  real kelvin_reference_stress = prior_location[15];
  real kelvin_reference_temperature = prior_location[16];
  real residual_correlation_strain;
  real piezometer_reference_grain_size = prior_location[18];
  real reference_flow_rate; // of the dashpot at the stress stress_scale and d_0, 1/s
  real kelvin_viscosity_here; // eta_K at the temperature of the test, Pa s
  real lprior; // log density of the priors on the physical parameters
  real log_jacobian = 0; // ln |d(physical parameters)/d(coordinates)|
  vector[n_coordinates] plain_coordinate = coordinate;
  {
    vector[n_parameters() + 1] mapped;
    vector[n_parameters()] parameter;
    if (coordinate_system == 2) {
      vector[n_coordinates + 1] sheared = plain_from_sheared(coordinate, coordinate_of,
        quantity_shift, quantity_scale, quantity_lower, quantity_upper, replaced_parameter,
        prior_location, prior_scale, flow_slope, flow_reference, record);
      plain_coordinate = head(sheared, n_coordinates);
      log_jacobian = sheared[n_coordinates + 1];
    }
    mapped = parameters_from_plain(plain_coordinate, parameter_of_coordinate, quantity_shift,
                                   quantity_scale, quantity_lower, quantity_upper,
                                   prior_location, replaced_parameter, 0, log(stress_scale),
                                   initial_grain_size, temperature);
    parameter = head(mapped, n_parameters());
    log_jacobian += mapped[n_parameters() + 1];
    lprior = joint_prior_log_density(parameter, prior_family, prior_location, prior_scale,
                                     prior_lower, prior_upper, prior_mass)
             + flow_law_prior_log_density(parameter, flow_law_mean, flow_law_factor,
                                          flow_law_conditions);
    maxwell_modulus = parameter[1];
    kelvin_modulus = parameter[2];
    kelvin_viscosity = parameter[3];
    stress_exponent = parameter[4];
    grain_size_exponent = parameter[5];
    activation_enthalpy = parameter[6];
    beta = parameter[7];
    steady_state_grain_size = parameter[8];
    steady_state_fabric_factor = parameter[9];
    critical_strain_grain_size = parameter[10];
    critical_strain_fabric = parameter[11];
    stress_noise = parameter[12];
    kelvin_stress_exponent = parameter[13];
    kelvin_activation_enthalpy = parameter[14];
    residual_correlation_strain = parameter[17];
  }
  kelvin_viscosity_here = kelvin_viscosity_at(kelvin_viscosity, kelvin_activation_enthalpy,
                                              temperature, prior_location[16]);
  reference_flow_rate = exp(log_flow_rate(stress_scale, initial_grain_size, temperature,
                                          stress_exponent, grain_size_exponent,
                                          activation_enthalpy, beta));
}
model {
  target += lprior + log_jacobian;
  if (use_likelihood) {
    array[n_points] vector[3] solution = forced_oscillation_solution(tau, start_tau, first_tau,
      period, strain_sine, strain_cosine, background, background_middle, background_half,
      initial_grain_size, temperature, start_stress, stress_scale, strain_scale, maxwell_modulus,
      kelvin_modulus, kelvin_viscosity_here, stress_exponent, grain_size_exponent,
      activation_enthalpy, beta, critical_strain_grain_size, power_law_kelvin,
      kelvin_stress_exponent, prior_location[15], relative_tolerance, absolute_tolerance,
      max_num_steps);
    vector[n_points] stress_model;
    for (i in 1 : n_points) {
      stress_model[i] = solution[i][1];
    }
    stress_model -= trend_shape * (trend_fit * stress_model);
    target += normal_lpdf(stress_observed | stress_model, stress_noise * relative_noise)
              + taken_noise_log_density(n_trend, stress_noise);
  }
}
generated quantities {
  vector[n_points] stress_model; // Pa, without its trend
  vector[n_points] stress_replicated; // Pa
  vector[n_points] log_lik;
  vector[n_grid] grid_stress; // Pa, its trend included
  vector[n_grid] grid_oscillating_stress; // Pa, without its trend, as stress_model
  vector[n_grid] grid_stress_replicated; // Pa, without its trend
  vector[n_grid] grid_kelvin_strain;
  vector[n_grid] grid_grain_size; // m
  vector[n_grid] grid_dashpot_rate; // strain rate of the dashpot, 1/s
  // What sets the sheared coordinates up: ln(d/d_0) in their approximation, its derivative by
  // epsilon_c1, and where they are.
  real typical_growth = rough_growth(critical_strain_grain_size, record[7], record[8]);
  real typical_growth_slope = rough_growth_slope(critical_strain_grain_size, record[7],
                                                 record[8]);
  vector[n_coordinates] sheared_coordinate = plain_coordinate;
  if (replaced_parameter > 0) {
    sheared_coordinate = sheared_from_plain(plain_coordinate, coordinate_of, quantity_shift,
                                            quantity_scale, quantity_lower, quantity_upper,
                                            replaced_parameter, prior_location, prior_scale,
                                            flow_slope, flow_reference, record);
  }
  vector[n_trend] trend; // coefficients
  {
    array[n_points + n_grid] vector[3] solution;
    solution[order] = forced_oscillation_solution(every_tau[order], start_tau, first_tau, period,
      strain_sine, strain_cosine, background, background_middle, background_half,
      initial_grain_size, temperature, start_stress, stress_scale, strain_scale, maxwell_modulus,
      kelvin_modulus, kelvin_viscosity_here, stress_exponent, grain_size_exponent,
      activation_enthalpy, beta, critical_strain_grain_size, power_law_kelvin,
      kelvin_stress_exponent, prior_location[15], relative_tolerance, absolute_tolerance,
      max_num_steps);
    for (i in 1 : n_points) {
      stress_model[i] = solution[i][1];
    }
    trend = trend_fit * stress_model;
    stress_model -= trend_shape * trend;
    for (i in 1 : n_points) {
      stress_replicated[i] = normal_rng(stress_model[i], stress_noise * relative_noise[i]);
      log_lik[i] = normal_lpdf(stress_observed[i] | stress_model[i],
                               stress_noise * relative_noise[i])
                   + taken_noise_log_density(n_trend, stress_noise) / n_points;
    }
    for (i in 1 : n_grid) {
      vector[3] state = solution[n_points + i];
      grid_stress[i] = state[1];
      grid_kelvin_strain[i] = state[2];
      grid_grain_size[i] = state[3];
      grid_dashpot_rate[i] = dashpot_strain_rate(state[1], state[3], 1, stress_exponent,
                                                 grain_size_exponent,
                                                 log_rate_factor(activation_enthalpy, beta,
                                                                 temperature));
    }
    grid_oscillating_stress = grid_stress - grid_trend_shape * trend;
    for (i in 1 : n_grid) {
      grid_stress_replicated[i] = normal_rng(grid_oscillating_stress[i], stress_noise);
    }
  }
}
