/**
 * Residuals of the stress along strain: independent, or the sum of a part that correlates and of one
 * that does not. Their standard deviation is s in both cases.
 *
 * The correlated part is an Ornstein-Uhlenbeck process of variance w s^2, whose correlation falls
 * off as exp(-|difference of strain|/epsilon_r); what the model misses is smooth. It starts anew in
 * every segment of constant rate, where the model misses something else. The rest is the reading.
 * The process is a Markov one, so that a filter (Kalman 1960, Journal of Basic Engineering 82,
 * 35-45) carries what the readings before say about it. Points are in the order of strain; two may
 * have the same one where w < 1.
 */

/**
 * Mean (Pa) and variance over s^2 of the correlated part at every point, given all before it.
 *
 * @param residual Pa
 * @param strain of the residuals, increasing or decreasing
 * @param segment of constant rate that each is in
 * @param correlation_strain epsilon_r
 * @param share w
 */
matrix correlated_part_given_before(vector residual, data vector strain,
                                    data array[] int segment, real correlation_strain,
                                    real share) {
  int n = num_elements(residual);
  matrix[n, 2] part;
  real mean;
  real variance;
  for (i in 1 : n) {
    if (i == 1 || segment[i] != segment[max(i - 1, 1)]) {
      mean = 0;
      variance = share;
    } else {
      real step = strain[i] - strain[i - 1];
      real lost = expm1(-fmax(step, -step) / correlation_strain);
      real kept = 1 + lost;
      real gain = variance / (variance + 1 - share);
      mean = kept * (mean + gain * (residual[i - 1] - mean));
      variance = square(kept) * (1 - share) * gain - share * lost * (1 + kept);
    }
    part[i, 1] = mean;
    part[i, 2] = variance;
  }
  return part;
}

/**
 * Joint log density of observed stresses.
 *
 * @param observed, predicted Pa
 * @param correlated 0: residuals are independent, and strain, epsilon_r and w have no effect
 * @param stress_noise s, Pa
 */
real stress_log_density(data vector observed, vector predicted, real stress_noise,
                        data int correlated, data vector strain, data array[] int segment,
                        real correlation_strain, real share) {
  if (correlated) {
    vector[num_elements(observed)] residual = observed - predicted;
    matrix[num_elements(observed), 2] part
      = correlated_part_given_before(residual, strain, segment, correlation_strain, share);
    return normal_lpdf(residual | part[ : , 1],
                       stress_noise * sqrt(part[ : , 2] + 1 - share));
  }
  return normal_lpdf(observed | predicted, stress_noise);
}

/**
 * Log density of every residual, as columns: given all those before it, the sum of which is the joint
 * density, and given all others. What those before and those after say about the correlated part is
 * multiplied, its prior taken out once.
 */
matrix log_densities_of_residuals(vector residual, real stress_noise, data int correlated,
                                  data vector strain, data array[] int segment,
                                  real correlation_strain, real share) {
  int n = num_elements(residual);
  matrix[n, 2] log_density;
  matrix[n, 2] before;
  matrix[n, 2] after;
  if (!correlated) {
    for (i in 1 : n) {
      log_density[i] = rep_row_vector(normal_lpdf(residual[i] | 0, stress_noise), 2);
    }
    return log_density;
  }
  before = correlated_part_given_before(residual, strain, segment, correlation_strain, share);
  after = correlated_part_given_before(reverse(residual), reverse(strain), reverse(segment),
                                       correlation_strain, share);
  for (i in 1 : n) {
    int j = n + 1 - i;
    real precision = 1 / before[i, 2] + 1 / after[j, 2] - 1 / share;
    real mean = (before[i, 1] / before[i, 2] + after[j, 1] / after[j, 2]) / precision;
    log_density[i, 1] = normal_lpdf(residual[i] | before[i, 1],
                                    stress_noise * sqrt(before[i, 2] + 1 - share));
    log_density[i, 2] = normal_lpdf(residual[i] | mean,
                                    stress_noise * sqrt(1 / precision + 1 - share));
  }
  return log_density;
}

/**
 * Random residuals, Pa.
 *
 * @param correlation_strain epsilon_r; 0: independent residuals
 */
vector residuals_rng(data vector strain, data array[] int segment, real stress_noise,
                     real correlation_strain, real share) {
  int n = num_elements(strain);
  vector[n] residual;
  real part;
  for (i in 1 : n) {
    if (correlation_strain == 0) {
      residual[i] = normal_rng(0, stress_noise);
    } else {
      if (i == 1 || segment[i] != segment[max(i - 1, 1)]) {
        part = normal_rng(0, stress_noise * sqrt(share));
      } else {
        real step = (strain[i] - strain[i - 1]) / correlation_strain;
        part = exp(-step) * part
               + stress_noise * sqrt(-share * expm1(-2 * step)) * std_normal_rng();
      }
      residual[i] = part + stress_noise * sqrt(1 - share) * std_normal_rng();
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
