/**
 * Evolution of mean grain size and of crystal fabric with strain (Maor et al., Eqs. 3 and 4).
 *
 * Both relax exponentially with the path strain gamma = integral of |strain rate| dt, which is
 * known in advance wherever the strain rate is imposed; the closed forms are exact there.
 */

/**
 * Rate of a microstructural variable, |strain rate| (steady state - value)/critical strain
 * (Eq. 3 with the grain size d in m, Eq. 4 with the fabric factor F).
 *
 * @return rate in the variable's unit per second
 */
real microstructure_rate(real value, real steady_state, real critical_strain, real strain_rate) {
  return (strain_rate < 0 ? -strain_rate : strain_rate) * (steady_state - value) / critical_strain;
}

/**
 * Grain size that a stress wants, d_1 (|stress|/1 MPa)^-m (Maor et al., Eq. 5).
 *
 * Eq. 5 is printed without the absolute value and without a floor: grains would grow without
 * limit in every passage of the stress through zero. |stress| is replaced by
 * sqrt(stress^2 + stress_floor^2), a floor without a corner.
 *
 * @param stress sigma, Pa
 * @param reference_grain_size d_1, in any unit; that of the grain size returned
 * @param exponent m
 * @param stress_floor Pa
 */
real piezometer_grain_size(real stress, real reference_grain_size, real exponent,
                           real stress_floor) {
  return reference_grain_size
         * pow(square(1e-6 * stress_floor) + square(1e-6 * stress), -0.5 * exponent);
}

/**
 * Value of a microstructural variable after a path strain: Eq. 3 or 4 integrated.
 *
 * @param initial value of the undeformed material
 * @param path_strain gamma >= 0
 */
real microstructure_at(real path_strain, real initial, real steady_state, real critical_strain) {
  return steady_state + (initial - steady_state) * exp(-path_strain / critical_strain);
}

/**
 * ln of a microstructural variable relative to its initial value.
 *
 * log1p and expm1 keep it accurate, and cheap to differentiate, near the undeformed state.
 *
 * @param path_strain gamma; below 0, where only a trial step of a solver can come, nothing has changed
 * @param deficit 1 - steady state/initial value
 * @param inverse_critical_strain 1/critical strain
 */
real log_relative_microstructure(real path_strain, real deficit, real inverse_critical_strain) {
  if (path_strain < 0) {
    return 0;
  }
  return log1p(deficit * expm1(-path_strain * inverse_critical_strain));
}
