/**
 * Stress at imposed, piecewise constant strain rate: the two-state form of the Burgers model.
 *
 * Grain size and fabric are known functions of strain (functions/microstructure.stan), so the
 * six states of the paper reduce exactly to stress and Kelvin strain. Strain is the independent
 * variable and both states are O(1):
 *
 *   y = stress/S_0,  z = E_K kelvin_strain/(eta_K rate),
 *   dy/d(strain) = (E_M/S_0) (1 - v_K - v_d),  dz/d(strain) = (E_K/(eta_K rate)) v_K,
 *   v_K = S_0 y/(eta_K rate) - z,  v_d = (rate_0/rate) (y/F)^n (d/d_0)^-p.
 *
 * v_K and v_d are the rates of the Kelvin element and of the dashpot over the imposed rate; S_0
 * is the reference stress (functions/flow_law.stan) at the rate of the first segment, rate_0.
 * Where the Kelvin element is a power law (functions/kelvin_element.stan), v_K as given is its
 * driving stress in the unit eta_K rate, and the rate follows from that; the solver gets this form
 * only then, because every argument costs it sensitivities.
 *
 * Where the grain size follows a piezometer, which needs the stress, it is a third state:
 *
 *   w = d/d_0,  dw/d(strain) = (d_piezometer(stress)/d_0 - w)/epsilon_c1.
 */

/**
 * Rate of the dashpot over the imposed rate, v_d.
 *
 * @param scaled_stress y
 * @param log_grain_size ln(d/d_0)
 * @param log_fabric ln F
 * @param log_rate_ratio ln(rate_0/rate)
 */
real relative_dashpot_rate(real scaled_stress, real stress_exponent, real grain_size_exponent,
                           real log_grain_size, real log_fabric, data real log_rate_ratio) {
  real dashpot_rate = 0;
  if (scaled_stress != 0) {
    real log_stress = scaled_stress > 0 ? log(scaled_stress) : log(-scaled_stress);
    dashpot_rate = exp(stress_exponent * (log_stress - log_fabric)
                       - grain_size_exponent * log_grain_size + log_rate_ratio);
    if (scaled_stress < 0) {
      dashpot_rate = -dashpot_rate;
    }
  }
  return dashpot_rate;
}

/**
 * Right-hand side with a linear Kelvin element; see the head of this file.
 *
 * @param strain total strain
 * @param state [y, z]
 * @param stiffness E_M/S_0
 * @param kelvin_fluidity S_0/(eta_K rate)
 * @param kelvin_decay E_K/(eta_K rate), per unit strain
 * @param grain_size_deficit 1 - d_ss/d_0
 * @param fabric_deficit 1 - F_ss
 * @param inverse_critical_strain_grain_size 1/epsilon_c1
 * @param inverse_critical_strain_fabric 1/epsilon_c2
 * @param log_rate_ratio ln(rate_0/rate)
 */
vector constant_rate_rhs(real strain, vector state, real stiffness, real kelvin_fluidity,
                         real kelvin_decay, real stress_exponent, real grain_size_exponent,
                         real grain_size_deficit, real fabric_deficit,
                         real inverse_critical_strain_grain_size,
                         real inverse_critical_strain_fabric, data real log_rate_ratio) {
  real kelvin_rate = kelvin_fluidity * state[1] - state[2];
  real log_grain_size = log_relative_microstructure(strain, grain_size_deficit,
                                                    inverse_critical_strain_grain_size);
  real log_fabric = log_relative_microstructure(strain, fabric_deficit,
                                                inverse_critical_strain_fabric);
  real dashpot_rate = relative_dashpot_rate(state[1], stress_exponent, grain_size_exponent,
                                            log_grain_size, log_fabric, log_rate_ratio);
  return [stiffness * (1 - kelvin_rate - dashpot_rate), kelvin_decay * kelvin_rate]';
}

/**
 * Right-hand side with a power-law Kelvin element: as constant_rate_rhs(), and
 *
 * @param kelvin_stress_exponent n_K
 * @param log_kelvin_unit ln(eta_K rate/q_0)
 */
vector constant_rate_power_law_kelvin_rhs(real strain, vector state, real stiffness,
                                          real kelvin_fluidity, real kelvin_decay,
                                          real stress_exponent, real grain_size_exponent,
                                          real grain_size_deficit, real fabric_deficit,
                                          real inverse_critical_strain_grain_size,
                                          real inverse_critical_strain_fabric,
                                          data real log_rate_ratio,
                                          real kelvin_stress_exponent,
                                          real log_kelvin_unit) {
  real kelvin_rate = linear_driving_stress(kelvin_fluidity * state[1] - state[2],
                                           kelvin_stress_exponent, log_kelvin_unit);
  real log_grain_size = log_relative_microstructure(strain, grain_size_deficit,
                                                    inverse_critical_strain_grain_size);
  real log_fabric = log_relative_microstructure(strain, fabric_deficit,
                                                inverse_critical_strain_fabric);
  real dashpot_rate = relative_dashpot_rate(state[1], stress_exponent, grain_size_exponent,
                                            log_grain_size, log_fabric, log_rate_ratio);
  return [stiffness * (1 - kelvin_rate - dashpot_rate), kelvin_decay * kelvin_rate]';
}

/**
 * Right-hand side with a grain size that follows a piezometer and a power-law Kelvin element: as
 * constant_rate_power_law_kelvin_rhs() without grain_size_deficit, and
 *
 * @param state [y, z, w]
 * @param reference_stress S_0, Pa
 * @param relative_piezometer d_1/d_0
 */
vector constant_rate_piezometric_rhs(real strain, vector state, real stiffness,
                                     real kelvin_fluidity, real kelvin_decay,
                                     real stress_exponent, real grain_size_exponent,
                                     real fabric_deficit,
                                     real inverse_critical_strain_grain_size,
                                     real inverse_critical_strain_fabric,
                                     data real log_rate_ratio, real kelvin_stress_exponent,
                                     real log_kelvin_unit, real reference_stress,
                                     data real relative_piezometer) {
  real kelvin_rate = linear_driving_stress(kelvin_fluidity * state[1] - state[2],
                                           kelvin_stress_exponent, log_kelvin_unit);
  real log_fabric = log_relative_microstructure(strain, fabric_deficit,
                                                inverse_critical_strain_fabric);
  real dashpot_rate = relative_dashpot_rate(state[1], stress_exponent, grain_size_exponent,
                                            log(state[3]), log_fabric, log_rate_ratio);
  real preferred = relative_piezometer
                   * relative_piezometer_grain_size(reference_stress * state[1]);
  return [stiffness * (1 - kelvin_rate - dashpot_rate), kelvin_decay * kelvin_rate,
          (preferred - state[3]) * inverse_critical_strain_grain_size]';
}

/**
 * Scaled states at the given strains of one constant-rate segment.
 *
 * @param initial_state [y, z], or [y, z, w], at start_strain
 * @param strain increasing, all greater than start_strain
 * @param power_law_kelvin 0: the Kelvin element is linear, and n_K and q_0 have no effect
 * @param kelvin_reference_stress q_0, Pa
 * @param relative_piezometer d_1/d_0; 0: the grain size has a steady state of its own, d_ss
 * @return array over strain of [y, z], or [y, z, w]
 */
array[] vector constant_rate_segment(vector initial_state, data real start_strain,
                                     data array[] real strain, data real strain_rate,
                                     data real log_rate_ratio, real reference_stress,
                                     real maxwell_modulus, real kelvin_modulus,
                                     real kelvin_viscosity, real stress_exponent,
                                     real grain_size_exponent, real grain_size_deficit,
                                     real fabric_deficit, real critical_strain_grain_size,
                                     real critical_strain_fabric, data int power_law_kelvin,
                                     real kelvin_stress_exponent,
                                     data real kelvin_reference_stress,
                                     data real relative_piezometer,
                                     data real relative_tolerance,
                                     data real absolute_tolerance, data int max_num_steps) {
  if (relative_piezometer > 0) {
    return ode_bdf_tol(constant_rate_piezometric_rhs, initial_state, start_strain, strain,
                       relative_tolerance, absolute_tolerance, max_num_steps,
                       maxwell_modulus / reference_stress,
                       reference_stress / (kelvin_viscosity * strain_rate),
                       kelvin_modulus / (kelvin_viscosity * strain_rate), stress_exponent,
                       grain_size_exponent, fabric_deficit, 1 / critical_strain_grain_size,
                       1 / critical_strain_fabric, log_rate_ratio, kelvin_stress_exponent,
                       log(kelvin_viscosity * strain_rate / kelvin_reference_stress),
                       reference_stress, relative_piezometer);
  }
  if (power_law_kelvin) {
    return ode_bdf_tol(constant_rate_power_law_kelvin_rhs, initial_state, start_strain, strain,
                       relative_tolerance, absolute_tolerance, max_num_steps,
                       maxwell_modulus / reference_stress,
                       reference_stress / (kelvin_viscosity * strain_rate),
                       kelvin_modulus / (kelvin_viscosity * strain_rate), stress_exponent,
                       grain_size_exponent, grain_size_deficit, fabric_deficit,
                       1 / critical_strain_grain_size, 1 / critical_strain_fabric,
                       log_rate_ratio, kelvin_stress_exponent,
                       log(kelvin_viscosity * strain_rate / kelvin_reference_stress));
  }
  return ode_bdf_tol(constant_rate_rhs, initial_state, start_strain, strain,
                     relative_tolerance, absolute_tolerance, max_num_steps,
                     maxwell_modulus / reference_stress,
                     reference_stress / (kelvin_viscosity * strain_rate),
                     kelvin_modulus / (kelvin_viscosity * strain_rate), stress_exponent,
                     grain_size_exponent, grain_size_deficit, fabric_deficit,
                     1 / critical_strain_grain_size, 1 / critical_strain_fabric,
                     log_rate_ratio);
}

/**
 * Stress and Kelvin strain along a test that starts at rest and steps through strain rates.
 *
 * The solver is restarted at every step of the rate; stress and Kelvin strain are carried over.
 *
 * @param strain output strains, increasing and positive; the strain of every rate step is one of
 *   them, as the last output of the segment that ends there
 * @param n_strains_in number of output strains in each segment
 * @param segment_start strain at which each segment starts, the first 0
 * @param segment_rate imposed strain rate of each segment, 1/s
 * @param reference_stress S_0 at the rate of the first segment, Pa
 * @param kelvin_viscosity eta_K at the temperature of the test, Pa s
 * @param power_law_kelvin, kelvin_reference_stress, relative_piezometer see
 *   constant_rate_segment()
 * @return array over output strains of [stress (Pa), kelvin strain], and the grain size (m) where
 *   it follows a piezometer
 */
array[] vector constant_rate_solution(data array[] real strain, data array[] int n_strains_in,
                                      data array[] real segment_start,
                                      data array[] real segment_rate,
                                      data real initial_grain_size, real reference_stress,
                                      real maxwell_modulus, real kelvin_modulus,
                                      real kelvin_viscosity, real stress_exponent,
                                      real grain_size_exponent, real steady_state_grain_size,
                                      real steady_state_fabric_factor,
                                      real critical_strain_grain_size,
                                      real critical_strain_fabric, data int power_law_kelvin,
                                      real kelvin_stress_exponent,
                                      data real kelvin_reference_stress,
                                      data real relative_piezometer,
                                      data real relative_tolerance,
                                      data real absolute_tolerance, data int max_num_steps) {
  real grain_size_deficit = 1 - steady_state_grain_size / initial_grain_size;
  real fabric_deficit = 1 - steady_state_fabric_factor;
  int n_states = relative_piezometer > 0 ? 3 : 2;
  array[size(strain)] vector[n_states] solution;
  vector[n_states] state;
  int first = 1;
  for (k in 1 : size(segment_start)) {
    int last = first + n_strains_in[k] - 1;
    array[n_strains_in[k]] vector[n_states] scaled;
    if (n_strains_in[k] > 0) {
      if (k == 1) {
        // A literal initial state is constant to the solver: no sensitivities to it.
        scaled = constant_rate_segment(append_row(rep_vector(0, 2),
                                                  rep_vector(1, n_states - 2)),
                                       segment_start[k], strain[first : last], segment_rate[k],
                                       log(segment_rate[1] / segment_rate[k]), reference_stress,
                                       maxwell_modulus, kelvin_modulus, kelvin_viscosity,
                                       stress_exponent, grain_size_exponent,
                                       grain_size_deficit, fabric_deficit,
                                       critical_strain_grain_size, critical_strain_fabric,
                                       power_law_kelvin, kelvin_stress_exponent,
                                       kelvin_reference_stress, relative_piezometer,
                                       relative_tolerance, absolute_tolerance, max_num_steps);
      } else {
        state[2] *= segment_rate[k - 1] / segment_rate[k];
        scaled = constant_rate_segment(state, segment_start[k], strain[first : last],
                                       segment_rate[k], log(segment_rate[1] / segment_rate[k]),
                                       reference_stress, maxwell_modulus, kelvin_modulus,
                                       kelvin_viscosity, stress_exponent, grain_size_exponent,
                                       grain_size_deficit, fabric_deficit,
                                       critical_strain_grain_size, critical_strain_fabric,
                                       power_law_kelvin, kelvin_stress_exponent,
                                       kelvin_reference_stress, relative_piezometer,
                                       relative_tolerance, absolute_tolerance, max_num_steps);
      }
      for (i in 1 : n_strains_in[k]) {
        solution[first + i - 1][1] = reference_stress * scaled[i][1];
        solution[first + i - 1][2] = scaled[i][2] * kelvin_viscosity * segment_rate[k]
                                     / kelvin_modulus;
        if (relative_piezometer > 0) {
          solution[first + i - 1][3] = scaled[i][3] * initial_grain_size;
        }
      }
      state = scaled[n_strains_in[k]];
    }
    first = last + 1;
  }
  return solution;
}

/**
 * Stress and Kelvin strain along a test at given parameters: constant_rate_solution().
 *
 * @param parameter in the order of functions/parameters.stan
 * @param temperature of the test, K
 * @param constants parameters that are never inferred, at their places in the same order
 */
array[] vector constant_rate_solution_at(vector parameter, data array[] real strain,
                                         data array[] int n_strains_in,
                                         data array[] real segment_start,
                                         data array[] real segment_rate,
                                         data real initial_grain_size, data real temperature,
                                         data vector constants, data int power_law_kelvin,
                                         data real relative_tolerance,
                                         data real absolute_tolerance, data int max_num_steps) {
  real reference_stress = exp(log_reference_stress(segment_rate[1], initial_grain_size,
                                                   temperature, parameter[4], parameter[5],
                                                   parameter[6], parameter[7]));
  real kelvin_viscosity = kelvin_viscosity_at(parameter[3], parameter[14], temperature,
                                              constants[16]);
  return constant_rate_solution(strain, n_strains_in, segment_start, segment_rate,
                                initial_grain_size, reference_stress, parameter[1],
                                parameter[2], kelvin_viscosity, parameter[4], parameter[5],
                                parameter[8], parameter[9], parameter[10], parameter[11],
                                power_law_kelvin, parameter[13], constants[15],
                                constants[18] / initial_grain_size, relative_tolerance,
                                absolute_tolerance, max_num_steps);
}
