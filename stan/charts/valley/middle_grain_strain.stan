/**
 * Middle of the places along u_1: the solution with a softening by fabric that is linear in
 * strain, as it is where epsilon_c2 is large.
 *
 * @return u_1 and its standard deviation
 */
vector middle_grain_strain(vector asked, data vector reference, data vector strain,
                           vector weight, data int stress_given, data matrix bounds) {
  vector[rows(strain)] linear = -strain / max(strain); // softening by fabric at an amplitude of 1
  real u = reference[i_grain_strain()];
  real amplitude = 0;
  real c11;
  real c12;
  real c22;
  for (k in 1 : n_valley_steps() + 1) {
    // The last pass is for the standard deviation, at full weight.
    int is_last = k > n_valley_steps();
    real f = fmin(1, k * 1.0 / n_valley_steps());
    // Of the rest, its derivative by u, and the linear softening.
    matrix[3, 3] product
      = (is_last ? 1 : softened_share())
        * centred_products(append_col(rest_of_strength(u, asked_along_path(f, asked, reference),
                                                       strain, bounds), linear),
                           weight, stress_given);
    c11 = product[3, 3] + amplitude_precision();
    c12 = product[2, 3];
    c22 = product[2, 2] + bounded_parameter_precision();
    if (!is_last) {
      real g1 = product[1, 3] - amplitude * c11;
      real g2 = product[1, 2] - amplitude * c12 + 1 - 2 * inv_logit(u);
      real determinant = c11 * c22 - square(c12);
      amplitude += (c22 * g1 - c12 * g2) / determinant;
      u += limited_step((c11 * g2 - c12 * g1) / determinant);
    }
  }
  return [u, 1 / sqrt(c22 - square(c12) / c11)]';
}
