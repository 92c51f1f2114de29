/** Dashpot and microstructure of a material, its parameters in the order of physics/parameters.stan. */

/** Rate of the dashpot (1/s) at a stress (Pa), grain size (m) and fabric factor. */
real dashpot_rate_at(real stress, real grain_size, real fabric_factor, vector parameter,
                     data real temperature) {
  return dashpot_strain_rate(power_law_stress(stress, parameter[i_breakdown_stress()],
                                              fabric_factor, parameter[i_stress_exponent()]),
                             grain_size, fabric_factor, parameter[i_stress_exponent()],
                             parameter[i_grain_size_exponent()],
                             log_rate_factor(parameter[i_activation_enthalpy()],
                                             parameter[i_beta()], temperature));
}

/** Grain size (m) that the material would have in the end. */
real preferred_grain_size(real stress, vector parameter) {
  if (parameter[i_piezometer_reference_grain_size()] > 0) {
    return piezometer_grain_size(stress, parameter[i_piezometer_reference_grain_size()],
                                 parameter[i_piezometer_exponent()],
                                 parameter[i_piezometer_stress_floor()]);
  }
  return parameter[i_steady_state_grain_size()];
}
