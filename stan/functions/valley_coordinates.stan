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
 * its split between grain size (d_ss, epsilon_c1) and fabric (F_ss, epsilon_c2). The posterior is
 * a thin, L-shaped valley in (epsilon_c1, epsilon_c2). The map here follows it:
 *
 *  - the two critical strains, as real numbers u_1 and u_2, are rotated to a coordinate across,
 *    b = u_1 - a u_2, and one along, t = a u_1 + u_2, with a = valley_slope();
 *  - t is centred and scaled, as a function of the other coordinates, by the least-squares
 *    solution of (*) at a few strains, the pins, for (ln S_0, u_F, t) together;
 *  - u_F is centred and scaled by the least-squares solution for (ln S_0, u_F) at this t, such
 *    that F_ss is nearly linear in what remains;
 *  - ln S_0 is centred and scaled by the least-squares solution at this t and u_F, which is
 *    linear.
 *
 * Solving in turn, rather than whitening all three at once, keeps to the valley where it bends:
 * far from the solution in t, (u_F, ln S_0) still fit the curve.
 *
 * The widths of these three, of the Maxwell modulus and of the Kelvin viscosity grow with the
 * stress noise s as far as the data, not the prior, set them; few points leave s, and with it the
 * widths, uncertain by a factor, which would be a funnel.
 *
 * The solutions are reached by Gauss-Newton steps along a straight path from a reference point
 * (the posterior mode). They have to be smooth in the other coordinates, not exact: whatever they
 * are, the map is triangular and one to one with the Jacobian given here, and the posterior is
 * exactly that of the plain coordinates. Only the speed depends on the pins.
 *
 * Pins are rows of a matrix with the columns
 *   1 strain, 2 slope d stress/d strain (Pa), 3 strain rate (1/s),
 *   4 ln(rate of the first segment/rate), 5 weight (inverse variance of ln stress).
 */

/** Slope a of the valley's axis in the plane of the two critical strains. */
real valley_slope() {
  return 1.0;
}

/** Gauss-Newton steps along the path from the reference point. */
int n_valley_steps() {
  return 16;
}

/** Gauss-Newton steps along the path from the solution in t to the t asked for. */
int n_fabric_steps() {
  return 6;
}

/** Share of the pins' weight with which t is solved.
 *
 * For some grain-size softenings the least-squares problem has two solutions, one on each arm of
 * the valley. At less than full weight the solution moves between them instead of jumping.
 */
real softened_share() {
  return 0.25;
}

/** Precision of ln S_0, and of each real number behind a bounded parameter, that keeps the
 * least-squares problem regular where the curve does not fix them.
 *
 * @param given 1: ln S_0 is given, with a precision well above that of any curve
 */
real reference_stress_precision(data int given) {
  return given ? 1e9 : 1.0;
}

real bounded_parameter_precision() {
  return 0.5;
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

/** u_1 and u_2, the real numbers behind the critical strains, from the rotated coordinates. */
vector critical_strains_from_rotated(real across, real along) {
  real a = valley_slope();
  return [across + a * along, along - a * across]' / (1 + square(a));
}

/**
 * Softening ln F + (p/n) ln(d/d_0) at the pins, and its slopes.
 *
 * @param u real numbers behind (epsilon_c1, epsilon_c2, F_ss)
 * @param exponent_ratio p/n
 * @param grain_size_ratio d_ss/d_0
 * @param strain of the pins
 * @param lower_bound, upper_bound of (epsilon_c1, epsilon_c2, F_ss)
 * @return columns: the softening, its derivatives by u_1, u_2 and u_F
 */
matrix softening_at_pins(vector u, real exponent_ratio, real grain_size_ratio,
                         data vector strain, data vector lower_bound,
                         data vector upper_bound) {
  vector[3] s = inv_logit(u);
  vector[3] value = lower_bound + (upper_bound - lower_bound) .* s;
  vector[3] slope = (upper_bound - lower_bound) .* s .* (1 - s);
  vector[rows(strain)] grain_decay = exp(-strain / value[1]);
  vector[rows(strain)] fabric_decay = exp(-strain / value[2]);
  vector[rows(strain)] grain_size = grain_size_ratio + (1 - grain_size_ratio) * grain_decay;
  vector[rows(strain)] fabric = value[3] + (1 - value[3]) * fabric_decay;
  matrix[rows(strain), 4] softening;
  softening[ : , 1] = log(fabric) + exponent_ratio * log(grain_size);
  softening[ : , 2] = slope[1] * exponent_ratio * (1 - grain_size_ratio) / square(value[1])
                      * (strain .* grain_decay ./ grain_size);
  softening[ : , 3] = slope[2] * (1 - value[3]) / square(value[2])
                      * (strain .* fabric_decay ./ fabric);
  softening[ : , 4] = slope[3] * (1 - fabric_decay) ./ fabric;
  return softening;
}

/**
 * Slope and precision of the ln prior that keeps real numbers behind bounded parameters regular:
 * a weak one, or where a parameter is partially pooled its own.
 *
 * @param pooled 1 where u is normal with `centre` and `spread`, which have no effect elsewhere
 * @return columns: slope, precision
 */
matrix regularisation(vector u, data array[] int pooled, vector centre, vector spread) {
  matrix[num_elements(u), 2] regular;
  for (k in 1 : num_elements(u)) {
    if (pooled[k]) {
      regular[k, 2] = 1 / square(spread[k]);
      regular[k, 1] = (centre[k] - u[k]) * regular[k, 2];
    } else {
      regular[k, 2] = bounded_parameter_precision();
      regular[k, 1] = 2 * bounded_parameter_precision() * (1 - 2 * inv_logit(u[k]));
    }
  }
  return regular;
}

/**
 * One Gauss-Newton step for (ln S_0, u_F, along).
 *
 * @param solved current (ln S_0, u_F, along)
 * @param across rotated coordinate of the critical strains
 * @param exponent_ratio, grain_size_ratio see softening_at_pins()
 * @param log_strength left-hand side of (*) at the pins
 * @param strain, weight of the pins
 * @param noise_variance over that of the reference point, for which the weights are
 * @param log_stress value of ln S_0 that keeps the problem regular
 * @param stress_given 1: ln S_0 has that value
 * @param lower_bound, upper_bound of (epsilon_c1, epsilon_c2, F_ss)
 * @param pooled, centre, spread of (u_1, u_2, u_F): see regularisation()
 * @return first column: the step; the others: the Gauss-Newton matrix
 */
matrix softening_step(vector solved, real across, real exponent_ratio, real grain_size_ratio,
                      vector log_strength, data vector strain, data vector weight,
                      real noise_variance, real log_stress, data int stress_given,
                      data vector lower_bound, data vector upper_bound,
                      data array[] int pooled, vector centre, vector spread) {
  vector[3] u = append_row(critical_strains_from_rotated(across, solved[3]), solved[2]);
  matrix[rows(strain), 4] softening = softening_at_pins(u, exponent_ratio, grain_size_ratio,
                                                        strain, lower_bound, upper_bound);
  vector[2] by_along = [valley_slope(), 1]' / (1 + square(valley_slope())); // du_1, du_2
  matrix[3, 2] regular = regularisation(u, pooled, centre, spread);
  matrix[rows(strain), 3] slope;
  matrix[3, 3] curvature;
  vector[3] gradient;
  slope[ : , 1] = rep_vector(1, rows(strain));
  slope[ : , 2] = softening[ : , 4];
  slope[ : , 3] = softening[ : , 2 : 3] * by_along;
  curvature = crossprod(diag_pre_multiply(sqrt(weight), slope)) / noise_variance;
  curvature[1, 1] += reference_stress_precision(stress_given);
  curvature[2, 2] += regular[3, 2];
  curvature[3, 3] += dot_product(regular[1 : 2, 2], square(by_along));
  gradient = slope' * (weight .* (log_strength - solved[1] - softening[ : , 1]))
             / noise_variance;
  gradient[1] -= reference_stress_precision(stress_given) * (solved[1] - log_stress);
  gradient[2] += regular[3, 1];
  gradient[3] += dot_product(regular[1 : 2, 1], by_along);
  return append_col(mdivide_left_spd(curvature, gradient), curvature);
}

/**
 * (ln S_0, u_F, along) that solve (*) at the given other coordinates, at softened_share().
 *
 * @param reference (across, p/n, ln(d_ss/d_0), ln S_0, u_F, along) of the reference point
 * @param reference_log_strength left-hand side of (*) there
 * @param log_stress and the others as for softening_step()
 * @return first column: the solution; the others: the Gauss-Newton matrix there, at full weight
 */
matrix solve_softening(real across, real exponent_ratio, real log_grain_size_ratio,
                       vector log_strength, data vector reference,
                       data vector reference_log_strength, data vector strain,
                       data vector weight, real noise_variance, real log_stress,
                       data int stress_given, data vector lower_bound,
                       data vector upper_bound, data array[] int pooled, vector centre,
                       vector spread) {
  vector[3] solved = reference[4 : 6];
  matrix[3, 4] step;
  for (k in 1 : n_valley_steps()) {
    real f = k * 1.0 / n_valley_steps();
    step = softening_step(solved, reference[1] + f * (across - reference[1]),
                          reference[2] + f * (exponent_ratio - reference[2]),
                          exp(reference[3] + f * (log_grain_size_ratio - reference[3])),
                          reference_log_strength + f * (log_strength - reference_log_strength),
                          strain, softened_share() * weight, noise_variance,
                          reference[4] + f * (log_stress - reference[4]), stress_given,
                          lower_bound, upper_bound, pooled, centre, spread);
    solved += step[ : , 1];
  }
  step = softening_step(solved, across, exponent_ratio, exp(log_grain_size_ratio),
                        log_strength, strain, weight, noise_variance, log_stress,
                        stress_given, lower_bound, upper_bound, pooled, centre, spread);
  step[ : , 1] = solved;
  return step;
}

/**
 * ln S_0 that solves (*) at given microstructure, which is linear in it, and its precision.
 *
 * @param softening ln F + (p/n) ln(d/d_0) at the pins
 */
vector solve_reference_stress(vector softening, vector log_strength, data vector weight,
                              real noise_variance, real log_stress,
                              data int stress_given) {
  real precision = sum(weight) / noise_variance
                   + reference_stress_precision(stress_given);
  return [(dot_product(weight, log_strength - softening) / noise_variance
           + reference_stress_precision(stress_given) * log_stress) / precision,
          precision]';
}

/**
 * u_F that solves (*), together with ln S_0, at a given position along the valley.
 *
 * The path starts at a solution for all three and follows the position.
 *
 * @param fabric u_F at the start of the path
 * @param start, along position along the valley at the start and at the end of the path
 * @return u_F and its precision, ln S_0 eliminated
 */
vector solve_fabric(real fabric, real start, real along, real across, real exponent_ratio,
                    real grain_size_ratio, vector log_strength, data vector strain,
                    data vector weight, real noise_variance, real log_stress,
                    data int stress_given, data vector lower_bound,
                    data vector upper_bound, data array[] int pooled, vector centre,
                    vector spread) {
  real solved = fabric;
  real precision;
  for (k in 1 : n_fabric_steps()) {
    real f = k * 1.0 / n_fabric_steps();
    vector[3] u = append_row(critical_strains_from_rotated(across,
                                                           start + f * (along - start)),
                             solved);
    matrix[rows(strain), 4] softening = softening_at_pins(u, exponent_ratio, grain_size_ratio,
                                                          strain, lower_bound, upper_bound);
    vector[2] stress = solve_reference_stress(softening[ : , 1], log_strength, weight,
                                              noise_variance, log_stress, stress_given);
    row_vector[2] regular = regularisation(u, pooled, centre, spread)[3];
    vector[rows(strain)] weighted = weight .* softening[ : , 4] / noise_variance;
    precision = dot_product(weighted, softening[ : , 4]) - square(sum(weighted)) / stress[2]
                + regular[2];
    solved += (dot_product(weighted, log_strength - softening[ : , 1] - stress[1])
               + regular[1]) / precision;
  }
  return [solved, precision]';
}

/**
 * Real number u behind a bounded parameter, from a remainder that is whitened in the parameter.
 *
 * Data fix the parameter, not u: where it is fixed to a small part of its range, but close to a
 * bound, u would have a long tail. The parameter's place in its range, f = inv_logit(u), is
 * therefore linear in the remainder as long as f is further from 0 and 1 than its standard
 * deviation c, and approaches them exponentially:
 *
 *   f = c [log1p_exp(a) - log1p_exp(a - 1/c)],  a = a(solution) + remainder.
 *
 * @param solved solution for u
 * @param precision of u at the solution
 * @return u, then ln |du/d(remainder)|
 */
vector bounded_from_remainder(real solved, real precision, real remainder) {
  real place = inv_logit(solved);
  real c = place * (1 - place) / sqrt(precision);
  real a = place / c + log1m_exp(-place / c) - log1m_exp(-(1 - place) / c) + remainder;
  real log_place = log(log1p_exp(a) - log1p_exp(a - 1 / c)); // ln(f/c)
  real log_rest = log(log1p_exp(1 / c - a) - log1p_exp(-a)); // ln((1 - f)/c)
  return [log_place - log_rest,
          log_diff_exp(log_inv_logit(a), log_inv_logit(a - 1 / c)) - log_place - log_rest
          - log(c)]';
}

/**
 * (ln S_0, u_F, along) from their whitened remainders, in turn.
 *
 * @param remainder (of ln S_0, of u_F, of along) in standard deviations
 * @param stress_given 1: ln S_0 is log_stress, and its remainder has no effect
 * @param log_stress and the others as for softening_step()
 * @return (ln S_0, u_F, along), then ln |d(these)/d(remainder)|
 */
vector softening_from_remainder(vector remainder, real across, real exponent_ratio,
                                real log_grain_size_ratio, vector log_strength,
                                data vector reference, data vector reference_log_strength,
                                data vector strain, data vector weight,
                                real noise_variance, data int stress_given, real log_stress,
                                data vector lower_bound, data vector upper_bound,
                                data array[] int pooled, vector centre, vector spread) {
  matrix[3, 4] joint = solve_softening(across, exponent_ratio, log_grain_size_ratio,
                                       log_strength, reference, reference_log_strength, strain,
                                       weight, noise_variance, log_stress, stress_given,
                                       lower_bound, upper_bound, pooled, centre, spread);
  real along_scale = cholesky_decompose(joint[ : , 2 : 4])[3, 3];
  real along = joint[3, 1] + remainder[3] / along_scale;
  vector[2] fabric = solve_fabric(joint[2, 1], joint[3, 1], along, across, exponent_ratio,
                                  exp(log_grain_size_ratio), log_strength, strain, weight,
                                  noise_variance, log_stress, stress_given, lower_bound,
                                  upper_bound, pooled, centre, spread);
  vector[2] fabric_factor = bounded_from_remainder(fabric[1], fabric[2], remainder[2]);
  vector[3] u = append_row(critical_strains_from_rotated(across, along), fabric_factor[1]);
  vector[2] stress;
  if (stress_given) {
    return [log_stress, fabric_factor[1], along, -log(along_scale) + fabric_factor[2]]';
  }
  stress = solve_reference_stress(softening_at_pins(u, exponent_ratio, exp(log_grain_size_ratio),
                                                    strain, lower_bound, upper_bound)[ : , 1],
                                  log_strength, weight, noise_variance, log_stress,
                                  stress_given);
  return [stress[1] + remainder[1] / sqrt(stress[2]), fabric_factor[1], along,
          -log(along_scale) + fabric_factor[2] - 0.5 * log(stress[2])]';
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
 * The coordinates stand in the order of the plain ones; those of ln S_0, F_ss and epsilon_c2 are
 * the whitened remainders, that of epsilon_c1 is the rotated coordinate across.
 *
 * A test that shares parameters with another has coordinates for its own ones only. Where the
 * flow law is complete without, ln S_0 follows from it and has no coordinate.
 *
 * Partially pooled parameters have a normal density on the real line. It takes part in the
 * least-squares problem for those that are solved, and in pooled_from_reference() for the others,
 * so that they are centred and scaled by whatever fixes them, curve or pooling.
 *
 * @param coordinate_of position of each parameter among the coordinates, 0 where it has none
 * @param fixed_value parameters that have no coordinate; other entries are overwritten
 * @param replaced_parameter 6 or 7; 0: ln S_0 is given
 * @param reference_coordinate plain coordinates of the reference point
 * @param reference, reference_log_strength see solve_softening()
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
  vector[3] remainder = [0, coordinate[coordinate_of[9]], coordinate[coordinate_of[11]]]';
  real log_stress = reference[4];
  vector[4] solved;
  real across;
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
      if (pooled[i]) {
        vector[2] placed = pooled_from_reference(coordinate[i], reference_coordinate[i],
                                                 centre[i], spread[i]);
        plain[i] = placed[1];
        log_jacobian += placed[2];
      } else {
        vector[2] straightened = plain_from_straightened(
          coordinate[i] * exp(noise_exponent[i] * log_noise_ratio), reference_coordinate[i],
          linear_from[i]);
        plain[i] = straightened[1];
        log_jacobian += straightened[2] + noise_exponent[i] * log_noise_ratio;
      }
      parameter[k] = bounded_from_real(plain[i], shift[i], scale[i], lower_bound[i],
                                       upper_bound[i]);
    }
  }
  if (pooled[bounded[1]] && pooled[bounded[2]]) {
    real a = valley_slope();
    vector[2] placed = pooled_from_reference(coordinate[bounded[1]], reference[1],
      centre[bounded[1]] - a * centre[bounded[2]],
      sqrt(square(spread[bounded[1]]) + square(a * spread[bounded[2]])));
    across = placed[1];
    log_jacobian += placed[2];
  } else {
    across = reference[1] + coordinate[bounded[1]];
  }
  if (stress_given) {
    log_stress = log_reference_stress(strain_rate, initial_grain_size, temperature, parameter[4],
                                      parameter[5], parameter[6], parameter[7]);
  } else {
    remainder[1] = coordinate[coordinate_of[replaced_parameter]];
  }
  solved = softening_from_remainder(remainder, across, parameter[5] / parameter[4],
    log(parameter[8] / initial_grain_size),
    log_strength_at_pins(knot_time_step, knot_stress, pin_knot, pin, parameter[1],
                         parameter[2], parameter[3], parameter[4]),
    reference, reference_log_strength, col(pin, 1), col(pin, 5), exp(2 * log_noise_ratio),
    stress_given, log_stress, lower_bound[bounded], upper_bound[bounded], pooled[bounded],
    centre[bounded], spread[bounded]);
  plain[coordinate_of[9]] = solved[2];
  plain[{coordinate_of[10], coordinate_of[11]}]
    = critical_strains_from_rotated(across, solved[3]);
  log_jacobian += solved[4] - log1p(square(valley_slope()));
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
 * The reference point in the form that solve_softening() wants.
 *
 * @param reference_parameter physical parameters at the reference point
 * @return (across, p/n, ln(d_ss/d_0), ln S_0, u_F, along)
 */
vector valley_reference(data vector reference_coordinate, data array[] int coordinate_of,
                        data vector shift, data vector scale, data vector reference_parameter,
                        data int replaced_parameter, data real initial_grain_size) {
  int i = coordinate_of[replaced_parameter];
  real u1 = reference_coordinate[coordinate_of[10]];
  real u2 = reference_coordinate[coordinate_of[11]];
  return [u1 - valley_slope() * u2, reference_parameter[5] / reference_parameter[4],
          log(reference_parameter[8] / initial_grain_size),
          shift[i] + scale[i] * reference_coordinate[i],
          reference_coordinate[coordinate_of[9]], valley_slope() * u1 + u2]';
}
