/**
 * Several mechanisms of the dashpot in valley coordinates: the pins ask the first one for the rate that
 * the others leave, at the grain sizes of the reference curve, and the rates of the others cannot take
 * all of it. Needs charts/valley/pins.stan and charts/parted_rates.stan.
 */

/**
 * v_1 of the rate of the whole dashpot and the rates of further mechanisms, all above 0, in one unit:
 * rate_of_mechanisms() inverted. Where the others leave nothing, or not enough, v_1 nears a floor or an
 * end smoothly.
 *
 * @param further v_2, then v_3
 * @param act of mechanisms_act(), above 0
 * @param least the floor over the whole rate, and that rate over the end
 */
real first_of_mechanisms(real whole, vector further, real act, data real least) {
  real beside = act > 3 && act < 7 ? further[2] : 0;
  real partner = act > 6 ? rate_of_both(further[1], further[2], 2) : further[1];
  real left = kept_above(1 - beside / whole, least);
  if (act == 1 || act == 4 || act == 7) {
    return whole * kept_above(left - partner / whole, least);
  }
  return whole * left / kept_above(1 - left * whole / partner, least);
}

/** Floor of the first mechanism's rate over that of the dashpot, far from the reference. */
real least_first_share() { return 0.05; }

/**
 * Rate of the first mechanism of the dashpot at the pins, over the unit of rates, where others take the
 * rest: at the grain sizes of the reference curve.
 *
 * @param dashpot_rate of all mechanisms, dashpot_rate_at_pins()
 * @param temperature true one, K
 */
vector first_rate_at_pins(vector dashpot_rate, data matrix knot, data matrix pin,
                          vector parameter, real temperature) {
  int act = mechanisms_act(parameter);
  vector[rows(pin)] first = dashpot_rate;
  if (act > 0) {
    vector[rows(pin)] stress = stress_at_pins(knot, pin) / stress_reading_factor(parameter);
    vector[rows(pin)] whole = floored_rate(dashpot_rate);
    vector[n_further_mechanisms(act)] further;
    for (m in 1 : rows(pin)) {
      for (k in 1 : num_elements(further)) {
        further[k] = exp(log_further_rate(k, stress[m], pin[m, 10], parameter, temperature))
                     / pin[m, 3];
      }
      first[m] = first_of_mechanisms(whole[m], further, act, least_first_share());
    }
  }
  return first;
}

/**
 * How far the logarithm of the rate of a further mechanism is moved from what is sampled, and ln of the
 * slope of the moved one: beside others it stays below the rate of the whole dashpot at the pins, in
 * series above.
 *
 * @param k 1: the second mechanism, 2: the third
 */
vector further_rate_move(data int k, vector parameter, data matrix knot, data matrix pin,
                         data real temperature) {
  int act = mechanisms_act(parameter);
  int is_series = act % 3 == 2 && (k == 1 || act == 8);
  vector[rows(pin)] stress = stress_at_pins(knot, pin);
  vector[rows(pin)] log_share; // of the sampled rate in the rate of the specimen
  real largest; // of these, or minus the least, smoothly
  if (k == 2 && act == 7) { // in series with the second, which lies below already
    return [0, 0]';
  }
  for (m in 1 : rows(pin)) {
    log_share[m] = log_further_rate(k, stress[m], pin[m, 10], parameter,
                                    true_temperature(parameter, temperature))
                   - log(pin[m, 3] * pin[m, 7]);
  }
  largest = log_sum_exp((is_series ? -4 : 4) * log_share) / 4;
  return log1p_exp(largest) * [is_series ? 1 : -1, -1]';
}
