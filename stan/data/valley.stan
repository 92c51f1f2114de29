// Valley coordinates (charts/valley/); all sizes 0 with plain coordinates. Columns of the matrices
// of pins and knots: see charts/valley/pins.stan; of the guide: see plain_from_valley().
array[n_tests + 1] int<lower=0> knot_end;
matrix[knot_end[n_tests + 1], 3] knot; // of the reference curve, the solution at the reference
array[n_tests + 1] int<lower=0> pin_end;
matrix[pin_end[n_tests + 1], 6] pin;
matrix[coordinate_system == 2 ? own_end[n_tests + 1] : 0, 3] guide;
array[coordinate_system == 2 ? n_tests : 0] vector[n_parameters()] reference_parameter;
