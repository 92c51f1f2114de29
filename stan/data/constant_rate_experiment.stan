// One test at imposed, piecewise constant strain rate.
real<lower=0> temperature; // K
real<lower=0> initial_grain_size; // m
int<lower=1> n_segments;
array[n_segments] real<lower=0> segment_start; // strain, the first 0
array[n_segments] real<lower=0> segment_rate; // 1/s
// Strains at which the solver reports, increasing; several observations may share one.
int<lower=0> n_strains;
array[n_strains] real<lower=0> strain;
array[n_segments] int<lower=0> n_strains_in_segment;
int<lower=0> n_points;
array[n_points] int<lower=1, upper=n_strains> strain_of_point;
vector[n_points] stress_observed; // Pa
int<lower=0, upper=1> use_likelihood; // 0: prior only
