// One to many tests of one material. Ragged arrays hold one test after the other; X_end says
// where the part of each test ends, after a leading 0.
int<lower=1> n_tests;
array[n_tests] real<lower=0> temperature; // K
array[n_tests] real<lower=0> initial_grain_size; // m
array[n_tests + 1] int<lower=0> point_end;
int<lower=0, upper=1> use_likelihood; // 0: prior only
int<lower=0, upper=n_parameters()> kelvin_law; // of kelvin_law_parameters(); 0: linear
