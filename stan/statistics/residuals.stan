/**
 * Residuals of the stress along strain: independent, or an Ornstein-Uhlenbeck process, whose
 * correlation falls off as exp(-|difference of strain|/epsilon_r). Their standard deviation is s
 * in both cases.
 *
 * The process is a Markov one: given the residual before, earlier ones say nothing more, and given
 * both neighbours no other one does. Points are in the order of strain, no two at the same one.
 */

/**
 * Standard deviation, over s, of a residual given its neighbour.
 *
 * @param step difference of strain over epsilon_r
 */
real conditional_spread(real step) {
  return sqrt(-expm1(-2 * step));
}

/**
 * Log density of every residual given all those before it; their sum is the joint density.
 *
 * @param residual Pa
 * @param stress_noise s, Pa
 * @param strain of the residuals, increasing
 * @param correlation_strain epsilon_r
 */
vector residual_log_densities(vector residual, real stress_noise, data vector strain,
                              real correlation_strain) {
  int n = num_elements(residual);
  vector[n] log_density;
  for (i in 1 : n) {
    if (i == 1) {
      log_density[i] = normal_lpdf(residual[i] | 0, stress_noise);
    } else {
      real step = (strain[i] - strain[i - 1]) / correlation_strain;
      log_density[i] = normal_lpdf(residual[i] | exp(-step) * residual[i - 1],
                                   stress_noise * conditional_spread(step));
    }
  }
  return log_density;
}

/**
 * Joint log density of observed stresses.
 *
 * @param observed, predicted Pa
 * @param correlated 0: residuals are independent, and strain and epsilon_r have no effect
 * @param strain, correlation_strain see residual_log_densities()
 */
real stress_log_density(data vector observed, vector predicted, real stress_noise,
                        data int correlated, data vector strain, real correlation_strain) {
  return correlated
         ? sum(residual_log_densities(observed - predicted, stress_noise, strain,
                                      correlation_strain))
         : normal_lpdf(observed | predicted, stress_noise);
}

/**
 * Log density of every residual given all others, those after it too.
 *
 * @param residual and the others as for residual_log_densities()
 */
vector residual_log_densities_given_others(vector residual, real stress_noise,
                                           data vector strain, real correlation_strain) {
  int n = num_elements(residual);
  vector[n] log_density;
  for (i in 1 : n) {
    real precision = 0; // times s^2
    real weighted = 0; // mean times precision
    if (i > 1) {
      real step = (strain[i] - strain[i - 1]) / correlation_strain;
      real variance = square(conditional_spread(step));
      precision += 1 / variance;
      weighted += exp(-step) * residual[i - 1] / variance;
    } else {
      precision += 1;
    }
    if (i < n) {
      real step = (strain[i + 1] - strain[i]) / correlation_strain;
      real variance = square(conditional_spread(step));
      precision += exp(-2 * step) / variance;
      weighted += exp(-step) * residual[i + 1] / variance;
    }
    log_density[i] = normal_lpdf(residual[i] | weighted / precision,
                                 stress_noise / sqrt(precision));
  }
  return log_density;
}

/**
 * Random residuals, Pa.
 *
 * @param correlation_strain epsilon_r; 0: independent residuals
 */
vector residuals_rng(data vector strain, real stress_noise, real correlation_strain) {
  int n = num_elements(strain);
  vector[n] residual;
  for (i in 1 : n) {
    if (i == 1 || correlation_strain == 0) {
      residual[i] = normal_rng(0, stress_noise);
    } else {
      real step = (strain[i] - strain[i - 1]) / correlation_strain;
      residual[i] = normal_rng(exp(-step) * residual[i - 1],
                               stress_noise * conditional_spread(step));
    }
  }
  return residual;
}

/**
 * What is added to the log density of residuals that their own trend was taken from: with it, the
 * density is that with the trend's coefficients integrated out under a flat prior, up to a
 * constant. The trend takes as many coefficients of the noise along, so that as many residuals
 * fewer are independent.
 *
 * @param n_taken coefficients of the trend, 0 where none was taken
 * @param stress_noise s, Pa
 */
real taken_noise_log_density(int n_taken, real stress_noise) {
  return n_taken * (log(stress_noise) + 0.5 * log(2 * pi()));
}
