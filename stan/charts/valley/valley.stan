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
 * Before them comes d_ss: where grain size does all the softening, its density ends at an edge that
 * depends on p/n, and its coordinate is stretched there.
 *
 * In a joint fit ln S_0 can follow from shared parameters and is then given. A quantile function
 * passes from one arm of the valley to another as far as the density does, without branches between
 * which it would have to jump.
 *
 * The widths of these four, of the Maxwell modulus and of the Kelvin viscosity grow with the
 * noise s as far as the data, not the prior, set them; few points leave s, and with it the
 * widths, uncertain by a factor, which would be a funnel.
 *
 * Solutions are reached by Gauss-Newton steps from a reference point (the posterior mode), and
 * densities are known at a few places only. Both have to be smooth in the other coordinates, not
 * exact: whatever they are, the map is triangular and one to one with the Jacobian given here, and
 * the posterior is exactly that of the plain coordinates. Only the speed depends on the pins.
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

/**
 * u_1 at a conditional quantile, and a solution for the fabric there.
 *
 * Along u_1 the misfit is that of the solution for (ln S_0, u_2, amplitude), with the amplitude
 * brought within its bounds, and their volume follows from its Gauss-Newton matrix (Laplace's
 * method).
 *
 * @param log_odds of the quantile
 * @param middle u_1 in the middle of the places, and their standard deviation
 * @return u_1, ln of its derivative by the log odds, u_2 and amplitude of the solution
 */
vector grain_strain_at_quantile(real log_odds, vector middle, vector asked,
                                data vector reference, data vector strain, vector weight,
                                data int stress_given, data matrix bounds) {
  int n = n_places();
  vector[rows(strain)] softened = softened_share() * weight;
  vector[2] solved = [reference[2], reference[3]]';
  vector[2] at_middle;
  real range = bounds[3, 2] - bounds[3, 1];
  matrix[2, 2 * n + 1] fabric;
  vector[2 * n + 1] log_density;
  vector[2] place;
  vector[2] away;
  vector[rows(strain)] rest;
  for (k in 1 : n_valley_steps()) {
    real f = k * 1.0 / n_valley_steps();
    rest = col(rest_of_strength(reference[1] + f * (middle[1] - reference[1]),
                                asked_along_path(f, asked, reference), strain, bounds), 1);
    solved = head(fabric_step(solved, rest, strain, softened, stress_given, bounds), 2);
  }
  at_middle = solved;
  for (sign in {-1, 1}) {
    solved = at_middle;
    for (k in (sign < 0 ? 0 : 1) : n) {
      int i = n + 1 + sign * k;
      vector[6] step;
      real determinant;
      away = offset_at(sign * k, middle[2]);
      rest = col(rest_of_strength(middle[1] + away[1], asked, strain, bounds), 1);
      solved = head(fabric_step(solved, rest, strain, softened, stress_given, bounds), 2);
      step = fabric_step(solved, rest, strain, weight, stress_given, bounds);
      determinant = step[3] * step[5] - square(step[4]);
      fabric[ : , i] = solved;
      log_density[i] = log_fit(step[6] + square(distance_beyond(
                                 (1 - solved[2] - bounds[3, 1]) / range,
                                 sqrt(step[3] / determinant) / range)))
                       - 0.5 * log(determinant) + log_density_of_bounded(solved[1])
                       + log_density_of_bounded(middle[1] + away[1]) + away[2];
    }
  }
  place = place_of_quantile(log_odds, with_prior(log_density, middle[1], middle[2]));
  away = offset_at(place[1], middle[2]);
  rest = col(rest_of_strength(middle[1] + away[1], asked, strain, bounds), 1);
  solved = fabric * interpolation_weights(place[1]);
  for (k in 1 : 2) {
    solved = head(fabric_step(solved, rest, strain, softened, stress_given, bounds), 2);
  }
  return append_row([middle[1] + away[1], away[2] + place[2]]', solved);
}

/**
 * u_2 at a conditional quantile, and what the data ask of F_ss there.
 *
 * Along u_2 the misfit is that of the solution for (ln S_0, F_ss); where F_ss would leave its
 * bounds, the misfit at the bound counts.
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
  int n = n_places();
  real range = bounds[3, 2] - bounds[3, 1];
  vector[2 * n + 1] total;
  vector[2 * n + 1] log_density;
  vector[2] place;
  vector[2] away;
  vector[4] factor;
  for (sign in {-1, 1}) {
    real total_before = total_softening;
    for (k in (sign < 0 ? 0 : 1) : n) {
      int i = n + 1 + sign * k;
      real c;
      away = offset_at(sign * k, middle[2]);
      factor = solve_fabric_factor(total_before, middle[1] + away[1], rest, 1, strain, weight,
                                   stress_given, bounds);
      c = 1 / (range * sqrt(factor[2]));
      total_before = factor[4];
      total[i] = factor[4];
      log_density[i] = log_fit(factor[3]
                               + square(distance_beyond((factor[1] - bounds[3, 1]) / range, c)))
                       + log(c) + log_density_of_bounded(middle[1] + away[1]) + away[2];
    }
  }
  place = place_of_quantile(log_odds, with_prior(log_density, middle[1], middle[2]));
  away = offset_at(place[1], middle[2]);
  factor = solve_fabric_factor(dot_product(total, interpolation_weights(place[1])),
                               middle[1] + away[1], rest, 2, strain, weight, stress_given,
                               bounds);
  return [middle[1] + away[1], away[2] + place[2], (factor[1] - bounds[3, 1]) / range,
          1 / (range * sqrt(factor[2]))]';
}

/**
 * (ln S_0, u_F, u_1, u_2) from their coordinates.
 *
 * @param coordinate in this order: remainders of ln S_0 and F_ss, log odds of the quantiles of u_1
 *   and u_2
 * @param asked, reference see charts/valley/least_squares.stan
 * @param pin, bounds see charts/valley/pins.stan
 * @param precision of the noise here over that at the reference point
 * @param stress_given 1: ln S_0 is given, its remainder and the one returned have no effect
 * @return (ln S_0, u_F, u_1, u_2), then ln |d(these)/d(coordinate)|
 */
vector softening_from_coordinates(vector coordinate, vector asked, data vector reference,
                                  data matrix pin, real precision, data int stress_given,
                                  data matrix bounds) {
  vector[rows(pin)] weight = precision * col(pin, 5);
  vector[rows(pin)] fine_weight = precision * col(pin, 6);
  vector[2] middle = middle_grain_strain(asked, reference,
    -centred(col(pin, 1), weight, stress_given) / max(col(pin, 1)), col(pin, 1), weight,
    stress_given, bounds);
  vector[4] grain = grain_strain_at_quantile(coordinate[3], middle, asked, reference,
                                             col(pin, 1), weight, stress_given, bounds);
  vector[rows(pin)] rest = col(rest_of_strength(grain[1], asked, col(pin, 1), bounds), 1);
  vector[6] step = fabric_step(grain[3 : 4], rest, col(pin, 1), fine_weight, stress_given,
                               bounds);
  vector[4] fabric = fabric_strain_at_quantile(coordinate[4],
    [grain[3], 1 / sqrt(step[3] - square(step[4]) / step[5])]',
    -fabric_softening(grain[3], grain[4], col(pin, 1), bounds)[rows(pin), 1], rest, col(pin, 1),
    fine_weight, stress_given, bounds);
  vector[2] factor = bounded_from_remainder(fabric[3], fabric[4], coordinate[2]);
  real log_jacobian = grain[2] + fabric[2] + factor[2];
  real log_stress = 0;
  if (!stress_given) {
    real amplitude = 1 - bounds[3, 1] - (bounds[3, 2] - bounds[3, 1]) * inv_logit(factor[1]);
    vector[2] stress = solve_reference_stress(
      rest - col(fabric_softening(fabric[1], amplitude, col(pin, 1), bounds), 1), fine_weight,
      reference[4]);
    log_stress = stress[1] + coordinate[1] / sqrt(stress[2]);
    log_jacobian -= 0.5 * log(stress[2]);
  }
  return [log_stress, factor[1], grain[1], fabric[1], log_jacobian]';
}

/**
 * Plain coordinate of a parameter, straightened: linear in the parameter or in its inverse.
 *
 * Data can push a parameter against its lower bound (the Kelvin modulus of ice). There the plain
 * coordinate is logarithmic and runs away; ln(c log1p_exp(x)) is linear in the parameter above c.
 * Of the Maxwell modulus they fix the inverse, to which elastic strain is proportional, and that
 * only together with what the Kelvin element adds (loading_compliance()).
 *
 * @param displacement from the reference point, in the straightened coordinate
 * @param reference plain coordinate of the reference point
 * @param linear_from c > 0: linear in exp(plain) above c; c < 0: linear in exp(-plain) above -c;
 *   0: plain
 * @return plain coordinate, and ln of its derivative by the displacement
 */
vector plain_from_straightened(real displacement, data real reference, data real linear_from) {
  real sign = linear_from > 0 ? 1 : -1;
  real c = sign * linear_from;
  real x;
  if (linear_from == 0) {
    return [reference + displacement, 0]';
  }
  x = log(expm1(exp(sign * reference) / c)) + sign * displacement;
  return [sign * log(c * log1p_exp(x)), log_inv_logit(x) - log(log1p_exp(x))]';
}

/** What parameters ask for at the pins: `asked` of charts/valley/least_squares.stan. */
vector asked_of_pins(vector parameter, data int stress_given, real log_stress,
                     data real initial_grain_size, data matrix knot, data matrix pin) {
  vector[rows(pin)] log_strength = log_strength_at_pins(knot, pin,
                                                        parameter[i_maxwell_modulus()]
                                                        / (1
                                                           + parameter[i_apparatus_compliance()]
                                                             * parameter[i_maxwell_modulus()]),
                                                        parameter[i_kelvin_modulus()],
                                                        parameter[i_kelvin_viscosity()],
                                                        parameter[i_stress_exponent()],
                                                        stress_reading_factor(parameter));
  return append_row([parameter[i_grain_size_exponent()] / parameter[i_stress_exponent()],
                     log(parameter[i_steady_state_grain_size()] / initial_grain_size)]',
                    stress_given ? log_strength - log_stress : log_strength);
}

/**
 * Compliance of a Kelvin element under a stress that has grown in proportion to time.
 *
 * It is that of its spring long after the Kelvin time, and that of its dashpot long before it.
 *
 * @return Kelvin strain over stress (1/Pa)
 */
real loading_compliance(real kelvin_modulus, real kelvin_viscosity, real time) {
  real x = time * kelvin_modulus / kelvin_viscosity;
  return (1 + expm1(-x) / x) / kelvin_modulus;
}

/**
 * What the Kelvin element takes over of the compliance in the elastic rise, so that a part of it is
 * left to the spring, whose modulus would else run away where that element is the softer one.
 *
 * @param compliance in units of a fiftieth of the spring's at the reference point
 */
real left_to_spring(real compliance) { return 45 - log1p_exp(45 - compliance); }

/** Softening of the dashpot, -ln F - (p/n) ln(d/d_0), after a path strain. */
real softening_after(real strain, vector parameter, real initial_grain_size) {
  real fabric = log_relative_microstructure(strain, 1 - parameter[i_steady_state_fabric_factor()],
                                            1 / parameter[i_critical_strain_fabric()]);
  real grain_size = log_relative_microstructure(strain,
    1 - parameter[i_steady_state_grain_size()] / initial_grain_size,
    1 / parameter[i_critical_strain_grain_size()]);
  return -fabric
         - parameter[i_grain_size_exponent()] / parameter[i_stress_exponent()] * grain_size;
}

/** Slope of the plain coordinate of d_ss where grain size does all the softening. */
real edge_slope() { return 0.25; }

/** Length of that stretch in the coordinate, and width of the bends at its ends. */
vector edge_shape() { return [4, 0.5]'; }

/** Softening of a curve from which on there is such an edge. */
real least_softening() { return 0.05; }

/** Share of the curve's softening at which that stretch starts. */
real edge_softening() { return 0.85; }

/**
 * Plain coordinate of d_ss, stretched where grain size does all the softening.
 *
 * The density of d_ss ends there, within a small part of its range: below, the dashpot would soften
 * by more than the curve does. Where the edge is depends on p/n.
 *
 * @param displaced plain coordinate without the stretch
 * @param exponent_ratio p/n
 * @param softening of the dashpot up to the last pin
 * @param quantity row of d_ss (charts/plain.stan), with a finite lower bound
 * @return plain coordinate, and ln of its derivative by the displacement
 */
vector grain_size_at_edge(real displaced, real exponent_ratio, data real softening,
                          data real initial_grain_size, data row_vector quantity) {
  real range = is_inf(quantity[i_upper()]) ? quantity[i_scale()]
               : quantity[i_upper()] - quantity[i_lower()];
  real edge = initial_grain_size * exp(-edge_softening() * softening / exponent_ratio);
  // A smooth floor: the bound may leave no room for an edge.
  real place = 0.003 * log1p_exp((edge - quantity[i_lower()]) / (0.003 * range));
  real b = edge_shape()[2];
  real from_edge = (displaced - log(place)) / b;
  real from_end = from_edge + edge_shape()[1] / b;
  return [displaced
          + (1 - edge_slope())
            * (edge_shape()[1] + b * (log1p_exp(from_edge) - log1p_exp(from_end))),
          log1m((1 - edge_slope()) * (inv_logit(from_end) - inv_logit(from_edge)))]';
}

/** Share of their own variance with which independent residuals count beside those that drift. */
real independent_weight() { return 0.1; }

/** ln of the noise of what changes slowly, over that of a reading. */
real log_drift_of(real correlated_share) {
  return 0.5 * log(correlated_share + independent_weight() * (1 - correlated_share));
}

/** Largest ln(s/s of the reference point) that widths follow: beyond, no solver follows them. */
real largest_log_ratio() { return 1.5; }

/**
 * What charts/valley/least_squares.stan wants to know of the reference point, with the compliance of
 * the Kelvin element in the elastic rise and the softening of the dashpot up to the last pin.
 *
 * @param parameter at the reference point
 * @param coordinate plain coordinates there, and the others as for plain_from_valley()
 */
vector valley_reference(data vector parameter, data vector coordinate, data array[] int place,
                        data int replaced_parameter, data vector conditions, data int noise,
                        data matrix knot, data matrix pin) {
  real log_stress = log_reference_stress_at(parameter, conditions[1], conditions[2],
                                            conditions[3]);
  return append_row([coordinate[place[i_critical_strain_grain_size()]],
                     coordinate[place[i_critical_strain_fabric()]],
                     1 - parameter[i_steady_state_fabric_factor()], log_stress,
                     log(parameter[noise]),
                     loading_compliance(parameter[i_kelvin_modulus()],
                                        parameter[i_kelvin_viscosity()], conditions[4]),
                     softening_after(pin[rows(pin), 1], parameter, conditions[2])]',
                    asked_of_pins(parameter, replaced_parameter == 0, log_stress, conditions[2],
                                  knot, pin));
}

/**
 * Plain coordinates of a test's own parameters at given valley coordinates.
 *
 * The coordinates stand in the order of the plain ones; those of ln S_0 and F_ss are remainders in
 * standard deviations, those of the critical strains the log odds of conditional quantiles. Where
 * the flow law is complete without them, ln S_0 follows from it and has no coordinate.
 *
 * @param given values of the parameters that are not the test's own; other entries have no effect
 * @param place of each parameter among the test's own ones, 0 where it is none of them
 * @param quantity a row for each of them (charts/plain.stan)
 * @param guide a row for each of them: plain coordinate of the reference point, linear_from (see
 *   plain_from_straightened()), power of the stress noise with which its width grows
 * @param replaced_parameter place of Q_M or beta; 0: ln S_0 is given
 * @param flow_stress where the plain coordinate is not that of S_0 but of the flow rate at a stress:
 *   this stress (Pa); else 0
 * @param conditions rate (1/s) that S_0 belongs to, d_0 (m), temperature (K), time (s) of the
 *   elastic rise, in which both springs give together
 * @param noise place of the noise that the widths follow
 * @param knot, pin see charts/valley/pins.stan
 * @param reference see valley_reference()
 * @return plain coordinates, then ln |d(these)/d(coordinate)|
 */
vector plain_from_valley(vector coordinate, vector given, data array[] int place,
                         data matrix quantity, data matrix guide, data int replaced_parameter,
                         data real flow_stress, data vector conditions, data int noise,
                         data matrix knot, data matrix pin, data vector reference) {
  array[3] int solved = place[{i_critical_strain_grain_size(), i_critical_strain_fabric(),
                               i_steady_state_fabric_factor()}];
  int stress_given = replaced_parameter == 0;
  int flow = stress_given ? 0 : place[replaced_parameter];
  int share = place[i_residual_correlated_share()];
  int grain_size = place[i_steady_state_grain_size()];
  int grain_size_is_stretched = grain_size > 0 && reference[7] > least_softening()
                                && quantity[max(grain_size, 1), i_lower()] > negative_infinity();
  vector[num_elements(coordinate)] plain;
  vector[num_elements(given)] parameter = given;
  real log_noise_ratio; // ln(s/s of the reference point)
  real log_stress = 0;
  real log_jacobian = 0;
  vector[5] softening;
  // Where residuals drift for long their whole standard deviation is next to unknown, that of their
  // independent part, sqrt(1 - correlated share) of it, is not: the coordinate goes with it.
  real log_independent = 0; // ln of this factor over that at the reference point
  // Widths go with what drifts, though: it moves level and slope of a curve.
  real log_drift = 0;
  // The noise first: widths of others go with it.
  if (share > 0) {
    parameter[i_residual_correlated_share()] = bounded_from_real(
      plain_from_straightened(coordinate[share], guide[share, 1], guide[share, 2])[1],
      quantity[share]);
    log_independent = 0.5
                      * (log1m(parameter[i_residual_correlated_share()])
                         - log1m(bounded_from_real(guide[share, 1], quantity[share])));
    log_drift = log_drift_of(parameter[i_residual_correlated_share()])
                - log_drift_of(bounded_from_real(guide[share, 1], quantity[share]));
  }
  if (place[noise] > 0) {
    int i = place[noise];
    parameter[noise]
      = bounded_from_real(plain_from_straightened(coordinate[i] - log_independent,
                                                  guide[i, 1], guide[i, 2])[1],
                          quantity[i]);
  }
  log_noise_ratio = largest_log_ratio()
                    * tanh((log(parameter[noise]) + log_drift - reference[5])
                           / largest_log_ratio());
  // From the last to the first: the Maxwell modulus follows the Kelvin element.
  for (from_last in 1 : num_elements(given)) {
    int k = num_elements(given) + 1 - from_last;
    int i = place[k];
    if (i > 0 && i != flow && i != solved[1] && i != solved[2] && i != solved[3]
        && !(i == grain_size && grain_size_is_stretched)) {
      real log_width = guide[i, 3] * log_noise_ratio;
      real displacement = coordinate[i] * exp(log_width);
      vector[2] straight;
      if (k == i_stress_noise() || k == i_strain_noise()) {
        displacement -= log_independent;
      }
      if (k == i_maxwell_modulus() && guide[i, 2] < 0) {
        // The curve fixes what both springs give together in the elastic rise.
        displacement += left_to_spring(quantity[i, i_scale()] / -guide[i, 2]
                                       * (loading_compliance(parameter[i_kelvin_modulus()],
                                                             parameter[i_kelvin_viscosity()],
                                                             conditions[4])
                                          - reference[6]));
      }
      straight = plain_from_straightened(displacement, guide[i, 1], guide[i, 2]);
      plain[i] = straight[1];
      log_jacobian += straight[2] + log_width;
      parameter[k] = bounded_from_real(plain[i], quantity[i]);
    }
  }
  if (grain_size_is_stretched) {
    // After p and n, on which the edge depends.
    vector[2] straight = plain_from_straightened(coordinate[grain_size], guide[grain_size, 1],
                                                 guide[grain_size, 2]);
    vector[2] stretched = grain_size_at_edge(straight[1],
      parameter[i_grain_size_exponent()] / parameter[i_stress_exponent()], reference[7],
      conditions[2], quantity[grain_size]);
    plain[grain_size] = stretched[1];
    log_jacobian += straight[2] + stretched[2];
    parameter[i_steady_state_grain_size()] = bounded_from_real(plain[grain_size],
                                                               quantity[grain_size]);
  }
  if (stress_given) {
    log_stress = log_reference_stress_at(parameter, conditions[1], conditions[2],
                                         conditions[3]);
  }
  softening = softening_from_coordinates(
    [stress_given ? 0 : coordinate[flow], coordinate[solved[3]], coordinate[solved[1]],
     coordinate[solved[2]]]',
    asked_of_pins(parameter, stress_given, log_stress, conditions[2], knot, pin), reference,
    pin, exp(-2 * log_noise_ratio), stress_given, quantity[solved, i_lower() : i_upper()]);
  plain[solved] = softening[{3, 4, 2}];
  log_jacobian += softening[5];
  if (!stress_given) {
    real flow_quantity = softening[1];
    if (flow_stress > 0) {
      flow_quantity = log(conditions[1])
                      + parameter[i_stress_exponent()] * (log(flow_stress) - softening[1]);
      log_jacobian += log(parameter[i_stress_exponent()]);
    }
    plain[flow] = (flow_quantity - quantity[flow, i_shift()]) / quantity[flow, i_scale()];
    log_jacobian -= log(quantity[flow, i_scale()]);
  }
  return append_row(plain, log_jacobian);
}
