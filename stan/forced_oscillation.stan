// Nonlinear Burgers model of tests at an imposed oscillating strain rate: Maxwell spring and
// power-law dashpot in series with a Kelvin-Voigt element, grain size following a piezometer
// (Maor, Hansen, Jerolmack and Goldsby, Eqs. 1, 2 and 5).
//
// All values are SI. Priors, fixed parameters, solver tolerance and the likelihood switch are
// data, and parameters of several tests are shared, partially pooled or separate, as in
// loading_history.stan.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/environment.stan
#include physics/composite_law.stan
#include physics/dashpot_mechanisms.stan
#include physics/dashpot_laws.stan
#include physics/kelvin_laws.stan
#include physics/microstructure.stan
#include solvers/radau_leg.stan
#include kinds/forced_oscillation_dynamics.stan
#include statistics/priors.stan
#include statistics/priors_of_test.stan
#include statistics/residuals.stan
#include charts/plain.stan
#include charts/pooling.stan
#include charts/sheared.stan
}
data {
#include data/tests.stan
#include data/forced_oscillation.stan
#include data/priors.stan
#include data/coordinates.stan
#include data/sheared.stan
#include data/solver.stan
  int<lower=0, upper=1> solver; // 0: ode_bdf_tol, 1: radau_leg() (solvers/radau_leg.stan)
  // Times at which generated quantities report the solution, apart from the observed ones.
  array[n_tests + 1] int<lower=0> grid_end;
  array[grid_end[n_tests + 1]] real grid_tau;
  matrix[grid_end[n_tests + 1], max(n_trend)] grid_trend_shape; // as trend_shape, there
}
transformed data {
  int n_points = point_end[n_tests + 1];
  int n_grid = grid_end[n_tests + 1];
  int n_errors = error_end[n_tests + 1];
  array[n_errors] int strain_error_position; // among the coordinates
  array[n_tests] vector[n_parameters()] prior_mass
    = prior_log_masses(prior_family, prior_location, prior_scale, prior_lower, prior_upper);
  array[n_tests] int uncertain_calibration;
  array[n_tests] vector[n_record() + n_solutions] record; // what the shifts want to know of a test
  for (i in 1 : n_errors) {
    strain_error_position[i] = n_coordinates - n_errors + i;
  }
  for (e in 1 : n_tests) {
    array[point_end[e + 1] - point_end[e]] int points = part(point_end, e);
    // Mean of the grain size that the observed stresses want, over d_0, less 1.
    real growth_limit = 0;
    for (i in points) {
      growth_limit += (piezometer_grain_size(stress_observed[i],
                         prior_location[e][i_piezometer_reference_grain_size()],
                         prior_location[e][i_piezometer_exponent()],
                         prior_location[e][i_piezometer_stress_floor()])
                       / initial_grain_size[e] - 1)
                      / size(points);
    }
    uncertain_calibration[e] = prior_scale[e][i_stress_calibration_error()] > 0
                               || prior_location[e][i_stress_calibration_error()] != 0;
    record[e] = append_row([stress_scale[e], storage_compliance[e], loss_compliance[e], period[e],
                            growth_limit, typical_path_strain[e], initial_grain_size[e],
                            temperature[e], first_log_rate[e], log_rate_step,
                            log_rate_scale[e]]', log_dashpot_compliance[e]);
  }
}
parameters {
  vector<multiplier=unit>[n_coordinates] coordinate;
}
transformed parameters {
#include charts/parameters_of_tests.stan
  vector[n_tests] log_reference; // ln of the flow rate (s) at stress_scale and d_0
  vector[own_end[n_tests + 1]] plain_coordinate; // of the tests' own parameters
  for (e in 1 : n_tests) {
#include charts/given_parameters.stan
    vector[size(own) + 1] plain = append_row(coordinate[own_position[own]], 0);
    vector[n_parameters() + 1] mapped;
    if (coordinate_system == 2) {
      plain = plain_from_sheared(coordinate[own_position[own]], given, own_place[e],
                                 quantity[own], replaced_parameter[e], prior_location[e],
                                 prior_scale[e], flow_slope[e], flow_reference[e], record[e]);
    }
    plain_coordinate[own] = head(plain, size(own));
    mapped = parameters_from_plain(plain_coordinate[own], own_parameter[own], quantity[own],
                                   given, replaced_parameter[e], 0, log(stress_scale[e]),
                                   initial_grain_size[e], temperature[e]);
    parameter[e] = head(mapped, n_parameters());
    log_reference[e] = log_flow_rate_at(stress_scale[e], initial_grain_size[e], temperature[e],
                                        parameter[e]);
    log_jacobian += pooled[n_parameters() + 1] + plain[size(own) + 1]
                    + mapped[n_parameters() + 1];
    log_pooling += pooled[n_parameters() + 2]
                   + std_normal_lpdf(coordinate[strain_error_position[part(error_end, e)]]);
  }
#include statistics/prior_density.stan
}
model {
  target += lprior + log_jacobian + log_pooling;
  if (use_likelihood) {
    for (e in 1 : n_tests) {
      array[point_end[e + 1] - point_end[e]] int points = part(point_end, e);
      array[size(points)] vector[3] solution
        = driven_solution(parameter[e], prior_location[e], tau[points], start_tau[e],
                          first_tau[e], period[e], strain_sine[e], strain_cosine[e],
                          background[e], background_range[e],
                          strain_error[part(error_end, e)],
                          coordinate[strain_error_position[part(error_end, e)]],
                          uncertain_calibration[e], initial_grain_size[e], temperature[e],
                          start_stress[e], stress_scale[e], strain_scale[e],
                          kelvin_law, solver, tolerance, max_num_steps);
      vector[size(points)] stress = to_vector(solution[ : , 1]);
      real noise = parameter[e][i_stress_noise()];
      stress -= trend_shape[points] * (trend_fit[points]' * (stress - stress_observed[points]));
      target += normal_lpdf(stress_observed[points] | stress, noise * relative_noise[points])
                + taken_noise_log_density(n_trend[e], noise);
    }
  }
}
generated quantities {
  // All stresses as the load cell reads them.
  vector[n_points] response_model; // Pa, without the trend below
  vector[n_points] response_replicated; // Pa, without the trend of its noise either
  vector[n_points] log_lik;
  // Of the coordinates, as the model block has it; here for runs of this block by itself.
  real log_density = lprior + log_jacobian + log_pooling;
  array[n_tests] vector[max(n_trend)] trend; // coefficients: by what the model lies off most likely
  vector[n_grid] grid_stress; // Pa, its trend included
  vector[n_grid] grid_oscillating_stress; // Pa, without its trend, as response_model
  vector[n_grid] grid_stress_replicated; // Pa, without its trend
  vector[n_grid] grid_kelvin_strain;
  vector[n_grid] grid_grain_size; // m
  vector[n_grid] grid_dashpot_rate; // strain rate of the dashpot, 1/s
  // What sets the sheared coordinates up: ln(d/d_0) in their approximation, its derivative by
  // epsilon_c1, and where they are.
  vector[n_tests] typical_growth;
  vector[n_tests] typical_growth_slope;
  vector[own_end[n_tests + 1]] sheared_coordinate;
  for (e in 1 : n_tests) {
    array[point_end[e + 1] - point_end[e]] int points = part(point_end, e);
    array[grid_end[e + 1] - grid_end[e]] int here = part(grid_end, e);
    array[own_end[e + 1] - own_end[e]] int own = part(own_end, e);
    real noise = parameter[e][i_stress_noise()];
    // Observed times and grid in one series, solved at once.
    array[size(points) + size(here)] real every_tau = append_array(tau[points], grid_tau[here]);
    array[size(every_tau)] int order = sort_indices_asc(every_tau);
    array[size(every_tau)] vector[3] solution;
    solution[order]
      = driven_solution(parameter[e], prior_location[e], every_tau[order], start_tau[e],
                        first_tau[e], period[e], strain_sine[e], strain_cosine[e],
                        background[e], background_range[e],
                        strain_error[part(error_end, e)],
                        coordinate[strain_error_position[part(error_end, e)]],
                        uncertain_calibration[e], initial_grain_size[e], temperature[e],
                        start_stress[e], stress_scale[e], strain_scale[e],
                        kelvin_law, solver, tolerance, max_num_steps);
    response_model[points] = to_vector(solution[1 : size(points), 1]);
    trend[e] = trend_fit[points]' * (response_model[points] - stress_observed[points]);
    response_model[points] -= trend_shape[points] * trend[e];
    for (i in points) {
      response_replicated[i] = normal_rng(0, noise * relative_noise[i]);
    }
    response_replicated[points] -= trend_shape[points]
                                 * (trend_fit[points]' * response_replicated[points]);
    response_replicated[points] += response_model[points];
    for (i in points) {
      log_lik[i] = normal_lpdf(stress_observed[i] | response_model[i], noise * relative_noise[i])
                   + taken_noise_log_density(n_trend[e], noise) / size(points);
    }
    if (use_likelihood) {
      log_density += sum(log_lik[points]);
    }
    for (j in 1 : size(here)) {
      vector[3] state = solution[size(points) + j];
      int i = here[j];
      grid_stress[i] = state[1];
      grid_kelvin_strain[i] = state[2];
      grid_grain_size[i] = state[3];
      grid_dashpot_rate[i] = dashpot_rate_at(state[1] / stress_reading_factor(parameter[e]), 0,
                                             state[3], 1, parameter[e],
                                             true_temperature(parameter[e], temperature[e]));
    }
    grid_oscillating_stress[here] = grid_stress[here] - grid_trend_shape[here] * trend[e];
    for (i in here) {
      grid_stress_replicated[i] = normal_rng(grid_oscillating_stress[i], noise);
    }
    typical_growth[e] = rough_growth(parameter[e][i_critical_strain_grain_size()],
                                     record[e][r_growth_limit()],
                                     record[e][r_path_strain()]);
    typical_growth_slope[e] = rough_growth_slope(parameter[e][i_critical_strain_grain_size()],
                                                 record[e][r_growth_limit()],
                                                 record[e][r_path_strain()]);
    sheared_coordinate[own] = plain_coordinate[own];
    if (replaced_parameter[e] > 0) {
      sheared_coordinate[own] = sheared_from_plain(plain_coordinate[own], parameter[e],
        own_place[e], quantity[own], replaced_parameter[e], prior_location[e], prior_scale[e],
        flow_slope[e], flow_reference[e], record[e]);
    }
  }
}
