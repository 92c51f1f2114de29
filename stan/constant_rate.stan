// Nonlinear Burgers model of tests at imposed, piecewise constant strain rate:
// Maxwell spring and power-law dashpot in series with a Kelvin-Voigt element, grain size and
// fabric evolving with strain (Maor, Hansen, Jerolmack and Goldsby, Eqs. 1-4), in the exact
// two-state reduction of functions/constant_rate_dynamics.stan.
//
// All values are SI. Priors, fixed parameters, solver tolerances and the likelihood switch are
// data. With every parameter fixed (n_coordinates = 0, algorithm=fixed_param) the program is a
// forward simulation.
//
// Several tests are fitted together where there are further ones; a single fit has none. Each
// parameter is then shared, partially pooled or separate (functions/pooling.stan).
functions {
#include functions/parameters.stan
#include functions/flow_law.stan
#include functions/kelvin_element.stan
#include functions/microstructure.stan
#include functions/residuals.stan
#include functions/priors.stan
#include functions/coordinates.stan
#include functions/pooling.stan
#include functions/valley_coordinates.stan
#include functions/constant_rate_dynamics.stan
}
data {
#include data/constant_rate_experiment.stan
#include data/priors.stan
#include data/coordinates.stan
#include data/valley.stan
#include data/solver.stan
  // Strains at which generated quantities report the solution, apart from the observed ones.
  int<lower=0> n_grid;
  array[n_grid] real<lower=0> grid_strain;
  array[n_segments] int<lower=0> n_grid_in_segment;
#include data/further_experiments.stan
}
transformed data {
  // From here on all tests stand in the same arrays, one after the other, the first one first.
  int n_experiments = 1 + n_further;
  int n_all_points = n_points + sum(n_further_points);
  int n_all_grid = n_grid + sum(n_further_grid);
  array[n_experiments] real all_temperature = append_array({temperature}, further_temperature);
  array[n_experiments] real all_grain_size
    = append_array({initial_grain_size}, further_initial_grain_size);
  array[n_segments + sum(n_further_segments)] real all_segment_start
    = append_array(segment_start, further_segment_start);
  array[n_segments + sum(n_further_segments)] real all_segment_rate
    = append_array(segment_rate, further_segment_rate);
  array[n_segments + sum(n_further_segments)] int all_strains_in_segment
    = append_array(n_strains_in_segment, n_further_strains_in_segment);
  array[n_segments + sum(n_further_segments)] int all_grid_in_segment
    = append_array(n_grid_in_segment, n_further_grid_in_segment);
  array[n_strains + sum(n_further_strains)] real all_strain
    = append_array(strain, further_strain);
  array[n_all_points] int all_strain_of_point
    = append_array(strain_of_point, further_strain_of_point);
  vector[n_all_points] all_stress_observed
    = append_row(stress_observed, further_stress_observed);
  array[n_all_grid] real all_grid_strain = append_array(grid_strain, further_grid_strain);
  // Where the parts of each test end; they start behind those of the test before.
  array[n_experiments + 1] int segment_end
    = ends_of(append_array({n_segments}, n_further_segments));
  array[n_experiments + 1] int strain_end = ends_of(append_array({n_strains}, n_further_strains));
  array[n_experiments + 1] int point_end = ends_of(append_array({n_points}, n_further_points));
  array[n_experiments + 1] int grid_end = ends_of(append_array({n_grid}, n_further_grid));
  array[n_experiments + 1] int knot_end = ends_of(append_array({n_knots}, n_further_knots));
  array[n_experiments + 1] int pin_end = ends_of(append_array({n_pins}, n_further_pins));
  vector[n_all_points] point_strain;
  // The Kelvin element is linear where n_K is fixed at 1.
  int power_law_kelvin = prior_family[13] != 0 || prior_location[13] != 1;
  // Above 0 where the grain size follows a piezometer.
  int piezometric = prior_location[18] > 0;
  int n_states = piezometric ? 3 : 2;
  // Residuals are independent where their correlation strain is fixed at 0.
  int correlated_residuals = prior_family[17] != 0 || prior_location[17] != 0;
  array[n_experiments] vector[n_parameters()] all_prior_location
    = append_array({prior_location}, further_prior_location);
  array[n_experiments] vector[n_parameters()] all_prior_scale
    = append_array({prior_scale}, further_prior_scale);
  array[n_experiments] vector[n_parameters()] all_prior_lower
    = append_array({prior_lower}, further_prior_lower);
  array[n_experiments] vector[n_parameters()] all_prior_upper
    = append_array({prior_upper}, further_prior_upper);
  array[n_experiments] vector[n_parameters()] prior_mass;
  // Families in each test: 0 also where the prior is counted elsewhere, in the first test for
  // shared parameters and with the centre for partially pooled ones.
  array[n_experiments, n_parameters()] int counted_family;
  array[n_experiments] int flow_law_counted; // whether the joint prior of the flow law is
  array[n_experiments] vector[n_coordinates] shift
    = append_array({quantity_shift}, further_quantity_shift);
  array[n_experiments] vector[n_coordinates] scale
    = append_array({quantity_scale}, further_quantity_scale);
  array[n_experiments] vector[n_coordinates] lower
    = append_array({quantity_lower}, further_quantity_lower);
  array[n_experiments] vector[n_coordinates] upper
    = append_array({quantity_upper}, further_quantity_upper);
  array[n_experiments, n_coordinates] int position; // of a test's coordinates among all
  // Coordinates that a test does not share with the first one, by their places in the test, and
  // where they end as above.
  array[n_experiments * n_coordinates] int own;
  array[n_experiments + 1] int own_end = rep_array(0, n_experiments + 1);
  // Place of each parameter's coordinate among the own ones of a test, 0 where it has none.
  array[n_experiments, n_parameters()] int coordinate_of
    = rep_array(0, n_experiments, n_parameters());
  array[n_experiments] int own_replaced; // replaced_parameter, or 0 where it is not an own one
  array[n_coordinates] int pooled = rep_array(0, n_coordinates);
  array[n_experiments] vector[n_coordinates] reference_coordinates;
  array[n_experiments] vector[n_coordinates] all_linear_from;
  array[n_experiments] vector[n_coordinates] all_noise_exponent;
  vector[n_knots + sum(n_further_knots)] all_knot_time_step
    = append_row(knot_time_step, further_knot_time_step);
  vector[n_knots + sum(n_further_knots)] all_knot_stress
    = append_row(knot_stress, further_knot_stress);
  array[n_pins + sum(n_further_pins)] int all_pin_knot
    = append_array(pin_knot, further_pin_knot);
  matrix[n_pins + sum(n_further_pins), 6] all_pin = append_row(pin, further_pin);
  array[n_experiments] vector[coordinate_system == 2 ? 6 : 0] reference;
  vector[n_pins + sum(n_further_pins)] reference_log_strength;
  for (h in 1 : n_pooled) {
    pooled[pooled_coordinate[h]] = 1;
  }
  for (e in 1 : n_experiments) {
    for (i in part(point_end, e)) {
      point_strain[i] = all_strain[strain_end[e] + all_strain_of_point[i]];
    }
    for (k in 1 : n_parameters()) {
      prior_mass[e][k] = prior_log_mass(prior_family[k], all_prior_location[e][k],
                                        all_prior_scale[e][k], all_prior_lower[e][k],
                                        all_prior_upper[e][k]);
      counted_family[e, k] = e == 1 ? prior_family[k] : 0;
    }
    own_end[e + 1] = own_end[e];
    own_replaced[e] = 0;
    flow_law_counted[e] = e == 1;
    for (i in 1 : n_coordinates) {
      int k = parameter_of_coordinate[i];
      position[e, i] = e == 1 ? i : further_position[e - 1, i];
      if (e == 1 || position[e, i] > n_coordinates) {
        own_end[e + 1] += 1;
        own[own_end[e + 1]] = i;
        coordinate_of[e, k] = own_end[e + 1] - own_end[e];
        counted_family[e, k] = pooled[i] ? 0 : prior_family[k];
        if (k == replaced_parameter) {
          own_replaced[e] = k;
        }
        if (prior_family[k] == 4) {
          flow_law_counted[e] = 1;
        }
      }
    }
  }
  if (coordinate_system == 2) {
    for (e in 1 : n_experiments) {
      vector[n_parameters()] parameter;
      array[n_parameters()] int place = rep_array(0, n_parameters());
      reference_coordinates[e] = e == 1 ? reference_coordinate
                                 : further_reference_coordinate[e - 1];
      all_linear_from[e] = e == 1 ? linear_from : further_linear_from[e - 1];
      all_noise_exponent[e] = e == 1 ? noise_exponent : further_noise_exponent[e - 1];
      parameter = head(parameters_from_plain(reference_coordinates[e],
        parameter_of_coordinate, shift[e], scale[e], lower[e], upper[e], all_prior_location[e],
        replaced_parameter, 1, log(all_segment_rate[segment_end[e] + 1]), all_grain_size[e],
        all_temperature[e]), n_parameters());
      for (i in 1 : n_coordinates) {
        place[parameter_of_coordinate[i]] = i;
      }
      if (place[12] > 0 && all_noise_exponent[e][place[12]] != 0) {
        reject("noise_exponent of the stress noise itself must be 0");
      }
      reference[e] = valley_reference(reference_coordinates[e], place, shift[e], scale[e],
                                      parameter, replaced_parameter, all_grain_size[e]);
      reference_log_strength[part(pin_end, e)] = log_strength_at_pins(
        all_knot_time_step[part(knot_end, e)],
        all_knot_stress[part(knot_end, e)],
        all_pin_knot[part(pin_end, e)],
        all_pin[part(pin_end, e)],
        parameter[1], parameter[2], parameter[3], parameter[4]);
    }
  }
}
parameters {
  vector[n_coordinates + n_further_coordinates] coordinate;
}
transformed parameters {
  // Every test's parameters, in the order of functions/parameters.stan, and its reference stress.
  array[n_experiments] vector[n_parameters()] parameter = all_prior_location;
  vector[n_experiments] log_stress; // ln(S_0/Pa) at the rate of the first segment
  // Those of the first test, which is the only one of a single fit, by their names.
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
  real reference_stress; // S_0 at the rate of the first segment, Pa
  real kelvin_viscosity_here; // eta_K at the temperature of the test, Pa s
  vector[n_pooled] pooled_centre; // of partially pooled parameters, SI
  vector[n_pooled] pooled_spread; // on the real line
  real lprior = 0; // log density of the priors on physical parameters, centres and spreads
  real log_jacobian = 0; // ln |d(physical parameters)/d(coordinates)|
  real log_pooling = 0; // log density of partially pooled parameters given centres and spreads
  {
    // Of each coordinate of a test; those that are not partially pooled make no use of them.
    vector[n_coordinates] centre = rep_vector(0, n_coordinates);
    vector[n_coordinates] spread = rep_vector(1, n_coordinates);
    for (h in 1 : n_pooled) {
      int i = pooled_coordinate[h];
      int k = parameter_of_coordinate[i];
      int last = n_coordinates + n_further_coordinates;
      real log_spread = pooling_reference[n_pooled + h] + coordinate[last - n_pooled + h];
      centre[i] = pooling_reference[h] + coordinate[last - 2 * n_pooled + h];
      spread[i] = spread_scale[h] * exp(log_spread);
      pooled_centre[h] = bounded_from_real(centre[i], quantity_shift[i], quantity_scale[i],
                                           quantity_lower[i], quantity_upper[i]);
      pooled_spread[h] = spread[i];
      lprior += prior_log_density(pooled_centre[h], prior_family[k], prior_location[k],
                                  prior_scale[k], prior_lower[k], prior_upper[k],
                                  prior_mass[1][k])
                + normal_lpdf(spread[i] | 0, spread_scale[h]) + log(2);
      log_jacobian += log_slope_of_bounded(centre[i], quantity_scale[i], quantity_lower[i],
                                           quantity_upper[i])
                      + log(spread[i]);
    }
    for (e in 1 : n_experiments) {
      int n_own = own_end[e + 1] - own_end[e];
      array[n_own] int mine = own[part(own_end, e)];
      vector[n_parameters() + 2] mapped;
      vector[n_parameters()] shared = all_prior_location[e];
      if (e > 1) {
        for (i in 1 : n_coordinates) {
          if (position[e, i] <= n_coordinates) {
            shared[parameter_of_coordinate[i]] = parameter[1][parameter_of_coordinate[i]];
          }
        }
      }
      if (coordinate_system == 1) {
        mapped = parameters_from_pooled(
          coordinate[position[e, mine]], pooled[mine], centre[mine], spread[mine],
          parameter_of_coordinate[mine], shift[e][mine], scale[e][mine], lower[e][mine],
          upper[e][mine], shared, own_replaced[e], log(all_segment_rate[segment_end[e] + 1]),
          all_grain_size[e], all_temperature[e]);
      } else {
        mapped = parameters_from_valley(
          coordinate[position[e, mine]], parameter_of_coordinate[mine], coordinate_of[e],
          shift[e][mine], scale[e][mine], lower[e][mine], upper[e][mine], shared,
          own_replaced[e], all_segment_rate[segment_end[e] + 1], all_grain_size[e],
          all_temperature[e], all_knot_time_step[part(knot_end, e)],
          all_knot_stress[part(knot_end, e)],
          all_pin_knot[part(pin_end, e)],
          all_pin[part(pin_end, e)], reference_coordinates[e][mine],
          reference[e], reference_log_strength[part(pin_end, e)],
          all_linear_from[e][mine], all_noise_exponent[e][mine], pooled[mine], centre[mine],
          spread[mine]);
      }
      parameter[e] = head(mapped, n_parameters());
      log_jacobian += mapped[n_parameters() + 1];
      log_pooling += mapped[n_parameters() + 2];
      lprior += joint_prior_log_density(parameter[e], counted_family[e], all_prior_location[e],
                                        all_prior_scale[e], all_prior_lower[e],
                                        all_prior_upper[e], prior_mass[e]);
      if (flow_law_counted[e]) {
        lprior += flow_law_prior_log_density(parameter[e], flow_law_mean, flow_law_factor,
                                             flow_law_conditions);
      }
      log_stress[e] = log_reference_stress(all_segment_rate[segment_end[e] + 1],
                                           all_grain_size[e], all_temperature[e],
                                           parameter[e][4], parameter[e][5], parameter[e][6],
                                           parameter[e][7]);
    }
  }
  maxwell_modulus = parameter[1][1];
  kelvin_modulus = parameter[1][2];
  kelvin_viscosity = parameter[1][3];
  stress_exponent = parameter[1][4];
  grain_size_exponent = parameter[1][5];
  activation_enthalpy = parameter[1][6];
  beta = parameter[1][7];
  steady_state_grain_size = parameter[1][8];
  steady_state_fabric_factor = parameter[1][9];
  critical_strain_grain_size = parameter[1][10];
  critical_strain_fabric = parameter[1][11];
  stress_noise = parameter[1][12];
  kelvin_stress_exponent = parameter[1][13];
  kelvin_activation_enthalpy = parameter[1][14];
  residual_correlation_strain = parameter[1][17];
  kelvin_viscosity_here = kelvin_viscosity_at(kelvin_viscosity, kelvin_activation_enthalpy,
                                              temperature, prior_location[16]);
  reference_stress = exp(log_stress[1]);
}
model {
  target += lprior + log_jacobian + log_pooling;
  if (use_likelihood) {
    for (e in 1 : n_experiments) {
      int n_of_test = point_end[e + 1] - point_end[e];
      vector[n_of_test] observed
        = all_stress_observed[part(point_end, e)];
      vector[n_of_test] stress_model;
      array[strain_end[e + 1] - strain_end[e]] vector[n_states] solution
        = constant_rate_solution_at(parameter[e],
            all_strain[part(strain_end, e)],
            all_strains_in_segment[part(segment_end, e)],
            all_segment_start[part(segment_end, e)],
            all_segment_rate[part(segment_end, e)], all_grain_size[e],
            all_temperature[e], all_prior_location[e], power_law_kelvin, relative_tolerance,
            absolute_tolerance, max_num_steps);
      for (i in 1 : n_of_test) {
        stress_model[i] = solution[all_strain_of_point[point_end[e] + i]][1];
      }
      if (correlated_residuals) {
        target += sum(residual_log_densities(
          observed - stress_model, parameter[e][12],
          point_strain[part(point_end, e)], parameter[e][17]));
      } else {
        target += normal_lpdf(observed | stress_model, parameter[e][12]);
      }
    }
  }
}
generated quantities {
  vector[n_all_points] stress_model; // Pa
  vector[n_all_points] stress_replicated; // Pa
  vector[n_all_points] log_lik; // of each point given those before it
  // Of each point given all others; where residuals are independent, log_lik is that already.
  vector[correlated_residuals ? n_all_points : 0] log_lik_given_others;
  // Of the coordinates, as the model block has it; here for runs of this block by itself.
  real log_density = lprior + log_jacobian + log_pooling;
  vector[n_all_grid] grid_stress; // Pa
  vector[n_all_grid] grid_stress_replicated; // Pa
  vector[n_all_grid] grid_kelvin_strain;
  vector[n_all_grid] grid_grain_size; // m
  vector[n_all_grid] grid_fabric_factor;
  vector[n_all_grid] grid_dashpot_share; // dashpot rate over imposed rate
  vector[n_all_grid] grid_stress_slope; // d stress/d strain, Pa
  // Softening of the flow strength along strain, split between its two causes.
  vector[n_all_grid] grid_grain_size_softening;
  vector[n_all_grid] grid_fabric_softening;
  for (e in 1 : n_experiments) {
    int n_of_test = point_end[e + 1] - point_end[e];
    array[n_of_test] int here = part(point_end, e);
    real noise = parameter[e][12];
    real correlation_strain = parameter[e][17];
    array[strain_end[e + 1] - strain_end[e]] vector[n_states] solution
      = constant_rate_solution_at(parameter[e],
          all_strain[part(strain_end, e)],
          all_strains_in_segment[part(segment_end, e)],
          all_segment_start[part(segment_end, e)],
          all_segment_rate[part(segment_end, e)], all_grain_size[e],
          all_temperature[e], all_prior_location[e], power_law_kelvin, relative_tolerance,
          absolute_tolerance, max_num_steps);
    for (i in here) {
      stress_model[i] = solution[all_strain_of_point[i]][1];
    }
    stress_replicated[here] = stress_model[here]
                                      + residuals_rng(point_strain[here], noise,
                                                      correlation_strain);
    if (correlated_residuals) {
      vector[n_of_test] residual = all_stress_observed[here]
                                          - stress_model[here];
      log_lik[here] = residual_log_densities(residual, noise,
                                                     point_strain[here],
                                                     correlation_strain);
      log_lik_given_others[here]
        = residual_log_densities_given_others(residual, noise, point_strain[here],
                                              correlation_strain);
    } else {
      for (i in here) {
        log_lik[i] = normal_lpdf(all_stress_observed[i] | stress_model[i], noise);
      }
    }
    if (use_likelihood) {
      log_density += sum(log_lik[here]);
    }
  }
  for (e in 1 : n_experiments) {
    int n_of_test = grid_end[e + 1] - grid_end[e];
    array[n_of_test] int here = part(grid_end, e);
    vector[n_parameters()] value = parameter[e];
    real log_factor = log_rate_factor(value[6], value[7], all_temperature[e]);
    real viscosity_here = kelvin_viscosity_at(value[3], value[14], all_temperature[e],
                                              prior_location[16]);
    int k = segment_end[e] + 1; // segment of the grid point
    int n_before = grid_end[e] + all_grid_in_segment[k]; // grid points up to its end
    array[n_of_test] vector[n_states] solution = constant_rate_solution_at(value,
        all_grid_strain[here],
        all_grid_in_segment[part(segment_end, e)],
        all_segment_start[part(segment_end, e)],
        all_segment_rate[part(segment_end, e)], all_grain_size[e],
        all_temperature[e], all_prior_location[e], power_law_kelvin, relative_tolerance,
        absolute_tolerance, max_num_steps);
    for (i in here) {
      while (i > n_before) {
        k += 1;
        n_before += all_grid_in_segment[k];
      }
      grid_stress[i] = solution[i - grid_end[e]][1];
      grid_kelvin_strain[i] = solution[i - grid_end[e]][2];
      grid_grain_size[i] = piezometric
                           ? solution[i - grid_end[e]][3]
                           : microstructure_at(all_grid_strain[i], all_grain_size[e], value[8],
                                               value[10]);
      grid_fabric_factor[i] = microstructure_at(all_grid_strain[i], 1, value[9], value[11]);
      grid_dashpot_share[i] = dashpot_strain_rate(grid_stress[i], grid_grain_size[i],
                                                  grid_fabric_factor[i], value[4], value[5],
                                                  log_factor)
                              / all_segment_rate[k];
      grid_stress_slope[i] = value[1]
                             * (1 - grid_dashpot_share[i]
                                - linear_driving_stress(grid_stress[i]
                                                        - value[2] * grid_kelvin_strain[i],
                                                        value[13], -log(prior_location[15]))
                                  / (viscosity_here * all_segment_rate[k]));
      grid_grain_size_softening[i] = pow(grid_grain_size[i] / all_grain_size[e],
                                         value[5] / value[4]);
      grid_fabric_softening[i] = strength_factor(all_grid_strain[i], 1, value[9], value[11], 1);
    }
    grid_stress_replicated[here] = grid_stress[here]
                                           + residuals_rng(
                                               to_vector(all_grid_strain[here]), value[12],
                                               value[17]);
  }
}
