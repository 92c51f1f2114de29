/**
 * Solutions of (*) in charts/valley/valley.stan at the pins by weighted least squares.
 *
 * What the other parameters ask for is a vector `asked`: p/n, ln(d_ss/d_0), then the left-hand side
 * of (*) at the pins, less ln S_0 where that is given. The same at the reference point is the end
 * of `reference`, which starts with what is named below (valley_reference()); steps go along the
 * path from there. Columns of pins, knots and bounds are those of charts/valley/pins.stan;
 * weights are those at the noise here. Where `stress_given` is 1, ln S_0 is.
 */

/** Gauss-Newton steps along the path from the reference point. */
int n_valley_steps() { return 8; }

/** Share of the pins' weight with which u_1, u_2 and the amplitude are solved for.
 *
 * For some grain-size softenings the least-squares problem has two solutions. At less than full
 * weight the solution moves between them instead of jumping.
 */
real softened_share() { return 0.25; }

/** Precision of each real number behind a bounded parameter, and of the amplitude of softening by
 * fabric, that keeps the least-squares problems regular where the curve does not fix them. */
real bounded_parameter_precision() { return 0.5; }

real amplitude_precision() { return 4.0; }

/** Precision of ln S_0 where the curve does not fix it. */
real reference_stress_precision() { return 1.0; }

/** Places in `reference`: u_1, u_2, 1 - F_ss, ln S_0 and ln s; see softening_of_one() too. */
int i_grain_strain() { return 1; }
int i_fabric_strain() { return 2; }
int i_fabric_amplitude() { return 3; }
int i_log_stress() { return 4; }
int i_log_noise() { return 5; }

/** Compliance of the Kelvin element in the elastic rise, and softening up to the last pin. */
int i_rise_compliance() { return 6; }
int i_whole_softening() { return 7; }

/** Value of the parameter that ln S_0 replaces, Q_M or beta. */
int i_replaced_value() { return 8; }

/** Width of ln(flow rate) by the prior of this parameter, where no other one of the flow law moves. */
int i_hidden_width() { return 9; }

/** Elements of `reference` beside the strength at the pins: those above, p/n and ln(d_ss/d_0). */
int n_reference() { return 11; }

/** What is asked for at a part of the way from the reference point. */
vector asked_along_path(real part_of_way, vector asked, data vector reference) {
  return part_of_way * asked + (1 - part_of_way) * tail(reference, rows(asked));
}

/**
 * Strength that is left to the fabric, and to ln S_0 where it is not given.
 *
 * @param u real number behind epsilon_c1
 * @return columns: the rest, derivative of the softening by grain size by u
 */
matrix rest_of_strength(real u, vector asked, data vector strain, data matrix bounds) {
  matrix[rows(strain), 2] rest = grain_softening(u, asked[1], asked[2], strain, bounds);
  rest[ : , 1] = tail(asked, rows(strain)) - rest[ : , 1];
  return rest;
}

/** Values less their weighted mean, which ln S_0 takes up unless it is given. */
vector centred(vector values, vector weight, data int stress_given) {
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
real limited_step(real step) { return step / hypot(1, step); }

/**
 * Middle of the places along u_1: the solution with a softening by fabric that is linear in
 * strain, as it is where epsilon_c2 is large.
 *
 * @param linear softening by fabric at an amplitude of 1, centred()
 * @return u_1 and its standard deviation
 */
vector middle_grain_strain(vector asked, data vector reference, vector linear,
                           data vector strain, vector weight, data int stress_given,
                           data matrix bounds) {
  real u = reference[i_grain_strain()];
  real amplitude = 0;
  real c11;
  real c12;
  real c22;
  for (k in 1 : n_valley_steps() + 1) {
    // The last pass is for the standard deviation, at full weight.
    int is_last = k > n_valley_steps();
    real f = fmin(1, k * 1.0 / n_valley_steps());
    vector[rows(strain)] trusted = (is_last ? 1 : softened_share()) * weight;
    matrix[rows(strain), 2] rest = rest_of_strength(u, asked_along_path(f, asked, reference),
                                                    strain, bounds);
    vector[rows(strain)] by_u = trusted .* centred(rest[ : , 2], trusted, stress_given);
    vector[rows(strain)] by_amplitude = trusted .* linear;
    c11 = dot_product(by_amplitude, linear) + amplitude_precision();
    c12 = dot_product(by_u, linear);
    c22 = dot_product(by_u, rest[ : , 2]) + bounded_parameter_precision();
    if (!is_last) {
      vector[rows(strain)] left = rest[ : , 1] - amplitude * linear;
      real g1 = dot_product(by_amplitude, left) - amplitude_precision() * amplitude;
      real g2 = dot_product(by_u, left) + 1 - 2 * inv_logit(u);
      real determinant = c11 * c22 - square(c12);
      amplitude += (c22 * g1 - c12 * g2) / determinant;
      u += limited_step((c11 * g2 - c12 * g1) / determinant);
    }
  }
  return [u, 1 / sqrt(c22 - square(c12) / c11)]';
}

/**
 * One Gauss-Newton step for epsilon_c2 and the amplitude of fabric softening, ln S_0 eliminated.
 *
 * The amplitude is not kept within the bounds of F_ss: where the rest leaves no softening to the
 * fabric, the bounds would ask for an epsilon_c2 that hides it, at either end of its range, and
 * the solution would jump from one to the other.
 *
 * @param solved real number behind epsilon_c2, amplitude
 * @return solution after the step, the Gauss-Newton matrix (1, 1), (1, 2), (2, 2), and the misfit
 *   before the step
 */
vector fabric_step(vector solved, vector rest, data vector strain, vector weight,
                   data int stress_given, data matrix bounds) {
  matrix[rows(strain), 3] softening = fabric_softening(solved[1], solved[2], strain, bounds);
  vector[rows(strain)] left = centred(rest - softening[ : , 1], weight, stress_given);
  vector[rows(strain)] weighted = weight .* left;
  vector[rows(strain)] by_u = weight .* centred(softening[ : , 2], weight, stress_given);
  vector[rows(strain)] by_amplitude = weight .* centred(softening[ : , 3], weight, stress_given);
  real c11 = dot_product(by_u, softening[ : , 2]) + bounded_parameter_precision();
  real c12 = dot_product(by_u, softening[ : , 3]);
  real c22 = dot_product(by_amplitude, softening[ : , 3]) + amplitude_precision();
  real g1 = dot_product(weighted, softening[ : , 2]) + 1 - 2 * inv_logit(solved[1]);
  real g2 = dot_product(weighted, softening[ : , 3]) + amplitude_precision() * (0.5 - solved[2]);
  real determinant = c11 * c22 - square(c12);
  real u = solved[1] + limited_step((c22 * g1 - c12 * g2) / determinant);
  real amplitude = solved[2] + (c11 * g2 - c12 * g1) / determinant;
  return [u, limited_amplitude(amplitude, u, strain, bounds), c11, c12, c22,
          dot_product(weighted, left)]';
}

/**
 * F_ss that solves (*), together with ln S_0, at given u_1 and u_2, whatever its bounds.
 *
 * Newton steps start from the amplitude that gives the same softening up to the last pin as a
 * solution nearby.
 *
 * @param total_softening -ln F at the last pin in the solution nearby
 * @return F_ss, its precision, the misfit left, and -ln F at the last pin
 */
vector solve_fabric_factor(real total_softening, real u_2, vector rest, int n_steps,
                           data vector strain, vector weight, data int stress_given,
                           data matrix bounds) {
  real growth = fabric_growth(u_2, strain, bounds);
  real amplitude = -expm1(-total_softening) / growth;
  real factor_precision;
  real misfit;
  for (k in 1 : n_steps) {
    matrix[rows(strain), 3] softening;
    vector[rows(strain)] left;
    vector[rows(strain)] by_amplitude;
    real step;
    if (k > 1) {
      amplitude = limited_amplitude(amplitude, u_2, strain, bounds);
    }
    softening = fabric_softening(u_2, amplitude, strain, bounds);
    left = centred(rest - softening[ : , 1], weight, stress_given);
    by_amplitude = weight .* centred(softening[ : , 3], weight, stress_given);
    factor_precision = dot_product(by_amplitude, softening[ : , 3]) + amplitude_precision();
    step = dot_product(by_amplitude, left) / factor_precision;
    misfit = dot_product(weight .* left, left) - factor_precision * square(step);
    amplitude += step;
  }
  return [1 - amplitude, factor_precision, misfit,
          -log1m(limited_amplitude(amplitude, u_2, strain, bounds) * growth)]';
}

/**
 * ln S_0 that solves (*) at given microstructure, which is linear in it, and its precision.
 *
 * @param strength left-hand side of (*) less ln F + (p/n) ln(d/d_0), at the pins
 * @param reference_log_stress ln S_0 at the reference point
 */
vector solve_reference_stress(vector strength, vector weight, data real reference_log_stress) {
  real total = sum(weight) + reference_stress_precision();
  return [(dot_product(weight, strength) + reference_stress_precision() * reference_log_stress)
          / total, total]';
}

/**
 * ln S_0 with which the dashpot spends as long on the whole path strain as at the reference point,
 *
 *   sum of t_k exp[n (ln S_0 - strength_k)] = sum of t_k.
 *
 * Where strain is read under an imposed stress, errors of its level last, and this time is what the
 * curve fixes best.
 *
 * @param time_spent t near each pin, s
 */
real reference_stress_of_time(vector strength, data vector time_spent, real stress_exponent) {
  return (log(sum(time_spent)) - log_sum_exp(log(time_spent) - stress_exponent * strength))
         / stress_exponent;
}
