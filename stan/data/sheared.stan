// Sheared coordinates (charts/sheared.stan).
array[n_tests] vector[3] flow_slope; // of ln(flow rate s) by n, p and p ln(d/d_0)
array[n_tests] vector[3] flow_reference; // n, p and epsilon_c1 where the flow rate is not shifted
array[n_tests] real log_rate_scale; // ln(flow rate s) from where the coordinate is the rate
// Solutions at the mode but for the flow rate:
array[n_tests] real first_log_rate; // ln(flow rate s)
real<lower=0> log_rate_step;
int<lower=2> n_solutions;
array[n_tests] vector[n_solutions] log_dashpot_compliance; // ln(loss compliance / (1/Pa))
// What the shifts want to know of a record beside its data above.
array[n_tests] real storage_compliance; // strain over stress of the fundamental, 1/Pa
array[n_tests] real loss_compliance;
array[n_tests] real<lower=0> typical_path_strain; // of the record, up to its middle
