/**
 * Log density of several tests at constant rate: terms of a sum that threads can share.
 *
 * A function does not see the blocks of the program. All that a test needs of them is handed over,
 * by the names that it has there.
 */

/**
 * Log density of some tests: Jacobian of the map to their parameters, priors, readings.
 *
 * The map is in it, because it takes about as long as the solution. Left outside are the parameters
 * that other tests share, and centres and spreads of pooled ones.
 *
 * @param test numbers of the tests
 * @param first, last of these tests, among all
 * @param coordinate of all tests
 * @param parameter of every test that gives parameters to others, in the order of
 *   physics/parameters.stan; of the others only what is fixed
 * @param gives 1: other tests share parameters of this one, whose map is already taken and counted
 */
real constant_rate_log_density(
    data array[] int test, data int first, data int last, vector coordinate,
    array[] vector parameter, data array[] int gives, vector pooled_spread,
    // data/tests.stan
    data array[] real temperature, data array[] real initial_grain_size, data array[] int point_end,
    data int use_likelihood, data int kelvin_law,
    // data/constant_rate.stan
    data vector stress_observed, data array[] int segment_end, data array[] real segment_start,
    data array[] real segment_rate, data array[] int strain_end, data array[] real strain,
    data array[] int n_strains_in_segment, data array[] int strain_of_point,
    data vector point_strain, data array[] int point_segment, data array[] int measured_end,
    data array[] int strain_of_measured, data matrix measured, data int correlated_residuals,
    // data/priors.stan, with the masses that truncation leaves
    data array[,] int prior_family, data array[] vector prior_location,
    data array[] vector prior_scale, data array[] vector prior_lower,
    data array[] vector prior_upper, data array[] vector prior_mass,
    data array[] int has_flow_law_prior, data vector flow_law_mean, data matrix flow_law_factor,
    data vector flow_law_conditions,
    // data/coordinates.stan
    data int coordinate_system, data array[] int shared_parameter, data array[,] int shared_from,
    data array[] int own_end, data array[] int own_parameter, data array[] int own_position,
    data matrix quantity, data array[,] int own_place, data array[] int replaced_parameter,
    data array[] int pooled_parameter, data array[,] int pooled_position,
    data array[] matrix pooled_quantity, data array[] int centre_position,
    data vector centre_reference, data array[] vector pooled_reference,
    data real pooled_data_precision,
    // data/valley.stan and charts/valley_references.stan
    data array[] int knot_end, data matrix knot, data array[] int pin_end, data matrix pin,
    data matrix guide, data array[] int noise_parameter,
    data array[] vector conditions, data array[] int reference_end, data vector reference,
    data matrix element,
    // data/solver.stan
    data int solver, data real tolerance, data int max_num_steps) {
  real log_density = 0;
  for (e in test) {
    vector[n_parameters()] value = parameter[e];
    if (!gives[e]) {
#include charts/constant_rate_parameters.stan
      value = head(mapped, n_parameters());
      log_density += mapped[n_parameters() + 1] + mapped[n_parameters() + 2];
    }
    log_density += test_prior_log_density(value, prior_family[e], prior_location[e],
                                          prior_scale[e], prior_lower[e], prior_upper[e],
                                          prior_mass[e], has_flow_law_prior[e], flow_law_mean,
                                          flow_law_factor, flow_law_conditions);
    if (use_likelihood) {
      array[point_end[e + 1] - point_end[e]] int points = part(point_end, e);
      array[measured_end[e + 1] - measured_end[e]] int sections = part(measured_end, e);
      array[strain_end[e + 1] - strain_end[e]] vector[n_constant_rate_states(prior_location[e])]
        solution = constant_rate_solution(value, prior_location[e], strain[part(strain_end, e)],
                                          n_strains_in_segment[part(segment_end, e)],
                                          segment_start[part(segment_end, e)],
                                          segment_rate[part(segment_end, e)],
                                          initial_grain_size[e], temperature[e],
                                          kelvin_law, solver, tolerance, max_num_steps);
      log_density += stress_log_density(stress_observed[points],
                                        stress_reading_factor(value)
                                        * to_vector(solution[strain_of_point[points], 1]),
                                        value[i_stress_noise()], correlated_residuals,
                                        point_strain[points], point_segment[points],
                                        value[i_residual_correlation_strain()],
                                        value[i_residual_correlated_share()]);
      if (size(sections) > 0) {
        array[size(sections)] int places = strain_of_measured[sections];
        log_density += sum(microstructure_log_densities(
          measured[sections],
          microstructure_along(solution[places], strain[part(strain_end, e)][places], value,
                               initial_grain_size[e])));
      }
    }
  }
  return log_density;
}
