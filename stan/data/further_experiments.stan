// Further tests of a joint fit after the first, whose data are those of a single fit; ragged
// arrays hold one test after the other. n_further = 0: a single fit.
int<lower=0> n_further;
array[n_further] real<lower=0> further_temperature; // K
array[n_further] real<lower=0> further_initial_grain_size; // m
array[n_further] int<lower=1> n_further_segments;
array[sum(n_further_segments)] real<lower=0> further_segment_start;
array[sum(n_further_segments)] real<lower=0> further_segment_rate; // 1/s
array[n_further] int<lower=0> n_further_strains;
array[sum(n_further_strains)] real<lower=0> further_strain;
array[sum(n_further_segments)] int<lower=0> n_further_strains_in_segment;
array[n_further] int<lower=0> n_further_points;
array[sum(n_further_points)] int<lower=1> further_strain_of_point; // among those of its test
vector[sum(n_further_points)] further_stress_observed; // Pa
array[n_further] int<lower=0> n_further_grid;
array[sum(n_further_grid)] real<lower=0> further_grid_strain;
array[sum(n_further_segments)] int<lower=0> n_further_grid_in_segment;
// Priors; their families are those of the first test.
array[n_further] vector[n_parameters()] further_prior_location;
array[n_further] vector[n_parameters()] further_prior_scale;
array[n_further] vector[n_parameters()] further_prior_lower;
array[n_further] vector[n_parameters()] further_prior_upper;
// Coordinates after those of the first test: the own ones of the further tests, then the centres
// and the spreads of the partially pooled parameters.
int<lower=0> n_further_coordinates;
// Where the coordinates of each test stand among all; up to n_coordinates: shared with the first.
array[n_further, n_coordinates] int<lower=1, upper=n_coordinates + n_further_coordinates>
  further_position;
array[n_further] vector[n_coordinates] further_quantity_shift;
array[n_further] vector[n_coordinates] further_quantity_scale;
array[n_further] vector[n_coordinates] further_quantity_lower;
array[n_further] vector[n_coordinates] further_quantity_upper;
// Partial pooling: coordinates of a test whose plain values scatter around a common centre.
int<lower=0, upper=n_coordinates> n_pooled;
array[n_pooled] int<lower=1, upper=n_coordinates> pooled_coordinate;
vector<lower=0>[n_pooled] spread_scale; // of the half-normal priors of the spreads
// Valley coordinates of the further tests, and where the centres and ln(spread/scale) start.
array[n_further] int<lower=0> n_further_knots;
vector<lower=0>[sum(n_further_knots)] further_knot_time_step;
vector[sum(n_further_knots)] further_knot_stress;
array[n_further] int<lower=0> n_further_pins;
array[sum(n_further_pins)] int<lower=1> further_pin_knot;
matrix[sum(n_further_pins), 6] further_pin;
array[n_further] vector[coordinate_system == 2 ? n_coordinates : 0] further_reference_coordinate;
array[n_further] vector[coordinate_system == 2 ? n_coordinates : 0] further_linear_from;
array[n_further] vector<lower=0, upper=1>[coordinate_system == 2 ? n_coordinates : 0]
  further_noise_exponent;
vector[2 * n_pooled] pooling_reference;
