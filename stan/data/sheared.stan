// Sheared coordinates (functions/sheared_coordinates.stan).
int<lower=1, upper=2> coordinate_system; // 1 plain, 2 sheared
vector[3] flow_slope; // of ln(flow rate s) by n, p and p ln(d/d_0)
vector[3] flow_reference; // n, p and epsilon_c1 where the flow rate is not shifted
