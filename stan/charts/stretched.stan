/**
 * Stretched coordinates for tables of attenuation: the plain ones, but for the flow rate.
 *
 * - Where the dashpot is too slow to be seen the logarithm of its rate is as wide as the prior;
 *   where it is seen data fix the rate itself. The coordinate is rate + ln(rate)/width, with the
 *   rate over one that data can just tell from none: it goes from one to the other, each as
 *   wide as it is in the posterior.
 * - All others are shifted by multiples of the rate: what the dashpot takes of the loss, other
 *   elements give. The multiples come from the curvature where it begins to be seen.
 * - Units of all others are standard deviations at the mode. Precise tables fix some plain
 *   coordinates to a thousandth, and Stan's adaptation of the metric pulls variances to 1e-3.
 *
 * A shift by a function of another coordinate changes no volume; the stretch and the units add to
 * the Jacobian of the plain coordinates.
 */

/** Places in a reference. */
int i_log_seen_rate() { return 1; } // ln of the rate (1/s) that data can just tell from none

int i_rate_at_mode() { return 2; } // over that one; nothing is shifted there

int i_log_width() { return 3; } // of ln(rate) where the dashpot is not seen

/**
 * ln(rate) at rate + ln(rate)/width.
 *
 * Newton's method for u + exp(u) = width stretched + ln(width) with u = ln(width rate), from a
 * start that is above the root and off by less than 1.
 */
real log_rate_from_stretched(real stretched, data real width) {
  real total = width * stretched + log(width);
  real u = total > 1 ? log(total) : total;
  for (i in 1 : 6) {
    u -= (u + exp(u) - total) / (1 + exp(u));
  }
  return u - log(width);
}

/**
 * Plain coordinates at given stretched ones, and ln |d plain/d stretched|.
 *
 * @param flow place of the flow rate among the test's own ones, 0 where it is none of them
 * @param quantity a row for each of them (charts/plain.stan)
 * @param unit of the coordinates in plain ones, 1 of the flow rate
 * @param slope of plain coordinates by the rate, 0 of its own
 */
vector plain_from_stretched(vector stretched, data int flow, data matrix quantity,
                            data vector unit, data vector slope, data vector reference) {
  vector[num_elements(stretched)] plain = unit .* stretched;
  real log_jacobian = sum(log(unit));
  if (flow > 0) {
    real log_rate = log_rate_from_stretched(stretched[flow], reference[i_log_width()]);
    plain += slope * (exp(log_rate) - reference[i_rate_at_mode()]);
    plain[flow] = (reference[i_log_seen_rate()] + log_rate - quantity[flow, i_shift()])
                  / quantity[flow, i_scale()];
    log_jacobian -= log(exp(log_rate) + 1 / reference[i_log_width()])
                    + log(quantity[flow, i_scale()]);
  }
  return append_row(plain, log_jacobian);
}

/**
 * Stretched coordinates at given plain ones: plain_from_stretched() inverted.
 */
vector stretched_from_plain(vector plain, data int flow, data matrix quantity,
                            data vector unit, data vector slope, data vector reference) {
  vector[num_elements(plain)] stretched = plain;
  if (flow > 0) {
    real log_rate = quantity[flow, i_shift()] + quantity[flow, i_scale()] * plain[flow]
                    - reference[i_log_seen_rate()];
    stretched -= slope * (exp(log_rate) - reference[i_rate_at_mode()]);
    stretched[flow] = exp(log_rate) + log_rate / reference[i_log_width()];
  }
  return stretched ./ unit;
}
