// Priors in the order of functions/parameters.stan; families as in functions/priors.stan.
// A fixed parameter has family 0 and its value as location.
array[n_parameters()] int<lower=0, upper=4> prior_family;
vector[n_parameters()] prior_location;
vector[n_parameters()] prior_scale;
vector[n_parameters()] prior_lower;
vector[n_parameters()] prior_upper;
// Joint prior of the flow law in place of those of n, p, Q_M and beta (family 4).
int<lower=0, upper=4> n_flow_law; // 4: n, p, ln(flow rate s) at the conditions, beta; 0: none
vector[n_flow_law] flow_law_mean;
matrix[n_flow_law, n_flow_law] flow_law_factor; // lower Cholesky factor of the covariance
vector<lower=0>[n_flow_law == 0 ? 0 : 3] flow_law_conditions; // K, Pa, m
