/**
 * Stress at an imposed oscillating strain rate: the three-state form of the Burgers model with
 * the grain size that a piezometer wants (Maor et al., Eq. 5) and no fabric (F = 1).
 *
 * Time is counted in periods and all states are O(1):
 *
 *   y = stress/S,  z = E_K kelvin_strain/S,  w = d/d_u,  r = (d strain/d tau)/e,
 *   dy/d tau = (E_M e/S) (r - v_K - v_d),  dz/d tau = (E_K period/eta_K) (y - z),
 *   dw/d tau = |r| (e/epsilon_c1) (d_piezometer(stress)/d_u - w),
 *   v_K = (S period/(eta_K e)) (y - z),  v_d = v_d0 sgn(y) |y|^n (d/d_0)^-p.
 *
 * With a power-law Kelvin element (physics/kelvin_laws.stan) the linear driving stress stands
 * for y - z in the rates, and with another law of the dashpot (physics/dashpot_laws.stan) the
 * equivalent stress for y in v_d, and a further mechanism (physics/dashpot_mechanisms.stan) has a rate
 * v_2 as in kinds/loading_history_rates.stan. Numbers that only some laws need are vectors, empty in the others:
 * every number costs the solver sensitivities.
 *
 * S and e are an observed stress and strain (data) and v_d0 the rate of the dashpot at stress S
 * and grain size d_0. v_K and v_d are the rates of the Kelvin element and of the dashpot, in the
 * unit of r. For d_u, the unit of the grain size, see grain_size_unit().
 *
 * The strain rate is a sum of harmonics and of a background: the strain is
 * sum_k [sine_k sin(2 pi k tau) + cosine_k cos(2 pi k tau)] + background, tau = 0 at the origin
 * of the record's clock; all of them are linear in the errors of the driving strain.
 */

/**
 * Unit of the grain size over its initial value, d_u/d_0; the solver's tolerance is one of w.
 *
 * Where the stress passes through zero the piezometer asks for huge grains for an instant. With a
 * small unit the solver spends steps on following that more closely than the stress of one
 * mechanism can tell. Diffusion with p = 3 tells more.
 *
 * @param act of mechanisms_act()
 */
real grain_size_unit(data int act) { return act > 0 ? 1 : 100; }

/**
 * d strain/d tau: the oscillation, and a background given as a polynomial of tau.
 *
 * @param tau time over period
 * @param harmonics sine amplitudes of the strain's harmonics, then cosine amplitudes, then the
 *   coefficients of the background's d strain/d tau as a polynomial of (tau - middle)/half, the
 *   constant first
 * @param n_harmonics number of harmonics
 * @param background_range middle and half of the record, in periods
 * @param first_tau start of the record: before it the background keeps the rate it has there
 */
real oscillating_rate(real tau, data row_vector harmonics, data int n_harmonics,
                      data vector background_range, data real first_tau) {
  real rate = 0;
  real position = ((tau > first_tau ? tau : first_tau) - background_range[1])
                  / background_range[2];
  for (k in 1 : num_elements(harmonics) - 2 * n_harmonics) {
    rate += harmonics[2 * n_harmonics + k] * position ^ (k - 1);
  }
  for (k in 1 : n_harmonics) {
    real angle = 2 * pi() * k * tau;
    rate += 2 * pi() * k
            * (harmonics[k] * cos(angle) - harmonics[n_harmonics + k] * sin(angle));
  }
  return rate;
}

/**
 * d strain/d tau that is most probable, and what one unit of each of its errors adds.
 *
 * It is linear in the errors; what the solver has to follow the sensitivity to is these few, not
 * every amplitude that they change.
 *
 * @param harmonics a row of most probable amplitudes, then a row for each error
 * @param error standardised errors
 */
real driving_rate(real tau, data matrix harmonics, vector error, data int n_harmonics,
                  data vector background_range, data real first_tau) {
  real rate = oscillating_rate(tau, harmonics[1], n_harmonics, background_range, first_tau);
  for (k in 1 : num_elements(error)) {
    rate += error[k] * oscillating_rate(tau, harmonics[1 + k], n_harmonics, background_range,
                                        first_tau);
  }
  return rate;
}

/** `harmonics` of driving_rate(). */
matrix harmonics_of(data vector sine, data vector cosine, data vector background,
                    data matrix error_factor) {
  return append_row(append_row(append_row(sine, cosine), background)', error_factor);
}

/**
 * Right-hand side; see the head of this file.
 *
 * @param state [y, z, w]; before the record the grain size keeps its initial value
 * @param stiffness E_M e/S
 * @param kelvin_fluidity S period/(eta_K e)
 * @param kelvin_decay E_K period/eta_K
 * @param log_dashpot_rate ln v_d0
 * @param inverse_critical_strain 1/epsilon_c1
 * @param stress_scale, strain_scale S (Pa) and e
 * @param unit d_u, m
 * @param piezometer d_1 (m), exponent and stress floor (Pa), see piezometer_grain_size()
 * @param kelvin of a Kelvin element that is not linear: the number of its law, ln(S/q_0)
 * @param dashpot of another law than the power law: its stress over S
 * @param further of each further mechanism: ln of its rate at stress S and grain size d_0, n_k, p_k
 * @param law, kelvin_law, act of dashpot_law(), kelvin_law_at() and mechanisms_act()
 */
vector forced_oscillation_rhs(real tau, vector state, real stiffness, real kelvin_fluidity,
                              real kelvin_decay, real stress_exponent,
                              real grain_size_exponent, real log_dashpot_rate,
                              real inverse_critical_strain, data matrix harmonics,
                              vector error, data int n_harmonics,
                              data vector background_range, data real first_tau,
                              real stress_scale, data real strain_scale,
                              data real unit, data vector piezometer, vector kelvin,
                              vector dashpot, matrix further, data int law,
                              data int kelvin_law, data int act) {
  real log_grain_size = log(grain_size_unit(act) * state[3]);
  real rate = driving_rate(tau, harmonics, error, n_harmonics, background_range, first_tau)
              / strain_scale;
  real kelvin_excess = state[1] - state[2];
  real flow_stress = state[1];
  real growth = 0;
  real dashpot_rate;
  if (kelvin_law > 0) {
    kelvin_excess = linear_driving_stress(kelvin_excess, kelvin_law, kelvin[1], kelvin[2]);
  }
  if (law > 0) {
    flow_stress = equivalent_stress(flow_stress, law, dashpot[1], 1, stress_exponent);
  }
  dashpot_rate = signed_power(flow_stress, 0, stress_exponent,
                              log_dashpot_rate - grain_size_exponent * log_grain_size);
  if (act > 0) {
    vector[rows(further)] rates;
    for (k in 1 : rows(further)) {
      rates[k] = signed_power(state[1], 0, further[k, 2],
                              further[k, 1] - further[k, 3] * log_grain_size);
    }
    dashpot_rate = rate_of_mechanisms(dashpot_rate, rates, act);
  }
  if (tau >= first_tau) {
    real preferred = piezometer_grain_size(stress_scale * state[1], piezometer[1],
                                           piezometer[2], piezometer[3]) / unit;
    growth = microstructure_rate(state[3], preferred, 1, strain_scale * rate)
             * inverse_critical_strain;
  }
  return [stiffness * (rate - kelvin_fluidity * kelvin_excess - dashpot_rate),
          kelvin_decay * kelvin_excess, growth]';
}

/**
 * [y, w, z] along a part of a record by radau_leg(), to which law and argument belong; NaN if the
 * method does not converge.
 *
 * @param from [y, w, z] at start_tau
 */
array[] vector fast_oscillation(vector from, data real start_tau, data array[] real tau,
                                data array[] int law, vector argument, data vector constant,
                                data vector background_range, data real first_tau,
                                data real initial_grain_size, data real strain_scale,
                                data real tolerance) {
  return radau_leg(law,
                   {0, 0, strain_scale,
                    constant[i_piezometer_reference_grain_size()]
                    / (grain_size_unit(law[7]) * initial_grain_size),
                    constant[i_piezometer_exponent()], constant[i_piezometer_stress_floor()],
                    start_tau, first_tau, background_range[1], background_range[2]},
                   to_array_1d(to_vector(tau) - start_tau), tolerance, from, argument);
}

/**
 * Stress, Kelvin strain and grain size at the given times of a record.
 *
 * The model starts cycles ahead of the record, where the oscillating strain passes through zero,
 * at the stress `relative_start` with a Kelvin element that has settled under it. For a solid any other phase
 * would leave a constant stress behind that only the dashpot relaxes, over many cycles. One call
 * of ode_bdf_tol covers these cycles and the record: its initial state is data, and sensitivities
 * to a state reached after the cycles would be three more to follow. radau_leg() starts again where
 * the record does, since grains start to grow there.
 *
 * @param parameter in the order of physics/parameters.stan
 * @param constant parameters that are never inferred, at their places in the same order, and
 *   which law the dashpot follows; the others in it have no effect
 * @param tau output times in periods, not decreasing, all after first_tau
 * @param start_tau, first_tau start of the spin-up and of the record, in periods
 * @param period s
 * @param initial_grain_size d_0, m
 * @param temperature stated, K
 * @param relative_start stress at the start of the spin-up over S: the bias of the record
 * @param stress_scale, strain_scale S (Pa) and e
 * @param kelvin_law of kelvin_law_at(), also where its parameter is still unknown
 * @param solver 0: ode_bdf_tol; 1: radau_leg() (solvers/radau_leg.stan), and ode_bdf_tol where that
 *   does not converge
 * @return array over times of [stress (Pa), Kelvin strain, grain size (m)]
 */
array[] vector forced_oscillation_solution(vector parameter, data vector constant,
                                           data array[] real tau, data real start_tau,
                                           data real first_tau, data real period,
                                           data matrix harmonics, vector error,
                                           data int n_harmonics,
                                           data vector background_range,
                                           data real initial_grain_size,
                                           data real temperature, data real relative_start,
                                           real stress_scale, data real strain_scale,
                                           data int kelvin_law, data int solver,
                                           data real tolerance, data int max_num_steps) {
  real at_temperature = true_temperature(parameter, temperature);
  real kelvin_modulus = parameter[i_kelvin_modulus()];
  real kelvin_viscosity = kelvin_viscosity_at(parameter, at_temperature,
                                              constant[i_kelvin_reference_temperature()]);
  real stress_exponent = parameter[i_stress_exponent()];
  real grain_size_exponent = parameter[i_grain_size_exponent()];
  real inverse_critical_strain = 1 / parameter[i_critical_strain_grain_size()];
  real stiffness = parameter[i_maxwell_modulus()] * strain_scale / stress_scale;
  real kelvin_fluidity = stress_scale * period / (kelvin_viscosity * strain_scale);
  real kelvin_decay = kelvin_modulus * period / kelvin_viscosity;
  real log_dashpot_rate = log(exp(log_flow_rate_at(stress_scale, initial_grain_size,
                                                   temperature, parameter))
                              * period / strain_scale);
  int law = dashpot_law(constant);
  vector[kelvin_law > 0 ? 2 : 0] kelvin;
  int act = mechanisms_act(constant);
  vector[law > 0] dashpot;
  matrix[n_further_mechanisms(act), 3] further;
  array[size(tau)] vector[3] solution = rep_array(rep_vector(not_a_number(), 3), size(tau));
  if (kelvin_law > 0) {
    kelvin = [parameter[kelvin_law],
              log(stress_scale / constant[i_kelvin_reference_stress()])]';
  }
  if (law > 0) {
    dashpot = [parameter[law] / stress_scale]';
  }
  for (k in 1 : rows(further)) {
    further[k, 1] = log_further_rate(k, stress_scale, initial_grain_size, parameter,
                                     at_temperature)
                    + log(period / strain_scale);
    further[k, 2 : 3] = parameter[mechanism_numbers(k)[2 : 3]]';
  }
  if (size(tau) > 0 && solver == 1) {
    int n_linear = kelvin_law == 0;
    vector[29 + 2 * n_linear + cols(harmonics)] argument
      = append_row(append_row(rep_vector(0, 29), head([kelvin_decay, 1]', 2 * n_linear)),
                   harmonics' * append_row(1, error) / strain_scale);
    vector[3] from = [relative_start, 1 / grain_size_unit(act), relative_start]'; // y, w, z
    array[9] int laws = {3, place_of_dashpot_law(law), place_of_kelvin_law(kelvin_law), -1, 1, -1,
                         act, n_harmonics, cols(harmonics) - 2 * n_harmonics};
    argument[1 : 6] = [log_dashpot_rate - grain_size_exponent * log(grain_size_unit(act)),
                       stress_exponent, grain_size_exponent, kelvin_decay,
                       kelvin_fluidity / kelvin_decay, 1 / stiffness]';
    argument[9] = inverse_critical_strain * strain_scale;
    if (kelvin_law > 0) {
      argument[{12, 14}] = kelvin;
    }
    if (law > 0) {
      argument[13] = dashpot[1];
    }
    // No path strain: of the microstructure grain size alone evolves, and is a state.
    argument[15 : 16] = [stress_scale, -1]';
    for (k in 1 : rows(further)) {
      argument[21 + 3 * k] = further[k, 1] - further[k, 3] * log(grain_size_unit(act));
      argument[22 + 3 * k : 23 + 3 * k] = further[k, 2 : 3]';
    }
    if (first_tau > start_tau) {
      from = fast_oscillation(from, start_tau, {first_tau}, laws, argument, constant,
                              background_range, first_tau, initial_grain_size, strain_scale,
                              tolerance)[1];
    }
    solution = fast_oscillation(from, first_tau, tau, laws, argument, constant,
                                background_range, first_tau, initial_grain_size, strain_scale,
                                tolerance)[ : , {1, 3, 2}];
  }
  if (size(tau) > 0 && is_nan(solution[1][1])) {
    // The state at the start is an expression of data: constant to the solver.
    solution = ode_bdf_tol(forced_oscillation_rhs,
                           [relative_start, relative_start, 1 / grain_size_unit(act)]',
                           start_tau, tau, tolerance, tolerance, max_num_steps, stiffness,
                           kelvin_fluidity, kelvin_decay, stress_exponent,
                           grain_size_exponent, log_dashpot_rate, inverse_critical_strain,
                           harmonics, error, n_harmonics, background_range, first_tau,
                           stress_scale, strain_scale,
                           grain_size_unit(act) * initial_grain_size,
                           constant[{i_piezometer_reference_grain_size(),
                                     i_piezometer_exponent(), i_piezometer_stress_floor()}],
                           kelvin, dashpot, further, law, kelvin_law, act);
  }
  for (i in 1 : size(tau)) {
    solution[i] = solution[i]
                  .* [stress_scale, stress_scale / kelvin_modulus,
                      grain_size_unit(act) * initial_grain_size]';
  }
  return solution;
}

/**
 * As forced_oscillation_solution(), with a load cell whose calibration may be uncertain; the
 * stresses are what the cell reads, at the start, in stress_scale and in what is returned.
 *
 * With a certain one the stress scale is data, which spares the solver its sensitivities.
 *
 * @param sine, cosine, background most probable values
 * @param error_factor what one unit of each error adds to sine, cosine and background: a row each
 * @param error standardised errors of the driving strain
 * @param uncertain_calibration 0: c is 0
 */
array[] vector driven_solution(vector parameter, data vector constant, data array[] real tau,
                               data real start_tau, data real first_tau, data real period,
                               data vector sine, data vector cosine, data vector background,
                               data vector background_range, data matrix error_factor,
                               vector error, data int uncertain_calibration,
                               data real initial_grain_size, data real temperature,
                               data real start_stress, data real stress_scale,
                               data real strain_scale,
                               data int kelvin_law, data int solver, data real tolerance,
                               data int max_num_steps) {
  real factor = stress_reading_factor(parameter);
  array[size(tau)] vector[3] solution;
  if (!uncertain_calibration) {
    return forced_oscillation_solution(parameter, constant, tau, start_tau, first_tau, period,
                                       harmonics_of(sine, cosine, background, error_factor),
                                       error, num_elements(sine), background_range,
                                       initial_grain_size, temperature,
                                       start_stress / stress_scale, stress_scale, strain_scale,
                                       kelvin_law, solver, tolerance, max_num_steps);
  }
  solution = forced_oscillation_solution(parameter, constant, tau, start_tau, first_tau, period,
                                         harmonics_of(sine, cosine, background, error_factor),
                                         error, num_elements(sine), background_range,
                                         initial_grain_size, temperature,
                                         start_stress / stress_scale, stress_scale / factor,
                                         strain_scale, kelvin_law, solver, tolerance,
                                         max_num_steps);
  for (i in 1 : size(tau)) {
    solution[i][1] *= factor;
  }
  return solution;
}
