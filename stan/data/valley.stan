// Valley coordinates (charts/valley/); all sizes 0 with plain coordinates. Columns of the matrices
// of pins and knots: see charts/valley/pins.stan; of the guide: those behind quantity,
// see charts/valley/elastic_rise.stan.
array[n_tests + 1] int<lower=0> knot_end;
matrix[knot_end[n_tests + 1], 3] knot; // of the reference curve, the solution at the reference
array[n_tests + 1] int<lower=0> pin_end;
matrix[pin_end[n_tests + 1], 10] pin;
matrix[coordinate_system == 2 ? own_end[n_tests + 1] : 0, 3] guide;
array[coordinate_system == 2 ? n_tests : 0] vector[n_parameters()] reference_parameter;
array[coordinate_system == 2 ? n_tests : 0] real<lower=0> reference_rate; // of ln S_0, 1/s
array[coordinate_system == 2 ? n_tests : 0] real<lower=0> loading_time; // of the elastic rise, s
// Where ln S_0 is solved from times (0 elsewhere): flow strain that data can just tell from none, over
// that of the reference curve, and prior standard deviation of the parameter that ln S_0 replaces.
array[coordinate_system == 2 ? n_tests : 0] real<lower=0> seen_flow;
array[coordinate_system == 2 ? n_tests : 0] real<lower=0> replaced_deviation;
array[coordinate_system == 2 ? n_tests : 0] int<lower=1> noise_parameter; // that widths follow
// Plain coordinates with a stretched flow rate (charts/stretched_flow.stan); a width of 0: others.
matrix[coordinate_system == 1 ? own_end[n_tests + 1] : 0, 2] stretched_flow_slope;
array[coordinate_system == 1 ? n_tests : 0] vector[4] stretched_flow_reference;
