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
 */

int n_parameters() {
  return 12;
}
