/**
 * Point of the flow law that the plain coordinates of a loading history hold: ln of the dashpot's
 * rate at the largest stress of the test.
 *
 * Of a power law it is the rate of the undeformed material, from which hardening by a factor F takes
 * n ln F. A hyperbolic sine takes stress/(F sigma_L) instead, which can be 50 and more: the rate of
 * undeformed material is astronomic then, and no data fix it. So it is that of the material after the
 * largest strain of the test. A shift by a function of other coordinates changes no volume.
 */

/**
 * ln of that rate over the rate of the undeformed material by the power law.
 *
 * @param parameter in the order of physics/parameters.stan
 * @param stress largest of the test, Pa
 * @param path_strain largest strain of the test
 */
real log_reference_flow_shift(vector parameter, data real stress, data real path_strain,
                              data real initial_grain_size) {
  int law = dashpot_law(parameter);
  if (law != i_breakdown_stress()) {
    return 0;
  }
  {
    real log_fabric = log(microstructure_at(path_strain, 1,
                                            parameter[i_steady_state_fabric_factor()],
                                            parameter[i_critical_strain_fabric()]));
    real log_grain_size
      = log(microstructure_at(path_strain, 1,
                              parameter[i_steady_state_grain_size()] / initial_grain_size,
                              parameter[i_critical_strain_grain_size()]));
    return parameter[i_stress_exponent()]
           * (log(equivalent_stress(stress, law, parameter[law], exp(log_fabric),
                                    parameter[i_stress_exponent()]) / stress) - log_fabric)
           - parameter[i_grain_size_exponent()] * log_grain_size;
  }
}
