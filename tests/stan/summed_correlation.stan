// A straight line through the origin whose residuals correlate: with w and the length summed over a grid.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include statistics/residuals.stan
#include charts/plain.stan
#include charts/pooling.stan
#include statistics/summed_correlation.stan
}
data {
  int<lower=1> n_tests;
  array[n_tests + 1] int<lower=0> point_end;
  vector[point_end[n_tests + 1]] position;
  array[point_end[n_tests + 1]] int segment;
  vector[point_end[n_tests + 1]] observed;
  int<lower=0, upper=1> use_likelihood;
#include data/summed_correlation.stan
}
transformed data {
  int most = largest_block(n_in_block, n_lengths);
  array[block_end[n_tests + 1]] matrix[n_lengths * most, most] basis
    = correlation_bases(position, point_end, block_end, n_in_block, length_node);
  array[block_end[n_tests + 1]] matrix[n_shares, n_lengths * most] precision
    = correlation_precisions(position, point_end, block_end, n_in_block, share_node, length_node);
  matrix[n_share_cells, n_length_cells] log_mass
    = log_cell_masses(log_share_mass, log_length_mass);
  array[n_tests] matrix[n_share_cells, n_length_cells] log_weight;
  for (e in 1 : n_tests) {
    log_weight[e] = log_mass
                    + log_cell_weights(n_in_block, part(block_end, e), precision, share_spline,
                                       length_spline);
  }
}
parameters {
  vector[2] coordinate; // slope, ln s
}
transformed parameters {
  vector[n_tests] log_likelihood;
  for (e in 1 : n_tests) {
    array[point_end[e + 1] - point_end[e]] int points = part(point_end, e);
    log_likelihood[e]
      = test_residuals_log_density((observed[points] - coordinate[1] * position[points])
                                   / exp(coordinate[2]),
                                   1, position[points], segment[points], 0, 0, block_end[e],
                                   block_end[e + 1] - block_end[e], n_in_block, basis, precision,
                                   log_weight[e], share_spline, length_spline)
        - size(points) * coordinate[2];
  }
}
model {
  coordinate ~ std_normal();
  target += sum(log_likelihood);
}
generated quantities {
  matrix[point_end[n_tests + 1], 2] log_densities; // given those before, and given all others
  array[n_tests] vector[2] residual_correlation;
  for (e in 1 : n_tests) {
    array[point_end[e + 1] - point_end[e]] int points = part(point_end, e);
    vector[size(points)] residual = (observed[points] - coordinate[1] * position[points])
                                    / exp(coordinate[2]);
    log_densities[points]
      = summed_log_densities(residual, position[points], segment[points], share_node[e],
                             length_node[e], share_spline, length_spline, log_mass)
        - coordinate[2];
    residual_correlation[e] = correlation_rng(
      use_likelihood
      ? log_cell_densities(residual, block_end[e], block_end[e + 1] - block_end[e], n_in_block,
                           basis, precision, log_weight[e], share_spline, length_spline)
      : log_mass,
      residual, use_likelihood, position[points], segment[points], log_share_mass, share_edge[e],
      log_length_edge[e], length_score);
  }
}
