  // Parameters of every test in the order of physics/parameters.stan, SI.
  array[n_tests] vector[n_parameters()] parameter = prior_location;
  vector[n_pooled] pooled_spread // of partially pooled parameters, on the real line
    = spread_scale .* exp(log_spread_reference + coordinate[spread_position]);
  real log_jacobian = 0; // ln |d(parameters, centres and spreads)/d(coordinates)|
  // Log density of partially pooled parameters given centres and spreads, and of errors of the
  // driving strain.
  real log_pooling = 0;
