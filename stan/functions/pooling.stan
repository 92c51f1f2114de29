/**
 * Joint fits: parameters of several tests that are shared, partially pooled or separate.
 *
 * Every test has the same free parameters. A shared one has a coordinate in the first test only.
 * A partially pooled one has a real number u in every test (functions/coordinates.stan), normal
 * with a common centre and spread; the centre has the parameter's own prior, the spread a
 * half-normal one.
 */

/**
 * Log density of a partially pooled parameter, on the scale of the parameter itself.
 *
 * @param u real number behind it
 * @param scale, lower_bound, upper_bound see bounded_from_real()
 */
real pooled_log_density(real u, real centre, real spread, data real scale,
                        data real lower_bound, data real upper_bound) {
  return normal_lpdf(u | centre, spread)
         - log_slope_of_bounded(u, scale, lower_bound, upper_bound);
}

/**
 * Physical parameters of one test at given plain coordinates.
 *
 * Coordinates of partially pooled parameters are (u - centre)/spread.
 *
 * @param pooled 1 for coordinates of partially pooled parameters
 * @param centre, spread of their u; those of others have no effect
 * @return as parameters_from_plain(), then the ln density of partially pooled parameters
 */
vector parameters_from_pooled(vector coordinate, data array[] int pooled, vector centre,
                              vector spread, data array[] int parameter_of_coordinate,
                              data vector shift, data vector scale, data vector lower_bound,
                              data vector upper_bound, vector fixed_value,
                              data int replaced_parameter, data real log_rate,
                              data real initial_grain_size, data real temperature) {
  vector[num_elements(coordinate)] plain = coordinate;
  real log_jacobian = 0;
  real log_pooling = 0;
  for (i in 1 : num_elements(coordinate)) {
    if (pooled[i]) {
      plain[i] = centre[i] + spread[i] * coordinate[i];
      log_jacobian += log(spread[i]);
      log_pooling += pooled_log_density(plain[i], centre[i], spread[i], scale[i],
                                        lower_bound[i], upper_bound[i]);
    }
  }
  {
    vector[n_parameters() + 1] mapped = parameters_from_plain(plain, parameter_of_coordinate,
      shift, scale, lower_bound, upper_bound, fixed_value, replaced_parameter, 1, log_rate,
      initial_grain_size, temperature);
    mapped[n_parameters() + 1] += log_jacobian;
    return append_row(mapped, log_pooling);
  }
}

/** Width that data leave a partially pooled real number, as a guess: it matters for speed only. */
real pooled_width() {
  return 1.0;
}

/**
 * A partially pooled real number, centred and scaled by pooling and data together.
 *
 * Data are taken as normal around the reference point. A small spread then gives the coordinate
 * (u - centre)/spread, for which the spread is no funnel, a large one u itself from the reference,
 * which the spread does not move.
 *
 * @return u, then ln |du/d(coordinate)|
 */
vector pooled_from_reference(real coordinate, real reference, real centre, real spread) {
  real of_data = 1 / square(pooled_width());
  real precision = 1 / square(spread) + of_data;
  return [(centre / square(spread) + reference * of_data) / precision
          + coordinate / sqrt(precision),
          -0.5 * log(precision)]';
}

/** Where the parts of ragged arrays end, after a leading 0. */
array[] int ends_of(array[] int sizes) {
  array[size(sizes) + 1] int ends;
  ends[1] = 0;
  for (i in 1 : size(sizes)) {
    ends[i + 1] = ends[i] + sizes[i];
  }
  return ends;
}

/** Places of one part of a ragged array; `ends` as from ends_of(). */
array[] int part(array[] int ends, int number) {
  array[ends[number + 1] - ends[number]] int places;
  for (i in 1 : size(places)) {
    places[i] = ends[number] + i;
  }
  return places;
}
