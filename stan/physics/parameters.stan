/**
 * The parameter vector, SI, and where each parameter stands in it: i_NAME().
 *
 * Priors, fixed values and `parameter` in the programs have this order. Those of variants have
 * standard values that leave them without effect (docs/variants.md).
 */
int n_parameters() { return 82; }

int i_maxwell_modulus() { return 1; } // E_M, Pa
int i_kelvin_modulus() { return 2; } // E_K, Pa
int i_kelvin_viscosity() { return 3; } // eta_K, Pa s
int i_stress_exponent() { return 4; } // n
int i_grain_size_exponent() { return 5; } // p
int i_activation_enthalpy() { return 6; } // Q_M, J/mol
int i_beta() { return 7; } // ln(A)/Q_M, mol/J
int i_steady_state_grain_size() { return 8; } // d_ss, m
int i_steady_state_fabric_factor() { return 9; } // F_ss
int i_critical_strain_grain_size() { return 10; } // epsilon_c1
int i_critical_strain_fabric() { return 11; } // epsilon_c2
int i_stress_noise() { return 12; } // s, Pa

// Of variants
int i_kelvin_stress_exponent() { return 13; } // n_K
int i_kelvin_activation_enthalpy() { return 14; } // Q_K, J/mol
int i_kelvin_reference_stress() { return 15; } // q_0, Pa, always fixed
int i_kelvin_reference_temperature() { return 16; } // T_0, K, always fixed
int i_residual_correlation_strain() { return 17; } // epsilon_r

// Of the material's piezometer, always fixed
int i_piezometer_reference_grain_size() { return 18; } // d_1, m; 0: there is none
int i_piezometer_exponent() { return 19; } // m
int i_piezometer_stress_floor() { return 20; } // sigma_f, Pa

// Of variants
int i_breakdown_stress() { return 21; } // sigma_L, Pa; 0: the dashpot is a power law
int i_residual_correlated_share() { return 22; } // w, of the variance of residuals
int i_modulus_temperature_coefficient() { return 23; } // a_E, 1/K; E_M(T) = E_M [1 + a_E (T - T_E)]
int i_modulus_reference_temperature() { return 24; } // T_E, K, always fixed
int i_attenuation_scatter() { return 25; } // s_Q, of ln(tan delta)
int i_modulus_scatter() { return 26; } // s_G, of ln(modulus)

// Of readings of strain (loading histories)
int i_strain_noise() { return 27; } // s_e, standard deviation of the residuals of strain
int i_residual_correlation_time() { return 28; } // tau_r, s
int i_strain_offset() { return 29; } // strain read where the strain is 0
int i_apparatus_compliance() { return 30; } // C, 1/Pa, strain of the apparatus over stress

// Of laws of the Kelvin part, physics/relaxation.stan
int i_relaxation_time_decades() { return 31; } // log10(tau_H/tau_L); 0: one relaxation time
int i_relaxation_exponent() { return 32; } // alpha of the band
int i_peak_strength() { return 33; } // Delta_P, over 1/E_M; 0: no peak
int i_peak_time_decades() { return 34; } // log10(tau_H/tau_P)
int i_peak_width() { return 35; } // sigma_P, of ln(tau)
int i_andrade_exponent() { return 36; } // a; 0: the part is no Andrade creep
int i_kelvin_grain_size_exponent() { return 37; } // m_K, of relaxation times
int i_kelvin_reference_grain_size() { return 38; } // d_K, m, always fixed

int i_threshold_stress() { return 39; } // sigma_t, Pa; 0: the dashpot has no threshold

// Of the backstress, physics/hardening.stan
int i_hardening_modulus() { return 40; } // H, Pa; 0: the dashpot has no backstress
int i_backstress_limit() { return 41; } // sigma_max, Pa
int i_recovery_rate() { return 42; } // r, 1/s, at sigma_max and T_0
int i_recovery_exponent() { return 43; } // m
int i_recovery_activation_enthalpy() { return 44; } // Q_r, J/mol
int i_initial_backstress() { return 45; } // sigma_b0, Pa, at the start of a test
int i_source_stress() { return 46; } // sigma_d, Pa, at d_K
int i_boundary_recovery() { return 47; } // c_r
int i_reference_backstress() { return 48; } // sigma_0, Pa, always fixed; 0: no dislocations

int i_discrepancy() { return 49; } // of the law, over the reading error; 0: w parts the residuals

// Of further mechanisms of the dashpot, physics/dashpot_mechanisms.stan
int i_second_rate() { return 50; } // r_2, 1/s, at S_r, d_r and T_r; 0: there is none
int i_second_stress_exponent() { return 51; } // n_2
int i_second_grain_size_exponent() { return 52; } // p_2
int i_second_activation_enthalpy() { return 53; } // Q_2, J/mol
int i_second_in_series() { return 54; } // 1: with the first, 0: beside it, always fixed
int i_third_rate() { return 55; } // r_3, as r_2
int i_third_stress_exponent() { return 56; } // n_3
int i_third_grain_size_exponent() { return 57; } // p_3
int i_third_activation_enthalpy() { return 58; } // Q_3, J/mol
int i_third_in_series() { return 59; } // 1: with the second, 0: beside both, always fixed
int i_mechanism_reference_stress() { return 60; } // S_r, Pa, always fixed
int i_mechanism_reference_grain_size() { return 61; } // d_r, m, always fixed
int i_mechanism_reference_temperature() { return 62; } // T_r, K, always fixed

// Of the environment, physics/environment.stan, which has the three of a rate in a row
int i_activation_volume() { return 63; } // V_M, m^3/mol
int i_water_exponent() { return 64; } // r_f
int i_melt_factor() { return 65; } // alpha_phi
int i_second_activation_volume() { return 66; } // V_M2, m^3/mol
int i_second_water_exponent() { return 67; } // r_f2
int i_second_melt_factor() { return 68; } // alpha_phi2
int i_third_activation_volume() { return 69; } // V_M3, m^3/mol
int i_third_water_exponent() { return 70; } // r_f3
int i_third_melt_factor() { return 71; } // alpha_phi3
int i_kelvin_activation_volume() { return 72; } // V_MK, m^3/mol
int i_kelvin_water_exponent() { return 73; } // r_fK
int i_kelvin_melt_factor() { return 74; } // alpha_phiK
int i_recovery_activation_volume() { return 75; } // V_Mr, m^3/mol
int i_recovery_water_exponent() { return 76; } // r_fr
int i_recovery_melt_factor() { return 77; } // alpha_phir

// Of the conditions of a test; errors are 0 where conditions are taken as known
int i_temperature_error() { return 78; } // true less stated temperature, K
int i_stress_calibration_error() { return 79; } // c: the load cell reads 1 + c times the stress
int i_pressure() { return 80; } // P, Pa, always fixed
int i_water_fugacity() { return 81; } // f, Pa, always fixed
int i_melt_fraction() { return 82; } // phi, always fixed

/** Temperature of a test (K): the stated one and its error. */
real true_temperature(vector parameter, data real stated) {
  return stated + parameter[i_temperature_error()];
}

/** What a load cell reads over the stress, 1 + c. */
real stress_reading_factor(vector parameter) {
  return 1 + parameter[i_stress_calibration_error()];
}

/** Elastic modulus at a temperature (K), E_M [1 + a_E (T - T_E)], Pa. */
vector maxwell_modulus_at(vector parameter, vector temperature) {
  return parameter[i_maxwell_modulus()]
         * (1
            + parameter[i_modulus_temperature_coefficient()]
              * (temperature - parameter[i_modulus_reference_temperature()]));
}

/** Standard deviation of residuals over s: with a discrepancy s is that of the reading alone. */
real residual_over_noise(vector parameter) {
  return sqrt(1 + square(parameter[i_discrepancy()]));
}

/** Share of the variance of residuals that correlates: w, or the share of the discrepancy. */
real share_that_correlates(vector parameter) {
  real discrepancy = square(parameter[i_discrepancy()]);
  return discrepancy > 0 ? discrepancy / (1 + discrepancy)
                         : parameter[i_residual_correlated_share()];
}
