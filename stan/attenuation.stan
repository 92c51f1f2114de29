// Tables of attenuation (tan delta, 1/Q) and modulus against period and temperature: Maxwell
// spring and power-law dashpot in series with a Kelvin-Voigt element under stress cycles, its
// microstructure frozen, in closed form (docs/model.md, docs/attenuation_data.md).
//
// All values are SI. Priors, fixed parameters and the likelihood switch are data, and parameters
// of several tables are shared, partially pooled or separate, as in constant_rate.stan. There is
// nothing to integrate in time: the solver's options are without effect.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/kelvin_element.stan
#include physics/relaxation.stan
#include physics/stress_cycles.stan
#include statistics/priors.stan
#include charts/plain.stan
#include charts/pooling.stan
#include charts/stretched.stan
#include charts/spectral.stan
#include protocols/attenuation_response.stan
}
data {
#include data/tests.stan
#include data/attenuation.stan
#include data/priors.stan
#include data/coordinates.stan
#include data/spectral.stan
#include data/solver.stan
  // Readings that generated quantities report apart from the observed ones.
  array[n_tests + 1] int<lower=0> grid_end;
  vector<lower=0>[grid_end[n_tests + 1]] grid_frequency;
  vector<lower=0>[grid_end[n_tests + 1]] grid_temperature;
  array[grid_end[n_tests + 1]] int<lower=1> grid_regime;
  array[grid_end[n_tests + 1]] int<lower=1, upper=2> grid_quantity;
  vector<lower=0>[grid_end[n_tests + 1]] grid_stated_error;
}
transformed data {
  int n_points = point_end[n_tests + 1];
  int n_grid = grid_end[n_tests + 1];
  array[n_tests] vector[n_parameters()] prior_mass
    = prior_log_masses(prior_family, prior_location, prior_scale, prior_lower, prior_upper);
}
parameters {
  vector[n_coordinates] coordinate;
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
      plain = plain_from_spectral(coordinate[own_position[own]], given, own_place[e],
                                  quantity[own], replaced_parameter[e], spectral_reference[e]);
    }
    plain_coordinate[own] = head(plain, size(own));
    mapped = parameters_from_plain(plain_coordinate[own], own_parameter[own], quantity[own],
                                   given, replaced_parameter[e], 0, log(stress_scale[e]),
                                   initial_grain_size[e], temperature[e]);
    parameter[e] = head(mapped, n_parameters());
    log_reference[e] = log_flow_rate(stress_scale[e], initial_grain_size[e], temperature[e],
                                     parameter[e][i_stress_exponent()],
                                     parameter[e][i_grain_size_exponent()],
                                     parameter[e][i_activation_enthalpy()],
                                     parameter[e][i_beta()]);
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
      array[row_end[e + 1] - row_end[e]] int here = part(row_end, e);
      array[regime_end[e + 1] - regime_end[e]] int regimes = part(regime_end, e);
      vector[2 * size(here)] of_rows
        = log_tan_delta_and_modulus(parameter[e], frequency[here], row_temperature[here],
                                    initial_grain_size[e], conversion[e],
                                    log_fluidity(parameter[e], row_temperature[here],
                                                 initial_grain_size[e], regime[here],
                                                 median_stress[regimes], amplitude[regimes],
                                                 node_end[regime_end[e] + 1 : regime_end[e + 1] + 1],
                                                 node));
      array[point_end[e + 1] - point_end[e]] int points = part(point_end, e);
      vector[2 * size(points)] law = log_reading_law(parameter[e], of_rows[reading[points]],
                                                     quantity_of_point[points],
                                                     stated_error[points]);
      for (i in 1 : size(points)) {
        target += log_reading_density(log_reading_observed[points[i]], is_limit[points[i]],
                                      law[i], law[size(points) + i]);
      }
    }
  }
}
generated quantities {
  // What would be read without scatter: the stated error or the limit, where the model lies below.
  vector[n_points] log_reading_model;
  vector[n_points] log_reading_replicated;
  vector[n_points] log_lik;
  // Of the coordinates, as the model block has it; here for runs of this block by itself.
  real log_density = lprior + log_jacobian + log_pooling;
  // What the chart is set up with: ln of the largest share of the loss of a row that the dashpot
  // carries; ln of the mean time (s) of the cycles, slowed as relaxation is, at the temperature and
  // grain size of the Kelvin viscosity; the coordinates there.
  vector[n_tests] log_dashpot_share;
  vector[n_tests] log_middle_time;
  vector[own_end[n_tests + 1]] spectral_coordinate;
  vector[n_grid] grid_log_reading; // ln(tan delta) or ln(modulus / Pa)
  vector[n_grid] grid_log_reading_replicated;
  vector[n_grid] grid_log_relaxation_time; // the longest of the Kelvin part, ln s
  vector[n_grid] grid_log_maxwell_time; // 1/(E_M B), ln s
  for (e in 1 : n_tests) {
    array[row_end[e + 1] - row_end[e]] int here = part(row_end, e);
    array[regime_end[e + 1] - regime_end[e]] int regimes = part(regime_end, e);
    array[point_end[e + 1] - point_end[e]] int points = part(point_end, e);
    array[grid_end[e + 1] - grid_end[e]] int on_grid = part(grid_end, e);
    array[size(regimes) + 1] int nodes = node_end[regime_end[e] + 1 : regime_end[e + 1] + 1];
    vector[size(here)] row_log_fluidity
      = log_fluidity(parameter[e], row_temperature[here], initial_grain_size[e], regime[here],
                     median_stress[regimes], amplitude[regimes], nodes, node);
    vector[2 * size(here)] of_rows
      = log_tan_delta_and_modulus(parameter[e], frequency[here], row_temperature[here],
                                  initial_grain_size[e], conversion[e], row_log_fluidity);
    vector[size(on_grid)] grid_log_fluidity
      = log_fluidity(parameter[e], grid_temperature[on_grid], initial_grain_size[e],
                     grid_regime[on_grid], median_stress[regimes], amplitude[regimes], nodes,
                     node);
    vector[2 * size(on_grid)] of_grid
      = log_tan_delta_and_modulus(parameter[e], grid_frequency[on_grid],
                                  grid_temperature[on_grid], initial_grain_size[e],
                                  conversion[e], grid_log_fluidity);
    vector[2 * size(points)] law = log_reading_law(parameter[e], of_rows[reading[points]],
                                                   quantity_of_point[points],
                                                   stated_error[points]);
    vector[2 * size(on_grid)] grid_law;
    log_middle_time[e] = log(parameter[e][i_kelvin_viscosity()]
                             / parameter[e][i_kelvin_modulus()])
                         - mean(log(frequency[here])
                                + log_relaxation_times(parameter[e], row_temperature[here],
                                                       initial_grain_size[e]));
    spectral_coordinate[part(own_end, e)]
      = spectral_from_plain(plain_coordinate[part(own_end, e)], parameter[e], own_place[e],
                            quantity[part(own_end, e)], replaced_parameter[e],
                            spectral_reference[e]);
    log_dashpot_share[e] = max(log(conversion[e, 3]) + row_log_fluidity - log(frequency[here])
                               - log_loss(head(of_rows, size(here)), tail(of_rows, size(here))));
    for (j in 1 : size(on_grid)) {
      grid_log_reading[on_grid[j]] = of_grid[j + (grid_quantity[on_grid[j]] - 1) * size(on_grid)];
    }
    grid_log_relaxation_time[on_grid]
      = log_relaxation_times(parameter[e], grid_temperature[on_grid], initial_grain_size[e]);
    grid_log_maxwell_time[on_grid]
      = -log(maxwell_modulus_at(parameter[e], grid_temperature[on_grid])) - grid_log_fluidity;
    grid_law = log_reading_law(parameter[e], grid_log_reading[on_grid], grid_quantity[on_grid],
                               grid_stated_error[on_grid]);
    for (j in 1 : size(on_grid)) {
      grid_log_reading_replicated[on_grid[j]] = normal_rng(grid_law[j],
                                                           grid_law[size(on_grid) + j]);
    }
    for (i in 1 : size(points)) {
      int k = points[i];
      log_reading_model[k] = fmax(law[i], log_limit[k]);
      log_reading_replicated[k] = fmax(normal_rng(law[i], law[size(points) + i]), log_limit[k]);
      log_lik[k] = log_reading_density(log_reading_observed[k], is_limit[k], law[i],
                                       law[size(points) + i]);
    }
    if (use_likelihood) {
      log_density += sum(log_lik[points]);
    }
  }
}
