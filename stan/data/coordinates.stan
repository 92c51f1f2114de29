// Coordinates: those of the first test, the own ones of the others, centres, spreads.
int<lower=0> n_coordinates;
vector<lower=0>[n_coordinates] unit; // in which the sampler moves in each of them
int<lower=1, upper=2> coordinate_system; // 1 plain, 2 those of the program's chart
// Parameters that tests share, and whose they are in each test: the first's that shares them.
int<lower=0, upper=n_parameters()> n_shared;
array[n_shared] int<lower=1, upper=n_parameters()> shared_parameter;
array[n_tests, n_shared] int<lower=1, upper=n_tests> shared_from;
// A test's own ones: places of the parameters and of their coordinates, and their quantities
// (charts/plain.stan).
array[n_tests + 1] int<lower=0> own_end;
array[own_end[n_tests + 1]] int<lower=1, upper=n_parameters()> own_parameter;
array[own_end[n_tests + 1]] int<lower=1, upper=n_coordinates> own_position;
matrix[own_end[n_tests + 1], 4] quantity;
// Place of each parameter among a test's own ones, 0 where it is none of them.
array[n_tests, n_parameters()] int<lower=0, upper=n_parameters()> own_place;
// Parameter in whose place a test's own point of the flow law is sampled; 0: none.
array[n_tests] int<lower=0, upper=n_parameters()> replaced_parameter;
// Partially pooled parameters (charts/pooling.stan).
int<lower=0, upper=n_parameters()> n_pooled;
array[n_pooled] int<lower=1, upper=n_parameters()> pooled_parameter;
array[n_pooled] int<lower=0, upper=4> pooled_family;
array[n_tests, n_pooled] int<lower=1, upper=n_coordinates> pooled_position;
array[n_tests] matrix[n_pooled, 4] pooled_quantity;
array[n_pooled] int<lower=1, upper=n_coordinates> centre_position;
array[n_pooled] int<lower=1, upper=n_coordinates> spread_position;
vector<lower=0>[n_pooled] spread_scale; // of the half-normal priors of the spreads
vector[n_pooled] centre_reference; // where the centres and ln(spread/scale) start
vector[n_pooled] log_spread_reference;
array[n_tests] vector[n_pooled] pooled_reference; // see pooled_number()
real<lower=0> pooled_data_precision;
