  // Priors of the tests' own parameters, of centres and of spreads (charts/pooling.stan).
  vector[n_pooled] pooled_centre; // SI
  real lprior = 0;
  for (e in 1 : n_tests) {
    lprior += joint_prior_log_density(parameter[e], prior_family[e], prior_location[e],
                                      prior_scale[e], prior_lower[e], prior_upper[e],
                                      prior_mass[e]);
    if (has_flow_law_prior[e]) {
      lprior += flow_law_prior_log_density(parameter[e][i_stress_exponent()],
                                           parameter[e][i_grain_size_exponent()],
                                           parameter[e][i_activation_enthalpy()],
                                           parameter[e][i_beta()], flow_law_mean,
                                           flow_law_factor, flow_law_conditions);
    }
  }
  for (h in 1 : n_pooled) {
    int k = pooled_parameter[h];
    real u = centre_reference[h] + coordinate[centre_position[h]];
    pooled_centre[h] = bounded_from_real(u, pooled_quantity[1][h]);
    lprior += prior_log_density(pooled_centre[h], pooled_family[h], prior_location[1][k],
                                prior_scale[1][k], prior_lower[1][k], prior_upper[1][k],
                                prior_log_mass(pooled_family[h], prior_location[1][k],
                                               prior_scale[1][k], prior_lower[1][k],
                                               prior_upper[1][k]))
              + normal_lpdf(pooled_spread[h] | 0, spread_scale[h]) + log(2);
    log_jacobian += log_slope_of_bounded(u, pooled_quantity[1][h]) + log(pooled_spread[h]);
  }
