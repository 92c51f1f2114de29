// Tests under loading histories. A leg is a part of a test over which what is imposed is linear in
// time (protocols/loading_history_dynamics.stan has its columns); times are counted from the start
// of their leg, over its duration.
array[n_tests + 1] int<lower=0> leg_end;
matrix[leg_end[n_tests + 1], 5] leg;
array[n_tests] real<lower=0> stress_scale; // Pa, that of the reference flow rate too
array[n_tests] real<lower=0> strain_scale;
// Readings, in the order of time: stress (Pa) where strain is imposed and the other way round.
vector[point_end[n_tests + 1]] response_observed;
array[point_end[n_tests + 1]] int<lower=0, upper=1> is_strain;
array[point_end[n_tests + 1]] real<lower=0, upper=1> point_time_in_leg;
array[leg_end[n_tests + 1]] int<lower=0> n_points_in_leg;
vector[point_end[n_tests + 1]] point_time; // s since the start of the test
array[point_end[n_tests + 1]] int<lower=0> point_stage; // of its test
int<lower=0, upper=1> correlated_residuals; // 0: tau_r is 0 and residuals are independent
// Elements of the Kelvin part (history_elements()): part of its law, place in it, weight.
int<lower=1> n_elements;
matrix[n_elements, 3] element;
