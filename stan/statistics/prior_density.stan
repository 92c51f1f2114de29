  // Priors of the tests' own parameters, of centres and of spreads (charts/pooling.stan).
  real lprior = 0;
  for (e in 1 : n_tests) {
    lprior += test_prior_log_density(parameter[e], prior_family[e], prior_location[e],
                                     prior_scale[e], prior_lower[e], prior_upper[e],
                                     prior_mass[e], has_flow_law_prior[e], flow_law_mean,
                                     flow_law_factor, flow_law_conditions);
  }
#include statistics/prior_of_centres.stan
