/**
 * Solutions for the fabric at places along u_1, and their ln density apart from the prior.
 *
 * Along u_1 the misfit is that of the solution for (ln S_0, u_2, amplitude), with the amplitude
 * brought within its bounds, and their volume follows from its Gauss-Newton matrix (Laplace's
 * method).
 *
 * @param grain_strain u_1 at the places
 * @return columns for the places: u_2, amplitude, ln density
 */
matrix fabric_along_grain_strain(vector grain_strain, vector asked, data vector reference,
                                 data vector strain, vector weight, data int stress_given,
                                 data matrix bounds) {
  int middle = n_places() + 1;
  real range = bounds[3, 2] - bounds[3, 1];
  vector[rows(strain)] softened = softened_share() * weight;
  vector[2] solved = reference[{i_fabric_strain(), i_fabric_amplitude()}];
  vector[2] at_middle;
  vector[rows(strain)] rest;
  matrix[3, rows(grain_strain)] found;
  for (k in 1 : n_valley_steps()) {
    real f = k * 1.0 / n_valley_steps();
    real start = reference[i_grain_strain()];
    rest = col(rest_of_strength(start + f * (grain_strain[middle] - start),
                                asked_along_path(f, asked, reference), strain, bounds), 1);
    solved = head(fabric_step(solved, rest, strain, softened, stress_given, bounds), 2);
  }
  at_middle = solved;
  for (sign in {-1, 1}) {
    solved = at_middle;
    for (k in (sign < 0 ? 0 : 1) : n_places()) {
      int i = middle + sign * k;
      vector[7] step;
      real determinant;
      rest = col(rest_of_strength(grain_strain[i], asked, strain, bounds), 1);
      solved = head(fabric_step(solved, rest, strain, softened, stress_given, bounds), 2);
      step = fabric_step(solved, rest, strain, weight, stress_given, bounds);
      determinant = step[3] * step[5] - square(step[4]);
      found[1 : 2, i] = solved;
      found[3, i] = log_fit(step[6] + square(distance_beyond(
                              (1 - solved[2] - bounds[3, 1]) / range,
                              sqrt(step[3] / determinant) / range)))
                    - 0.5 * log(determinant) + log_inv_logit(solved[1])
                    + log1m_inv_logit(solved[1]);
    }
  }
  return found;
}
