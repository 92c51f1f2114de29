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
 * Where only one of grain size and fabric evolves, there is one critical strain, whose density needs
 * no other; what is centred and scaled next to it is d_ss or F_ss.
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

/** Places in `named`, see there. */
int i_replaced() { return 1; }
int i_noise() { return 2; }

/**
 * Places in `conditions`: rate that S_0 belongs to (1/s), d_0 (m), temperature (K), time of the
 * elastic rise, in which both springs give together (s), the stress of the flow rate where the
 * plain coordinate is of that and not of S_0 (Pa; else 0); where ln S_0 is solved from times the flow
 * strain that data can just tell from none, over that of the reference curve, and the prior standard
 * deviation of what ln S_0 replaces.
 */
int c_rate() { return 1; }
int c_grain_size() { return 2; }
int c_temperature() { return 3; }
int c_loading_time() { return 4; }
int c_flow_stress() { return 5; }
int c_seen_flow() { return 6; }
int c_replaced_deviation() { return 7; }

/**
 * Modulus (Pa) and viscosity (Pa s) of each element of the Kelvin part, (n, 2).
 *
 * @param temperature K
 * @param grain_size m
 */
matrix kelvin_elements(vector parameter, data matrix element, data real temperature,
                       data real grain_size) {
  real slowing = log_kelvin_slowing(parameter, temperature,
                                    parameter[i_kelvin_reference_temperature()])
                 + log_kelvin_coarsening(parameter, grain_size);
  matrix[rows(element), 2] decay_and_compliance
    = relaxation_elements(element, relaxation_numbers(parameter));
  return append_col(parameter[i_kelvin_modulus()] ./ decay_and_compliance[ : , 2],
                    parameter[i_kelvin_viscosity()] * exp(slowing)
                    ./ (decay_and_compliance[ : , 1] .* decay_and_compliance[ : , 2]));
}

/** Rate of the first mechanism at the pins at parameters: first_rate_at_pins(). */
vector dashpot_rate_of(vector parameter, matrix kelvin, data matrix knot, data matrix pin,
                       data real temperature) {
  return first_rate_at_pins(
    dashpot_rate_at_pins(knot, pin,
                         parameter[i_maxwell_modulus()]
                         / (1
                            + parameter[i_apparatus_compliance()]
                              * parameter[i_maxwell_modulus()]),
                         kelvin, stress_reading_factor(parameter)),
    knot, pin, parameter, true_temperature(parameter, temperature));
}

/** What parameters ask for at the pins: `asked` of charts/valley/least_squares.stan. */
vector asked_of_pins(vector parameter, vector dashpot_rate, data int stress_given,
                     real log_stress, data real initial_grain_size, data matrix knot,
                     data matrix pin) {
  vector[rows(pin)] log_strength = log_strength_at_pins(knot, pin, dashpot_rate,
                                                        parameter[i_stress_exponent()],
                                                        stress_reading_factor(parameter));
  return append_row([parameter[i_grain_size_exponent()] / parameter[i_stress_exponent()],
                     log(parameter[i_steady_state_grain_size()] / initial_grain_size)]',
                    stress_given ? log_strength - log_stress : log_strength);
}

/**
 * Places among a test's own parameters of what is solved for: (epsilon_c1, epsilon_c2, F_ss), or
 * where grain size or fabric evolves alone (0, its critical strain, its steady state).
 */
array[] int solved_places(data array[] int place) {
  array[3] int both = place[{i_critical_strain_grain_size(), i_critical_strain_fabric(),
                             i_steady_state_fabric_factor()}];
  if (both[2] == 0) {
    return {0, both[1], place[i_steady_state_grain_size()]};
  }
  return both;
}

/** Bounds of what is solved for, a row for each; those of d_ss over d_0. */
matrix solved_bounds(data array[] int place, data matrix quantity,
                     data real initial_grain_size) {
  array[3] int solved = solved_places(place);
  matrix[3, 2] bounds = quantity[{max(solved[1], 1), solved[2], solved[3]}, i_lower() : i_upper()];
  if (solved[3] == place[i_steady_state_grain_size()]) {
    bounds[3] /= initial_grain_size;
  }
  return bounds;
}

/** Share of their own variance with which independent residuals count beside those that drift. */
real independent_weight() { return 0.1; }

/** ln of the noise of what changes slowly, over that of a reading. */
real log_drift_of(real correlated_share) {
  return 0.5 * log(correlated_share + independent_weight() * (1 - correlated_share));
}

/** The same over the reading error, with a discrepancy over it. */
real log_drift_beside(real discrepancy) {
  return 0.5 * log(square(discrepancy) + independent_weight());
}

/** Largest ln(s/s of the reference point) that widths follow: beyond, no solver follows them. */
real largest_log_ratio() { return 1.5; }

/**
 * What charts/valley/least_squares.stan wants to know of the reference point, with the compliance of
 * the Kelvin element in the elastic rise and the softening of the dashpot up to the last pin.
 *
 * @param parameter at the reference point
 */
vector valley_reference(data vector parameter, data vector coordinate, data array[] int place,
                        data array[] int named, data vector conditions, data matrix knot,
                        data matrix pin, data matrix element) {
  matrix[rows(element), 2] kelvin = kelvin_elements(parameter, element,
                                                    conditions[c_temperature()],
                                                    conditions[c_grain_size()]);
  real log_stress = log_reference_stress_at(parameter, conditions[c_rate()],
                                            conditions[c_grain_size()],
                                            conditions[c_temperature()]);
  array[3] int solved = solved_places(place);
  real steady_state = solved[3] == place[i_steady_state_grain_size()]
                      ? parameter[i_steady_state_grain_size()] / conditions[c_grain_size()]
                      : parameter[i_steady_state_fabric_factor()];
  int replaced = max(named[i_replaced()], 1);
  vector[num_elements(parameter)] beside = parameter;
  real width; // of ln(flow rate)
  beside[replaced] += conditions[c_replaced_deviation()];
  width = parameter[i_stress_exponent()]
          * (log_reference_stress_at(beside, conditions[c_rate()], conditions[c_grain_size()],
                                     conditions[c_temperature()])
             - log_stress);
  return append_row([solved[1] > 0 ? coordinate[solved[1]] : 0, coordinate[solved[2]],
                     1 - steady_state, log_stress, log(parameter[named[i_noise()]]),
                     loading_compliance(kelvin, conditions[c_loading_time()]),
                     softening_after(pin[rows(pin), 1], parameter, conditions[c_grain_size()]),
                     parameter[replaced],
                     fmax(width, -width)]',
                    asked_of_pins(parameter,
                                  dashpot_rate_of(parameter, kelvin, knot, pin,
                                                  conditions[c_temperature()]),
                                  named[i_replaced()] == 0, log_stress,
                                  conditions[c_grain_size()], knot, pin));
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
 * @param named numbers of parameters: Q_M or beta, which ln S_0 replaces (0: ln S_0 is given), and
 *   the noise that the widths follow
 * @return plain coordinates, then ln |d(these)/d(coordinate)|
 */
vector plain_from_valley(vector coordinate, vector given, data array[] int place,
                         data matrix quantity, data array[] int named, data vector conditions,
                         data matrix knot, data matrix pin, data vector reference,
                         data matrix element) {
  array[3] int solved = solved_places(place);
  int noise = named[i_noise()];
  int stress_given = named[i_replaced()] == 0;
  int flow = stress_given ? 0 : place[named[i_replaced()]];
  int share = place[i_residual_correlated_share()];
  int discrepancy = place[i_discrepancy()];
  int grain_size = place[i_steady_state_grain_size()];
  int grain_size_is_stretched = grain_size > 0 && grain_size != solved[3]
                                && reference[i_whole_softening()] > least_softening()
                                && quantity[max(grain_size, 1), i_lower()] > negative_infinity();
  vector[num_elements(coordinate)] plain;
  vector[num_elements(given)] parameter = given;
  matrix[rows(element), 2] kelvin;
  real log_noise_ratio; // ln(s/s of the reference point)
  real log_stress; // given, or what the other parameters suggest
  real log_jacobian = 0;
  vector[rows(pin)] dashpot_rate;
  vector[rows(pin) + 2] asked;
  vector[2] remainder; // of ln S_0, and of F_ss or d_ss
  vector[5] softening;
  // Where residuals drift for long their whole standard deviation is next to unknown, that of their
  // independent part, sqrt(1 - correlated share) of it, is not: the coordinate goes with it.
  real log_independent = 0; // ln of this factor over that at the reference point
  // Widths go with what drifts, though: it moves level and slope of a curve.
  real log_drift = 0;
  // The noise first: widths of others go with it.
  if (share > 0) {
    parameter[i_residual_correlated_share()] = bounded_from_real(
      plain_from_straightened(coordinate[share], quantity[share])[1],
      quantity[share]);
    log_independent = 0.5
                      * (log1m(parameter[i_residual_correlated_share()])
                         - log1m(bounded_from_real(quantity[share, i_mode()], quantity[share])));
    log_drift = log_drift_of(parameter[i_residual_correlated_share()])
                - log_drift_of(bounded_from_real(quantity[share, i_mode()], quantity[share]));
  }
  if (discrepancy > 0) {
    parameter[i_discrepancy()] = bounded_from_real(
      plain_from_straightened(coordinate[discrepancy], quantity[discrepancy])[1],
      quantity[discrepancy]);
    log_drift = log_drift_beside(parameter[i_discrepancy()])
                - log_drift_beside(bounded_from_real(quantity[discrepancy, i_mode()],
                                                     quantity[discrepancy]));
  }
  if (place[noise] > 0) {
    int i = place[noise];
    parameter[noise]
      = bounded_from_real(plain_from_straightened(coordinate[i] - log_independent, quantity[i])[1],
                          quantity[i]);
  }
  log_noise_ratio = largest_log_ratio()
                    * tanh((log(parameter[noise]) + log_drift - reference[i_log_noise()])
                           / largest_log_ratio());
  // From the last to the first: the Maxwell modulus follows the Kelvin element.
  for (from_last in 1 : num_elements(given)) {
    int k = num_elements(given) + 1 - from_last;
    int i = place[k];
    if (i > 0 && i != flow && i != solved[1] && i != solved[2] && i != solved[3]
        && !(i == grain_size && grain_size_is_stretched)) {
      real log_width = quantity[i, i_power()] * log_noise_ratio;
      real displacement = coordinate[i] * exp(log_width);
      vector[2] straight;
      if (k == i_stress_noise() || k == i_strain_noise()) {
        displacement -= log_independent;
      }
      if (k == i_maxwell_modulus() && quantity[i, i_linear()] < 0) {
        // The curve fixes what both springs give together in the elastic rise. Peaks of relaxation times
        // are in proportion to this modulus: its value at the mode stands for it.
        parameter[k] = bounded_from_real(quantity[i, i_mode()], quantity[i]);
        kelvin = kelvin_elements(parameter, element, conditions[c_temperature()],
                                 conditions[c_grain_size()]);
        displacement += left_to_spring(quantity[i, i_scale()] / -quantity[i, i_linear()]
                                       * (loading_compliance(kelvin, conditions[c_loading_time()])
                                          - reference[i_rise_compliance()]),
                                       exp(-quantity[i, i_mode()]) / -quantity[i, i_linear()]);
      }
      straight = plain_from_straightened(displacement, quantity[i]);
      plain[i] = straight[1];
      log_jacobian += straight[2] + log_width;
      parameter[k] = bounded_from_real(plain[i], quantity[i]);
    }
  }
  if (grain_size_is_stretched) {
    // After p and n, on which the edge depends.
    vector[2] straight = plain_from_straightened(coordinate[grain_size], quantity[grain_size]);
    vector[2] stretched = grain_size_at_edge(straight[1],
      parameter[i_grain_size_exponent()] / parameter[i_stress_exponent()],
      reference[i_whole_softening()], conditions[c_grain_size()], quantity[grain_size]);
    plain[grain_size] = stretched[1];
    log_jacobian += straight[2] + stretched[2];
    parameter[i_steady_state_grain_size()] = bounded_from_real(plain[grain_size],
                                                               quantity[grain_size]);
  }
  if (!stress_given) {
    parameter[named[i_replaced()]] = reference[i_replaced_value()];
  }
  log_stress = log_reference_stress_at(parameter, conditions[c_rate()],
                                       conditions[c_grain_size()], conditions[c_temperature()]);
  kelvin = kelvin_elements(parameter, element, conditions[c_temperature()],
                           conditions[c_grain_size()]);
  for (k in 1 : n_further_mechanisms(mechanisms_act(parameter))) {
    int i = place[mechanism_numbers(k)[1]];
    if (rates_that_move(place, quantity)[k]) {
      vector[2] move = further_rate_move(k, parameter, knot, pin, conditions[c_temperature()]);
      plain[i] += move[1];
      log_jacobian += move[2];
      parameter[mechanism_numbers(k)[1]] *= exp(move[1]);
    }
  }
  dashpot_rate = dashpot_rate_of(parameter, kelvin, knot, pin, conditions[c_temperature()]);
  asked = asked_of_pins(parameter, dashpot_rate, stress_given, log_stress,
                        conditions[c_grain_size()], knot, pin);
  remainder = [stress_given ? 0 : coordinate[flow], coordinate[solved[3]]]';
  if (solved[1] > 0) {
    softening = softening_from_coordinates(
      append_row(remainder, coordinate[solved[1 : 2]]), asked, reference, pin, dashpot_rate,
      log_stress, exp(-2 * log_noise_ratio), parameter[i_stress_exponent()],
      [conditions[c_seen_flow()], reference[i_hidden_width()]]', stress_given,
      solved_bounds(place, quantity, conditions[c_grain_size()]));
    plain[solved[1]] = softening[3];
  } else {
    softening = softening_of_one(
      append_row(remainder, coordinate[solved[2]]), asked, reference, pin, dashpot_rate,
      log_stress, exp(-2 * log_noise_ratio), parameter[i_stress_exponent()],
      [conditions[c_seen_flow()], reference[i_hidden_width()]]', solved[3] == grain_size,
      stress_given, solved_bounds(place, quantity, conditions[c_grain_size()]));
  }
  plain[solved[2 : 3]] = softening[{4, 2}];
  log_jacobian += softening[5];
  if (!stress_given) {
    real flow_quantity = softening[1];
    if (conditions[c_flow_stress()] > 0) {
      flow_quantity = log(conditions[c_rate()])
                      + parameter[i_stress_exponent()]
                        * (log(conditions[c_flow_stress()]) - softening[1]);
      log_jacobian += log(parameter[i_stress_exponent()]);
    }
    plain[flow] = (flow_quantity - quantity[flow, i_shift()]) / quantity[flow, i_scale()];
    log_jacobian -= log(quantity[flow, i_scale()]);
  }
  return append_row(plain, log_jacobian);
}
