  // Priors of centres and of spreads (charts/pooling.stan).
  vector[n_pooled] pooled_centre; // SI
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
