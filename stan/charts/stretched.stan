/**
 * Stretched coordinates for tables of attenuation: the plain ones, but for what lies beyond the
 * periods.
 *
 * - The flow rate is stretched, and all others are shifted by multiples of it
 *   (charts/stretched_flow.stan).
 * - eta_K stands for the shortest relaxation time, and of a band of times E_K for its density at a
 *   time in the middle of what the periods see: the longest time may lie far beyond them, and the
 *   exponent tilts the band about that middle.
 * - Units of all but the flow rate are standard deviations at the mode. Precise tables fix some plain
 *   coordinates to a thousandth, and Stan's adaptation of the metric pulls variances to 1e-3.
 *
 * A shift by a function of another coordinate changes no volume; the stretch and the units add to
 * the Jacobian of the plain coordinates.
 */

/** Place in a reference, behind those of the flow rate. */
int i_log_middle_time() { return 4; } // ln of a time (s) in the middle of what the periods see

/**
 * ln of E_K times the density of a band of relaxation times, by ln(time).
 *
 * @param exponent alpha, between 0 and 1
 * @param log_width ln(tau_H/tau_L)
 * @param log_time ln of the time over the longest, tau_H
 */
real log_band_density(real exponent, real log_width, real log_time) {
  return log(exponent) - log1m_exp(-exponent * log_width) + exponent * log_time;
}

/**
 * alpha and the width ln(tau_H/tau_L) of the band of relaxation times, 0 where there is none.
 *
 * @param plain coordinates
 * @param given values of the parameters that are not the test's own; other entries have no effect
 * @param place of each parameter among the test's own ones, 0 where it is none of them
 * @param quantity a row for each of them (charts/plain.stan)
 */
vector band_from_plain(vector plain, vector given, data array[] int place, data matrix quantity) {
  vector[2] band = given[{i_relaxation_exponent(), i_relaxation_time_decades()}];
  array[2] int own = place[{i_relaxation_exponent(), i_relaxation_time_decades()}];
  for (k in 1 : 2) {
    if (own[k] > 0) {
      band[k] = bounded_from_real(plain[own[k]], quantity[own[k]]);
    }
  }
  return [band[1], log(10) * band[2]]';
}

/**
 * By how much the plain coordinate of E_K lies above that of the density of the band.
 *
 * @param log_longest_time ln(tau_H/s)
 */
real density_shift(vector band, real log_longest_time, data real log_middle_time) {
  return band[2] > 0
         ? log_band_density(band[1], band[2], log_middle_time - log_longest_time) : 0;
}

/**
 * Plain coordinates at given stretched ones, and ln |d plain/d stretched|.
 *
 * @param flow place of the flow rate among the test's own ones, 0 where it is none of them
 * @param unit of the coordinates, 1 of the flow rate
 * @param slope of coordinates by the rate, 0 of its own
 */
vector plain_from_stretched(vector stretched, vector given, data array[] int place,
                            data matrix quantity, data int flow, data vector unit,
                            data vector slope, data vector reference) {
  vector[num_elements(stretched)] plain = unit .* stretched;
  real log_jacobian = sum(log(unit));
  int modulus = place[i_kelvin_modulus()];
  int viscosity = place[i_kelvin_viscosity()];
  if (flow > 0) {
    vector[num_elements(plain) + 1] flowing
      = plain_from_stretched_flow(plain, flow,
                                  append_col(slope, rep_vector(0, num_elements(slope))),
                                  quantity[flow], reference);
    plain = head(flowing, num_elements(plain));
    log_jacobian += flowing[num_elements(plain) + 1];
  }
  if (modulus > 0 && viscosity > 0) {
    vector[2] band = band_from_plain(plain, given, place, quantity);
    plain[viscosity] += band[2];
    plain[modulus] += density_shift(band,
                                    plain[viscosity]
                                    + log(quantity[viscosity, i_scale()]
                                          / quantity[modulus, i_scale()]),
                                    reference[i_log_middle_time()]);
    plain[viscosity] += plain[modulus];
  }
  return append_row(plain, log_jacobian);
}

/** Stretched coordinates at given plain ones: plain_from_stretched() inverted. */
vector stretched_from_plain(vector plain, vector given, data array[] int place,
                            data matrix quantity, data int flow, data vector unit,
                            data vector slope, data vector reference) {
  vector[num_elements(plain)] stretched = plain;
  int modulus = place[i_kelvin_modulus()];
  int viscosity = place[i_kelvin_viscosity()];
  if (modulus > 0 && viscosity > 0) {
    vector[2] band = band_from_plain(plain, given, place, quantity);
    stretched[viscosity] -= plain[modulus] + band[2];
    stretched[modulus] -= density_shift(band,
                                        plain[viscosity] - plain[modulus]
                                        + log(quantity[viscosity, i_scale()]
                                              / quantity[modulus, i_scale()]),
                                        reference[i_log_middle_time()]);
  }
  if (flow > 0) {
    real log_rate = quantity[flow, i_shift()] + quantity[flow, i_scale()] * plain[flow]
                    - reference[i_log_seen_rate()];
    stretched -= slope * (exp(log_rate) - reference[i_rate_at_mode()]);
    stretched[flow] = exp(log_rate) + log_rate / reference[i_log_width()];
  }
  return stretched ./ unit;
}
