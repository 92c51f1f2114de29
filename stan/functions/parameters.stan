/**
 * Order of the parameter vector, shared by the data block (priors) and by the programs.
 *
 *  1 maxwell_modulus             E_M    Pa
 *  2 kelvin_modulus              E_K    Pa
 *  3 kelvin_viscosity            eta_K  Pa s
 *  4 stress_exponent             n
 *  5 grain_size_exponent         p
 *  6 activation_enthalpy         Q_M    J/mol
 *  7 beta                        ln(A)/Q_M, mol/J
 *  8 steady_state_grain_size     d_ss   m
 *  9 steady_state_fabric_factor  F_ss
 * 10 critical_strain_grain_size  epsilon_c1
 * 11 critical_strain_fabric      epsilon_c2
 * 12 stress_noise                s      Pa
 *
 * Those of variants; standard values leave them without effect (docs/variants.md):
 *
 * 13 kelvin_stress_exponent       n_K
 * 14 kelvin_activation_enthalpy   Q_K    J/mol
 * 15 kelvin_reference_stress      q_0    Pa, always fixed
 * 16 kelvin_reference_temperature T_0    K, always fixed
 * 17 residual_correlation_strain  epsilon_r
 * 18 piezometer_reference_grain_size d_1    m, always fixed
 */

int n_parameters() {
  return 18;
}
