/**
 * Composite flow laws: mechanisms that act side by side, some of them in series with another.
 *
 * A mechanism is a power law,
 *
 *   ln(rate) = ln(r) + n ln(S/S_1) - p ln(d/d_1) - Q/R (1/T - 1/T_1) - P V_M/(R T)
 *              + r_f ln(f/f_1) + alpha_phi phi,
 *
 * with its rate r at reference conditions (S_1, d_1, T_1, no pressure P, water fugacity f_1, no melt
 * phi), which decouples r from n, p and Q. Above
 * a premelting temperature its activation enthalpy is another one, and the rate has a kink there.
 * Mechanisms of one step add their rates; steps of one process are in series, so that the slower
 * one rules: 1/rate is the sum of 1/rate of its steps (Goldsby and Kohlstedt 2001, Eq. 4).
 *
 * A law is a matrix with a row for each mechanism: ln(r s), n, p, Q (J/mol), Q above the
 * premelting temperature, V_M (m^3/mol), r_f, alpha_phi. Conditions are distances from the reference ones:
 * x = ln(S/S_1), y = ln(d/d_1), c = 1/T - 1/T_1 in 1/K. An environment is a row of P (Pa), ln(f/f_1)
 * and phi for each condition; without columns these three have no effect.
 */

/** Columns of a law. */
int m_rate() { return 1; }

int m_stress_exponent() { return 2; }

int m_grain_size_exponent() { return 3; }

int m_activation_enthalpy() { return 4; }

int m_premelting_enthalpy() { return 5; }

int m_activation_volume() { return 6; }

int m_water_exponent() { return 7; }

int m_melt_factor() { return 8; }

int n_of_mechanism() { return 8; }

/** Part of the distance c that lies above a premelting temperature (0: there is none), <= 0. */
vector premelted(vector coldness, data real premelting_temperature,
                 data real reference_temperature) {
  if (premelting_temperature <= 0) {
    return rep_vector(0, rows(coldness));
  }
  return fmin(coldness - (1 / premelting_temperature - 1 / reference_temperature), 0);
}

/** ln(rate s) of one mechanism. */
vector log_mechanism_rate(row_vector mechanism, vector log_stress, vector log_grain_size,
                          vector coldness, vector premelted_coldness,
                          data real reference_temperature, matrix environment) {
  real q = mechanism[m_activation_enthalpy()];
  vector[rows(coldness)] log_rate
    = mechanism[m_rate()] + mechanism[m_stress_exponent()] * log_stress
      - mechanism[m_grain_size_exponent()] * log_grain_size
      - (q * coldness + (mechanism[m_premelting_enthalpy()] - q) * premelted_coldness)
        / gas_constant();
  if (cols(environment) > 0) {
    log_rate += mechanism[m_water_exponent()] * environment[ : , 2]
                + mechanism[m_melt_factor()] * environment[ : , 3]
                - mechanism[m_activation_volume()] / gas_constant()
                  * environment[ : , 1] .* (coldness + 1 / reference_temperature);
  }
  return log_rate;
}

/** ln(exp(a) + exp(b)), element by element. */
vector log_sum(vector a, vector b) { return a + log1p_exp(b - a); }

/**
 * Rate of a composite law and how it changes with the conditions.
 *
 * @param process of each mechanism, from 1; those of one process are in series
 * @param environment (n, 3) or (n, 0)
 * @return columns: ln(rate s); its derivatives by x, -y and -c/R (n, p and Q as seen from outside)
 */
matrix composite_law(matrix law, array[] int process, data vector premelting_temperature,
                     data real reference_temperature, vector log_stress, vector log_grain_size,
                     vector coldness, data matrix environment) {
  int n_rows = rows(coldness);
  int n_processes = max(process);
  array[rows(law)] vector[n_rows] log_rate;
  array[rows(law)] vector[n_rows] enthalpy;
  array[n_processes] vector[n_rows] of_process;
  array[n_processes] int found = rep_array(0, n_processes);
  vector[n_rows] total;
  vector[n_rows] n = rep_vector(0, n_rows);
  vector[n_rows] p = rep_vector(0, n_rows);
  vector[n_rows] q = rep_vector(0, n_rows);
  for (m in 1 : rows(law)) {
    int k = process[m];
    vector[n_rows] warm = premelted(coldness, premelting_temperature[m],
                                    reference_temperature);
    log_rate[m] = log_mechanism_rate(law[m], log_stress, log_grain_size, coldness, warm,
                                     reference_temperature, environment);
    enthalpy[m] = rep_vector(law[m, m_activation_enthalpy()], n_rows);
    if (premelting_temperature[m] > 0) {
      for (i in 1 : n_rows) {
        if (warm[i] < 0) {
          enthalpy[m, i] = law[m, m_premelting_enthalpy()];
        }
      }
    }
    if (cols(environment) > 0) {
      enthalpy[m] += law[m, m_activation_volume()] * environment[ : , 1];
    }
    of_process[k] = found[k] ? -log_sum(-of_process[k], -log_rate[m]) : log_rate[m];
    found[k] = 1;
  }
  total = of_process[1];
  for (k in 2 : n_processes) {
    total = log_sum(total, of_process[k]);
  }
  for (m in 1 : rows(law)) {
    vector[n_rows] weight = exp(2 * of_process[process[m]] - total - log_rate[m]);
    n += weight * law[m, m_stress_exponent()];
    p += weight * law[m, m_grain_size_exponent()];
    q += weight .* enthalpy[m];
  }
  return append_col(append_col(total, n), append_col(p, q));
}

/** Newton steps after which the search for a stress ends, and where it ends before, in ln. */
int n_newton_steps() { return 100; }

real newton_precision() { return 1e-12; }

/**
 * x at which a composite law has given rates: Newton steps of at most 2 in ln(stress).
 *
 * @param log_rate ln(rate s)
 * @param start first guess of x
 */
vector log_stress_of_rate(vector log_rate, vector start, matrix law, array[] int process,
                          data vector premelting_temperature, data real reference_temperature,
                          vector log_grain_size, vector coldness, data matrix environment) {
  vector[rows(log_rate)] x = start;
  for (step in 1 : n_newton_steps()) {
    matrix[rows(log_rate), 4] at = composite_law(law, process, premelting_temperature,
                                                 reference_temperature, x, log_grain_size,
                                                 coldness, environment);
    vector[rows(log_rate)] change = fmax(fmin((log_rate - at[ : , 1]) ./ at[ : , 2], 2), -2);
    x += change;
    if (max(change) < newton_precision() && min(change) > -newton_precision()) {
      break;
    }
  }
  return x;
}
