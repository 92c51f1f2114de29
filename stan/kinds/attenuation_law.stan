    // Rows and readings of a table, and the law of the logarithms of the readings.
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
