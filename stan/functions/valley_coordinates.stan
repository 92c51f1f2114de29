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
 *  - for every value of the other coordinates, (ln S_0, u_F, t) get the least-squares solution of
 *    (*) at a few strains, the pins, plus a whitened remainder w: solution + L^-T w, where
 *    L L' is the Gauss-Newton matrix of that least-squares problem.
 *
 * The solution is reached by Gauss-Newton steps along a straight path from a reference point (the
 * posterior mode). It has to be smooth in the other coordinates, not exact: whatever it is, the
 * map (other coordinates, w) -> parameters is one to one with the Jacobian given here, and the
 * posterior is exactly that of the plain coordinates. Only the speed depends on the pins.
 *
 * Pins are rows of a matrix with the columns
 *   1 strain, 2 slope d stress/d strain (Pa), 3 strain rate (1/s),
 *   4 ln(rate of the first segment/rate), 5 weight (inverse variance of ln stress).
 */

/** Slope a of the valley's axis in the plane of the two critical strains. */
real valley_slope() {
  return 1.5;
}

/** Gauss-Newton steps along the path from the reference point. */
int n_valley_steps() {
  return 16;
}

/** Precision of ln S_0, and of each real number behind a bounded parameter, that keeps the
 * least-squares problem regular where the curve does not fix them. */
real reference_stress_precision() {
  return 1.0;
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
 * One Gauss-Newton step for (ln S_0, u_F, along).
 *
 * @param solved current (ln S_0, u_F, along)
 * @param across rotated coordinate of the critical strains
 * @param exponent_ratio p/n
 * @param grain_size_ratio d_ss/d_0
 * @param log_strength left-hand side of (*) at the pins
 * @param reference_log_stress ln S_0 of the reference point
 * @param lower_bound, upper_bound of (epsilon_c1, epsilon_c2, F_ss)
 * @return first column: the step; the others: the Gauss-Newton matrix
 */
matrix softening_step(vector solved, real across, real exponent_ratio, real grain_size_ratio,
                      vector log_strength, data matrix pin, data real reference_log_stress,
                      data vector lower_bound, data vector upper_bound) {
  real a = valley_slope();
  real shrink = 1 / (1 + square(a));
  vector[2] u = critical_strains_from_rotated(across, solved[3]);
  vector[3] s = inv_logit([u[1], u[2], solved[2]]');
  vector[3] value = lower_bound + (upper_bound - lower_bound) .* s;
  vector[3] slope = (upper_bound - lower_bound) .* s .* (1 - s);
  vector[3] pull = bounded_parameter_precision() * 2 * (1 - 2 * s);
  vector[rows(pin)] strain = col(pin, 1);
  vector[rows(pin)] weight = col(pin, 5);
  vector[rows(pin)] grain_decay = exp(-strain / value[1]);
  vector[rows(pin)] fabric_decay = exp(-strain / value[2]);
  vector[rows(pin)] grain_size = grain_size_ratio + (1 - grain_size_ratio) * grain_decay;
  vector[rows(pin)] fabric = value[3] + (1 - value[3]) * fabric_decay;
  vector[rows(pin)] residual = log_strength - solved[1] - log(fabric)
                               - exponent_ratio * log(grain_size);
  vector[rows(pin)] by_fabric = slope[3] * (1 - fabric_decay) ./ fabric;
  vector[rows(pin)] by_along
    = shrink * slope[2] * (1 - value[3]) / square(value[2]) * (strain .* fabric_decay ./ fabric)
      + a * shrink * slope[1] * exponent_ratio * (1 - grain_size_ratio) / square(value[1])
        * (strain .* grain_decay ./ grain_size);
  vector[rows(pin)] weighted_fabric = weight .* by_fabric;
  vector[rows(pin)] weighted_along = weight .* by_along;
  matrix[3, 3] curvature;
  vector[3] gradient;
  matrix[3, 4] step;
  curvature[1, 1] = sum(weight) + reference_stress_precision();
  curvature[1, 2] = sum(weighted_fabric);
  curvature[1, 3] = sum(weighted_along);
  curvature[2, 2] = dot_product(weighted_fabric, by_fabric) + bounded_parameter_precision();
  curvature[2, 3] = dot_product(weighted_fabric, by_along);
  curvature[3, 3] = dot_product(weighted_along, by_along)
                    + bounded_parameter_precision() * shrink;
  curvature[2, 1] = curvature[1, 2];
  curvature[3, 1] = curvature[1, 3];
  curvature[3, 2] = curvature[2, 3];
  gradient[1] = dot_product(weight, residual)
                - reference_stress_precision() * (solved[1] - reference_log_stress);
  gradient[2] = dot_product(weighted_fabric, residual) + pull[3];
  gradient[3] = dot_product(weighted_along, residual) + shrink * (a * pull[1] + pull[2]);
  step[ : , 1] = mdivide_left_spd(curvature, gradient);
  step[ : , 2 : 4] = curvature;
  return step;
}

/**
 * (ln S_0, u_F, along) that solve (*) at the given other coordinates.
 *
 * @param reference (across, p/n, ln(d_ss/d_0), ln S_0, u_F, along) of the reference point
 * @param reference_log_strength left-hand side of (*) there
 * @return first column: the solution; the others: the Gauss-Newton matrix at the last step
 */
matrix solve_softening(real across, real exponent_ratio, real log_grain_size_ratio,
                       vector log_strength, data vector reference,
                       data vector reference_log_strength, data matrix pin,
                       data vector lower_bound, data vector upper_bound) {
  vector[3] solved = reference[4 : 6];
  matrix[3, 4] step;
  for (k in 1 : n_valley_steps()) {
    real f = k * 1.0 / n_valley_steps();
    step = softening_step(solved, reference[1] + f * (across - reference[1]),
                          reference[2] + f * (exponent_ratio - reference[2]),
                          exp(reference[3] + f * (log_grain_size_ratio - reference[3])),
                          reference_log_strength + f * (log_strength - reference_log_strength),
                          pin, reference[4], lower_bound, upper_bound);
    solved += step[ : , 1];
  }
  step[ : , 1] = solved;
  return step;
}

/**
 * Plain coordinate of a bounded parameter, linear in the parameter where `linear_from` says so.
 *
 * Data can push a parameter against its lower bound (the Kelvin modulus of ice). There the plain
 * coordinate is logarithmic and runs away; ln(linear_from log1p(exp x)) is linear above.
 *
 * @return plain coordinate, and ln of its derivative
 */
vector plain_from_softened(real x, data real linear_from) {
  if (linear_from == 0) {
    return [x, 0]';
  }
  return [log(linear_from * log1p_exp(x)), log_inv_logit(x) - log(log1p_exp(x))]';
}

/**
 * Physical parameters at given valley coordinates.
 *
 * The coordinates stand in the order of the plain ones; those of ln S_0, F_ss and epsilon_c2 are
 * the whitened remainder w, that of epsilon_c1 is the rotated coordinate across.
 *
 * @param coordinate_of position of each parameter among the coordinates, 0 where fixed
 * @param reference_coordinate plain coordinates of the reference point
 * @param reference, reference_log_strength see solve_softening()
 * @param linear_from see plain_from_softened()
 * @return as parameters_from_plain()
 */
vector parameters_from_valley(vector coordinate, data array[] int parameter_of_coordinate,
                              data array[] int coordinate_of, data vector shift,
                              data vector scale, data vector lower_bound,
                              data vector upper_bound, data vector fixed_value,
                              data int replaced_parameter, data real strain_rate,
                              data real initial_grain_size, data real temperature,
                              data vector knot_time_step, data vector knot_stress,
                              data array[] int pin_knot, data matrix pin,
                              data vector reference_coordinate, data vector reference,
                              data vector reference_log_strength, data vector linear_from) {
  int n = num_elements(coordinate);
  array[3] int bounded = {coordinate_of[10], coordinate_of[11], coordinate_of[9]};
  array[3] int whitened = {coordinate_of[replaced_parameter], coordinate_of[9],
                           coordinate_of[11]};
  vector[n] plain = reference_coordinate;
  vector[n_parameters()] parameter = fixed_value;
  matrix[3, 4] solution;
  matrix[3, 3] cholesky;
  vector[3] solved;
  real across = reference[1] + coordinate[coordinate_of[10]];
  real log_jacobian = 0;
  for (i in 1 : n) {
    int k = parameter_of_coordinate[i];
    if (k != 9 && k != 10 && k != 11 && k != replaced_parameter) {
      vector[2] softened = plain_from_softened(
        (linear_from[i] > 0 ? log(expm1(exp(reference_coordinate[i]) / linear_from[i]))
         : reference_coordinate[i]) + coordinate[i], linear_from[i]);
      plain[i] = softened[1];
      log_jacobian += softened[2];
      parameter[k] = bounded_from_real(plain[i], shift[i], scale[i], lower_bound[i],
                                       upper_bound[i]);
    }
  }
  solution = solve_softening(across, parameter[5] / parameter[4],
                             log(parameter[8] / initial_grain_size),
                             log_strength_at_pins(knot_time_step, knot_stress, pin_knot, pin,
                                                  parameter[1], parameter[2], parameter[3],
                                                  parameter[4]),
                             reference, reference_log_strength, pin, lower_bound[bounded],
                             upper_bound[bounded]);
  cholesky = cholesky_decompose(solution[ : , 2 : 4]);
  solved = solution[ : , 1]
           + mdivide_right_tri_low(coordinate[whitened]', cholesky)';
  plain[coordinate_of[replaced_parameter]] = (solved[1]
                                              - shift[coordinate_of[replaced_parameter]])
                                             / scale[coordinate_of[replaced_parameter]];
  plain[coordinate_of[9]] = solved[2];
  plain[{coordinate_of[10], coordinate_of[11]}]
    = critical_strains_from_rotated(across, solved[3]);
  log_jacobian += -sum(log(diagonal(cholesky))) - log1p(square(valley_slope()))
                  - log(scale[coordinate_of[replaced_parameter]]);
  {
    vector[n_parameters() + 1] mapped = parameters_from_plain(plain, parameter_of_coordinate,
      shift, scale, lower_bound, upper_bound, fixed_value, replaced_parameter, strain_rate,
      initial_grain_size, temperature);
    mapped[n_parameters() + 1] += log_jacobian;
    return mapped;
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
