// Values of the functions of the valley coordinates, on their own.
functions {
#include functions/parameters.stan
#include functions/flow_law.stan
#include functions/coordinates.stan
#include functions/pooling.stan
#include functions/valley_coordinates.stan
}
data {
  vector[2 * n_places() + 1] log_density; // at the places
  int<lower=0> n;
  vector[n] log_odds;
  real place; // of a bounded parameter in its range
  real<lower=0> deviation;
  vector[n] remainder;
  int<lower=1> n_pins;
  vector<lower=0>[n_pins] strain;
  vector[3] lower_bound;
  vector[3] upper_bound;
  vector[2] u; // real numbers behind (epsilon_c1, epsilon_c2)
  real amplitude; // 1 - F_ss
  real exponent_ratio;
  real grain_size_ratio;
}
generated quantities {
  vector[n] quantile_place;
  vector[n] quantile_log_slope;
  vector[n] bounded;
  vector[n] bounded_log_slope;
  matrix[n_pins, 2] grain = grain_softening(u[1], exponent_ratio, grain_size_ratio, strain,
                                            lower_bound, upper_bound);
  matrix[n_pins, 3] fabric = fabric_softening(u[2], amplitude, strain, lower_bound, upper_bound);
  for (i in 1 : n) {
    vector[2] quantile = place_of_quantile(log_odds[i], log_density);
    vector[2] from_remainder = bounded_from_remainder(place, deviation, remainder[i]);
    quantile_place[i] = quantile[1];
    quantile_log_slope[i] = quantile[2];
    bounded[i] = from_remainder[1];
    bounded_log_slope[i] = from_remainder[2];
  }
}
