/**
 * A second mechanism of the dashpot, beside its law or in series with it:
 *
 *   v = v_1 + v_2  or  1/v = 1/v_1 + 1/v_2,
 *   v_2 = r_2 sgn(stress) |stress/S_2|^n_2 (d/d_2)^-p_2 exp[-(Q_2/R)(1/T - 1/T_2)] exp(e_2),
 *
 * v_1 the rate by physics/dashpot_laws.stan, e_2 of physics/environment.stan. The second mechanism is one of
 * physics/composite_law.stan, so a law of a table of rates holds here. It flows by the whole stress,
 * whatever the fabric and the backstress. Needs that file and physics/parameters.stan.
 */

/** How the mechanisms of the dashpot act: 0 there is one, 1 side by side, 2 in series. */
int mechanisms_act(vector parameter) {
  if (parameter[i_second_rate()] == 0) {
    return 0;
  }
  return parameter[i_mechanisms_in_series()] == 0 ? 1 : 2;
}

/** Whether the dashpot has a second mechanism in some test. */
int any_second_mechanism(array[] vector parameter) {
  for (own in parameter) {
    if (mechanisms_act(own) > 0) {
      return 1;
    }
  }
  return 0;
}

/**
 * ln(v_2 s).
 *
 * @param stress above 0, Pa
 * @param grain_size m
 * @param parameter in the order of physics/parameters.stan
 * @param temperature true one, K
 */
real log_second_rate(real stress, real grain_size, vector parameter, real temperature) {
  real enthalpy = parameter[i_second_activation_enthalpy()];
  matrix[1, 0] none; // of its environment, which stands below
  return log_mechanism_rate([log(parameter[i_second_rate()]),
                             parameter[i_second_stress_exponent()],
                             parameter[i_second_grain_size_exponent()], enthalpy, enthalpy],
                            [log(stress / parameter[i_second_reference_stress()])]',
                            [log(grain_size / parameter[i_second_reference_grain_size()])]',
                            [1 / temperature - 1 / parameter[i_second_reference_temperature()]]',
                            [0]', 1, none)[1]
         + log_environment(parameter, temperature, second_environment_numbers());
}

/**
 * v of rates of one sign, in any unit.
 *
 * @param act of mechanisms_act(), 1 or 2
 */
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
