// Tables of attenuation (tan delta, 1/Q) and modulus against period and temperature: Maxwell
// spring and power-law dashpot in series with a Kelvin-Voigt element under stress cycles, its
// microstructure frozen, in closed form (docs/model.md, docs/attenuation_data.md).
//
// All values are SI. Priors, fixed parameters and the likelihood switch are data, and parameters
// of several tables are shared, partially pooled or separate, as in loading_history.stan. There is
// nothing to integrate in time: the solver's options are without effect.
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
#include statistics/priors.stan
#include statistics/priors_of_test.stan
#include charts/plain.stan
#include charts/stretched_flow.stan
#include charts/pooling.stan
#include charts/stretched.stan
#include kinds/attenuation_response.stan
}
data {
#include data/tests.stan
#include data/attenuation.stan
#include data/priors.stan
#include data/coordinates.stan
#include data/stretched.stan
#include data/solver.stan
  array[n_tests] real<lower=0> stress_scale; // Pa, of the sampled flow rate
}
transformed data {
  int n_points = point_end[n_tests + 1];
  int n_grid = reading_grid_end[n_tests + 1];
  array[n_tests] vector[n_parameters()] prior_mass
    = prior_log_masses(prior_family, prior_location, prior_scale, prior_lower, prior_upper);
  array[n_tests] int flow_place; // of the flow rate among a test's own ones, 0: it has none
  for (e in 1 : n_tests) {
    flow_place[e] = replaced_parameter[e] > 0 ? own_place[e, replaced_parameter[e]] : 0;
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
      plain = plain_from_stretched(coordinate[own_position[own]], given, own_place[e],
                                   quantity[own], flow_place[e], stretched_unit[own],
                                   stretched_slope[own], stretched_reference[e]);
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
    log_pooling += pooled[n_parameters() + 2];
  }
#include statistics/prior_density.stan
}
model {
  target += lprior + log_jacobian + log_pooling;
  if (use_likelihood) {
    for (e in 1 : n_tests) {
#include kinds/attenuation_law.stan
      target += sum(log_reading_densities(log_reading_observed[readings], is_limit[readings],
                                          law));
    }
  }
}
generated quantities {
  // What would be read without scatter: the stated error or the limit, where the model lies below.
  vector[n_points] response_model;
  vector[n_points] response_replicated;
  vector[n_points] log_lik;
  // Of the coordinates, as the model block has it; here for runs of this block by itself.
  real log_density = lprior + log_jacobian + log_pooling;
  // What the chart is set up with: ln of the largest share of the loss of a row that the dashpot
  // carries; ln of the mean time (s) of the cycles, slowed as relaxation is, at the temperature and
  // grain size of the Kelvin viscosity; the coordinates there.
  vector[n_tests] log_dashpot_share;
  vector[n_tests] log_middle_time;
  vector[own_end[n_tests + 1]] stretched_coordinate;
  vector[n_grid] grid_log_reading; // ln(tan delta) or ln(modulus / Pa)
  vector[n_grid] grid_log_reading_replicated;
  vector[n_grid] grid_log_relaxation_time; // the longest of the Kelvin part, ln s
  vector[n_grid] grid_log_maxwell_time; // 1/(E_M B), ln s
  for (e in 1 : n_tests) {
    array[point_end[e + 1] - point_end[e]] int points = part(point_end, e);
#include kinds/attenuation_readings.stan
    response_model[points] = read;
    response_replicated[points] = replicated;
    log_lik[points] = log_density_of_readings;
    log_dashpot_share[e]
      = largest_log_dashpot_share(parameter[e], frequency[here], row_temperature[here],
                                  initial_grain_size[e], conversion[e], regime[here],
                                  median_stress[regimes], amplitude[regimes],
                                  node_end[regime_end[e] + 1 : regime_end[e + 1] + 1], node);
    log_middle_time[e] = log(parameter[e][i_kelvin_viscosity()]
                             / parameter[e][i_kelvin_modulus()])
                         - mean(log(frequency[here])
                                + log_relaxation_times(parameter[e], row_temperature[here],
                                                       initial_grain_size[e]));
    stretched_coordinate[part(own_end, e)]
      = stretched_from_plain(plain_coordinate[part(own_end, e)], parameter[e], own_place[e],
                             quantity[part(own_end, e)], flow_place[e],
                             stretched_unit[part(own_end, e)],
                             stretched_slope[part(own_end, e)], stretched_reference[e]);
    if (use_likelihood) {
      log_density += sum(log_lik[points]);
    }
  }
#include kinds/attenuation_grid.stan
}
