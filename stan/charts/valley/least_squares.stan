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

/** Columns less their weighted means, which ln S_0 takes up unless it is given. */
matrix centred(matrix values, vector weight, data int stress_given) {
  if (stress_given) {
    return values;
  }
  return values - rep_vector(1, rows(values)) * (weight' * values / sum(weight));
}

/** Weighted sums of products of two columns, both centred(). */
matrix centred_products(matrix values, vector weight, data int stress_given) {
  matrix[rows(values), cols(values)] own = centred(values, weight, stress_given);
  return own' * (rep_matrix(weight, cols(values)) .* own);
}

/**
 * A step of a real number behind a bounded parameter, brought below a length of 1.
 *
 * Full steps overshoot where the curve softens within a few percent of strain, and what they end at
 * is then as good as random in the other coordinates.
 */
real limited_step(real step) { return step / hypot(1, step); }

#include charts/valley/middle_grain_strain.stan
#include charts/valley/fabric_step.stan

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
    vector[7] there;
    real step;
    if (k > 1) {
      amplitude = limited_amplitude(amplitude, u_2, strain, bounds);
    }
    there = fabric_step([u_2, amplitude]', rest, strain, weight, stress_given, bounds);
    factor_precision = there[5];
    step = there[7] / factor_precision;
    misfit = there[6] - factor_precision * square(step);
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
