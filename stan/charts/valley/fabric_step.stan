/**
 * One Gauss-Newton step for epsilon_c2 and the amplitude of fabric softening, ln S_0 eliminated.
 *
 * The amplitude is not kept within the bounds of F_ss: where the rest leaves no softening to the
 * fabric, the bounds would ask for an epsilon_c2 that hides it, at either end of its range, and
 * the solution would jump from one to the other.
 *
 * @param solved real number behind epsilon_c2, amplitude
 * @return solution after the step, the Gauss-Newton matrix (1, 1), (1, 2), (2, 2), the misfit before
 *   the step, and minus half of its derivative by the amplitude
 */
vector fabric_step(vector solved, vector rest, data vector strain, vector weight,
                   data int stress_given, data matrix bounds) {
  matrix[rows(strain), 3] softening = fabric_softening(solved[1], solved[2], strain, bounds);
  // Of the derivatives by u and the amplitude, and of the strength that is left.
  matrix[3, 3] product
    = centred_products(append_col(softening[ : , 2 : 3], rest - softening[ : , 1]), weight,
                       stress_given);
  real c11 = product[1, 1] + bounded_parameter_precision();
  real c12 = product[1, 2];
  real c22 = product[2, 2] + amplitude_precision();
  real g1 = product[1, 3] + 1 - 2 * inv_logit(solved[1]);
  real g2 = product[2, 3] + amplitude_precision() * (0.5 - solved[2]);
  real determinant = c11 * c22 - square(c12);
  real u = solved[1] + limited_step((c22 * g1 - c12 * g2) / determinant);
  real amplitude = solved[2] + (c11 * g2 - c12 * g1) / determinant;
  return [u, limited_amplitude(amplitude, u, strain, bounds), c11, c12, c22,
          product[3, 3], product[2, 3]]';
}
