// Tests under loading histories. A leg is a part of a test over which what is imposed is linear in
// time (kinds/loading_history_dynamics.stan has its columns); times are counted from the start
// of their leg, over its duration.
array[n_tests + 1] int<lower=0> leg_end;
matrix[leg_end[n_tests + 1], 5] leg;
array[n_tests] real<lower=0> stress_scale; // Pa, that of the reference flow rate too
array[n_tests] real<lower=0> strain_scale;
// Rate (1/s) of the S_0 whose logarithm is sampled; 0: that of the flow rate at stress_scale is.
array[n_tests] real<lower=0> reference_stress_rate;
// Readings, in the order of time: stress (Pa) where strain is imposed and the other way round.
vector[point_end[n_tests + 1]] response_observed;
array[point_end[n_tests + 1]] int<lower=0, upper=1> is_strain;
// Where the solver reports: readings and sections, in the order of time.
array[n_tests + 1] int<lower=0> output_end;
array[output_end[n_tests + 1]] real<lower=0, upper=1> output_time_in_leg;
array[leg_end[n_tests + 1]] int<lower=0> n_outputs_in_leg;
array[point_end[n_tests + 1]] int<lower=0> output_of_point; // among those of its test
vector[point_end[n_tests + 1]] point_position; // along which residuals correlate: s, or strain
array[point_end[n_tests + 1]] int<lower=0> point_stage; // of its test
// Measured microstructure of sections: the place of its time among the outputs of its test, or 0 and
// the path strain that it belongs to; and the numbers (columns: see
// statistics/measured_microstructure.stan).
array[n_tests + 1] int<lower=0> measured_end;
array[measured_end[n_tests + 1]] int<lower=0> output_of_measured;
vector<lower=0>[measured_end[n_tests + 1]] measured_path_strain;
matrix[measured_end[n_tests + 1], 4] measured;
int<lower=0, upper=1> correlated_residuals; // 0: residuals are independent
int<lower=1, upper=n_parameters()> correlation_parameter; // tau_r or epsilon_r
// Elements of the Kelvin part (history_elements()): part of its law, place in it, weight.
int<lower=1> n_elements;
matrix[n_elements, 3] element;
