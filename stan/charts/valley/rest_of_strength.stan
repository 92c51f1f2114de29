/**
 * Strength that is left to the fabric, and to ln S_0 where it is not given.
 *
 * @param u real number behind epsilon_c1
 * @return columns: the rest, derivative of the softening by grain size by u
 */
matrix rest_of_strength(real u, vector asked, data vector strain, data matrix bounds) {
  matrix[rows(strain), 2] rest = grain_softening(u, asked[1], asked[2], strain, bounds);
  rest[ : , 1] = tail(asked, rows(strain)) - rest[ : , 1];
  return rest;
}
