/** Curves of a settled stress cycle: its path strain, and whether attenuation has a peak. */

/**
 * Path strain of a settled cycle, the integral of |strain rate| over a period.
 *
 * Spring and Kelvin element strain at the rate omega (a cos(omega t) + b sin(omega t)). The times x
 * and pi - x differ in the sign of the cosine alone, and |u + v| + |u - v| = 2 max(|u|, |v|).
 *
 * @param rate of the dashpot at each sine, times the period
 * @param sine sin(omega t) at the midpoints of equal steps over half a period
 * @param in_phase, behind a and b, strain amplitudes of spring and Kelvin element
 */
real settled_cycle_strain(vector rate, data vector sine, real in_phase, real behind) {
  int n = num_elements(sine);
  real total = 0;
  for (k in 1 : n) {
    total += fmax(fabs(2 * pi() * behind * sine[k] + rate[k]),
                  fabs(2 * pi() * in_phase) * sqrt(1 - square(sine[k])));
  }
  return total / n;
}

/**
 * Whether the peak of one Kelvin element stands out of the dashpot's background.
 *
 * The slope of tan(delta) changes sign twice along frequency, at a dip and a peak, if and only if
 * (1 + r)(1 + c) > 9 r c, that is r <= 1/8 or c < (1 + r)/(8 r - 1); else it falls everywhere.
 *
 * @param ratio r = E_K/E_M
 * @param background c = B eta_K
 */
int element_has_peak(real ratio, real background) {
  return (1 + ratio) * (1 + background) > 9 * ratio * background;
}

/** Whether a curve rises from some point to the next. */
int rises_somewhere(vector value) {
  for (k in 2 : num_elements(value)) {
    if (value[k] > value[k - 1]) {
      return 1;
    }
  }
  return 0;
}
