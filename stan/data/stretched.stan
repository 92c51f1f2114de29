// Stretched coordinates (charts/stretched.stan).
vector<lower=0>[own_end[n_tests + 1]] stretched_unit; // of every own coordinate
vector[own_end[n_tests + 1]] stretched_slope; // by the flow rate
array[n_tests] vector[4] stretched_reference; // see places in charts/stretched.stan
