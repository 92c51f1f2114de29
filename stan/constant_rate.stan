// Nonlinear Burgers model of tests at imposed, piecewise constant strain rate:
// Maxwell spring and power-law dashpot in series with a Kelvin-Voigt element, grain size and
// fabric evolving with strain (Maor, Hansen, Jerolmack and Goldsby, Eqs. 1-4), in the exact
// two-state reduction of kinds/constant_rate_dynamics.stan.
//
// All values are SI. Priors, fixed parameters, solver tolerance and the likelihood switch are
// data. With every parameter fixed (n_coordinates = 0, algorithm=fixed_param) the program is a
// forward simulation. Parameters of several tests are shared, partially pooled or separate.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/dashpot_laws.stan
#include physics/kelvin_laws.stan
#include physics/relaxation.stan
#include physics/microstructure.stan
#include solvers/radau_leg.stan
#include kinds/constant_rate_dynamics.stan
#include statistics/priors.stan
#include statistics/priors_of_test.stan
#include statistics/residuals.stan
#include statistics/measured_microstructure.stan
#include charts/plain.stan
#include charts/pooling.stan
#include charts/valley/pins.stan
#include charts/valley/least_squares.stan
#include charts/valley/quantiles.stan
#include charts/valley/softening.stan
#include charts/valley/elastic_rise.stan
#include charts/valley/grain_size_edge.stan
#include charts/valley/valley.stan
#include kinds/constant_rate_density.stan
}
data {
#include data/tests.stan
#include data/constant_rate.stan
#include data/priors.stan
#include data/coordinates.stan
#include data/valley.stan
#include data/solver.stan
  int<lower=0, upper=1> solver; // 0: ode_bdf_tol, 1: radau_leg() (solvers/radau_leg.stan)
  // Strains at which generated quantities report the solution, apart from the observed ones.
  array[n_tests + 1] int<lower=0> grid_end;
  array[grid_end[n_tests + 1]] real<lower=0> grid_strain;
  array[grid_end[n_tests + 1]] real<lower=0> grid_rate; // imposed there, 1/s
  array[segment_end[n_tests + 1]] int<lower=0> n_grid_in_segment;
}
transformed data {
  int n_points = point_end[n_tests + 1];
  int n_grid = grid_end[n_tests + 1];
  int n_measured = measured_end[n_tests + 1];
  int n_states = n_constant_rate_states(prior_location[1]);
  array[n_tests] vector[n_parameters()] prior_mass
    = prior_log_masses(prior_family, prior_location, prior_scale, prior_lower, prior_upper);
  array[n_tests] int test = linspaced_int_array(n_tests, 1, n_tests);
  array[n_tests] int gives = gives_to_others(shared_from); // parameters
  matrix[1, 3] element = [[is_only_element(), 0, 1]]; // of the Kelvin part
#include charts/valley_references.stan
}
parameters {
  vector<multiplier=unit>[n_coordinates] coordinate;
}
model {
#include charts/parameters_of_tests.stan
  real lprior = 0;
#include statistics/prior_of_centres.stan
  // First the tests whose parameters others share; then no test needs another.
  for (e in 1 : n_tests) {
    if (gives[e]) {
#include charts/constant_rate_parameters.stan
      parameter[e] = head(mapped, n_parameters());
      log_jacobian += mapped[n_parameters() + 1];
      log_pooling += mapped[n_parameters() + 2];
    }
  }
  target += lprior + log_jacobian + log_pooling;
  // In a fixed order of summation, whichever thread is ready first.
  target += reduce_sum_static(
    constant_rate_log_density, test, 1, coordinate, parameter, gives, pooled_spread,
    temperature, initial_grain_size, point_end, use_likelihood, kelvin_law,
    stress_observed, segment_end, segment_start, segment_rate, strain_end, strain,
    n_strains_in_segment, strain_of_point, point_strain, point_segment, measured_end,
    strain_of_measured, measured, correlated_residuals,
    prior_family, prior_location, prior_scale, prior_lower, prior_upper, prior_mass,
    has_flow_law_prior, flow_law_mean, flow_law_factor, flow_law_conditions,
    coordinate_system, shared_parameter, shared_from, own_end, own_parameter, own_position,
    quantity, own_place, replaced_parameter, pooled_parameter, pooled_position, pooled_quantity,
    centre_position, centre_reference, pooled_reference, pooled_data_precision,
    knot_end, knot, pin_end, pin, guide, noise_parameter, conditions,
    reference_end, reference, element,
    solver, tolerance, max_num_steps);
}
generated quantities {
#include charts/parameters_of_tests.stan
  vector[n_tests] log_reference; // ln(S_0/Pa)
  // All stresses as the load cell reads them.
  vector[n_points] stress_model; // Pa
  vector[n_points] stress_replicated; // Pa
  vector[n_points] log_lik; // of each point given those before it
  // Of each point given all others; where residuals are independent, log_lik is that already.
  vector[correlated_residuals ? n_points : 0] log_lik_given_others;
  // Where the microstructure was measured: grain size (m) and fabric factor.
  matrix[n_measured, 2] microstructure_model;
  matrix[n_measured, 2] microstructure_replicated;
  matrix[n_measured, 2] microstructure_log_lik;
  real log_density; // of the coordinates, as the model block has it
  vector[n_grid] grid_stress; // Pa
  vector[n_grid] grid_stress_replicated; // Pa
  vector[n_grid] grid_kelvin_strain;
  vector[n_grid] grid_grain_size; // m
  vector[n_grid] grid_fabric_factor;
  vector[n_grid] grid_dashpot_share; // dashpot rate over imposed rate
  vector[n_grid] grid_stress_slope; // d stress/d strain, Pa
  // Softening of the flow strength along strain, split between its two causes.
  vector[n_grid] grid_grain_size_softening;
  vector[n_grid] grid_fabric_softening;
  for (e in 1 : n_tests) {
#include charts/constant_rate_parameters.stan
    parameter[e] = head(mapped, n_parameters());
    log_reference[e] = log_reference_stress_at(parameter[e], segment_rate[segment_end[e] + 1],
                                               initial_grain_size[e], temperature[e]);
    log_jacobian += mapped[n_parameters() + 1];
    log_pooling += mapped[n_parameters() + 2];
  }
#include statistics/prior_density.stan
  log_density = lprior + log_jacobian + log_pooling;
  for (e in 1 : n_tests) {
    array[point_end[e + 1] - point_end[e]] int points = part(point_end, e);
    array[measured_end[e + 1] - measured_end[e]] int sections = part(measured_end, e);
    real noise = parameter[e][i_stress_noise()];
    real correlation_strain = parameter[e][i_residual_correlation_strain()];
    real share = parameter[e][i_residual_correlated_share()];
    array[strain_end[e + 1] - strain_end[e]] vector[n_states] solution
      = constant_rate_solution(parameter[e], prior_location[e], strain[part(strain_end, e)],
                               n_strains_in_segment[part(segment_end, e)],
                               segment_start[part(segment_end, e)],
                               segment_rate[part(segment_end, e)], initial_grain_size[e],
                               temperature[e], kelvin_law, solver, tolerance, max_num_steps);
    stress_model[points] = stress_reading_factor(parameter[e])
                           * to_vector(solution[strain_of_point[points], 1]);
    stress_replicated[points] = stress_model[points]
                                + residuals_rng(point_strain[points], point_segment[points],
                                                noise, correlation_strain, share);
    {
      matrix[size(points), 2] log_density_of_points = log_densities_of_residuals(
        stress_observed[points] - stress_model[points], noise, correlated_residuals,
        point_strain[points], point_segment[points], correlation_strain, share);
      log_lik[points] = log_density_of_points[ : , 1];
      if (correlated_residuals) {
        log_lik_given_others[points] = log_density_of_points[ : , 2];
      }
    }
    if (size(sections) > 0) {
      array[size(sections)] int places = strain_of_measured[sections];
      microstructure_model[sections]
        = microstructure_along(solution[places], strain[part(strain_end, e)][places],
                               parameter[e], initial_grain_size[e]);
      microstructure_replicated[sections]
        = microstructure_rng(measured[sections], microstructure_model[sections]);
      microstructure_log_lik[sections]
        = microstructure_log_densities(measured[sections], microstructure_model[sections]);
    }
    if (use_likelihood) {
      log_density += sum(log_lik[points]) + sum(microstructure_log_lik[sections]);
    }
  }
#include kinds/constant_rate_grid.stan
}
