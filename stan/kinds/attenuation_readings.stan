    // Readings of a table: without scatter, replicated, and their log densities.
    array[row_end[e + 1] - row_end[e]] int here = part(row_end, e);
    array[regime_end[e + 1] - regime_end[e]] int regimes = part(regime_end, e);
    array[reading_end[e + 1] - reading_end[e]] int readings = part(reading_end, e);
    vector[2 * size(readings)] law
      = table_reading_law(parameter[e], frequency[here], row_temperature[here],
                          initial_grain_size[e], conversion[e], regime[here],
                          median_stress[regimes], amplitude[regimes],
                          node_end[regime_end[e] + 1 : regime_end[e + 1] + 1], node,
                          reading[readings], quantity_of_point[readings],
                          stated_error[readings]);
    int n_readings = size(readings);
    // What would be read without scatter: the stated error or the limit, where the model lies below.
    vector[n_readings] read;
    vector[n_readings] replicated;
    vector[n_readings] log_density_of_readings
      = log_reading_densities(log_reading_observed[readings], is_limit[readings], law);
    for (i in 1 : n_readings) {
      real limit = log_limit[readings[i]];
      read[i] = fmax(law[i], limit);
      replicated[i] = fmax(normal_rng(law[i], law[n_readings + i]), limit);
    }
