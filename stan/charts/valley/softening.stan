/**
 * ln S_0, F_ss and the critical strains from their valley coordinates (charts/valley/valley.stan).
 */

/** Misfit, as of chi squared, from which on the density of a misfit has a long tail. */
real misfit_tail() { return 6; }

/**
 * ln density of a misfit: normal where it is small, with a tail as of Student's t.
 *
 * Where nothing fits, differences between misfits are large and change quickly from one set of
 * parameters to the next; a quantile function of the normal density would as well.
 */
real log_fit(real misfit) {
  return -0.5 * misfit_tail() * log1p(misfit / misfit_tail());
}

#include charts/valley/fabric_along_grain_strain.stan

/**
 * u_1 at a conditional quantile, and a solution for the fabric there.
 *
 * @param log_odds of the quantile
 * @param middle u_1 in the middle of the places, and their standard deviation
 * @return u_1, ln of its derivative by the log odds, u_2 and amplitude of the solution
 */
vector grain_strain_at_quantile(real log_odds, vector middle, vector asked,
                                data vector reference, data vector strain, vector weight,
                                data int stress_given, data matrix bounds) {
  matrix[n_all_places(), 2] at_place = numbers_at(quantile_places(), middle);
  matrix[3, n_all_places()] fabric
    = fabric_along_grain_strain(col(at_place, 1), asked, reference, strain, weight, stress_given,
                                bounds);
  vector[2] place = place_of_quantile(log_odds, with_prior(to_vector(fabric[3]), at_place));
  row_vector[2] there = numbers_at(head(place, 1), middle)[1];
  vector[rows(strain)] rest = col(rest_of_strength(there[1], asked, strain, bounds), 1);
  vector[2] solved = fabric[1 : 2] * interpolation_weights(place[1]);
  for (k in 1 : 2) {
    solved = head(fabric_step(solved, rest, strain, softened_share() * weight, stress_given,
                              bounds), 2);
  }
  return append_row([there[1], there[2] + place[2]]', solved);
}

#include charts/valley/factor_along_fabric_strain.stan

/**
 * u_2 at a conditional quantile, and what the data ask of F_ss there.
 *
 * @param log_odds of the quantile
 * @param middle u_2 in the middle of the places, and their standard deviation
 * @param total_softening -ln F at the last pin in the middle
 * @return u_2, ln of its derivative by the log odds, place of F_ss in its range, and its standard
 *   deviation
 */
vector fabric_strain_at_quantile(real log_odds, vector middle, real total_softening,
                                 vector rest, data vector strain, vector weight,
                                 data int stress_given, data matrix bounds) {
  real range = bounds[3, 2] - bounds[3, 1];
  matrix[n_all_places(), 2] at_place = numbers_at(quantile_places(), middle);
  matrix[2, n_all_places()] factors
    = factor_along_fabric_strain(col(at_place, 1), total_softening, rest, strain, weight,
                                 stress_given, bounds);
  vector[2] place = place_of_quantile(log_odds, with_prior(to_vector(factors[2]), at_place));
  row_vector[2] there = numbers_at(head(place, 1), middle)[1];
  vector[4] factor = solve_fabric_factor(factors[1] * interpolation_weights(place[1]), there[1],
                                         rest, 2, strain, weight, stress_given, bounds);
  return [there[1], there[2] + place[2], (factor[1] - bounds[3, 1]) / range,
          1 / (range * sqrt(factor[2]))]';
}

/**
 * u_F and u_2 where what is left is softened by fabric, or by grain size as if by fabric.
 *
 * @param coordinate in this order: remainder of F_ss, log odds of the quantile of u_2
 * @param solved u_2 and amplitude of a solution nearby
 * @param rest ln of the strength that is left
 * @return u_F and u_2, then ln of the derivatives of u_2 and of u_F by their coordinates
 */
vector last_softening(vector coordinate, vector solved, vector rest, vector weight,
                      data matrix pin, data int stress_given, data matrix bounds) {
  vector[7] step = fabric_step(solved, rest, col(pin, 1), weight, stress_given, bounds);
  vector[4] fabric = fabric_strain_at_quantile(coordinate[2],
    [solved[1], 1 / sqrt(step[3] - square(step[4]) / step[5])]',
    -fabric_softening(solved[1], solved[2], col(pin, 1), bounds)[rows(pin), 1], rest, col(pin, 1),
    weight, stress_given, bounds);
  vector[2] factor = bounded_from_remainder(fabric[3], fabric[4], coordinate[1]);
  return [factor[1], fabric[1], fabric[2], factor[2]]';
}

/** 1 - F_ss at a real number behind F_ss. */
real amplitude_of(real u, data matrix bounds) {
  return 1 - bounds[3, 1] - (bounds[3, 2] - bounds[3, 1]) * inv_logit(u);
}

/**
 * ln S_0 from its remainder at given microstructure.
 *
 * @return ln S_0, then ln |d(ln S_0)/d(remainder)|
 */
vector stress_from_remainder(real remainder, vector strength, vector weight,
                             data real reference_log_stress) {
  vector[2] stress = solve_reference_stress(strength, weight, reference_log_stress);
  return [stress[1] + remainder / sqrt(stress[2]), -0.5 * log(stress[2])]';
}

/** Whether ln S_0 is solved from times. */
int is_solved_from_times(data matrix pin) { return max(col(pin, 8)) > 0; }

/**
 * The same where ln S_0 is solved from times, from the strain of the flow over what data can tell
 * from none.
 *
 * With soft springs the flow is next to nothing. Data then fix its strain, down to what they can tell
 * from none, and below that the priors its logarithm: so it is stretched (log_from_stretched()).
 *
 * @param dashpot_rate dashpot_rate_at_pins()
 * @param expected ln S_0 that the other parameters suggest, without data
 * @param precision of the noise here over that at the reference point
 * @param seen flow strain that data can just tell from none, over that of the reference curve, and
 *   width of the logarithm of the flow strain without data
 */
vector stress_from_flow(real remainder, vector strength, vector dashpot_rate, real expected,
                        data matrix pin, real precision, real stress_exponent,
                        data vector seen) {
  vector[rows(pin)] strain = col(pin, 3) .* col(pin, 8) / dot_product(col(pin, 3), col(pin, 8));
  real log_seen = log(seen[1]) - 0.5 * log(precision);
  // At the floored rates.
  real log_strain = log(dot_product(strain, floored_rate(dashpot_rate))) - log_seen;
  real log_stress = reference_stress_of_time(strength, col(pin, 8), stress_exponent);
  real asked = dot_product(strain, dashpot_rate) / exp(log_seen);
  // What data ask for, or where that is next to nothing what priors suggest.
  real middle = log_sum_exp(log(log1p_exp(asked) + 1e-300),
                            log_inv_logit(log_strain
                                          + stress_exponent * (log_stress - expected)));
  real log_flow = log_from_stretched(exp(middle) + middle / seen[2] - remainder, seen[2]);
  return [log_stress + (log_strain - log_flow) / stress_exponent,
          -log(stress_exponent) - log(exp(log_flow) + 1 / seen[2])]';
}

/**
 * (ln S_0, u_F, u_1, u_2) from their coordinates.
 *
 * @param coordinate in this order: remainders of ln S_0 and F_ss, log odds of the quantiles of u_1
 *   and u_2
 * @param dashpot_rate, expected, precision, seen see stress_from_flow()
 * @param stress_exponent n
 * @param stress_given 1: ln S_0 is given, its remainder and the one returned have no effect
 * @return (ln S_0, u_F, u_1, u_2), then ln |d(these)/d(coordinate)|
 */
vector softening_from_coordinates(vector coordinate, vector asked, data vector reference,
                                  data matrix pin, vector dashpot_rate, real expected,
                                  real precision, real stress_exponent, data vector seen,
                                  data int stress_given, data matrix bounds) {
  vector[rows(pin)] weight = precision * col(pin, 5);
  vector[rows(pin)] fine_weight = precision * col(pin, 6);
  vector[2] middle = middle_grain_strain(asked, reference, col(pin, 1), weight, stress_given,
                                         bounds);
  vector[4] grain = grain_strain_at_quantile(coordinate[3], middle, asked, reference,
                                             col(pin, 1), weight, stress_given, bounds);
  vector[rows(pin)] rest = col(rest_of_strength(grain[1], asked, col(pin, 1), bounds), 1);
  vector[4] last = last_softening(coordinate[{2, 4}], grain[3 : 4], rest, fine_weight, pin,
                                  stress_given, bounds);
  vector[rows(pin)] strength
    = rest - col(fabric_softening(last[2], amplitude_of(last[1], bounds), col(pin, 1), bounds), 1);
  vector[2] stress
    = stress_given ? rep_vector(0, 2)
      : is_solved_from_times(pin)
      ? stress_from_flow(coordinate[1], strength, dashpot_rate, expected, pin, precision,
                         stress_exponent, seen)
      : stress_from_remainder(coordinate[1], strength, fine_weight, reference[i_log_stress()]);
  return [stress[1], last[1], grain[1], last[2], grain[2] + last[3] + last[4] + stress[2]]';
}

/**
 * The same where grain size or fabric evolves alone: (ln S_0, u_F, 0, u_2).
 *
 * A grain size softens like a fabric to the power p/n: d/d_0 is in the place of F then, d_ss/d_0 in
 * that of F_ss and epsilon_c1 in that of epsilon_c2.
 *
 * @param coordinate in this order: remainders of ln S_0 and F_ss, log odds of the quantile of u_2
 * @param is_grain_size 1: grain size evolves, 0: fabric
 */
vector softening_of_one(vector coordinate, vector asked, data vector reference,
                        data matrix pin, vector dashpot_rate, real expected, real precision,
                        real stress_exponent, data vector seen, data int is_grain_size,
                        data int stress_given, data matrix bounds) {
  real power = is_grain_size ? asked[1] : 1;
  vector[rows(pin)] fine_weight = precision * col(pin, 6);
  vector[rows(pin)] root = tail(asked, rows(pin)) / power; // ln strength, as one of a fabric
  vector[2] solved = reference[{i_fabric_strain(), i_fabric_amplitude()}];
  vector[4] last;
  vector[2] stress = rep_vector(0, 2);
  for (k in 1 : n_valley_steps()) {
    vector[rows(asked)] here = asked_along_path(k * 1.0 / n_valley_steps(), asked, reference);
    real power_here = is_grain_size ? here[1] : 1;
    vector[rows(pin)] root_here = tail(here, rows(pin)) / power_here;
    vector[rows(pin)] softened = softened_share() * precision * square(power_here) * col(pin, 5);
    solved = head(fabric_step(solved, root_here, col(pin, 1), softened, stress_given, bounds), 2);
  }
  last = last_softening(coordinate[2 : 3], solved, root, square(power) * fine_weight, pin,
                        stress_given, bounds);
  if (!stress_given) {
    vector[rows(pin)] strength
      = power * (root - col(fabric_softening(last[2], amplitude_of(last[1], bounds), col(pin, 1),
                                             bounds), 1));
    stress = is_solved_from_times(pin)
             ? stress_from_flow(coordinate[1], strength, dashpot_rate, expected, pin, precision,
                                stress_exponent, seen)
             : stress_from_remainder(coordinate[1], strength, fine_weight,
                                     reference[i_log_stress()]);
  }
  return [stress[1], last[1], 0, last[2], last[3] + last[4] + stress[2]]';
}
