// Tests at imposed, piecewise constant strain rate.
vector[point_end[n_tests + 1]] stress_observed; // Pa
array[n_tests + 1] int<lower=0> segment_end;
array[segment_end[n_tests + 1]] real<lower=0> segment_start; // strain, the first of a test 0
array[segment_end[n_tests + 1]] real<lower=0> segment_rate; // 1/s
// Strains at which the solver reports, increasing; several observations may share one.
array[n_tests + 1] int<lower=0> strain_end;
array[strain_end[n_tests + 1]] real<lower=0> strain;
array[segment_end[n_tests + 1]] int<lower=0> n_strains_in_segment;
array[point_end[n_tests + 1]] int<lower=1> strain_of_point; // among the strains of its test
vector[point_end[n_tests + 1]] point_strain;
array[point_end[n_tests + 1]] int<lower=0> point_segment; // of constant rate, of its test
// Measured microstructure: place of its strain among those of its test, and the numbers (columns: see
// statistics/measured_microstructure.stan).
array[n_tests + 1] int<lower=0> measured_end;
array[measured_end[n_tests + 1]] int<lower=1> strain_of_measured;
matrix[measured_end[n_tests + 1], 4] measured;
int<lower=0, upper=1> correlated_residuals; // 0: epsilon_r is 0 and residuals are independent
