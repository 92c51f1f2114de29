/**
 * Several tests: parameters that are shared, partially pooled or separate.
 *
 * Every test has the same free parameters. A shared one has a coordinate in the first of the tests
 * that share it: all tests, or those of one furnace or load cell.
 * Behind a partially pooled one is a real number u in every test (charts/plain.stan), normal with
 * a common centre and spread; the centre has the parameter's own prior, the spread a half-normal
 * one. The coordinate of u is centred and scaled by pooling and data together, data taken as
 * normal around a reference point: a small spread then gives (u - centre)/spread, for which the
 * spread is no funnel, a large one u itself from the reference, which the spread does not move.
 * In plain coordinates data have no say in this.
 */

/**
 * Values of one test with those that it shares with others.
 *
 * @param parameter of every test; those of earlier ones are known
 * @param shared_from the test whose value it is, for each of the shared parameters
 */
vector with_shared(vector value, array[] vector parameter, data array[] int shared_from,
                   data array[] int shared_parameter) {
  vector[num_elements(value)] common = value;
  for (h in 1 : size(shared_parameter)) {
    common[shared_parameter[h]] = parameter[shared_from[h]][shared_parameter[h]];
  }
  return common;
}

/**
 * Real number u behind a partially pooled parameter.
 *
 * @param reference u that data ask for
 * @param data_precision how firmly they do; it matters for speed only
 * @return u, then ln |du/d(coordinate)|
 */
vector pooled_number(real coordinate, real centre, real spread, data real reference,
                     data real data_precision) {
  real precision = 1 / square(spread) + data_precision;
  return [(centre / square(spread) + reference * data_precision) / precision
          + coordinate / sqrt(precision),
          -0.5 * log(precision)]';
}

/**
 * Log density of a partially pooled parameter, on the scale of the parameter itself.
 *
 * @param u real number behind it
 */
real pooled_log_density(real u, real centre, real spread, data row_vector quantity) {
  return normal_lpdf(u | centre, spread) - log_slope_of_bounded(u, quantity);
}

/**
 * Values of one test with its partially pooled ones.
 *
 * @param coordinate of the pooled parameters of this test
 * @param centre, spread of their real numbers
 * @param pooled_parameter places of the parameters
 * @return parameters, then ln |d(pooled parameters)/d(coordinate)| and their ln density
 */
vector with_pooled(vector value, vector coordinate, vector centre, vector spread,
                   data array[] int pooled_parameter, data matrix quantity,
                   data vector reference, data real data_precision) {
  vector[num_elements(value)] pooled = value;
  real log_jacobian = 0;
  real log_density = 0;
  for (h in 1 : num_elements(coordinate)) {
    vector[2] u = pooled_number(coordinate[h], centre[h], spread[h], reference[h],
                                data_precision);
    pooled[pooled_parameter[h]] = bounded_from_real(u[1], quantity[h]);
    log_jacobian += u[2] + log_slope_of_bounded(u[1], quantity[h]);
    log_density += pooled_log_density(u[1], centre[h], spread[h], quantity[h]);
  }
  return append_row(pooled, [log_jacobian, log_density]');
}

/** Places of one part of a ragged array; `ends` of the parts, after a leading 0. */
array[] int part(array[] int ends, int number) {
  array[ends[number + 1] - ends[number]] int places;
  for (i in 1 : size(places)) {
    places[i] = ends[number] + i;
  }
  return places;
}
