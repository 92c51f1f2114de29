  // The solution on the grid, and what its parts contribute.
  for (e in 1 : n_tests) {
    array[grid_end[e + 1] - grid_end[e]] int here = part(grid_end, e);
    real n = parameter[e][i_stress_exponent()];
    real p = parameter[e][i_grain_size_exponent()];
    real at_temperature = true_temperature(parameter[e], temperature[e]);
    real reading_factor = stress_reading_factor(parameter[e]);
    real kelvin_modulus = parameter[e][i_kelvin_modulus()];
    real kelvin_viscosity
      = kelvin_viscosity_at(parameter[e][i_kelvin_viscosity()],
                            parameter[e][i_kelvin_activation_enthalpy()],
                            at_temperature,
                            prior_location[e][i_kelvin_reference_temperature()]);
    array[size(here)] vector[n_states] solution
      = constant_rate_solution(parameter[e], prior_location[e], grid_strain[here],
                               n_grid_in_segment[part(segment_end, e)],
                               segment_start[part(segment_end, e)],
                               segment_rate[part(segment_end, e)], initial_grain_size[e],
                               temperature[e], kelvin_law, solver, tolerance, max_num_steps);
    matrix[size(here), 2] microstructure
      = microstructure_along(solution, grid_strain[here], parameter[e], initial_grain_size[e]);
    for (j in 1 : size(here)) {
      int i = here[j];
      real stress = solution[j][1];
      real kelvin_rate;
      grid_stress[i] = stress * reading_factor;
      grid_kelvin_strain[i] = solution[j][2];
      grid_grain_size[i] = microstructure[j, 1];
      grid_fabric_factor[i] = microstructure[j, 2];
      kelvin_rate = linear_driving_stress(stress - kelvin_modulus * grid_kelvin_strain[i],
                                          kelvin_law, kelvin_law_number(parameter[e], kelvin_law),
                                          -log(prior_location[e][i_kelvin_reference_stress()]))
                    / kelvin_viscosity;
      grid_dashpot_share[i] = dashpot_rate_at(stress, grid_grain_size[i], grid_fabric_factor[i],
                                              parameter[e], at_temperature)
                              / grid_rate[i];
      grid_stress_slope[i] = reading_factor * parameter[e][i_maxwell_modulus()]
                             * (1 - grid_dashpot_share[i] - kelvin_rate / grid_rate[i]);
      grid_grain_size_softening[i] = pow(grid_grain_size[i] / initial_grain_size[e], p / n);
      grid_fabric_softening[i] = strength_factor(grid_strain[i], 1,
                                                 parameter[e][i_steady_state_fabric_factor()],
                                                 parameter[e][i_critical_strain_fabric()], 1);
    }
    grid_stress_replicated[here]
      = grid_stress[here]
        + residuals_rng(to_vector(grid_strain[here]),
                        segment_of_outputs(n_grid_in_segment[part(segment_end, e)]),
                        parameter[e][i_stress_noise()],
                        parameter[e][i_residual_correlation_strain()],
                        parameter[e][i_residual_correlated_share()]);
  }
