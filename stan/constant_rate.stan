// Nonlinear Burgers model of one test at imposed, piecewise constant strain rate:
// Maxwell spring and power-law dashpot in series with a Kelvin-Voigt element, grain size and
// fabric evolving with strain (Maor, Hansen, Jerolmack and Goldsby, Eqs. 1-4), in the exact
// two-state reduction of functions/constant_rate_dynamics.stan.
//
// All values are SI. Priors, fixed parameters, solver tolerances and the likelihood switch are
// data. With every parameter fixed (n_coordinates = 0, algorithm=fixed_param) the program is a
// forward simulation.
functions {
#include functions/parameters.stan
#include functions/flow_law.stan
#include functions/kelvin_element.stan
#include functions/microstructure.stan
#include functions/residuals.stan
#include functions/priors.stan
#include functions/coordinates.stan
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
}
transformed data {
  // The Kelvin element is linear where n_K is fixed at 1.
  int power_law_kelvin = prior_family[13] != 0 || prior_location[13] != 1;
  // Above 0 where the grain size follows a piezometer.
  real relative_piezometer = prior_location[18] / initial_grain_size;
  int n_states = relative_piezometer > 0 ? 3 : 2;
  // Residuals are independent where their correlation strain is fixed at 0.
  int correlated_residuals = prior_family[17] != 0 || prior_location[17] != 0;
  vector[n_points] point_strain;
  vector[n_parameters()] prior_mass;
  array[n_parameters()] int coordinate_of; // position among the coordinates, 0 where fixed
  vector[coordinate_system == 2 ? 6 : 0] reference;
  vector[n_pins] reference_log_strength;
  for (i in 1 : n_points) {
    point_strain[i] = strain[strain_of_point[i]];
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
  if (coordinate_system == 2) {
    vector[n_parameters()] parameter = head(parameters_from_plain(reference_coordinate,
      parameter_of_coordinate, quantity_shift, quantity_scale, quantity_lower, quantity_upper,
      prior_location, replaced_parameter, 1, log(segment_rate[1]), initial_grain_size,
      temperature), n_parameters());
    if (coordinate_of[12] > 0 && noise_exponent[coordinate_of[12]] != 0) {
      reject("noise_exponent of the stress noise itself must be 0");
    }
    reference = valley_reference(reference_coordinate, coordinate_of, quantity_shift,
                                 quantity_scale, parameter, replaced_parameter,
                                 initial_grain_size);
    reference_log_strength = log_strength_at_pins(knot_time_step, knot_stress, pin_knot, pin,
                                                  parameter[1], parameter[2], parameter[3],
                                                  parameter[4]);
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
  real reference_stress; // S_0 at the rate of the first segment, Pa
  real kelvin_viscosity_here; // eta_K at the temperature of the test, Pa s
  real lprior; // log density of the priors on the physical parameters
  real log_jacobian; // ln |d(physical parameters)/d(coordinates)|
  {
    vector[n_parameters() + 1] mapped;
    vector[n_parameters()] parameter;
    if (coordinate_system == 1) {
      mapped = parameters_from_plain(coordinate, parameter_of_coordinate, quantity_shift,
                                     quantity_scale, quantity_lower, quantity_upper,
                                     prior_location, replaced_parameter, 1,
                                     log(segment_rate[1]), initial_grain_size, temperature);
    } else {
      mapped = parameters_from_valley(coordinate, parameter_of_coordinate, coordinate_of,
                                      quantity_shift, quantity_scale, quantity_lower,
                                      quantity_upper, prior_location, replaced_parameter,
                                      segment_rate[1], initial_grain_size, temperature,
                                      knot_time_step, knot_stress, pin_knot, pin,
                                      reference_coordinate, reference,
                                      reference_log_strength, linear_from, noise_exponent);
    }
    parameter = head(mapped, n_parameters());
    log_jacobian = mapped[n_parameters() + 1];
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
  reference_stress = exp(log_reference_stress(segment_rate[1], initial_grain_size, temperature,
                                              stress_exponent, grain_size_exponent,
                                              activation_enthalpy, beta));
}
model {
  target += lprior + log_jacobian;
  if (use_likelihood) {
    array[n_strains] vector[n_states] solution = constant_rate_solution(
      strain, n_strains_in_segment, segment_start, segment_rate, initial_grain_size,
      reference_stress, maxwell_modulus, kelvin_modulus, kelvin_viscosity_here,
      stress_exponent, grain_size_exponent, steady_state_grain_size,
      steady_state_fabric_factor, critical_strain_grain_size, critical_strain_fabric,
      power_law_kelvin, kelvin_stress_exponent, prior_location[15], relative_piezometer,
      relative_tolerance, absolute_tolerance, max_num_steps);
    vector[n_points] stress_model;
    for (i in 1 : n_points) {
      stress_model[i] = solution[strain_of_point[i]][1];
    }
    if (correlated_residuals) {
      target += sum(residual_log_densities(stress_observed - stress_model, stress_noise,
                                           point_strain, residual_correlation_strain));
    } else {
      target += normal_lpdf(stress_observed | stress_model, stress_noise);
    }
  }
}
generated quantities {
  vector[n_points] stress_model; // Pa
  vector[n_points] stress_replicated; // Pa
  vector[n_points] log_lik; // of each point given those before it
  // Of each point given all others; where residuals are independent, log_lik is that already.
  vector[correlated_residuals ? n_points : 0] log_lik_given_others;
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
  {
    array[n_strains] vector[n_states] solution = constant_rate_solution(
      strain, n_strains_in_segment, segment_start, segment_rate, initial_grain_size,
      reference_stress, maxwell_modulus, kelvin_modulus, kelvin_viscosity_here,
      stress_exponent, grain_size_exponent, steady_state_grain_size,
      steady_state_fabric_factor, critical_strain_grain_size, critical_strain_fabric,
      power_law_kelvin, kelvin_stress_exponent, prior_location[15], relative_piezometer,
      relative_tolerance, absolute_tolerance, max_num_steps);
    for (i in 1 : n_points) {
      stress_model[i] = solution[strain_of_point[i]][1];
    }
    stress_replicated = stress_model
                        + residuals_rng(point_strain, stress_noise,
                                        residual_correlation_strain);
    if (correlated_residuals) {
      log_lik = residual_log_densities(stress_observed - stress_model, stress_noise,
                                       point_strain, residual_correlation_strain);
      log_lik_given_others
        = residual_log_densities_given_others(stress_observed - stress_model, stress_noise,
                                              point_strain, residual_correlation_strain);
    } else {
      for (i in 1 : n_points) {
        log_lik[i] = normal_lpdf(stress_observed[i] | stress_model[i], stress_noise);
      }
    }
  }
  {
    array[n_grid] vector[n_states] solution = constant_rate_solution(
      grid_strain, n_grid_in_segment, segment_start, segment_rate, initial_grain_size,
      reference_stress, maxwell_modulus, kelvin_modulus, kelvin_viscosity_here,
      stress_exponent, grain_size_exponent, steady_state_grain_size,
      steady_state_fabric_factor, critical_strain_grain_size, critical_strain_fabric,
      power_law_kelvin, kelvin_stress_exponent, prior_location[15], relative_piezometer,
      relative_tolerance, absolute_tolerance, max_num_steps);
    real log_factor = log_rate_factor(activation_enthalpy, beta, temperature);
    int k = 1; // segment of the grid point
    int n_before = n_grid_in_segment[1]; // grid points up to the end of segment k
    for (i in 1 : n_grid) {
      while (i > n_before) {
        k += 1;
        n_before += n_grid_in_segment[k];
      }
      grid_stress[i] = solution[i][1];
      grid_kelvin_strain[i] = solution[i][2];
      grid_grain_size[i] = relative_piezometer > 0
                           ? solution[i][3]
                           : microstructure_at(grid_strain[i], initial_grain_size,
                                               steady_state_grain_size,
                                               critical_strain_grain_size);
      grid_fabric_factor[i] = microstructure_at(grid_strain[i], 1, steady_state_fabric_factor,
                                                critical_strain_fabric);
      grid_dashpot_share[i] = dashpot_strain_rate(grid_stress[i], grid_grain_size[i],
                                                  grid_fabric_factor[i], stress_exponent,
                                                  grain_size_exponent, log_factor)
                              / segment_rate[k];
      grid_stress_slope[i] = maxwell_modulus
                             * (1 - grid_dashpot_share[i]
                                - linear_driving_stress(grid_stress[i]
                                                        - kelvin_modulus
                                                          * grid_kelvin_strain[i],
                                                        kelvin_stress_exponent,
                                                        -log(prior_location[15]))
                                  / (kelvin_viscosity_here * segment_rate[k]));
      grid_grain_size_softening[i] = pow(grid_grain_size[i] / initial_grain_size,
                                         grain_size_exponent / stress_exponent);
      grid_fabric_softening[i] = strength_factor(grid_strain[i], 1, steady_state_fabric_factor,
                                                 critical_strain_fabric, 1);
    }
    grid_stress_replicated = grid_stress
                             + residuals_rng(to_vector(grid_strain), stress_noise,
                                             residual_correlation_strain);
  }
}
