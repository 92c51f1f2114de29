/** Microstructure of a material, its parameters in the order of physics/parameters.stan. */

/** Grain size (m) that the material would have in the end. */
real preferred_grain_size(real stress, vector parameter) {
  if (parameter[i_piezometer_reference_grain_size()] > 0) {
    return piezometer_grain_size(stress, parameter[i_piezometer_reference_grain_size()],
                                 parameter[i_piezometer_exponent()],
                                 parameter[i_piezometer_stress_floor()]);
  }
  return parameter[i_steady_state_grain_size()];
}
