// Grid of w and of epsilon_r or tau_r, the length, over which the density is summed where both are each
// test's own (statistics/summed_correlation.stan); no nodes: they are parameters, or known.
int<lower=0> n_shares; // nodes
int<lower=0> n_lengths;
array[n_tests] vector<lower=0, upper=1>[n_shares] share_node;
array[n_tests] vector<lower=0>[n_lengths] length_node; // strain or s
// Cells, and the spline from the nodes to the middles of the cells.
int<lower=0> n_share_cells;
int<lower=0> n_length_cells;
matrix[n_share_cells, n_shares] share_spline;
matrix[n_lengths, n_length_cells] length_spline;
// Prior masses of the cells, and their edges. Scores are standard normal under the prior.
vector<upper=0>[n_share_cells] log_share_mass;
vector<upper=0>[n_length_cells] log_length_mass;
array[n_tests] vector<lower=0, upper=1>[n_shares == 0 ? 0 : n_share_cells + 1] share_edge;
array[n_tests] vector[n_shares == 0 ? 0 : n_length_cells + 1] log_length_edge;
vector[n_shares == 0 ? 0 : n_length_cells + 1] length_score;
// Blocks of readings within which residuals correlate, and how many readings are in each.
array[n_tests + 1] int<lower=0> block_end;
array[block_end[n_tests + 1]] int<lower=1> n_in_block;
