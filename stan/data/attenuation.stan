// Tables of attenuation and modulus; tests that are no tables have no rows. Every row gives one or
// two readings; stresses are axial equivalents.
array[n_tests + 1] int<lower=0> row_end;
vector<lower=0>[row_end[n_tests + 1]] frequency; // angular, rad/s
vector<lower=0>[row_end[n_tests + 1]] row_temperature; // K
// Stresses that rows have in common, and nodes of the integral over half a period
// (physics/stress_cycles.stan), columns sine and weight.
array[n_tests + 1] int<lower=0> regime_end;
vector<lower=0>[regime_end[n_tests + 1]] median_stress; // Pa
vector<lower=0>[regime_end[n_tests + 1]] amplitude; // Pa; 0: not stated
array[regime_end[n_tests + 1] + 1] int<lower=0> node_end;
matrix[node_end[regime_end[n_tests + 1] + 1], 2] node;
array[row_end[n_tests + 1]] int<lower=1> regime; // of a row, among those of its test
array[n_tests] vector[3] conversion; // from axial to the table's (attenuation_response.stan)
// Readings: ln(tan delta) of rows, then ln(modulus / Pa) of rows.
array[n_tests + 1] int<lower=0> reading_end;
array[reading_end[n_tests + 1]] int<lower=1> reading; // among twice the rows of its test
array[reading_end[n_tests + 1]] int<lower=1, upper=2> quantity_of_point; // 1 tan delta, 2 modulus
vector[reading_end[n_tests + 1]] log_reading_observed;
vector<lower=0>[reading_end[n_tests + 1]] stated_error; // of tan delta, of ln(modulus)
array[reading_end[n_tests + 1]] int<lower=0, upper=1> is_limit; // 1: an upper limit
vector[reading_end[n_tests + 1]] log_limit; // below which a reading is only a limit
// Readings that generated quantities report apart from the observed ones.
array[n_tests + 1] int<lower=0> reading_grid_end;
vector<lower=0>[reading_grid_end[n_tests + 1]] grid_frequency;
vector<lower=0>[reading_grid_end[n_tests + 1]] grid_temperature;
array[reading_grid_end[n_tests + 1]] int<lower=1> grid_regime;
array[reading_grid_end[n_tests + 1]] int<lower=1, upper=2> grid_quantity;
vector<lower=0>[reading_grid_end[n_tests + 1]] grid_stated_error;
