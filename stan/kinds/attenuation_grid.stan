  // Readings of tables on the grid, and the times behind them.
  for (e in 1 : n_tests) {
    array[reading_grid_end[e + 1] - reading_grid_end[e]] int here = part(reading_grid_end, e);
    if (size(here) > 0) {
      array[regime_end[e + 1] - regime_end[e]] int regimes = part(regime_end, e);
      matrix[size(here), 4] log_of_fluidity
        = log_fluidity(parameter[e], grid_temperature[here], initial_grain_size[e],
                       grid_regime[here], median_stress[regimes], amplitude[regimes],
                       node_end[regime_end[e] + 1 : regime_end[e + 1] + 1], node);
      vector[2 * size(here)] both
        = log_tan_delta_and_modulus(parameter[e], grid_frequency[here], grid_temperature[here],
                                    initial_grain_size[e], conversion[e], log_of_fluidity);
      vector[2 * size(here)] law;
      for (j in 1 : size(here)) {
        grid_log_reading[here[j]] = both[j + (grid_quantity[here[j]] - 1) * size(here)];
      }
      grid_log_relaxation_time[here]
        = log_relaxation_times(parameter[e], grid_temperature[here], initial_grain_size[e]);
      grid_log_maxwell_time[here]
        = -log(maxwell_modulus_at(parameter[e], grid_temperature[here])) - log_of_fluidity[ : , 1];
      law = log_reading_law(parameter[e], grid_log_reading[here], grid_quantity[here],
                            grid_stated_error[here]);
      for (j in 1 : size(here)) {
        grid_log_reading_replicated[here[j]] = normal_rng(law[j], law[size(here) + j]);
      }
    }
  }
