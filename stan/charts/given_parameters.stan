    // Places of a test's own coordinates; its other parameters: fixed, shared or partially pooled.
    array[own_end[e + 1] - own_end[e]] int own = part(own_end, e);
    vector[n_parameters() + 2] pooled = with_pooled(
      with_shared(prior_location[e], parameter, shared_from[e], shared_parameter),
      coordinate[pooled_position[e]], centre_reference + coordinate[centre_position],
      pooled_spread, pooled_parameter, pooled_quantity[e], pooled_reference[e],
      pooled_data_precision);
    vector[n_parameters()] given = head(pooled, n_parameters());
