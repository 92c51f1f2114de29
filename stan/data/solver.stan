// Options of ode_bdf_tol; the states are O(1), so one tolerance fits all of them.
real<lower=0> tolerance; // relative and absolute
int<lower=1> max_num_steps;
