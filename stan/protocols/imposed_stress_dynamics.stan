/**
 * Strain under imposed stress with frozen microstructure: a hold at the median stress, then cycles
 * median_stress + amplitude sin(angular_frequency t).
 *
 * Stress being known, spring, Kelvin element and dashpot answer independently:
 *
 *   dz/dt = (sigma/sigma_max - z) E_K/eta_K,   z = E_K kelvin_strain/sigma_max,
 *   dw/dt = angular_frequency g(sigma)/g(sigma_max),
 *   w = angular_frequency dashpot_strain/g(sigma_max),
 *
 * (with a power-law Kelvin element its linear driving stress in place of sigma/sigma_max - z, see
 * physics/kelvin_element.stan), with g the flow law (physics/flow_law.stan) and sigma_max = median_stress + amplitude. z is
 * O(1), and w counts the radians that the dashpot would need at its fastest.
 */

/** Imposed stress (Pa) at a time (s) since the cycles started. */
real cyclic_stress(real time, real median_stress, real amplitude, real angular_frequency) {
  return median_stress + amplitude * sin(angular_frequency * time);
}

/**
 * Right-hand side; see the head of this file.
 *
 * @param time since the cycles started, s
 * @param state [z, w]
 * @param amplitude of the cycles, Pa; 0 while the median stress is held
 * @param largest_stress sigma_max, Pa
 * @param kelvin_viscosity eta_K at the temperature of the test, Pa s
 * @param breakdown_stress sigma_L, Pa; 0: the dashpot is a power law
 * @param log_factor value of log_rate_factor()
 * @param kelvin_stress_exponent n_K
 * @param log_kelvin_unit ln(sigma_max/q_0)
 */
vector imposed_stress_rhs(real time, vector state, real median_stress, real amplitude,
                          real largest_stress, real angular_frequency, real kelvin_modulus,
                          real kelvin_viscosity, real stress_exponent, real grain_size_exponent,
                          real breakdown_stress, real grain_size, real fabric_factor,
                          real log_factor,
                          real kelvin_stress_exponent, real log_kelvin_unit) {
  real stress = cyclic_stress(time, median_stress, amplitude, angular_frequency);
  real dashpot_rate
    = dashpot_strain_rate(power_law_stress(stress, breakdown_stress, fabric_factor), grain_size,
                          fabric_factor, stress_exponent, grain_size_exponent, log_factor);
  real largest_rate
    = dashpot_strain_rate(power_law_stress(largest_stress, breakdown_stress, fabric_factor),
                          grain_size, fabric_factor, stress_exponent, grain_size_exponent,
                          log_factor);
  real driving_stress = linear_driving_stress(stress / largest_stress - state[1],
                                              kelvin_stress_exponent, log_kelvin_unit);
  return [driving_stress * kelvin_modulus / kelvin_viscosity,
          angular_frequency * dashpot_rate / largest_rate]';
}

/**
 * Kelvin and dashpot strain at times since the cycles started, the material being at rest when
 * the median stress is put on.
 *
 * The solver is restarted when the cycles start, where the stress has a kink.
 *
 * @param time increasing, greater than -hold_time, s; 0, the end of the hold, is one of them
 * @param n_in_hold number of times up to 0
 * @param hold_time s, positive
 * @param kelvin_reference_stress q_0, Pa
 * @return array over time of [kelvin strain, dashpot strain]
 */
array[] vector imposed_stress_solution(data array[] real time, data int n_in_hold,
                                       data real hold_time, real median_stress, real amplitude,
                                       real angular_frequency, real kelvin_modulus,
                                       real kelvin_viscosity, real stress_exponent,
                                       real grain_size_exponent, real breakdown_stress,
                                       real grain_size, real fabric_factor, real log_factor,
                                       real kelvin_stress_exponent,
                                       data real kelvin_reference_stress,
                                       data real tolerance, data int max_num_steps) {
  real largest_stress = median_stress + amplitude;
  real dashpot_scale = dashpot_strain_rate(power_law_stress(largest_stress, breakdown_stress,
                                                            fabric_factor), grain_size,
                                           fabric_factor, stress_exponent, grain_size_exponent,
                                           log_factor)
                       / angular_frequency;
  real kelvin_scale = largest_stress / kelvin_modulus;
  real log_kelvin_unit = log(largest_stress / kelvin_reference_stress);
  int n = size(time);
  array[n] vector[2] solution;
  solution[1 : n_in_hold]
    = ode_bdf_tol(imposed_stress_rhs, rep_vector(0, 2), -hold_time, time[1 : n_in_hold],
                  tolerance, tolerance, max_num_steps, median_stress, 0.0,
                  largest_stress, angular_frequency, kelvin_modulus, kelvin_viscosity,
                  stress_exponent, grain_size_exponent, breakdown_stress, grain_size,
                  fabric_factor, log_factor, kelvin_stress_exponent, log_kelvin_unit);
  if (n_in_hold < n) {
    // The dashpot's strain starts anew: its tolerance is relative to what the cycles add.
    solution[n_in_hold + 1 : n]
      = ode_bdf_tol(imposed_stress_rhs, [solution[n_in_hold][1], 0]', 0, time[n_in_hold + 1 : n],
                    tolerance, tolerance, max_num_steps, median_stress,
                    amplitude, largest_stress, angular_frequency, kelvin_modulus,
                    kelvin_viscosity, stress_exponent, grain_size_exponent, breakdown_stress,
                    grain_size, fabric_factor, log_factor, kelvin_stress_exponent, log_kelvin_unit);
    for (i in n_in_hold + 1 : n) {
      solution[i][2] += solution[n_in_hold][2];
    }
  }
  for (i in 1 : n) {
    solution[i] = [kelvin_scale * solution[i][1], dashpot_scale * solution[i][2]]';
  }
  return solution;
}
