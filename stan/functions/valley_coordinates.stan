/**
 * Valley coordinates: the softening of the dashpot solved from the observed curve.
 *
 * Where the dashpot flows, the series circuit fixes its strength: with v the dashpot's share of
 * the imposed rate,
 *
 *   ln stress - ln(v)/n  =  ln S_0 + ln F(strain) + (p/n) ln[d(strain)/d_0]            (*)
 *   v = 1 - v_K - (d stress/d strain)/E_M,
 *
 * so a well fitted curve fixes the right-hand side to a fraction of a percent all along, but not
 * its split between grain size (d_ss, epsilon_c1) and fabric (F_ss, epsilon_c2): the posterior is a
 * thin, L-shaped valley in (epsilon_c1, epsilon_c2), and a T where d_ss is given. The map here
 * follows it by conditional quantiles. With u_1 and u_2 the real numbers behind the critical
 * strains, and at given coordinates of all other parameters,
 *
 *  - u_1 is the quantile function of its conditional density under (*) at a few strains, the pins,
 *    and the priors; at places along u_1 the other three are solved for, or integrated over;
 *  - u_2 is that of its conditional density at this u_1;
 *  - F_ss is centred and scaled by the solution for (ln S_0, F_ss) at this u_1 and u_2;
 *  - ln S_0 is centred and scaled by the solution at this microstructure, which is linear.
 *
 * In a joint fit ln S_0 can follow from shared parameters, and u_1, u_2 and u_F of F_ss can be
 * partially pooled; the conditional densities are then those at this ln S_0 and with the normal
 * densities of the pooling.
 *
 * A quantile function passes from one arm to another as far as the density does: it does not care
 * how many arms there are, and has no branches between which it would have to jump.
 *
 * The widths of these four, of the Maxwell modulus and of the Kelvin viscosity grow with the
 * stress noise s as far as the data, not the prior, set them; few points leave s, and with it the
 * widths, uncertain by a factor, which would be a funnel.
 *
 * Solutions are reached by Gauss-Newton steps from a reference point (the posterior mode), and
 * densities are known at a few places only. Both have to be smooth in the other coordinates, not
 * exact: whatever they are, the map is triangular and one to one with the Jacobian given here, and
 * the posterior is exactly that of the plain coordinates. Only the speed depends on the pins.
 *
 * Pins are rows of a matrix with the columns
 *   1 strain, 2 slope d stress/d strain (Pa), 3 strain rate (1/s),
 *   4 ln(rate of the first segment/rate), 5 and 6 weights (inverse variance of ln stress): that for
 *   u_1, whose conditional density is known at solutions that a few steps have reached and is
 *   jagged if it is narrow, and that for u_2, F_ss and ln S_0.
 */

/** Gauss-Newton steps along the path from the reference point. */
int n_valley_steps() {
  return 8;
}

/** Places on either side of the middle at which a conditional density is evaluated. */
int n_places() {
  return 6;
}

/** Distance of outer places on the real line; the prior there, a logistic one, has sd 1.8. */
real outer_spacing() {
  return 1.5;
}

/** Width of the bends of a quantile function, in its argument. */
real bend_width() {
  return 0.5;
}

/** Share of the prior in conditional densities: how far down they are trusted in their tails. */
real prior_share() {
  return 1e-6;
}

/** Misfit, as of chi squared, from which on the density of a misfit has a long tail. */
real misfit_tail() {
  return 6;
}

/** Share of the pins' weight with which u_1, u_2 and the amplitude are solved for.
 *
 * For some grain-size softenings the least-squares problem has two solutions. At less than full
 * weight the solution moves between them instead of jumping.
 */
real softened_share() {
  return 0.25;
}

/** Precision of each real number behind a bounded parameter, and of the amplitude of softening by
 * fabric, that keeps the least-squares problems regular where the curve does not fix them. */
real bounded_parameter_precision() {
  return 0.5;
}

real amplitude_precision() {
  return 4.0;
}

/** Least standard deviation of a pooled F_ss, against a density that closes on its bounds. */
real least_deviation() {
  return 0.01;
}

/** Precision of ln S_0 where the curve does not fix it. */
real reference_stress_precision() {
  return 1.0;
}

/**
 * ln of the strength (*) that the reference curve implies at the pins.
 *
 * The Kelvin rate is the exact response of the Kelvin element to the piecewise linear reference
 * curve; with q = E_K kelvin_strain it obeys dq/dt = (stress - q) E_K/eta_K.
 *
 * @param time_step time between knots of the reference curve, s
 * @param stress at the knots, Pa
 * @param pin_knot knot of each pin
 * @param pin see the head of this file
 */
vector log_strength_at_pins(data vector time_step, data vector stress,
                            data array[] int pin_knot, data matrix pin, real maxwell_modulus,
                            real kelvin_modulus, real kelvin_viscosity, real stress_exponent) {
  int n_knots = num_elements(stress);
  int n_pins = rows(pin);
  vector[n_knots] x = time_step * (kelvin_modulus / kelvin_viscosity);
  vector[n_knots] decay = exp(-x);
  vector[n_knots] stress_before = append_row(0, head(stress, n_knots - 1));
  vector[n_knots] gain = stress_before .* (1 - decay)
                         + (stress - stress_before) .* (1 - (1 - decay) ./ x);
  vector[n_pins] log_strength;
  real q = 0;
  int knot = 0;
  for (m in 1 : n_pins) {
    real kelvin_share;
    real dashpot_share;
    while (knot < pin_knot[m]) {
      knot += 1;
      q = q * decay[knot] + gain[knot];
    }
    kelvin_share = (stress[knot] - q) / (kelvin_viscosity * pin[m, 3]);
    dashpot_share = 1 - kelvin_share - pin[m, 2] / maxwell_modulus;
    // A smooth floor: far from the reference the other coordinates may ask for a share below 0.
    dashpot_share = 0.15 + log1p_exp(20 * (dashpot_share - 0.15)) / 20;
    log_strength[m] = log(stress[knot]) - (log(dashpot_share) - pin[m, 4]) / stress_exponent;
  }
  return log_strength;
}

/**
 * Softening by grain size, (p/n) ln(d/d_0), at the pins.
 *
 * @param u real number behind epsilon_c1
 * @param exponent_ratio p/n
 * @param grain_size_ratio d_ss/d_0
 * @param strain of the pins
 * @param lower_bound, upper_bound of (epsilon_c1, epsilon_c2, F_ss)
 * @return columns: the softening, its derivative by u
 */
matrix grain_softening(real u, real exponent_ratio, real grain_size_ratio, data vector strain,
                       data vector lower_bound, data vector upper_bound) {
  real s = inv_logit(u);
  real range = upper_bound[1] - lower_bound[1];
  real critical = lower_bound[1] + range * s;
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
 * @param strain, lower_bound, upper_bound see grain_softening()
 * @return columns: the softening, its derivatives by u and by the amplitude
 */
matrix fabric_softening(real u, real amplitude, data vector strain, data vector lower_bound,
                        data vector upper_bound) {
  real s = inv_logit(u);
  real range = upper_bound[2] - lower_bound[2];
  real critical = lower_bound[2] + range * s;
  vector[rows(strain)] growth = -expm1(-strain / critical);
  vector[rows(strain)] fabric = 1 - amplitude * growth;
  matrix[rows(strain), 3] softening;
  softening[ : , 1] = log(fabric);
  softening[ : , 2] = amplitude * range * s * (1 - s) / square(critical)
                      * (strain .* (1 - growth) ./ fabric);
  softening[ : , 3] = -growth ./ fabric;
  return softening;
}

/** An amplitude with which F stays above 0.04 up to the last pin, smoothly. */
real limited_amplitude(real amplitude, real u, data vector strain, data vector lower_bound,
                       data vector upper_bound) {
  real critical = lower_bound[2] + (upper_bound[2] - lower_bound[2]) * inv_logit(u);
  real limit = -0.96 / expm1(-strain[rows(strain)] / critical);
  return amplitude - log1p_exp(50 * (amplitude - limit)) / 50;
}

/**
 * ln density of the real number behind a bounded parameter: that of a uniform prior, or of the
 * pooling.
 *
 * @param pooled 1 where u is normal with `centre` and `spread`, which have no effect elsewhere
 */
real log_density_of_bounded(real u, data int pooled, real centre, real spread) {
  return pooled ? std_normal_lpdf((u - centre) / spread) - log(spread)
                : log_inv_logit(u) + log1m_inv_logit(u);
}

/** Slope of this ln density and its precision for least squares, which keeps them regular where
 * the curve does not fix u. */
vector regularisation(real u, data int pooled, real centre, real spread) {
  if (pooled) {
    return [(centre - u) / square(spread), 1 / square(spread)]';
  }
  return [1 - 2 * inv_logit(u), bounded_parameter_precision()]';
}

/**
 * Amplitude of softening by fabric that keeps least squares regular, and its precision: those of
 * the pooling of F_ss where there is one.
 *
 * @param pooled, centre, spread of u_F: see log_density_of_bounded()
 */
vector amplitude_regularisation(data int pooled, real centre, real spread,
                                data vector lower_bound, data vector upper_bound) {
  if (pooled) {
    real s = inv_logit(centre);
    real range = upper_bound[3] - lower_bound[3];
    return [1 - lower_bound[3] - range * s,
            1 / (square(range * s * (1 - s) * spread) + square(least_deviation()))]';
  }
  return [0.5, amplitude_precision()]';
}

/** Values less their weighted mean: what is left of them where ln S_0 takes up the mean; all of
 * them where ln S_0 is given. */
vector centred(vector values, data vector weight, data int stress_given) {
  if (stress_given) {
    return values;
  }
  return values - dot_product(weight, values) / sum(weight);
}

/**
 * A step of a real number behind a bounded parameter, brought below a length of 1.
 *
 * Full steps overshoot where the curve softens within a few percent of strain, and what they end at
 * is then as good as random in the other coordinates.
 */
real limited_step(real step) {
  return step / hypot(1, step);
}

/**
 * One Gauss-Newton step for epsilon_c2 and the amplitude of fabric softening, ln S_0 eliminated.
 *
 * The amplitude is not kept within the bounds of F_ss: where the rest leaves no softening to the
 * fabric, the bounds would ask for an epsilon_c2 that hides it, at either end of its range, and
 * the solution would jump from one to the other.
 *
 * @param solved real number behind epsilon_c2, amplitude
 * @param rest left-hand side of (*) less the softening by grain size, at the pins, and less ln S_0
 *   where that is given
 * @param weight of the pins
 * @param precision by which the weights count
 * @param stress_given 1: ln S_0 is given
 * @param pooled, centre, spread of (u_1, u_2, u_F): see log_density_of_bounded()
 * @return solution after the step, the Gauss-Newton matrix (1, 1), (1, 2), (2, 2), and the misfit
 *   before the step
 */
vector fabric_step(vector solved, vector rest, data vector strain, data vector weight,
                   real precision, data int stress_given, data vector lower_bound,
                   data vector upper_bound, data array[] int pooled, vector centre,
                   vector spread) {
  matrix[rows(strain), 3] softening = fabric_softening(solved[1], solved[2], strain, lower_bound,
                                                       upper_bound);
  vector[rows(strain)] left = centred(rest - softening[ : , 1], weight, stress_given);
  vector[rows(strain)] weighted = precision * weight .* left;
  vector[rows(strain)] by_u = precision * weight
                              .* centred(softening[ : , 2], weight, stress_given);
  vector[rows(strain)] by_amplitude = precision * weight
                                      .* centred(softening[ : , 3], weight, stress_given);
  vector[2] regular = regularisation(solved[1], pooled[2], centre[2], spread[2]);
  vector[2] regular_amplitude = amplitude_regularisation(pooled[3], centre[3], spread[3],
                                                         lower_bound, upper_bound);
  real c11 = dot_product(by_u, softening[ : , 2]) + regular[2];
  real c12 = dot_product(by_u, softening[ : , 3]);
  real c22 = dot_product(by_amplitude, softening[ : , 3]) + regular_amplitude[2];
  real g1 = dot_product(weighted, softening[ : , 2]) + regular[1];
  real g2 = dot_product(weighted, softening[ : , 3])
            + regular_amplitude[2] * (regular_amplitude[1] - solved[2]);
  real determinant = c11 * c22 - square(c12);
  real u = solved[1] + limited_step((c22 * g1 - c12 * g2) / determinant);
  real amplitude = solved[2] + (c11 * g2 - c12 * g1) / determinant;
  return [u, limited_amplitude(amplitude, u, strain, lower_bound, upper_bound), c11, c12, c22,
          dot_product(weighted, left)]';
}

/**
 * Middle of the places along u_1: the solution with a softening by fabric that is linear in
 * strain, as it is where epsilon_c2 is large.
 *
 * @param log_grain_size_ratio ln(d_ss/d_0)
 * @param log_strength left-hand side of (*) at the pins, less ln S_0 where that is given
 * @param reference see valley_reference()
 * @param reference_log_strength the same at the reference point
 * @param stress_given and the others: see fabric_step()
 * @return u_1 and its standard deviation
 */
vector middle_grain_strain(real exponent_ratio, real log_grain_size_ratio, vector log_strength,
                           data vector reference, data vector reference_log_strength,
                           data vector strain, data vector weight, real precision,
                           data int stress_given, data vector lower_bound,
                           data vector upper_bound, data array[] int pooled, vector centre,
                           vector spread) {
  vector[rows(strain)] linear = -centred(strain, weight, stress_given) / max(strain);
  real u = reference[1];
  real amplitude = 0;
  real c11;
  real c12;
  real c22;
  for (k in 1 : n_valley_steps() + 1) {
    // The last pass is for the standard deviation, at full weight.
    int is_last = k > n_valley_steps();
    real f = is_last ? 1 : k * 1.0 / n_valley_steps();
    real trust = is_last ? precision : softened_share() * precision;
    matrix[rows(strain), 2] softening
      = grain_softening(u, reference[2] + f * (exponent_ratio - reference[2]),
                        exp(reference[3] + f * (log_grain_size_ratio - reference[3])), strain,
                        lower_bound, upper_bound);
    vector[rows(strain)] left = reference_log_strength
                                + f * (log_strength - reference_log_strength)
                                - softening[ : , 1] - amplitude * linear;
    vector[rows(strain)] by_u = trust * weight
                                .* centred(softening[ : , 2], weight, stress_given);
    vector[2] regular = regularisation(u, pooled[1], centre[1], spread[1]);
    c11 = trust * dot_product(weight .* linear, linear) + amplitude_precision();
    c12 = dot_product(by_u, linear);
    c22 = dot_product(by_u, softening[ : , 2]) + regular[2];
    if (!is_last) {
      real g1 = trust * dot_product(weight .* linear, left) - amplitude_precision() * amplitude;
      real g2 = dot_product(by_u, left) + regular[1];
      real determinant = c11 * c22 - square(c12);
      amplitude += (c22 * g1 - c12 * g2) / determinant;
      u += limited_step((c11 * g2 - c12 * g1) / determinant);
    }
  }
  return [u, 1 / sqrt(c22 - square(c12) / c11)]';
}

/**
 * Offset from the middle at a place: places are a standard deviation apart near the middle and
 * outer_spacing() further out.
 *
 * @return the offset, ln of its derivative by the place
 */
vector offset_at(real place, real standard_deviation) {
  real further = hypot(standard_deviation, outer_spacing()) - standard_deviation;
  real above = 2 * (place - 2);
  real below = 2 * (-place - 2);
  return [standard_deviation * place + further * (log1p_exp(above) - log1p_exp(below)) / 2,
          log(standard_deviation + further * (inv_logit(above) + inv_logit(below)))]';
}

/**
 * ln density by place, normalised at the places, with a little of the prior mixed in.
 *
 * @param pooled, centre, spread see log_density_of_bounded()
 */
vector with_prior(vector log_density, real middle, real standard_deviation, data int pooled,
                  real centre, real spread) {
  vector[rows(log_density)] mixed = log_density - log_sum_exp(log_density);
  for (k in 1 : rows(log_density)) {
    vector[2] offset = offset_at(k - n_places() - 1, standard_deviation);
    mixed[k] = log_sum_exp(mixed[k], log(prior_share()) + offset[2]
                                     + log_density_of_bounded(middle + offset[1], pooled,
                                                              centre, spread));
  }
  return mixed;
}

/**
 * Quantile function of a density that is known at the places -n_places(), ..., n_places().
 *
 * The density is log-linear between places. The function is linear between them too, in the log
 * odds, with its bends smoothed by a logistic kernel, which keeps it increasing.
 *
 * @param log_odds of the probability
 * @param log_density ln density at the places
 * @return the place, ln of its derivative by the log odds
 */
vector place_of_quantile(real log_odds, vector log_density) {
  int n = rows(log_density);
  vector[n + 1] log_mass; // below the first place, between places, above the last
  vector[n] bend; // log odds at the places
  vector[n + 1] slope;
  real place;
  real derivative;
  log_mass[1] = log_density[1];
  log_mass[n + 1] = log_density[n];
  for (k in 2 : n) {
    // The mean of an exponential function between two values; 0.01 keeps it smooth where they
    // are equal.
    real half = hypot((log_density[k] - log_density[k - 1]) / 2, 0.01);
    log_mass[k] = (log_density[k] + log_density[k - 1]) / 2 + half + log1m_exp(-2 * half)
                  - log(2 * half);
  }
  for (k in 1 : n) {
    bend[k] = log_sum_exp(head(log_mass, k)) - log_sum_exp(tail(log_mass, n + 1 - k));
  }
  slope = rep_vector(1 / outer_spacing(), n + 1);
  for (k in 2 : n) {
    slope[k] = 1 / (bend[k] - bend[k - 1] + 1e-3); // no steeper than numbers can follow
  }
  place = -n_places() + slope[1] * (log_odds - bend[1]);
  derivative = slope[1];
  for (k in 1 : n) {
    real x = (log_odds - bend[k]) / bend_width();
    place += (slope[k + 1] - slope[k]) * bend_width() * log1p_exp(x);
    derivative += (slope[k + 1] - slope[k]) * inv_logit(x);
  }
  return [place, log(derivative)]';
}

/** Weights of the places in the interpolation of solutions. */
vector interpolation_weights(real place) {
  vector[2 * n_places() + 1] distance;
  for (k in 1 : rows(distance)) {
    distance[k] = place - (k - n_places() - 1);
  }
  return softmax(-2 * square(distance));
}

/** Where most of a normal density's mass above 0 lies, as the argument of log1p_exp(). */
real compressed(real mean) {
  real root = sqrt(square(mean) + 4);
  real middle = mean > 0 ? (root + mean) / 2 : 2 / (root - mean);
  return middle + log1m_exp(-middle);
}

/**
 * Argument a of a bounded parameter's place f in its range,
 *
 *   f = c [log1p_exp(a) - log1p_exp(a - 1/c)],
 *
 * which is linear in a as long as f is further from 0 and 1 than c, and approaches them
 * exponentially.
 *
 * @param place that the data ask for, in or out of the range
 * @param c its standard deviation
 */
real argument_of_place(real place, real c) {
  return compressed(place / c) - compressed((1 - place) / c) + (1 - place) / c;
}

/** Distance in standard deviations from what the data ask for to what the bounds allow. */
real distance_beyond(real place, real c) {
  real a = argument_of_place(place, c);
  return place / c - (log1p_exp(a) - log1p_exp(a - 1 / c));
}

/**
 * ln density of a misfit: normal where it is small, with a tail as of Student's t.
 *
 * Where nothing fits, differences between misfits are large and change quickly from one set of
 * parameters to the next; a quantile function of the normal density would as well.
 */
real log_fit(real misfit) {
  return -0.5 * misfit_tail() * log1p(misfit / misfit_tail());
}

/**
 * u_1 at a conditional quantile, and a solution for the fabric there.
 *
 * Along u_1 the misfit is that of the solution for (ln S_0, u_2, amplitude), with the amplitude
 * brought within its bounds, and their volume follows from its Gauss-Newton matrix (Laplace's
 * method).
 *
 * @param log_odds of the quantile
 * @return u_1, ln of its derivative by the log odds, u_2 and amplitude of the solution
 */
vector grain_strain_at_quantile(real log_odds, real exponent_ratio, real log_grain_size_ratio,
                                vector log_strength, data vector reference,
                                data vector reference_log_strength, data vector strain,
                                data vector weight, real precision, data int stress_given,
                                data vector lower_bound, data vector upper_bound,
                                data array[] int pooled, vector centre, vector spread) {
  int n = n_places();
  vector[2] middle = middle_grain_strain(exponent_ratio, log_grain_size_ratio, log_strength,
                                         reference, reference_log_strength, strain, weight,
                                         precision, stress_given, lower_bound, upper_bound,
                                         pooled, centre, spread);
  vector[2] fabric_at_middle = [reference[6], reference[5]]';
  real range = upper_bound[3] - lower_bound[3];
  matrix[2, 2 * n + 1] fabric;
  vector[2 * n + 1] log_density;
  for (k in 1 : n_valley_steps()) {
    real f = k * 1.0 / n_valley_steps();
    vector[rows(strain)] rest
      = reference_log_strength + f * (log_strength - reference_log_strength)
        - col(grain_softening(reference[1] + f * (middle[1] - reference[1]),
                              reference[2] + f * (exponent_ratio - reference[2]),
                              exp(reference[3] + f * (log_grain_size_ratio - reference[3])),
                              strain, lower_bound, upper_bound), 1);
    fabric_at_middle = head(fabric_step(fabric_at_middle, rest, strain, weight,
                                        softened_share() * precision, stress_given, lower_bound,
                                        upper_bound, pooled, centre, spread), 2);
  }
  for (side in 0 : 1) {
    int sign = side == 0 ? -1 : 1;
    vector[2] solved = fabric_at_middle;
    for (k in side : n) {
      int i = n + 1 + sign * k;
      vector[2] offset = offset_at(sign * k, middle[2]);
      vector[rows(strain)] rest = log_strength
        - col(grain_softening(middle[1] + offset[1], exponent_ratio, exp(log_grain_size_ratio),
                              strain, lower_bound, upper_bound), 1);
      vector[6] step;
      real determinant;
      solved = head(fabric_step(solved, rest, strain, weight, softened_share() * precision,
                                stress_given, lower_bound, upper_bound, pooled, centre, spread),
                    2);
      step = fabric_step(solved, rest, strain, weight, precision, stress_given, lower_bound,
                         upper_bound, pooled, centre, spread);
      determinant = step[3] * step[5] - square(step[4]);
      fabric[ : , i] = solved;
      log_density[i] = log_fit(step[6] + square(distance_beyond(
                                 (1 - solved[2] - lower_bound[3]) / range,
                                 sqrt(step[3] / determinant) / range)))
                       - 0.5 * log(determinant)
                       + log_density_of_bounded(solved[1], pooled[2], centre[2], spread[2])
                       + log_density_of_bounded(middle[1] + offset[1], pooled[1], centre[1],
                                                spread[1])
                       + offset[2];
    }
  }
  {
    vector[2] place
      = place_of_quantile(log_odds, with_prior(log_density, middle[1], middle[2], pooled[1],
                                               centre[1], spread[1]));
    vector[2] offset = offset_at(place[1], middle[2]);
    real u = middle[1] + offset[1];
    vector[2] solved = fabric * interpolation_weights(place[1]);
    vector[rows(strain)] rest = log_strength
      - col(grain_softening(u, exponent_ratio, exp(log_grain_size_ratio), strain, lower_bound,
                            upper_bound), 1);
    for (k in 1 : 2) {
      solved = head(fabric_step(solved, rest, strain, weight, softened_share() * precision,
                                stress_given, lower_bound, upper_bound, pooled, centre, spread),
                    2);
    }
    return [u, offset[2] + place[2], solved[1], solved[2]]';
  }
}

/**
 * F_ss that solves (*), together with ln S_0, at given u_1 and u_2, whatever its bounds.
 *
 * Newton steps start from the amplitude that gives the same softening up to the last pin as a
 * solution nearby.
 *
 * @param total_softening -ln F at the last pin in the solution nearby
 * @param pooled, centre, spread of u_F: see log_density_of_bounded()
 * @return F_ss, its precision, the misfit left, and -ln F at the last pin
 */
vector solve_fabric_factor(real total_softening, real u_2, vector rest, int n_steps,
                           data vector strain, data vector weight, real precision,
                           data int stress_given, data vector lower_bound,
                           data vector upper_bound, data int pooled, real centre, real spread) {
  vector[2] regular = amplitude_regularisation(pooled, centre, spread, lower_bound, upper_bound);
  real critical = lower_bound[2] + (upper_bound[2] - lower_bound[2]) * inv_logit(u_2);
  real growth = -expm1(-strain[rows(strain)] / critical); // up to the last pin
  real amplitude = -expm1(-total_softening) / growth;
  real factor_precision;
  real misfit;
  for (k in 1 : n_steps) {
    matrix[rows(strain), 3] softening;
    vector[rows(strain)] left;
    vector[rows(strain)] by_amplitude;
    real step;
    if (k > 1) {
      amplitude = limited_amplitude(amplitude, u_2, strain, lower_bound, upper_bound);
    }
    softening = fabric_softening(u_2, amplitude, strain, lower_bound, upper_bound);
    left = centred(rest - softening[ : , 1], weight, stress_given);
    by_amplitude = precision * weight .* centred(softening[ : , 3], weight, stress_given);
    factor_precision = dot_product(by_amplitude, softening[ : , 3]) + regular[2];
    step = dot_product(by_amplitude, left);
    misfit = precision * dot_product(weight .* left, left);
    if (pooled) {
      step += regular[2] * (regular[1] - amplitude);
      misfit += regular[2] * square(regular[1] - amplitude);
    }
    step /= factor_precision;
    misfit -= factor_precision * square(step);
    amplitude += step;
  }
  return [1 - amplitude, factor_precision, misfit,
          -log1m(limited_amplitude(amplitude, u_2, strain, lower_bound, upper_bound) * growth)]';
}

/**
 * Real number u behind a bounded parameter, from a remainder that is whitened in the parameter.
 *
 * Data fix the parameter, not u: where it is fixed to a small part of its range, but close to a
 * bound, u would have a long tail.
 *
 * @param place, c see argument_of_place()
 * @return u, then ln |du/d(remainder)|
 */
vector bounded_from_remainder(real place, real c, real remainder) {
  real a = argument_of_place(place, c) + remainder;
  real log_place = log(log1p_exp(a) - log1p_exp(a - 1 / c)); // ln(f/c)
  real log_rest = log(log1p_exp(1 / c - a) - log1p_exp(-a)); // ln((1 - f)/c)
  return [log_place - log_rest,
          log_diff_exp(log_inv_logit(a), log_inv_logit(a - 1 / c)) - log_place - log_rest
          - log(c)]';
}

/**
 * u_2 at a conditional quantile, and what the data ask of F_ss there.
 *
 * Along u_2 the misfit is that of the solution for (ln S_0, F_ss); where F_ss would leave its
 * bounds, the misfit at the bound counts.
 *
 * @param log_odds of the quantile
 * @param middle, standard_deviation of the places along u_2
 * @param total_softening -ln F at the last pin in the middle
 * @return u_2, ln of its derivative by the log odds, place of F_ss in its range, and its standard
 *   deviation
 */
vector fabric_strain_at_quantile(real log_odds, real middle, real standard_deviation,
                                 real total_softening, vector rest, data vector strain,
                                 data vector weight, real precision, data int stress_given,
                                 data vector lower_bound, data vector upper_bound,
                                 data array[] int pooled, vector centre, vector spread) {
  int n = n_places();
  real range = upper_bound[3] - lower_bound[3];
  vector[2 * n + 1] total;
  vector[2 * n + 1] log_density;
  for (side in 0 : 1) {
    int sign = side == 0 ? -1 : 1;
    real total_before = total_softening;
    for (k in side : n) {
      int i = n + 1 + sign * k;
      vector[2] offset = offset_at(sign * k, standard_deviation);
      vector[4] factor = solve_fabric_factor(total_before, middle + offset[1], rest, 1, strain,
                                             weight, precision, stress_given, lower_bound,
                                             upper_bound, pooled[3], centre[3], spread[3]);
      real place = (factor[1] - lower_bound[3]) / range;
      real c = 1 / (range * sqrt(factor[2]));
      total_before = factor[4];
      total[i] = factor[4];
      log_density[i] = log_fit(factor[3] + square(distance_beyond(place, c))) + log(c)
                       + log_density_of_bounded(middle + offset[1], pooled[2], centre[2],
                                                spread[2])
                       + offset[2];
    }
  }
  {
    vector[2] place
      = place_of_quantile(log_odds, with_prior(log_density, middle, standard_deviation,
                                               pooled[2], centre[2], spread[2]));
    vector[2] offset = offset_at(place[1], standard_deviation);
    vector[4] factor
      = solve_fabric_factor(dot_product(total, interpolation_weights(place[1])),
                            middle + offset[1], rest, 2, strain, weight, precision,
                            stress_given, lower_bound, upper_bound, pooled[3], centre[3],
                            spread[3]);
    return [middle + offset[1], offset[2] + place[2], (factor[1] - lower_bound[3]) / range,
            1 / (range * sqrt(factor[2]))]';
  }
}

/**
 * ln S_0 that solves (*) at given microstructure, which is linear in it, and its precision.
 *
 * @param softening ln F + (p/n) ln(d/d_0) at the pins
 */
vector solve_reference_stress(vector softening, vector log_strength, data vector weight,
                              real precision, data real reference_log_stress) {
  real total = precision * sum(weight) + reference_stress_precision();
  return [(precision * dot_product(weight, log_strength - softening)
           + reference_stress_precision() * reference_log_stress) / total,
          total]';
}

/**
 * (ln S_0, u_F, u_1, u_2) from their coordinates.
 *
 * @param coordinate in this order: remainders of ln S_0 and F_ss, log odds of the quantiles of u_1
 *   and u_2
 * @param log_strength left-hand side of (*) at the pins, less ln S_0 where that is given
 * @param reference_log_strength the same at the reference point
 * @param weight of the pins for u_1
 * @param fine_weight that for the others
 * @param precision of the reference point's noise variance over the variance here, by which the
 *   weights count
 * @param stress_given 1: ln S_0 is given, its remainder and the one returned have no effect
 * @param pooled, centre, spread of (u_1, u_2, u_F): see log_density_of_bounded()
 * @return (ln S_0, u_F, u_1, u_2), then ln |d(these)/d(coordinate)|
 */
vector softening_from_coordinates(vector coordinate, real exponent_ratio,
                                  real log_grain_size_ratio, vector log_strength,
                                  data vector reference, data vector reference_log_strength,
                                  data vector strain, data vector weight,
                                  data vector fine_weight, real precision,
                                  data int stress_given, data vector lower_bound,
                                  data vector upper_bound, data array[] int pooled,
                                  vector centre, vector spread) {
  vector[4] grain = grain_strain_at_quantile(coordinate[3], exponent_ratio,
    log_grain_size_ratio, log_strength, reference, reference_log_strength, strain, weight,
    precision, stress_given, lower_bound, upper_bound, pooled, centre, spread);
  vector[rows(strain)] rest = log_strength
    - col(grain_softening(grain[1], exponent_ratio, exp(log_grain_size_ratio), strain,
                          lower_bound, upper_bound), 1);
  vector[6] step = fabric_step(grain[3 : 4], rest, strain, fine_weight, precision, stress_given,
                               lower_bound, upper_bound, pooled, centre, spread);
  vector[4] fabric = fabric_strain_at_quantile(coordinate[4], grain[3],
    1 / sqrt(step[3] - square(step[4]) / step[5]),
    -fabric_softening(grain[3], grain[4], strain, lower_bound, upper_bound)[rows(strain), 1], rest,
    strain, fine_weight, precision, stress_given, lower_bound, upper_bound, pooled, centre, spread);
  vector[2] factor = bounded_from_remainder(fabric[3], fabric[4], coordinate[2]);
  real log_jacobian = grain[2] + fabric[2] + factor[2];
  real amplitude;
  vector[2] stress;
  if (stress_given) {
    return [0, factor[1], grain[1], fabric[1], log_jacobian]';
  }
  amplitude = 1 - lower_bound[3] - (upper_bound[3] - lower_bound[3]) * inv_logit(factor[1]);
  stress = solve_reference_stress(col(fabric_softening(fabric[1], amplitude, strain, lower_bound,
                                                       upper_bound), 1),
                                  rest, fine_weight, precision, reference[4]);
  return [stress[1] + coordinate[1] / sqrt(stress[2]), factor[1], grain[1], fabric[1],
          log_jacobian - 0.5 * log(stress[2])]';
}

/**
 * Plain coordinate of a parameter, straightened: linear in the parameter or in its inverse.
 *
 * Data can push a parameter against its lower bound (the Kelvin modulus of ice). There the plain
 * coordinate is logarithmic and runs away; ln(c log1p_exp(x)) is linear in the parameter above c.
 * Of the Maxwell modulus they fix the inverse, to which elastic strain is proportional.
 *
 * @param offset from the reference point, in the straightened coordinate
 * @param reference plain coordinate of the reference point
 * @param linear_from c > 0: linear in exp(plain) above c; c < 0: linear in exp(-plain) above -c;
 *   0: plain
 * @return plain coordinate, and ln of its derivative by the offset
 */
vector plain_from_straightened(real offset, data real reference, data real linear_from) {
  if (linear_from == 0) {
    return [reference + offset, 0]';
  } else {
    real sign = linear_from > 0 ? 1 : -1;
    real c = linear_from > 0 ? linear_from : -linear_from;
    real x = log(expm1(exp(sign * reference) / c)) + sign * offset;
    return [sign * log(c * log1p_exp(x)), log_inv_logit(x) - log(log1p_exp(x))]';
  }
}

/**
 * Physical parameters at given valley coordinates.
 *
 * The coordinates stand in the order of the plain ones; those of ln S_0 and F_ss are remainders in
 * standard deviations, those of the critical strains the log odds of conditional quantiles.
 *
 * A test that shares parameters with another has coordinates for its own ones only. Where the
 * flow law is complete without, ln S_0 follows from it and has no coordinate.
 *
 * Partially pooled parameters have a normal density on the real line. It takes part in the
 * conditional densities of those that are solved for, and in pooled_from_reference() for the
 * others, so that they are centred and scaled by whatever fixes them, curve or pooling.
 *
 * @param coordinate_of position of each parameter among the coordinates, 0 where it has none
 * @param fixed_value parameters that have no coordinate; other entries are overwritten
 * @param replaced_parameter 6 or 7; 0: ln S_0 is given
 * @param reference_coordinate plain coordinates of the reference point
 * @param reference see valley_reference()
 * @param reference_log_strength left-hand side of (*) at the pins at the reference point
 * @param linear_from see plain_from_straightened()
 * @param noise_exponent power of the noise s with which the width of each coordinate grows
 * @param pooled 1 for coordinates of partially pooled parameters
 * @param centre, spread their normal density; those of others have no effect
 * @return as parameters_from_plain(), then the ln density of partially pooled parameters
 */
vector parameters_from_valley(vector coordinate, data array[] int parameter_of_coordinate,
                              data array[] int coordinate_of, data vector shift,
                              data vector scale, data vector lower_bound,
                              data vector upper_bound, vector fixed_value,
                              data int replaced_parameter, data real strain_rate,
                              data real initial_grain_size, data real temperature,
                              data vector knot_time_step, data vector knot_stress,
                              data array[] int pin_knot, data matrix pin,
                              data vector reference_coordinate, data vector reference,
                              data vector reference_log_strength, data vector linear_from,
                              data vector noise_exponent, data array[] int pooled,
                              vector centre, vector spread) {
  int n = num_elements(coordinate);
  array[3] int bounded = {coordinate_of[10], coordinate_of[11], coordinate_of[9]};
  int stress_given = replaced_parameter == 0;
  vector[n] plain = reference_coordinate;
  vector[n_parameters()] parameter = fixed_value;
  vector[4] of_softening = [0, coordinate[coordinate_of[9]], coordinate[coordinate_of[10]],
                            coordinate[coordinate_of[11]]]';
  real log_stress = 0; // what is taken from the strength at the pins
  vector[5] solved;
  real log_noise_ratio = 0; // ln(s/s of the reference point)
  real log_jacobian = 0;
  real log_pooling = 0;
  if (coordinate_of[12] > 0) {
    int i = coordinate_of[12];
    if (pooled[i]) {
      plain[i] = pooled_from_reference(coordinate[i], reference_coordinate[i], centre[i],
                                       spread[i])[1];
    } else {
      plain[i] += coordinate[i];
    }
    log_noise_ratio = log(bounded_from_real(plain[i], shift[i], scale[i], lower_bound[i],
                                            upper_bound[i]))
                      - log(bounded_from_real(reference_coordinate[i], shift[i], scale[i],
                                              lower_bound[i], upper_bound[i]));
  }
  for (i in 1 : n) {
    int k = parameter_of_coordinate[i];
    if (k != 9 && k != 10 && k != 11 && k != replaced_parameter) {
      vector[2] placed; // plain coordinate, ln of its derivative
      if (pooled[i]) {
        placed = pooled_from_reference(coordinate[i], reference_coordinate[i], centre[i],
                                       spread[i]);
      } else {
        placed = plain_from_straightened(
          coordinate[i] * exp(noise_exponent[i] * log_noise_ratio), reference_coordinate[i],
          linear_from[i]);
        placed[2] += noise_exponent[i] * log_noise_ratio;
      }
      plain[i] = placed[1];
      log_jacobian += placed[2];
      parameter[k] = bounded_from_real(plain[i], shift[i], scale[i], lower_bound[i],
                                       upper_bound[i]);
    }
  }
  if (stress_given) {
    log_stress = log_reference_stress(strain_rate, initial_grain_size, temperature, parameter[4],
                                      parameter[5], parameter[6], parameter[7]);
  } else {
    of_softening[1] = coordinate[coordinate_of[replaced_parameter]];
  }
  solved = softening_from_coordinates(of_softening, parameter[5] / parameter[4],
    log(parameter[8] / initial_grain_size),
    log_strength_at_pins(knot_time_step, knot_stress, pin_knot, pin, parameter[1],
                         parameter[2], parameter[3], parameter[4]) - log_stress,
    reference, reference_log_strength - (stress_given ? reference[4] : 0), col(pin, 1),
    col(pin, 5), col(pin, 6), exp(-2 * log_noise_ratio), stress_given, lower_bound[bounded],
    upper_bound[bounded], pooled[bounded], centre[bounded], spread[bounded]);
  plain[{coordinate_of[9], coordinate_of[10], coordinate_of[11]}] = solved[2 : 4];
  log_jacobian += solved[5];
  if (!stress_given) {
    int i = coordinate_of[replaced_parameter];
    plain[i] = (solved[1] - shift[i]) / scale[i];
    log_jacobian -= log(scale[i]);
  }
  for (i in 1 : n) {
    if (pooled[i]) {
      log_pooling += pooled_log_density(plain[i], centre[i], spread[i], scale[i],
                                        lower_bound[i], upper_bound[i]);
    }
  }
  {
    vector[n_parameters() + 1] mapped = parameters_from_plain(plain, parameter_of_coordinate,
      shift, scale, lower_bound, upper_bound, fixed_value, replaced_parameter, 1,
      log(strain_rate), initial_grain_size, temperature);
    mapped[n_parameters() + 1] += log_jacobian;
    return append_row(mapped, log_pooling);
  }
}

/**
 * What softening_from_coordinates() wants to know of the reference point.
 *
 * @param reference_parameter physical parameters at the reference point
 * @return (u_1, p/n, ln(d_ss/d_0), ln S_0, 1 - F_ss, u_2)
 */
vector valley_reference(data vector reference_coordinate, data array[] int coordinate_of,
                        data vector shift, data vector scale, data vector reference_parameter,
                        data int replaced_parameter, data real initial_grain_size) {
  int i = coordinate_of[replaced_parameter];
  return [reference_coordinate[coordinate_of[10]],
          reference_parameter[5] / reference_parameter[4],
          log(reference_parameter[8] / initial_grain_size),
          shift[i] + scale[i] * reference_coordinate[i],
          1 - reference_parameter[9], reference_coordinate[coordinate_of[11]]]';
}
