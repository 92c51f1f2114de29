/**
 * Plain coordinates whose flow rate is stretched.
 *
 * - Where the dashpot is too slow to be seen the logarithm of its rate is as wide as the prior;
 *   where it is seen data fix the rate itself. The coordinate is rate + ln(rate)/width, with the
 *   rate over one that data can just tell from none: it goes from one to the other, each as
 *   wide as it is in the posterior.
 * - All others are shifted by multiples of the rate: what the dashpot takes of the response, other
 *   elements give. The multiples come from the curvature where it begins to be seen.
 * - They are shifted by multiples of ln(rate) too: at a stress exponent the prior of the rate may be
 *   narrow.
 */

/** Places in a reference. */
int i_log_seen_rate() { return 1; } // ln of the rate (1/s) that data can just tell from none

int i_rate_at_mode() { return 2; } // over that one; nothing is shifted there

int i_log_width() { return 3; } // of ln(rate) where the dashpot is not seen

int i_exponent() { return 4; } // of the rate by the sampled point of the flow law (histories)

/**
 * Plain coordinates at given stretched ones, and ln |d plain/d stretched|.
 *
 * @param flow place of the flow rate
 * @param slope of coordinates by the rate and by ln(rate), 0 of its own
 * @param quantity row of ln(rate) (charts/plain.stan); its scale is negative if the plain coordinate
 *   is that of a strength
 */
vector plain_from_stretched_flow(vector stretched, data int flow, data matrix slope,
                                 data row_vector quantity, data vector reference) {
  real log_rate = log_from_stretched(stretched[flow], reference[i_log_width()]);
  vector[num_elements(stretched)] plain
    = stretched + slope * [exp(log_rate) - reference[i_rate_at_mode()], log_rate]';
  plain[flow] = (reference[i_log_seen_rate()] + log_rate - quantity[i_shift()])
                / quantity[i_scale()];
  return append_row(plain,
                    -log(exp(log_rate) + 1 / reference[i_log_width()])
                    - 0.5 * log(square(quantity[i_scale()])));
}
