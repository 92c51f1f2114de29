/**
 * Rates of the mechanisms of a dashpot, from plain coordinates of a loading history; those of the
 * valley have a map of their own.
 *
 * Data fix the rate of the whole dashpot and leave those of its mechanisms broad along a bent ridge. So
 * the point of the flow law that is sampled is that of the whole dashpot, and the sampled rates of
 * further mechanisms are moved: where one is slow beside the whole, hardly, where it is fast, to the
 * whole one. Needs charts/plain.stan and physics/dashpot_mechanisms.stan.
 */

/**
 * Logarithms of the rates of two mechanisms, from that of both together and what is sampled for the
 * second. The map keeps volumes.
 */
vector parts_of_pair(real whole, real sampled, int in_series) {
  real move = in_series ? log1p_exp(whole - sampled) : -log1p_exp(sampled - whole);
  return [whole + move, sampled + move]';
}

/** Which rates of further mechanisms are the test's own and may have any value above 0. */
array[] int rates_that_move(data array[] int place, data matrix quantity) {
  array[2] int moves = {0, 0};
  for (k in 1 : 2) {
    int own = place[mechanism_numbers(k)[1]];
    if (own > 0) {
      moves[k] = quantity[own, i_lower()] == 0 && is_inf(quantity[own, i_upper()]);
    }
  }
  return moves;
}

/**
 * Parameters with the rates of their mechanisms in place of the sampled ones.
 *
 * @param parameter vector whose entry `replaced_parameter` holds ln(stress / Pa) or ln(rate s) of the
 *   whole dashpot, see resolve_flow()
 * @param moves of rates_that_move()
 * @param samples_stress 1: that stress is the one at the rate exp(log_rate), 0: that rate is the one at
 *   the stress
 * @param stress at which the rates are compared, Pa
 * @param temperature stated, K
 * @return parameters, that entry of the first mechanism, then ln |d(rates)/d(sampled rates)|
 */
vector with_parted_rates(vector parameter, data array[] int moves, data int replaced_parameter,
                         data int samples_stress, data real log_rate, data real stress,
                         data real grain_size, data real temperature) {
  int act = mechanisms_act(parameter);
  int n = n_further_mechanisms(act);
  vector[num_elements(parameter)] parted = parameter;
  real log_jacobian = 0;
  if (replaced_parameter > 0 && n > 0) {
    real exponent = parameter[i_stress_exponent()];
    vector[n + 1] log_rates; // of all mechanisms
    vector[n + 1] sampled;
    log_rates[1] = samples_stress
                   ? log_rate + exponent * (log(stress) - parameter[replaced_parameter])
                   : parameter[replaced_parameter];
    for (k in 1 : n) {
      log_rates[k + 1] = log_further_rate(k, stress, grain_size, parameter,
                                          true_temperature(parameter, temperature));
    }
    sampled = log_rates;
    if (act > 3 && act < 7 && moves[2]) {
      log_rates[{1, 3}] = parts_of_pair(log_rates[1], log_rates[3], 0);
    }
    if (moves[1]) {
      log_rates[1 : 2] = parts_of_pair(log_rates[1], log_rates[2], act % 3 == 2);
    }
    if (act > 6 && min(moves)) {
      log_rates[2 : 3] = parts_of_pair(log_rates[2], log_rates[3], 1);
    }
    parted[replaced_parameter] = samples_stress
                                 ? log(stress) + (log_rate - log_rates[1]) / exponent
                                 : log_rates[1];
    for (k in 1 : n) {
      real move = log_rates[k + 1] - sampled[k + 1];
      parted[mechanism_numbers(k)[1]] *= exp(move);
      log_jacobian += move;
    }
  }
  return append_row(parted, log_jacobian);
}
