// Numbers of the softening, and where they stand.
int n_softening() { return 4; }
int h_mean() { return 1; } // softening at the mean conditions
int h_rate() { return 2; } // its slopes by ln(strain rate),
int h_stress() { return 3; } // ln(peak stress)
int h_grain_size() { return 4; } // and ln(grain size)

/**
 * Softening at the mean conditions and its slopes.
 *
 * @param coordinate standard normal
 * @param coefficients, centre, factor of the normal distribution
 */
vector softening_at(vector coordinate, real stress_exponent, real grain_size_exponent,
                    data matrix coefficients, data vector centre, data matrix factor) {
  vector[n_softening()] w = coefficients * [1, log(stress_exponent) - centre[1],
                                            log(grain_size_exponent) - centre[2]]'
                            + factor * coordinate;
  real mean_softening = exp(w[h_mean()]);
  return mean_softening * [1, w[h_rate()], exp(w[h_stress()]), w[h_grain_size()]]';
}
