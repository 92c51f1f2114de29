/**
 * Spectral coordinates for tables of attenuation: the plain ones, with
 *
 * - the flow rate and the strength of a peak stretched (charts/stretched.stan): where data fix them
 *   they stand for themselves, where they are too small to be seen for their logarithms;
 * - eta_K shifted by ln E_K, so that it stands for the longest relaxation time;
 * - where relaxation times are a band, E_K shifted so that it stands for the density of the band
 *   at a time in the middle of what the periods see: the longest time may lie far beyond them, and
 *   the exponent tilts the band about that middle.
 *
 * A shift by a function of other coordinates changes no volume; only stretches add to the
 * Jacobian of the plain coordinates. E_K, eta_K and the strength of a peak have logarithms for plain
 * coordinates.
 */

/** Strength of a peak over 1/E_M from which on its coordinate is the strength itself. */
real seen_peak_strength() { return 0.02; }

/**
 * ln of what E_K times the density of a band of relaxation times is at a time.
 *
 * @param exponent alpha, between 0 and 1
 * @param log_width ln(tau_H/tau_L)
 * @param log_time ln of the time over the longest, tau_H
 */
real log_band_density(real exponent, real log_width, real log_time) {
  return log(exponent) - log1m_exp(-exponent * log_width) + exponent * log_time;
}

/**
 * Plain coordinates at given spectral ones, and ln |d plain/d spectral|.
 *
 * @param given values of the parameters that are not the test's own; other entries have no effect
 * @param place of each parameter among the test's own ones, 0 where it is none of them
 * @param quantity a row for each of them (charts/plain.stan)
 * @param replaced_parameter Q_M or beta: the flow rate is sampled in its place; 0: it is given
 * @param reference ln of the rate (1/s) from which on the coordinate of the flow rate is the rate,
 *   and ln of the time (s) in the middle of the periods
 */
vector plain_from_spectral(vector spectral, vector given, data array[] int place,
                           data matrix quantity, data int replaced_parameter,
                           data vector reference) {
  vector[num_elements(spectral)] plain = spectral;
  vector[num_elements(given)] parameter = given;
  real log_jacobian = 0;
  int modulus = place[i_kelvin_modulus()];
  int viscosity = place[i_kelvin_viscosity()];
  if (replaced_parameter > 0) {
    int flow = place[replaced_parameter];
    vector[2] rate = log_from_stretched(spectral[flow]);
    plain[flow] = (reference[1] + rate[1] - quantity[flow, i_shift()])
                  / quantity[flow, i_scale()];
    log_jacobian = rate[2] - log(quantity[flow, i_scale()]);
  }
  if (place[i_peak_strength()] > 0) {
    int peak = place[i_peak_strength()];
    vector[2] strength = log_from_stretched(spectral[peak]);
    plain[peak] = strength[1] + log(seen_peak_strength() / quantity[peak, i_scale()]);
    log_jacobian += strength[2];
  }
  for (k in {i_relaxation_exponent(), i_relaxation_time_decades()}) {
    if (place[k] > 0) {
      parameter[k] = bounded_from_real(plain[place[k]], quantity[place[k]]);
    }
  }
  if (modulus > 0 && viscosity > 0) {
    if (parameter[i_relaxation_time_decades()] > 0) {
      real log_time = spectral[viscosity]
                      + log(quantity[viscosity, i_scale()] / quantity[modulus, i_scale()]);
      plain[modulus] += log_band_density(parameter[i_relaxation_exponent()],
                                         log(10) * parameter[i_relaxation_time_decades()],
                                         reference[2] - log_time);
    }
    plain[viscosity] += plain[modulus];
  }
  return append_row(plain, log_jacobian);
}

/**
 * Spectral coordinates at given plain ones: plain_from_spectral() inverted.
 *
 * @param parameter values of all parameters there
 */
vector spectral_from_plain(vector plain, vector parameter, data array[] int place,
                           data matrix quantity, data int replaced_parameter,
                           data vector reference) {
  vector[num_elements(plain)] spectral = plain;
  int modulus = place[i_kelvin_modulus()];
  int viscosity = place[i_kelvin_viscosity()];
  if (replaced_parameter > 0) {
    int flow = place[replaced_parameter];
    spectral[flow] = stretched_from(exp(quantity[flow, i_shift()]
                                             + quantity[flow, i_scale()] * plain[flow]
                                             - reference[1]));
  }
  if (place[i_peak_strength()] > 0) {
    spectral[place[i_peak_strength()]] = stretched_from(parameter[i_peak_strength()]
                                                        / seen_peak_strength());
  }
  if (modulus > 0 && viscosity > 0) {
    spectral[viscosity] -= plain[modulus];
    if (parameter[i_relaxation_time_decades()] > 0) {
      spectral[modulus] -= log_band_density(parameter[i_relaxation_exponent()],
        log(10) * parameter[i_relaxation_time_decades()],
        reference[2]
        - log(parameter[i_kelvin_viscosity()] / parameter[i_kelvin_modulus()]));
    }
  }
  return spectral;
}
