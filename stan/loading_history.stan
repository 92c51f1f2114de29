// Nonlinear Burgers model of tests under any loading history: strain or stress imposed, piecewise
// linear in time, the other one read. Maxwell spring and power-law dashpot in series with a
// Kelvin-Voigt element, grain size and fabric evolving with the path strain (Maor, Hansen,
// Jerolmack and Goldsby, Eqs. 1-5), solved leg by leg (kinds/loading_history_dynamics.stan).
//
// All values are SI. Priors, fixed parameters, solver tolerance and the likelihood switch are
// data. With every parameter fixed (n_coordinates = 0, algorithm=fixed_param) the program is a
// forward simulation. Parameters of several tests are shared, partially pooled or separate.
//
// A test at constant rate is a history whose residuals correlate along strain, and in which ln S_0
// is sampled in place of the flow rate (data/loading_history.stan).
//
// Some of the tests may be tables of attenuation and modulus in place of histories
// (data/attenuation.stan): they have no legs, their points are the readings of the table, and their
// answer is a closed form in which the microstructure is frozen (attenuation_response.stan).
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/environment.stan
#include physics/composite_law.stan
#include physics/dashpot_mechanisms.stan
#include physics/dashpot_laws.stan
#include physics/hardening.stan
#include physics/kelvin_laws.stan
#include physics/relaxation.stan
#include physics/stress_cycles.stan
#include physics/microstructure.stan
#include solvers/radau_leg.stan
#include kinds/loading_history_rates.stan
#include kinds/loading_history_legs.stan
#include kinds/loading_history_dynamics.stan
#include statistics/priors.stan
#include statistics/priors_of_test.stan
#include statistics/residuals.stan
#include statistics/measured_microstructure.stan
#include charts/plain.stan
#include charts/stretched_flow.stan
#include charts/flow_of_hardened.stan
#include charts/parted_rates.stan
#include charts/pooling.stan
#include kinds/attenuation_response.stan
#include charts/valley/pins.stan
#include charts/valley/mechanisms.stan
#include charts/valley/least_squares.stan
#include charts/valley/quantiles.stan
#include charts/valley/softening.stan
#include charts/valley/elastic_rise.stan
#include charts/valley/grain_size_edge.stan
#include charts/valley/valley.stan
}
data {
#include data/tests.stan
#include data/loading_history.stan
#include data/attenuation.stan
#include data/priors.stan
#include data/coordinates.stan
#include data/valley.stan
#include data/solver.stan
  int<lower=0, upper=1> solver; // 0: ode_bdf_tol, 1: radau_leg() (solvers/radau_leg.stan)
  // Where generated quantities report the solution, apart from the readings.
  array[n_tests + 1] int<lower=0> grid_end;
  array[grid_end[n_tests + 1]] real<lower=0, upper=1> grid_time_in_leg;
  array[leg_end[n_tests + 1]] int<lower=0> n_grid_in_leg;
  vector[grid_end[n_tests + 1]] grid_position; // as point_position
  array[grid_end[n_tests + 1]] int<lower=0> grid_stage; // of its test
}
transformed data {
  int n_points = point_end[n_tests + 1];
  int n_grid = grid_end[n_tests + 1];
  int n_measured = measured_end[n_tests + 1];
  int n_reading_grid = reading_grid_end[n_tests + 1];
  // What some free parameter changes; the rest is constant to the solver.
  array[n_parameters()] int is_free = free_in_any_test(own_parameter, pooled_parameter);
  int hardening = any_hardening(prior_location);
  int n_further = most_further_mechanisms(prior_location);
  array[size(varying_rates(is_free, element, hardening, n_further))] int varying
    = varying_rates(is_free, element, hardening, n_further);
  array[leg_end[n_tests + 1]] vector[n_history_rates()] fixed;
  array[n_tests] vector[n_history_constants()] test;
  array[n_tests] vector[n_parameters()] prior_mass
    = prior_log_masses(prior_family, prior_location, prior_scale, prior_lower, prior_upper);
  for (e in 1 : n_tests) {
    test[e] = history_constants(prior_location[e], initial_grain_size[e], stress_scale[e],
                                strain_scale[e], kelvin_law);
    fixed[part(leg_end, e)] = fixed_rates(prior_location[e], leg[part(leg_end, e)],
                                          initial_grain_size[e], test[e]);
  }
#include charts/valley_references.stan
}
parameters {
  vector<multiplier=unit>[n_coordinates] coordinate;
}
transformed parameters {
#include charts/parameters_of_tests.stan
  // ln of the flow rate (s) (charts/flow_of_hardened.stan), or ln(S_0/Pa)
  vector[n_tests] log_reference;
  for (e in 1 : n_tests) {
#include charts/given_parameters.stan
#include charts/valley_or_plain.stan
    vector[n_parameters() + 1] mapped
      = parameters_from_plain(head(plain, size(own)), own_parameter[own], quantity[own], given,
                              0, 0, 0, initial_grain_size[e], temperature[e]);
    int samples_stress = reference_stress_rate[e] > 0;
    vector[n_parameters() + 1] parted
      = with_parted_rates(head(mapped, n_parameters()),
                          coordinate_system == 2 && pin_end[e + 1] > pin_end[e]
                          ? {0, 0}
                          : rates_that_move(own_place[e], quantity[own]),
                          replaced_parameter[e],
                          samples_stress, samples_stress ? log(reference_stress_rate[e]) : 0,
                          stress_scale[e], initial_grain_size[e], temperature[e]);
    real shift = samples_stress ? 0
                 : log_reference_flow_shift(head(parted, n_parameters()), stress_scale[e],
                                            strain_scale[e], initial_grain_size[e]);
    parameter[e] = head(parted, n_parameters());
    if (replaced_parameter[e] > 0) {
      parameter[e][replaced_parameter[e]] -= shift;
    }
    vector[n_parameters() + 1] resolved
      = resolve_flow(parameter[e], replaced_parameter[e], samples_stress,
                     log(samples_stress ? reference_stress_rate[e] : stress_scale[e]),
                     initial_grain_size[e], temperature[e]);
    parameter[e] = head(resolved, n_parameters());
    log_reference[e] = samples_stress
                       ? log_reference_stress_at(parameter[e], reference_stress_rate[e],
                                                 initial_grain_size[e], temperature[e])
                       : shift
                         + log_flow_rate_at(stress_scale[e], initial_grain_size[e],
                                            temperature[e], parameter[e]);
    log_jacobian += plain[size(own) + 1] + mapped[n_parameters() + 1]
                    + parted[n_parameters() + 1] + resolved[n_parameters() + 1];
    // A table has nothing to say of what is partially pooled: it carries another test's value.
    if (row_end[e + 1] == row_end[e]) {
      log_jacobian += pooled[n_parameters() + 1];
      log_pooling += pooled[n_parameters() + 2];
    }
  }
#include statistics/prior_density.stan
}
model {
  target += lprior + log_jacobian + log_pooling;
  if (use_likelihood) {
    for (e in 1 : n_tests) {
      if (row_end[e + 1] > row_end[e]) {
#include kinds/attenuation_law.stan
        target += sum(log_reading_densities(log_reading_observed[readings], is_limit[readings],
                                            law));
      } else {
        array[point_end[e + 1] - point_end[e]] int points = part(point_end, e);
        array[measured_end[e + 1] - measured_end[e]] int sections = part(measured_end, e);
#include kinds/loading_history_response.stan
        // Residuals over their standard deviations, so that stress and strain have one process.
        target += stress_log_density(rep_vector(0, size(points)),
                                     (response - response_observed[points]) ./ noise, 1,
                                     correlated_residuals, point_position[points],
                                     point_stage[points], parameter[e][correlation_parameter],
                                     share_that_correlates(parameter[e]))
                  - sum(log(noise));
        if (size(sections) > 0) {
          target += sum(microstructure_log_densities(
            measured[sections],
            section_microstructure(states, output_of_measured[sections],
                                   measured_path_strain[sections], parameter[e], test[e],
                                   initial_grain_size[e])));
        }
      }
    }
  }
}
generated quantities {
  vector[n_points] response_model; // Pa or 1; of tables ln(tan delta), ln(modulus / Pa)
  vector[n_points] response_replicated;
  vector[n_points] log_lik; // of each point given those before it
  // Of each point given all others; where residuals are independent, log_lik is that already.
  vector[correlated_residuals ? n_points : 0] log_lik_given_others;
  // Where the microstructure was measured: grain size (m) and fabric factor.
  matrix[n_measured, 2] microstructure_model;
  matrix[n_measured, 2] microstructure_replicated;
  matrix[n_measured, 2] microstructure_log_lik;
  // Of the coordinates, as the model block has it; here for runs of this block by itself.
  real log_density = lprior + log_jacobian + log_pooling;
  vector[n_grid] grid_stress; // Pa
  vector[n_grid] grid_stress_replicated;
  vector[n_grid] grid_strain; // as it is read
  vector[n_grid] grid_strain_replicated;
  vector[n_grid] grid_strain_rate; // 1/s
  vector[n_grid] grid_kelvin_strain;
  vector[n_grid] grid_path_strain;
  vector[n_grid] grid_grain_size; // m
  vector[n_grid] grid_fabric_factor;
  // Softening of the flow strength, split between its two causes.
  vector[n_grid] grid_grain_size_softening;
  vector[n_grid] grid_fabric_softening;
  vector[n_reading_grid] grid_log_reading; // ln(tan delta) or ln(modulus / Pa)
  vector[n_reading_grid] grid_log_reading_replicated;
  vector[n_reading_grid] grid_log_relaxation_time; // the longest of the Kelvin part, ln s
  vector[n_reading_grid] grid_log_maxwell_time; // 1/(E_M B), ln s
  for (e in 1 : n_tests) {
    array[point_end[e + 1] - point_end[e]] int points = part(point_end, e);
    array[measured_end[e + 1] - measured_end[e]] int sections = part(measured_end, e);
    if (row_end[e + 1] > row_end[e]) {
#include kinds/attenuation_readings.stan
      response_model[points] = read;
      response_replicated[points] = replicated;
      log_lik[points] = log_density_of_readings;
      if (correlated_residuals) {
        log_lik_given_others[points] = log_density_of_readings; // a table's never are
      }
    } else {
      real correlation = parameter[e][correlation_parameter];
      real share = share_that_correlates(parameter[e]);
#include kinds/loading_history_response.stan
      response_model[points] = response;
      response_replicated[points]
        = response_model[points]
          + noise
            .* residuals_rng(point_position[points], point_stage[points], 1, correlation, share);
      {
        matrix[size(points), 2] log_density_of_points = log_densities_of_residuals(
          (response_observed[points] - response_model[points]) ./ noise, 1, correlated_residuals,
          point_position[points], point_stage[points], correlation, share);
        log_lik[points] = log_density_of_points[ : , 1] - log(noise);
        if (correlated_residuals) {
          log_lik_given_others[points] = log_density_of_points[ : , 2] - log(noise);
        }
      }
      if (size(sections) > 0) {
        microstructure_model[sections]
          = section_microstructure(states, output_of_measured[sections],
                                   measured_path_strain[sections], parameter[e], test[e],
                                   initial_grain_size[e]);
        microstructure_replicated[sections]
          = microstructure_rng(measured[sections], microstructure_model[sections]);
        microstructure_log_lik[sections]
          = microstructure_log_densities(measured[sections], microstructure_model[sections]);
      }
    }
    if (use_likelihood) {
      log_density += sum(log_lik[points]) + sum(microstructure_log_lik[sections]);
    }
  }
#include kinds/loading_history_grid.stan
#include kinds/attenuation_grid.stan
}
