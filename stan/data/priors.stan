// Priors of every test in the order of physics/parameters.stan; families as in
// statistics/priors.stan. A fixed parameter has family 0 and its value as location. Family 0 have
// also parameters whose prior is counted elsewhere: shared ones in the first test, partially
// pooled ones with their centre.
array[n_tests, n_parameters()] int<lower=0, upper=4> prior_family;
array[n_tests] vector[n_parameters()] prior_location;
array[n_tests] vector[n_parameters()] prior_scale;
array[n_tests] vector[n_parameters()] prior_lower;
array[n_tests] vector[n_parameters()] prior_upper;
// Joint prior of the flow law in place of those of n, p, Q_M and beta (family 4).
array[n_tests] int<lower=0, upper=1> has_flow_law_prior; // 0: none, or counted elsewhere
int<lower=0, upper=4> n_flow_law; // 4: n, p, ln(flow rate s) at the conditions, beta; 0: none
vector[n_flow_law] flow_law_mean;
matrix[n_flow_law, n_flow_law] flow_law_factor; // lower Cholesky factor of the covariance
vector<lower=0>[n_flow_law == 0 ? 0 : 3] flow_law_conditions; // K, Pa, m
