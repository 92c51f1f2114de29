// Valley coordinates (functions/valley_coordinates.stan); all sizes 0 with plain coordinates.
int<lower=1, upper=2> coordinate_system; // 1 plain, 2 valley
int<lower=0> n_knots; // the reference curve: the solution at the reference point
vector<lower=0>[n_knots] knot_time_step; // time since the knot before, the first since 0, s
vector[n_knots] knot_stress; // Pa
int<lower=0> n_pins; // knots at which the softening is pinned to the reference curve
array[n_pins] int<lower=1, upper=n_knots> pin_knot;
matrix[n_pins, 6] pin; // columns: see functions/valley_coordinates.stan
vector[coordinate_system == 2 ? n_coordinates : 0] reference_coordinate; // plain
// where a coordinate turns from logarithmic to linear; below 0: in the inverse; 0: plain
vector[coordinate_system == 2 ? n_coordinates : 0] linear_from;
// power of the stress noise with which the width of a coordinate grows
vector<lower=0, upper=1>[coordinate_system == 2 ? n_coordinates : 0] noise_exponent;
