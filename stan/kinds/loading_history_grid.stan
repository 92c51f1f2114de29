  // The solution on the grid, and what follows from it.
  for (e in 1 : n_tests) {
    array[grid_end[e + 1] - grid_end[e]] int here = part(grid_end, e);
    matrix[size(here), 8] solution
      = history_solution(history_states(parameter[e], prior_location[e], varying,
                                        leg[part(leg_end, e)], fixed[part(leg_end, e)], test[e],
                                        element, grid_time_in_leg[here],
                                        n_grid_in_leg[part(leg_end, e)], initial_grain_size[e],
                                        solver, tolerance, max_num_steps),
                         parameter[e], prior_location[e], varying, leg[part(leg_end, e)],
                         fixed[part(leg_end, e)], test[e], element,
                         n_grid_in_leg[part(leg_end, e)], initial_grain_size[e]);
    matrix[size(here), 2] microstructure
      = history_microstructure(solution[ : , 4], solution[ : , 6], parameter[e], test[e],
                               initial_grain_size[e]);
    int j = 0;
    for (k in part(leg_end, e)) {
      for (i in 1 : n_grid_in_leg[k]) {
        int at = grid_end[e] + j + i;
        row_vector[8] state = solution[j + i];
        grid_stress[at] = state[1];
        grid_strain[at] = state[2] + parameter[e][i_strain_offset()];
        grid_kelvin_strain[at] = state[3];
        grid_path_strain[at] = state[4];
        grid_grain_size[at] = microstructure[j + i, 1];
        grid_fabric_factor[at] = microstructure[j + i, 2];
        grid_grain_size_softening[at]
          = pow(grid_grain_size[at] / initial_grain_size[e],
                parameter[e][i_grain_size_exponent()] / parameter[e][i_stress_exponent()]);
        grid_fabric_softening[at] = grid_fabric_factor[at]; // stress goes with F
        grid_strain_rate[at] = history_strain_rate(state, row(leg, k), parameter[e],
                                                   grid_grain_size[at], grid_fabric_factor[at]);
      }
      j += n_grid_in_leg[k];
    }
    {
      vector[size(here)] residual
        = residuals_rng(grid_position[here], grid_stage[here], residual_over_noise(parameter[e]),
                        parameter[e][correlation_parameter], share_that_correlates(parameter[e]));
      grid_stress_replicated[here] = grid_stress[here]
                                     + parameter[e][i_stress_noise()] * residual;
      grid_strain_replicated[here] = grid_strain[here]
                                     + parameter[e][i_strain_noise()] * residual;
    }
  }
