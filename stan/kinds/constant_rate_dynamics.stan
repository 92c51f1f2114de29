/**
 * Stress at imposed, piecewise constant strain rate: the two-state form of the Burgers model.
 *
 * Grain size and fabric are known functions of strain (physics/microstructure.stan), so the
 * six states of the paper reduce exactly to stress and Kelvin strain. Strain is the independent
 * variable and both states are O(1):
 *
 *   y = stress/S_0,  z = E_K kelvin_strain/(eta_K rate),
 *   dy/d(strain) = (E_M/S_0) (1 - v_K - v_d),  dz/d(strain) = (E_K/(eta_K rate)) v_K,
 *   v_K = S_0 y/(eta_K rate) - z,  v_d = (rate_0/rate) (y/F)^n (d/d_0)^-p.
 *
 * v_K and v_d are the rates of the Kelvin element and of the dashpot over the imposed rate; S_0
 * is the reference stress (physics/flow_law.stan) at the rate of the first segment, rate_0.
 * Where the Kelvin element is a power law (physics/kelvin_laws.stan), v_K as given is its
 * driving stress in the unit eta_K rate, and the rate follows from that. With another law of the
 * dashpot (physics/dashpot_laws.stan) the equivalent stress stands for y in v_d.
 *
 * Where the grain size follows a piezometer, which needs the stress, it is a third state:
 *
 *   w = d/d_0,  dw/d(strain) = (d_piezometer(stress)/d_0 - w)/epsilon_c1.
 *
 * Numbers that only some laws need are vectors, empty in the others: every number costs the solver
 * sensitivities.
 */

/** Number of states: stress, Kelvin strain, and the grain size where it follows a piezometer. */
int n_constant_rate_states(data vector constant) {
  return constant[i_piezometer_reference_grain_size()] > 0 ? 3 : 2;
}

/**
 * Right-hand side; see the head of this file.
 *
 * @param run strain since the start of the segment
 * @param state [y, z], or [y, z, w]
 * @param stiffness E_M/S_0
 * @param kelvin_fluidity S_0/(eta_K rate)
 * @param kelvin_decay E_K/(eta_K rate), per unit strain
 * @param fabric_deficit 1 - F_ss
 * @param inverse_critical_strain 1/epsilon_c1, 1/epsilon_c2
 * @param grains 1 - d_ss/d_0, or where the grain size is a state S_0 (Pa)
 * @param kelvin of a Kelvin element that is not linear: the number of its law, ln(eta_K rate/q_0)
 * @param dashpot of another law than the power law: its stress over S_0
 * @param law, kelvin_law of dashpot_law() and kelvin_law_at()
 * @param start_strain, log_rate_ratio of the segment: its start and ln(rate_0/rate)
 * @param piezometer d_1/d_0, exponent, stress floor (Pa), see piezometer_grain_size()
 */
vector constant_rate_rhs(real run, vector state, real stiffness, real kelvin_fluidity,
                         real kelvin_decay, real stress_exponent, real grain_size_exponent,
                         real fabric_deficit, vector inverse_critical_strain, vector grains,
                         vector kelvin, vector dashpot, data int law, data int kelvin_law,
                         data real start_strain, data real log_rate_ratio,
                         data vector piezometer) {
  int n_states = num_elements(state);
  real kelvin_rate = kelvin_fluidity * state[1] - state[2];
  real log_fabric = log_relative_microstructure(start_strain + run, fabric_deficit,
                                                inverse_critical_strain[2]);
  real log_grain_size = n_states > 2
                        ? log(state[3])
                        : log_relative_microstructure(start_strain + run, grains[1],
                                                      inverse_critical_strain[1]);
  real flow_stress = state[1];
  real dashpot_rate;
  vector[n_states] slope;
  if (kelvin_law > 0) {
    kelvin_rate = linear_driving_stress(kelvin_rate, kelvin_law, kelvin[1], kelvin[2]);
  }
  if (law > 0) {
    flow_stress = equivalent_stress(flow_stress, law, dashpot[1], exp(log_fabric),
                                    stress_exponent);
  }
  dashpot_rate = signed_power(flow_stress, log_fabric, stress_exponent,
                              log_rate_ratio - grain_size_exponent * log_grain_size);
  slope[1] = stiffness * (1 - kelvin_rate - dashpot_rate);
  slope[2] = kelvin_decay * kelvin_rate;
  if (n_states > 2) {
    slope[3] = (piezometer_grain_size(grains[1] * state[1], piezometer[1], piezometer[2],
                                      piezometer[3])
                - state[3])
               * inverse_critical_strain[1];
  }
  return slope;
}

/**
 * As constant_rate_segment(), by radau_leg(); NaN if the method does not converge.
 *
 * Its unit of stresses, S, is the stress at which undeformed material flows at the first rate.
 */
array[] vector fast_constant_rate_segment(vector initial_state, data real start_strain,
                                          data array[] real strain, data real strain_rate,
                                          data real log_rate_ratio, real reference_stress,
                                          real kelvin_viscosity, vector parameter,
                                          data vector constant, data real initial_grain_size,
                                          data int kelvin_law, data real tolerance) {
  int law = dashpot_law(constant);
  int has_grains = num_elements(initial_state) > 2;
  real unit = stress_of_equivalent(reference_stress, law, dashpot_stress(parameter, law));
  real kelvin_unit = unit / (kelvin_viscosity * strain_rate);
  vector[num_elements(initial_state)] start = initial_state;
  array[size(strain)] vector[num_elements(initial_state)] states;
  vector[17] argument
    = [log_rate_ratio + parameter[i_stress_exponent()] * log(unit / reference_stress),
       parameter[i_stress_exponent()], parameter[i_grain_size_exponent()],
       parameter[i_kelvin_modulus()] / (kelvin_viscosity * strain_rate),
       unit / parameter[i_kelvin_modulus()], unit / parameter[i_maxwell_modulus()], 0,
       1 - parameter[i_steady_state_grain_size()] / initial_grain_size,
       1 / parameter[i_critical_strain_grain_size()],
       1 - parameter[i_steady_state_fabric_factor()],
       1 / parameter[i_critical_strain_fabric()], kelvin_law_number(parameter, kelvin_law),
       dashpot_stress(parameter, law) / unit,
       log(unit / constant[i_kelvin_reference_stress()]), unit, start_strain, 0]';
  start[1] *= reference_stress / unit;
  start[2] /= kelvin_unit;
  states = radau_leg({0, place_of_dashpot_law(law), place_of_kelvin_law(kelvin_law), 1, -1,
                      has_grains ? 2 : -1},
                     {0, 1, 1, constant[i_piezometer_reference_grain_size()] / initial_grain_size,
                      constant[i_piezometer_exponent()], constant[i_piezometer_stress_floor()]},
                     to_array_1d(to_vector(strain) - start_strain), tolerance, start, argument);
  if (is_nan(states[1][1])) {
    return states; // untouched: products of NaN would have derivatives
  }
  for (i in 1 : size(strain)) {
    states[i][2] *= kelvin_unit;
    if (law > 0) {
      states[i][1] *= unit / reference_stress;
    }
  }
  return states;
}

/**
 * Scaled states at the given strains of one constant-rate segment.
 *
 * The solver counts strain from the start of the segment. After a drop of the rate the stress
 * relaxes within strains of 1e-8, and steps much smaller than that would carry the rounding of the
 * total strain: at tight tolerances the solver gives up on it.
 *
 * @param initial_state [y, z], or [y, z, w], at start_strain
 * @param strain increasing, all greater than start_strain
 * @param log_rate_ratio ln(rate_0/rate)
 * @param reference_stress S_0, Pa
 * @param kelvin_viscosity eta_K at the temperature of the test, Pa s
 * @return array over strain of [y, z], or [y, z, w]
 */
array[] vector constant_rate_segment(vector initial_state, data real start_strain,
                                     data array[] real strain, data real strain_rate,
                                     data real log_rate_ratio, real reference_stress,
                                     real kelvin_viscosity, vector parameter,
                                     data vector constant, data real initial_grain_size,
                                     data int kelvin_law, data int solver,
                                     data real tolerance, data int max_num_steps) {
  int law = dashpot_law(constant);
  int n_states = num_elements(initial_state);
  int has_grains = n_states > 2;
  vector[1] grains = [has_grains
                      ? reference_stress
                      : 1 - parameter[i_steady_state_grain_size()] / initial_grain_size]';
  vector[kelvin_law > 0 ? 2 : 0] kelvin;
  vector[law > 0] dashpot;
  if (solver == 1) {
    array[size(strain)] vector[n_states] states
      = fast_constant_rate_segment(initial_state, start_strain, strain, strain_rate,
                                   log_rate_ratio, reference_stress, kelvin_viscosity, parameter,
                                   constant, initial_grain_size, kelvin_law, tolerance);
    if (!is_nan(states[1][1])) {
      return states;
    }
  }
  if (kelvin_law > 0) {
    kelvin = [parameter[kelvin_law],
              log(kelvin_viscosity * strain_rate / constant[i_kelvin_reference_stress()])]';
  }
  if (law > 0) {
    dashpot = [parameter[law] / reference_stress]';
  }
  return ode_bdf_tol(constant_rate_rhs, initial_state, 0,
                     to_array_1d(to_vector(strain) - start_strain), tolerance, tolerance,
                     max_num_steps, parameter[i_maxwell_modulus()] / reference_stress,
                     reference_stress / (kelvin_viscosity * strain_rate),
                     parameter[i_kelvin_modulus()] / (kelvin_viscosity * strain_rate),
                     parameter[i_stress_exponent()], parameter[i_grain_size_exponent()],
                     1 - parameter[i_steady_state_fabric_factor()],
                     [1 / parameter[i_critical_strain_grain_size()],
                      1 / parameter[i_critical_strain_fabric()]]',
                     grains, kelvin, dashpot, law, kelvin_law, start_strain, log_rate_ratio,
                     [constant[i_piezometer_reference_grain_size()] / initial_grain_size,
                      constant[i_piezometer_exponent()],
                      constant[i_piezometer_stress_floor()]]');
}

/**
 * Stress and Kelvin strain along a test that starts at rest and steps through strain rates.
 *
 * The solver is restarted at every step of the rate; stress and Kelvin strain are carried over.
 *
 * @param parameter in the order of physics/parameters.stan
 * @param constant parameters that are never inferred, at their places in the same order, and
 *   which law the dashpot follows; the others in it have no effect
 * @param strain output strains, increasing and positive; the strain of every rate step is one of
 *   them, as the last output of the segment that ends there
 * @param n_strains_in_segment number of output strains in each segment
 * @param segment_start strain at which each segment starts, the first 0
 * @param segment_rate imposed strain rate of each segment, 1/s
 * @param initial_grain_size m
 * @param temperature stated, K
 * @param kelvin_law of kelvin_law_at(), also where its parameter is still unknown
 * @param solver 0: ode_bdf_tol; 1: radau_leg() (solvers/radau_leg.stan), and ode_bdf_tol where that
 *   does not converge
 * @return array over output strains of [stress (Pa), kelvin strain], and the grain size (m) where
 *   it is a third state
 */
array[] vector constant_rate_solution(vector parameter, data vector constant,
                                      data array[] real strain,
                                      data array[] int n_strains_in_segment,
                                      data array[] real segment_start,
                                      data array[] real segment_rate,
                                      data real initial_grain_size, data real temperature,
                                      data int kelvin_law, data int solver,
                                      data real tolerance, data int max_num_steps) {
  int n_states = n_constant_rate_states(constant);
  real reference_stress = exp(log_reference_stress_at(parameter, segment_rate[1],
                                                      initial_grain_size, temperature));
  real kelvin_viscosity = kelvin_viscosity_at(parameter[i_kelvin_viscosity()],
                                              parameter[i_kelvin_activation_enthalpy()],
                                              true_temperature(parameter, temperature),
                                              constant[i_kelvin_reference_temperature()]);
  array[size(strain)] vector[n_states] solution;
  vector[n_states] state;
  int before = 0; // outputs of earlier segments
  for (k in 1 : size(segment_start)) {
    int n = n_strains_in_segment[k];
    if (n > 0) {
      array[n] vector[n_states] scaled;
      if (k == 1) {
        // A literal initial state is constant to the solver: no sensitivities to it.
        scaled = constant_rate_segment(append_row(rep_vector(0, 2),
                                                  rep_vector(1, n_states - 2)),
                                       segment_start[k], strain[1 : n], segment_rate[k], 0,
                                       reference_stress, kelvin_viscosity, parameter, constant,
                                       initial_grain_size, kelvin_law, solver, tolerance,
                                       max_num_steps);
      } else {
        state[2] *= segment_rate[k - 1] / segment_rate[k];
        scaled = constant_rate_segment(state, segment_start[k], strain[before + 1 : before + n],
                                       segment_rate[k], log(segment_rate[1] / segment_rate[k]),
                                       reference_stress, kelvin_viscosity, parameter, constant,
                                       initial_grain_size, kelvin_law, solver, tolerance,
                                       max_num_steps);
      }
      for (i in 1 : n) {
        solution[before + i][1] = reference_stress * scaled[i][1];
        solution[before + i][2] = scaled[i][2] * kelvin_viscosity * segment_rate[k]
                                  / parameter[i_kelvin_modulus()];
        if (n_states > 2) {
          solution[before + i][3] = scaled[i][3] * initial_grain_size;
        }
      }
      state = scaled[n];
      before += n;
    }
  }
  return solution;
}

/**
 * Grain size (m) and fabric factor along a solution.
 *
 * @param strain of its rows
 * @return columns: grain size, fabric factor
 */
matrix microstructure_along(array[] vector solution, data array[] real strain, vector parameter,
                            data real initial_grain_size) {
  matrix[size(strain), 2] microstructure;
  for (i in 1 : size(strain)) {
    microstructure[i, 1] = num_elements(solution[i]) == 3
                           ? solution[i][3]
                           : microstructure_at(strain[i], initial_grain_size,
                                               parameter[i_steady_state_grain_size()],
                                               parameter[i_critical_strain_grain_size()]);
    microstructure[i, 2] = microstructure_at(strain[i], 1,
                                             parameter[i_steady_state_fabric_factor()],
                                             parameter[i_critical_strain_fabric()]);
  }
  return microstructure;
}
