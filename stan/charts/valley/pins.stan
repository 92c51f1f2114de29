/**
 * What the curve fixes: the strength of the dashpot at the pins, and its softening.
 *
 * Data are matrices. A row of `pin` has the columns
 *   1 path strain, 2 stress rate over the unit of rates (Pa), 3 unit of rates (1/s), 4 ln(rate that
 *   ln S_0 belongs to/unit), 5 and 6 weights (inverse variance of ln stress): that for
 *   u_1, whose conditional density is known at solutions that a few steps have reached and is
 *   jagged if it is narrow, and that for u_2, F_ss and ln S_0; 7 strain rate over the unit; 8 time
 *   that the dashpot spends near the pin (s), where ln S_0 is solved from times; 9 time from the start
 *   of the load (s) over which the rates are averages, 0: they are those at the pin; 10 grain size
 *   of the reference curve (m).
 * At constant rate the unit is the imposed rate; where stress is imposed, the strain rate is that
 * of the reference curve.
 * A row of `knot`, a knot of the reference curve, has the columns
 *   1 time since the knot before (s), 0 at the start of a leg, 2 stress (Pa), 3 whether the
 *   next pin lies there.
 * The rows of `bounds` are those of epsilon_c1, epsilon_c2 and F_ss, with the columns
 *   1 lower, 2 upper. Where grain size or fabric evolves alone, the second and the third are those of
 *   its critical strain and of its steady state over the start.
 */

/** Rates of the dashpot at the pins, kept above 0 by a smooth floor. */
vector floored_rate(vector dashpot_rate) {
  return 0.15 + log1p_exp(20 * (dashpot_rate - 0.15)) / 20;
}

/**
 * Rate that spring and Kelvin part leave to the dashpot at the pins, over the unit of rates.
 *
 * The Kelvin rate is the exact response of the Kelvin part to the piecewise linear reference curve;
 * with q = modulus times kelvin_strain an element obeys dq/dt = (stress - q) modulus/viscosity. The
 * curve is that of the readings; stress and q are in proportion to it. Far from the reference the
 * others may ask for a rate below 0.
 *
 * @param stiffness stress over elastic strain, that of the apparatus included (Pa)
 * @param kelvin modulus (Pa) and viscosity (Pa s) of each element of the Kelvin part
 * @param reading_factor of the load cell, over the stress
 */
vector dashpot_rate_at_pins(data matrix knot, data matrix pin, real stiffness, matrix kelvin,
                            real reading_factor) {
  vector[rows(pin)] kelvin_rate = rep_vector(0, rows(pin)); // 1/s
  for (j in 1 : rows(kelvin)) {
    vector[rows(knot)] x = col(knot, 1) * (kelvin[j, 1] / kelvin[j, 2]);
    vector[rows(knot)] decay = exp(-x);
    real q = 0;
    real start = 0; // q at the start of the load
    int m = 0;
    for (k in 1 : rows(knot)) {
      if (knot[k, 1] == 0) {
        start = q;
      } else {
        real mean_decay = (1 - decay[k]) / x[k]; // over the time since the knot before
        q = q * decay[k] + knot[k, 2] * (1 - mean_decay);
        if (k > 1) {
          q += knot[k - 1, 2] * (mean_decay - decay[k]);
        }
      }
      if (knot[k, 3] > 0) {
        m += 1;
        kelvin_rate[m] += pin[m, 9] > 0
                          ? (q - start) / (kelvin[j, 1] * pin[m, 9])
                          : (knot[k, 2] - q) / kelvin[j, 2];
      }
    }
  }
  return col(pin, 7)
         - (kelvin_rate ./ col(pin, 3) + col(pin, 2) / stiffness) / reading_factor;
}

/** Stresses of the reference curve at the pins, Pa. */
vector stress_at_pins(data matrix knot, data matrix pin) {
  vector[rows(pin)] stress;
  int at_pin = 0;
  for (k in 1 : rows(knot)) {
    if (knot[k, 3] > 0) {
      at_pin += 1;
      stress[at_pin] = knot[k, 2];
    }
  }
  return stress;
}

/**
 * ln of the strength that the reference curve implies at the pins: the left-hand side of (*) in
 * charts/valley/valley.stan.
 *
 * @param dashpot_rate dashpot_rate_at_pins()
 */
vector log_strength_at_pins(data matrix knot, data matrix pin, vector dashpot_rate,
                            real stress_exponent, real reading_factor) {
  return log(stress_at_pins(knot, pin) / reading_factor)
         - (log(floored_rate(dashpot_rate)) - col(pin, 4)) / stress_exponent;
}

/**
 * Softening by grain size, (p/n) ln(d/d_0), at the pins.
 *
 * @param u real number behind epsilon_c1
 * @param exponent_ratio p/n
 * @param log_grain_size_ratio ln(d_ss/d_0)
 * @param strain of the pins
 * @return columns: the softening, its derivative by u
 */
matrix grain_softening(real u, real exponent_ratio, real log_grain_size_ratio,
                       data vector strain, data matrix bounds) {
  real s = inv_logit(u);
  real range = bounds[1, 2] - bounds[1, 1];
  real critical = bounds[1, 1] + range * s;
  real grain_size_ratio = exp(log_grain_size_ratio);
  vector[rows(strain)] decay = exp(-strain / critical);
  vector[rows(strain)] grain_size = grain_size_ratio + (1 - grain_size_ratio) * decay;
  matrix[rows(strain), 2] softening;
  softening[ : , 1] = exponent_ratio * log(grain_size);
  softening[ : , 2] = range * s * (1 - s) * exponent_ratio * (1 - grain_size_ratio)
                      / square(critical) * (strain .* decay ./ grain_size);
  return softening;
}

/**
 * Softening by fabric, ln F, at the pins, with F = 1 - amplitude [1 - exp(-strain/epsilon_c2)].
 *
 * @param u real number behind epsilon_c2
 * @param amplitude 1 - F_ss, which may leave the bounds of F_ss
 * @param strain of the pins
 * @return columns: the softening, its derivatives by u and by the amplitude
 */
matrix fabric_softening(real u, real amplitude, data vector strain, data matrix bounds) {
  real s = inv_logit(u);
  real range = bounds[2, 2] - bounds[2, 1];
  real critical = bounds[2, 1] + range * s;
  vector[rows(strain)] growth = -expm1(-strain / critical);
  vector[rows(strain)] fabric = 1 - amplitude * growth;
  matrix[rows(strain), 3] softening;
  softening[ : , 1] = log(fabric);
  softening[ : , 2] = amplitude * range * s * (1 - s) / square(critical)
                      * (strain .* (1 - growth) ./ fabric);
  softening[ : , 3] = -growth ./ fabric;
  return softening;
}

/** Growth of the fabric up to the last pin, 1 - exp(-strain/epsilon_c2). */
real fabric_growth(real u, data vector strain, data matrix bounds) {
  real critical = bounds[2, 1] + (bounds[2, 2] - bounds[2, 1]) * inv_logit(u);
  return -expm1(-strain[rows(strain)] / critical);
}

/** An amplitude with which F stays above 0.04 up to the last pin, smoothly. */
real limited_amplitude(real amplitude, real u, data vector strain, data matrix bounds) {
  real limit = 0.96 / fabric_growth(u, strain, bounds);
  return amplitude - log1p_exp(50 * (amplitude - limit)) / 50;
}
