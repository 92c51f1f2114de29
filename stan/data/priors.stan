// Priors in the order of functions/parameters.stan; families as in functions/priors.stan.
// A fixed parameter has family 0 and its value as location.
array[n_parameters()] int<lower=0, upper=3> prior_family;
vector[n_parameters()] prior_location;
vector[n_parameters()] prior_scale;
vector[n_parameters()] prior_lower;
vector[n_parameters()] prior_upper;
