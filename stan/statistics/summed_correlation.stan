/**
 * Residuals that correlate (statistics/residuals.stan), with the share w and the correlation strain or
 * time summed over a grid, and both drawn afterwards.
 *
 * Covariances are s^2 (w T + (1 - w) I), with T that of exp(-|difference|/length). At every node of the
 * length the eigenvectors of T are data, so that one product of a matrix and the residuals gives the
 * quadratic form at every w. Logarithms of densities are smooth along the grid where densities are
 * narrow: a cubic spline leads from nodes to cells, over which densities and prior masses are summed.
 *
 * Residuals are those over s. Blocks are parts between which none correlates. Rows of bases and columns
 * of precisions hold the readings of a block at the first length, then at the second, and so on.
 */

/** Correlations of the smooth part of the readings of a block. */
matrix correlations(data vector position, data real correlation_length) {
  int n = num_elements(position);
  matrix[n, n] correlation;
  for (i in 1 : n) {
    for (j in 1 : n) {
      correlation[i, j] = exp(-fmax(position[i] - position[j], position[j] - position[i])
                              / correlation_length);
    }
  }
  return correlation;
}

/** Most readings in a block; 0 where nothing is summed. */
int largest_block(data array[] int n_in_block, data int n_lengths) {
  return size(n_in_block) > 0 && n_lengths > 0 ? max(n_in_block) : 0;
}

/** Places, among all points, of the readings of a block of a test. */
array[] int points_of_block(data array[] int n_in_block, data int first_block,
                            data int points_before, data int block) {
  return linspaced_int_array(n_in_block[block],
                             points_before + sum(n_in_block[first_block : block])
                             - n_in_block[block] + 1,
                             points_before + sum(n_in_block[first_block : block]));
}

/** Eigenvectors of the correlations of every block, as rows. */
array[] matrix correlation_bases(data vector position, data array[] int point_end,
                                 data array[] int block_end, data array[] int n_in_block,
                                 data array[] vector length_node) {
  int n_lengths = num_elements(length_node[1]);
  int most = largest_block(n_in_block, n_lengths);
  array[size(n_in_block)] matrix[n_lengths * most, most] basis;
  for (e in 1 : size(length_node)) {
    for (b in part(block_end, e)) {
      int n = n_in_block[b];
      array[n] int points = points_of_block(n_in_block, block_end[e] + 1, point_end[e], b);
      basis[b] = rep_matrix(0, n_lengths * most, most);
      for (m in 1 : n_lengths) {
        basis[b, (m - 1) * n + 1 : m * n, 1 : n]
          = eigenvectors_sym(correlations(position[points], length_node[e, m]))';
      }
    }
  }
  return basis;
}

/** Inverse variances of the parts of the residuals along these vectors, a row for each w. */
array[] matrix correlation_precisions(data vector position, data array[] int point_end,
                                      data array[] int block_end, data array[] int n_in_block,
                                      data array[] vector share_node,
                                      data array[] vector length_node) {
  int n_lengths = num_elements(length_node[1]);
  int n_shares = num_elements(share_node[1]);
  int most = largest_block(n_in_block, n_lengths);
  array[size(n_in_block)] matrix[n_shares, n_lengths * most] precision;
  for (e in 1 : size(length_node)) {
    for (b in part(block_end, e)) {
      int n = n_in_block[b];
      array[n] int points = points_of_block(n_in_block, block_end[e] + 1, point_end[e], b);
      precision[b] = rep_matrix(1, n_shares, n_lengths * most);
      for (m in 1 : n_lengths) {
        row_vector[n] variance = eigenvalues_sym(correlations(position[points],
                                                              length_node[e, m]))';
        for (j in 1 : n_shares) {
          precision[b, j, (m - 1) * n + 1 : m * n]
            = inv(share_node[e, j] * fmax(variance, 0) + 1 - share_node[e, j]);
        }
      }
    }
  }
  return precision;
}

/** ln of the prior masses of the cells, (n_share_cells, n_length_cells). */
matrix log_cell_masses(vector log_share_mass, vector log_length_mass) {
  return rep_matrix(log_share_mass, num_elements(log_length_mass))
         + rep_matrix(log_length_mass', num_elements(log_share_mass));
}

/** What is added to these at the readings of a test, whatever they are. */
matrix log_cell_weights(data array[] int n_in_block, data array[] int blocks,
                        data array[] matrix precision, data matrix share_spline,
                        data matrix length_spline) {
  int n_lengths = rows(length_spline);
  matrix[cols(share_spline), n_lengths] log_volume
    = rep_matrix(-0.5 * sum(n_in_block[blocks]) * log(2 * pi()), cols(share_spline), n_lengths);
  for (b in blocks) {
    int n = n_in_block[b];
    for (m in 1 : n_lengths) {
      log_volume[ : , m] += 0.5
                            * log(precision[b, : , (m - 1) * n + 1 : m * n])
                            * rep_vector(1, n);
    }
  }
  return share_spline * log_volume * length_spline;
}

/**
 * ln of prior mass times density of the residuals of a test in every cell, whose sum of exponentials is
 * the density with w and the length integrated out.
 *
 * @param residual over s
 * @param before, number of blocks ahead of those of the test, and of these
 * @param log_weight log_cell_masses() and log_cell_weights()
 */
matrix log_cell_densities(vector residual, data int before, data int number,
                          data array[] int n_in_block, data array[] matrix basis,
                          data array[] matrix precision, data matrix log_weight,
                          data matrix share_spline, data matrix length_spline) {
  int n_shares = cols(share_spline);
  int n_lengths = rows(length_spline);
  matrix[n_shares, n_lengths] squares = rep_matrix(0, n_shares, n_lengths);
  int at = 1;
  for (b in before + 1 : before + number) {
    int n = n_in_block[b];
    vector[n] own = segment(residual, at, n);
    vector[n_lengths * n] along;
    if (n == cols(basis[b])) {
      along = basis[b] * own; // the whole of the matrix, without a copy of it
    } else {
      along = block(basis[b], 1, 1, n_lengths * n, n) * own;
    }
    for (m in 1 : n_lengths) {
      squares[ : , m] += block(precision[b], 1, (m - 1) * n + 1, n_shares, n)
                         * square(segment(along, (m - 1) * n + 1, n));
    }
    at += n;
  }
  return log_weight - 0.5 * share_spline * squares * length_spline;
}

/**
 * Log density of residuals over their standard deviations, summed over the grid where there is one.
 *
 * @param correlation_length, share of the test, without effect where there is a grid
 */
real test_residuals_log_density(vector residual, data int correlated, data vector position,
                                data array[] int segment, real correlation_length, real share,
                                data int before, data int number, data array[] int n_in_block,
                                data array[] matrix basis, data array[] matrix precision,
                                data matrix log_weight, data matrix share_spline,
                                data matrix length_spline) {
  if (rows(length_spline) > 0) {
    return log_sum_exp(log_cell_densities(residual, before, number, n_in_block, basis, precision,
                                          log_weight, share_spline, length_spline));
  }
  return residuals_log_density(residual, correlated, position, segment, correlation_length,
                               share);
}

/**
 * Log density of every residual with w and the length summed out, as columns: given all those before
 * it, and given all others.
 */
matrix summed_log_densities(vector residual, data vector position, data array[] int segment,
                            data vector share_node, data vector length_node,
                            data matrix share_spline, data matrix length_spline,
                            data matrix log_mass) {
  int n = num_elements(residual);
  int n_shares = num_elements(share_node);
  int n_lengths = num_elements(length_node);
  array[n] matrix[n_shares, n_lengths] up_to; // of the residuals up to each
  array[n] matrix[n_shares, n_lengths] of_it; // given all others
  matrix[n, 2] log_density;
  vector[n + 1] summed;
  summed[1] = 0;
  for (j in 1 : n_shares) {
    for (m in 1 : n_lengths) {
      matrix[n, 2] at_node = log_densities_of_residuals(residual, 1, 1, position, segment,
                                                        length_node[m], share_node[j]);
      vector[n] cumulative = cumulative_sum(at_node[ : , 1]);
      for (i in 1 : n) {
        up_to[i, j, m] = cumulative[i];
        of_it[i, j, m] = at_node[i, 2];
      }
    }
  }
  for (i in 1 : n) {
    summed[i + 1] = log_sum_exp(log_mass + share_spline * up_to[i] * length_spline);
  }
  for (i in 1 : n) {
    log_density[i, 1] = summed[i + 1] - summed[i];
    log_density[i, 2] = summed[n + 1]
                        - log_sum_exp(log_mass
                                      + share_spline * (up_to[n] - of_it[i]) * length_spline);
  }
  return log_density;
}

/** Proposals for a draw of w and the length, of which most are taken. */
int n_proposals() { return 12; }

/**
 * Random length and w, given the residuals of a test or, without likelihood, of their prior.
 *
 * A cell is drawn by its density, a point in it by the prior. Proposals of this kind are taken as
 * their exact densities demand (Metropolis and Hastings), so that the cells leave no trace.
 *
 * @param log_cell_density log_cell_densities(), or the prior's
 * @param share_edge, log_length_edge, length_score see data/summed_correlation.stan
 */
vector correlation_rng(matrix log_cell_density, vector residual, data int use_likelihood,
                       data vector position, data array[] int segment, data vector log_share_mass,
                       data vector share_edge, data vector log_length_edge,
                       data vector length_score) {
  vector[2] drawn;
  real log_ratio = negative_infinity(); // of its density and that of proposing it
  vector[num_elements(log_cell_density)] probability = softmax(to_vector(log_cell_density));
  for (k in 1 : n_proposals()) {
    int cell = categorical_rng(probability) - 1;
    int i = cell % rows(log_cell_density) + 1;
    int j = cell %/% rows(log_cell_density) + 1;
    real place = uniform_rng(0, 1);
    real score = length_score[j] + place * (length_score[j + 1] - length_score[j]);
    vector[2] proposed
      = [exp(log_length_edge[j] + place * (log_length_edge[j + 1] - log_length_edge[j])),
         share_edge[i] + uniform_rng(0, 1) * (share_edge[i + 1] - share_edge[i])]';
    real proposed_ratio = log_share_mass[i] - log_cell_density[i, j] - 0.5 * square(score);
    if (use_likelihood) {
      proposed_ratio += residuals_log_density(residual, 1, position, segment, proposed[1],
                                              proposed[2]);
    }
    if (log(uniform_rng(0, 1)) < proposed_ratio - log_ratio) {
      drawn = proposed;
      log_ratio = proposed_ratio;
    }
  }
  return drawn;
}
