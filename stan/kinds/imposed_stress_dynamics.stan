/**
 * Strain under imposed stress: a hold at the median stress, then cycles
 * median_stress + amplitude sin(angular_frequency t), with frozen or evolving microstructure.
 *
 * Stress being known, spring and Kelvin element answer independently of the rest:
 *
 *   dz/dt = (sigma/sigma_max - z) E_K/eta_K,   z = E_K kelvin_strain/sigma_max,
 *   dw/dt = angular_frequency g(sigma, d, F)/g(sigma_max, d_0, F_0),
 *   w = angular_frequency dashpot_strain/g(sigma_max, d_0, F_0),
 *
 * (with a power-law Kelvin element its linear driving stress in place of sigma/sigma_max - z, see
 * physics/kelvin_laws.stan), with g the flow law (physics/flow_law.stan) and
 * sigma_max = median_stress + amplitude. z is O(1), and w counts the radians that the dashpot would
 * need at its fastest.
 *
 * Where the microstructure evolves there are two more states, the path strain
 * gamma = integral of |strain rate| dt, on which the fabric factor depends in closed form, and the
 * grain size, which may follow a piezometer (physics/microstructure.stan):
 *
 *   d gamma/dt = |d sigma/dt/E_M + kelvin rate + dashpot rate|,
 *   du/dt = (d gamma/dt) (preferred grain size/d_0 - u)/epsilon_c1,   u = d/d_0.
 */

/** Imposed stress (Pa) at a time (s) since the cycles started. */
real cyclic_stress(real time, real median_stress, real amplitude, real angular_frequency) {
  return median_stress + amplitude * sin(angular_frequency * time);
}

/**
 * Right-hand side; see the head of this file.
 *
 * @param time since the cycles started, s
 * @param state [z, w], or [z, w, gamma, u] where the microstructure evolves
 * @param amplitude of the cycles, Pa; 0 while the median stress is held
 * @param largest_stress sigma_max, Pa
 * @param parameter in the order of physics/parameters.stan
 * @param temperature K
 * @param initial [d_0 (m), F_0]
 */
vector imposed_stress_rhs(real time, vector state, data real median_stress, data real amplitude,
                          data real largest_stress, data real angular_frequency,
                          data vector parameter, data real temperature, data vector initial) {
  int evolves = num_elements(state) > 2;
  real stress = cyclic_stress(time, median_stress, amplitude, angular_frequency);
  real kelvin_viscosity
    = kelvin_viscosity_at(parameter, temperature, parameter[i_kelvin_reference_temperature()]);
  real driving_stress
    = linear_driving_stress(stress / largest_stress - state[1],
                            kelvin_law_at(parameter),
                            kelvin_law_number(parameter, kelvin_law_at(parameter)),
                            log(largest_stress / parameter[i_kelvin_reference_stress()]));
  real grain_size = evolves ? state[4] * initial[1] : initial[1];
  real fabric_factor = evolves
                       ? microstructure_at(state[3], initial[2],
                                           parameter[i_steady_state_fabric_factor()],
                                           parameter[i_critical_strain_fabric()])
                       : initial[2];
  real dashpot_rate = dashpot_rate_at(stress, 0, grain_size, fabric_factor, parameter, temperature);
  vector[num_elements(state)] rate;
  rate[1] = driving_stress * parameter[i_kelvin_modulus()] / kelvin_viscosity;
  rate[2] = angular_frequency * dashpot_rate
            / dashpot_rate_at(largest_stress, 0, initial[1], initial[2], parameter, temperature);
  if (evolves) {
    real spring_rate = amplitude * angular_frequency * cos(angular_frequency * time)
                       / parameter[i_maxwell_modulus()];
    real strain_rate
      = spring_rate + driving_stress * largest_stress / kelvin_viscosity + dashpot_rate;
    rate[3] = fmax(strain_rate, -strain_rate);
    rate[4] = microstructure_rate(state[4],
                                  preferred_grain_size(stress, parameter) / initial[1],
                                  parameter[i_critical_strain_grain_size()], rate[3]);
  }
  return rate;
}

/**
 * Strains and microstructure at times since the cycles started, the material being at rest when
 * the median stress is put on. Putting it on strains the spring at once, which is part of gamma.
 *
 * The solver is restarted when the cycles start, where the stress has a kink.
 *
 * @param time increasing, greater than -hold_time, s; 0, the end of the hold, is one of them
 * @param n_in_hold number of times up to 0
 * @param hold_time s, positive
 * @param evolves 0: the microstructure is frozen
 * @return array over time of [kelvin strain, dashpot strain], and where the microstructure evolves
 *   gamma and the grain size (m)
 */
array[] vector imposed_stress_solution(data array[] real time, data int n_in_hold,
                                       data real hold_time, data real median_stress,
                                       data real amplitude, data real angular_frequency,
                                       data vector parameter, data real temperature,
                                       data vector initial, data int evolves,
                                       data real tolerance, data int max_num_steps) {
  real largest_stress = median_stress + amplitude;
  int n = size(time);
  int n_states = evolves ? 4 : 2;
  real loading_strain = median_stress / parameter[i_maxwell_modulus()];
  vector[n_states] state = rep_vector(0, n_states);
  array[n] vector[n_states] solution;
  vector[n_states] scale = rep_vector(1, n_states);
  if (evolves) {
    state[3] = loading_strain;
    state[4] = microstructure_at(loading_strain, 1,
                                 preferred_grain_size(median_stress, parameter) / initial[1],
                                 parameter[i_critical_strain_grain_size()]);
    scale[4] = initial[1];
  }
  solution[1 : n_in_hold]
    = ode_bdf_tol(imposed_stress_rhs, state, -hold_time, time[1 : n_in_hold], tolerance, tolerance,
                  max_num_steps, median_stress, 0.0, median_stress + amplitude, angular_frequency,
                  parameter, temperature, initial);
  if (n_in_hold < n) {
    // The dashpot's strain starts anew: its tolerance is relative to what the cycles add.
    state = solution[n_in_hold];
    state[2] = 0;
    solution[n_in_hold + 1 : n]
      = ode_bdf_tol(imposed_stress_rhs, state, 0, time[n_in_hold + 1 : n], tolerance, tolerance,
                    max_num_steps, median_stress, amplitude, median_stress + amplitude,
                    angular_frequency, parameter, temperature, initial);
    for (i in n_in_hold + 1 : n) {
      solution[i][2] += solution[n_in_hold][2];
    }
  }
  scale[1] = largest_stress / parameter[i_kelvin_modulus()];
  scale[2] = dashpot_rate_at(largest_stress, 0, initial[1], initial[2], parameter, temperature)
             / angular_frequency;
  for (i in 1 : n) {
    solution[i] = scale .* solution[i];
  }
  return solution;
}
