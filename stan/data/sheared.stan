// Sheared coordinates (charts/sheared.stan).
array[n_tests] vector[3] flow_slope; // of ln(flow rate s) by n, p and p ln(d/d_0)
array[n_tests] vector[3] flow_reference; // n, p and epsilon_c1 where the flow rate is not shifted
// What the shifts want to know of a record beside its data above.
array[n_tests] real<lower=0> stress_amplitude; // Pa, of the fundamental
array[n_tests] real storage_compliance; // strain over stress of the fundamental, 1/Pa
array[n_tests] real loss_compliance;
array[n_tests] real<lower=0> typical_path_strain; // of the record, up to its middle
