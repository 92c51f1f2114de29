/**
 * Measured grain sizes and fabric factors, each with an error of its own.
 *
 * The logarithm of a measured grain size is normal: a size is positive, and what counting, sectioning
 * and the stereological factor do to it goes in proportion to it. A measured fabric factor is normal:
 * it is worked out from a texture, whose scatter does not vanish with it, and may come out above 1.
 *
 * A row of `measured` has the columns
 *   1 grain size (m), 2 standard deviation of its logarithm, 3 fabric factor, 4 its standard
 *   deviation; 0: not measured.
 * A row of `microstructure` has the columns 1 grain size (m), 2 fabric factor, as the model has them.
 */

/** Log densities of measured grain sizes and, in the second column, of fabric factors. */
matrix microstructure_log_densities(data matrix measured, matrix microstructure) {
  matrix[rows(measured), 2] log_density = rep_matrix(0, rows(measured), 2);
  for (i in 1 : rows(measured)) {
    log_density[i, 1] = lognormal_lpdf(measured[i, 1] | log(microstructure[i, 1]),
                                       measured[i, 2]);
    if (measured[i, 4] > 0) {
      log_density[i, 2] = normal_lpdf(measured[i, 3] | microstructure[i, 2], measured[i, 4]);
    }
  }
  return log_density;
}

/** Random measurements; without noise where nothing was measured. */
matrix microstructure_rng(data matrix measured, matrix microstructure) {
  matrix[rows(measured), 2] replicated = microstructure;
  for (i in 1 : rows(measured)) {
    replicated[i, 1] = lognormal_rng(log(microstructure[i, 1]), measured[i, 2]);
    if (measured[i, 4] > 0) {
      replicated[i, 2] = normal_rng(microstructure[i, 2], measured[i, 4]);
    }
  }
  return replicated;
}
