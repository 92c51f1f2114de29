/**
 * Softening by fabric at places along u_2, and their ln density apart from the prior.
 *
 * Along u_2 the misfit is that of the solution for (ln S_0, F_ss); where F_ss would leave its
 * bounds, the misfit at the bound counts.
 *
 * @param fabric_strain u_2 at the places
 * @param total_softening -ln F at the last pin in the middle
 * @return columns for the places: -ln F at the last pin, ln density
 */
matrix factor_along_fabric_strain(vector fabric_strain, real total_softening, vector rest,
                                  data vector strain, vector weight, data int stress_given,
                                  data matrix bounds) {
  real range = bounds[3, 2] - bounds[3, 1];
  matrix[2, rows(fabric_strain)] found;
  for (sign in {-1, 1}) {
    real total_before = total_softening;
    for (k in (sign < 0 ? 0 : 1) : n_places()) {
      int i = n_places() + 1 + sign * k;
      vector[4] factor = solve_fabric_factor(total_before, fabric_strain[i], rest, 1, strain,
                                             weight, stress_given, bounds);
      real c = 1 / (range * sqrt(factor[2]));
      total_before = factor[4];
      found[ : , i]
        = [factor[4],
           log_fit(factor[3] + square(distance_beyond((factor[1] - bounds[3, 1]) / range, c)))
           + log(c)]';
    }
  }
  return found;
}
