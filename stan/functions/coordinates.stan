/**
 * Coordinates in which NUTS moves, and the way back to the physical parameters.
 *
 * Plain coordinates: every free parameter, shifted and scaled to O(1), with its prior's bounds.
 * One of them is replaced: data fix the reference stress S_0 tightly while n, p, Q_M and beta stay
 * broad along the surface of constant S_0, so ln S_0 is sampled in place of Q_M (or of beta, where
 * Q_M is fixed). The prior is still that of Q_M (or beta), evaluated on the value that follows
 * from ln S_0, times the Jacobian below: the posterior is the same one.
 */

/**
 * Physical parameters at given plain coordinates.
 *
 * @param coordinate sampled coordinates, (value - shift)/scale
 * @param parameter_of_coordinate index of the parameter that each coordinate stands for
 * @param shift, scale of each coordinate, SI (ln Pa for the reference stress)
 * @param fixed_value parameter vector; entries of free parameters are overwritten
 * @param replaced_parameter 6 (activation_enthalpy) or 7 (beta): its coordinate is ln S_0;
 *   0: none is replaced
 * @param strain_rate rate of the first segment, 1/s
 * @return parameters in the order of functions/parameters.stan
 */
vector parameters_from_plain(vector coordinate, data array[] int parameter_of_coordinate,
                             data vector shift, data vector scale, data vector fixed_value,
                             data int replaced_parameter, data real strain_rate,
                             data real initial_grain_size, data real temperature) {
  vector[num_elements(fixed_value)] parameter = fixed_value;
  for (i in 1 : num_elements(coordinate)) {
    parameter[parameter_of_coordinate[i]] = shift[i] + scale[i] * coordinate[i];
  }
  if (replaced_parameter == 6) {
    parameter[6] = activation_enthalpy_from_reference_stress(parameter[6], strain_rate,
                                                             initial_grain_size, temperature,
                                                             parameter[4], parameter[5],
                                                             parameter[7]);
  } else if (replaced_parameter == 7) {
    parameter[7] = beta_from_reference_stress(parameter[7], strain_rate, initial_grain_size,
                                              temperature, parameter[4], parameter[5],
                                              parameter[6]);
  }
  return parameter;
}

/**
 * ln |d(replaced parameter)/d(ln S_0)|; the linear scales are constants and are left out.
 */
real log_jacobian_of_plain(vector parameter, data int replaced_parameter, data real temperature) {
  if (replaced_parameter == 6) {
    return log(parameter[4]) - log(1 / (gas_constant() * temperature) - parameter[7]);
  }
  if (replaced_parameter == 7) {
    return log(parameter[4]) - log(parameter[6]);
  }
  return 0;
}
