/**
 * Quantile functions: of a density that is known at a few places, and of a bounded parameter.
 */

/** Places on either side of the middle at which a conditional density is evaluated. */
int n_places() { return 6; }

/** The middle, and the places on both sides of it. */
int n_all_places() { return 2 * n_places() + 1; }

/** Distance of outer places on the real line; the prior there, a logistic one, has sd 1.8. */
real outer_spacing() { return 1.5; }

/** Width of the bends of a quantile function, in its argument. */
real bend_width() { return 0.5; }

/** Share of the prior in conditional densities: how far down they are trusted in their tails. */
real prior_share() { return 1e-6; }

/**
 * Numbers at places: a standard deviation apart near the middle and outer_spacing() further out.
 *
 * @param middle number at the place 0, and the standard deviation
 * @return columns: the numbers, ln of their derivatives by the place
 */
matrix numbers_at(vector place, vector middle) {
  real further = hypot(middle[2], outer_spacing()) - middle[2];
  vector[rows(place)] above = 2 * (place - 2);
  vector[rows(place)] below = 2 * (-place - 2);
  return append_col(middle[1] + middle[2] * place
                    + further * ((log1p_exp(above) - log1p_exp(below)) / 2),
                    log(middle[2] + further * (inv_logit(above) + inv_logit(below))));
}

/** Places at which a conditional density is evaluated. */
vector quantile_places() { return linspaced_vector(n_all_places(), -n_places(), n_places()); }

/**
 * ln density by place, normalised at the places, with a little of the prior mixed in.
 *
 * @param log_fit ln density of the data at the places
 * @param at_place numbers_at() them
 */
vector with_prior(vector log_fit, matrix at_place) {
  vector[rows(log_fit)] log_prior = log_inv_logit(col(at_place, 1))
                                    + log1m_inv_logit(col(at_place, 1)) + col(at_place, 2);
  vector[rows(log_fit)] log_density = log_fit + log_prior;
  real total = log_sum_exp(log_density);
  for (k in 1 : rows(log_density)) {
    log_density[k] = log_sum_exp(log_density[k] - total, log(prior_share()) + log_prior[k]);
  }
  return log_density;
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
  vector[n] log_below; // ln of the mass on either side of a place
  vector[n] log_above;
  vector[n] bend; // log odds at the places
  vector[n] x;
  vector[n + 1] slope = rep_vector(1 / outer_spacing(), n + 1);
  vector[n] turn;
  log_mass[1] = log_density[1];
  log_mass[n + 1] = log_density[n];
  for (k in 2 : n) {
    // The mean of an exponential function between two values; 0.01 keeps it smooth where they
    // are equal.
    real half = hypot((log_density[k] - log_density[k - 1]) / 2, 0.01);
    log_mass[k] = (log_density[k] + log_density[k - 1]) / 2 + half + log1m_exp(-2 * half)
                  - log(2 * half);
  }
  log_below[1] = log_mass[1];
  log_above[n] = log_mass[n + 1];
  for (k in 2 : n) {
    log_below[k] = log_sum_exp(log_below[k - 1], log_mass[k]);
    log_above[n + 1 - k] = log_sum_exp(log_above[n + 2 - k], log_mass[n + 2 - k]);
  }
  bend = log_below - log_above;
  // No steeper than numbers can follow.
  slope[2 : n] = inv(tail(bend, n - 1) - head(bend, n - 1) + 1e-3);
  turn = tail(slope, n) - head(slope, n);
  x = (log_odds - bend) / bend_width();
  return [slope[1] * (log_odds - bend[1]) - n_places()
          + bend_width() * dot_product(turn, log1p_exp(x)),
          log(slope[1] + dot_product(turn, inv_logit(x)))]';
}

/** Weights of the places in the interpolation of solutions. */
vector interpolation_weights(real place) {
  return softmax(-2 * square(place - quantile_places()));
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
 * Real number u behind a bounded parameter, from a remainder that is whitened in the parameter.
 *
 * Data fix the parameter, not u: where it is fixed to a small part of its range, but close to a
 * bound, u would have a long tail.
 *
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
