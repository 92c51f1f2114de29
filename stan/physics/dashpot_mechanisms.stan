/**
 * Further mechanisms of the dashpot. The second one acts beside the law of the dashpot or in series
 * with it, the third one beside both or in series with the second:
 *
 *   v = v_1 + v_2 + v_3,  v = v_1 + 1/(1/v_2 + 1/v_3),  1/v = 1/v_1 + 1/v_2,  and so on,
 *   v_k = r_k sgn(stress) |stress/S_r|^n_k (d/d_r)^-p_k exp[-(Q_k/R)(1/T - 1/T_r)] exp(e_k),
 *
 * v_1 the rate by physics/dashpot_laws.stan, e_k of physics/environment.stan. Each is a mechanism of
 * physics/composite_law.stan, so a law of a table of rates holds here. Further mechanisms flow by the
 * whole stress, whatever the fabric and the backstress. Needs that file and physics/parameters.stan.
 */

/** Places of r_k, n_k, p_k, Q_k and of how it acts, k = 1 of the second mechanism, 2 of the third. */
array[] int mechanism_numbers(data int k) {
  if (k == 1) {
    return {i_second_rate(), i_second_stress_exponent(), i_second_grain_size_exponent(),
            i_second_activation_enthalpy(), i_second_in_series()};
  }
  return {i_third_rate(), i_third_stress_exponent(), i_third_grain_size_exponent(),
          i_third_activation_enthalpy(), i_third_in_series()};
}

/**
 * How the mechanisms of the dashpot act. 0: there is one. The second acts 1 beside the first, 2 in
 * series with it; 3 more with a third one beside both, 6 more with one in series with the second.
 */
int mechanisms_act(vector parameter) {
  int act = 0;
  if (parameter[i_second_rate()] > 0) {
    act = parameter[i_second_in_series()] == 0 ? 1 : 2;
    if (parameter[i_third_rate()] > 0) {
      act += parameter[i_third_in_series()] == 0 ? 3 : 6;
    }
  }
  return act;
}

/** Mechanisms beyond the first. */
int n_further_mechanisms(real act) { return act > 3 ? 2 : act > 0; }

/** The largest number of them in any test. */
int most_further_mechanisms(data array[] vector parameter) {
  int n = 0;
  for (own in parameter) {
    n = max(n, n_further_mechanisms(mechanisms_act(own)));
  }
  return n;
}

/**
 * ln(v_k s).
 *
 * @param k 1: the second mechanism, 2: the third
 * @param stress above 0, Pa
 * @param grain_size m
 * @param parameter in the order of physics/parameters.stan
 * @param temperature true one, K
 */
real log_further_rate(data int k, real stress, real grain_size, vector parameter,
                      real temperature) {
  array[5] int number = mechanism_numbers(k);
  real enthalpy = parameter[number[4]];
  matrix[1, 0] none; // of its environment, which stands below
  return log_mechanism_rate([log(parameter[number[1]]), parameter[number[2]],
                             parameter[number[3]], enthalpy, enthalpy],
                            [log(stress / parameter[i_mechanism_reference_stress()])]',
                            [log(grain_size / parameter[i_mechanism_reference_grain_size()])]',
                            [1 / temperature
                             - 1 / parameter[i_mechanism_reference_temperature()]]',
                            [0]', 1, none)[1]
         + log_environment(parameter, temperature, environment_numbers(k + 1));
}

/** Rate of two mechanisms with rates of one sign: 1 side by side, 2 in series. */
real rate_of_both(real first, real second, real act) {
  if (act == 1) {
    return first + second;
  }
  if (first == 0 || second == 0) {
    return 0;
  }
  // Divided by the larger one, so that nothing overflows.
  return first / second < 1 ? first / (1 + first / second) : second / (1 + second / first);
}

/**
 * v of rates of one sign, in any unit.
 *
 * @param first v_1
 * @param further v_2, then v_3
 * @param act of mechanisms_act(), above 0
 */
real rate_of_mechanisms(real first, vector further, real act) {
  if (act > 6) {
    return rate_of_both(first, rate_of_both(further[1], further[2], 2), act - 6);
  }
  if (act > 3) {
    return rate_of_both(first, further[1], act - 3) + further[2];
  }
  return rate_of_both(first, further[1], act);
}
