// Compliance of the Kelvin part at rows of frequency, temperature and parameters.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/kelvin_element.stan
#include physics/relaxation.stan
}
data {
  int<lower=1> n;
  vector<lower=0>[n] angular_frequency; // rad/s
  vector<lower=0>[n] temperature; // K
  vector<lower=0>[n] grain_size; // m
  array[n] vector[n_parameters()] parameter;
}
generated quantities {
  matrix[n, 2] compliance; // storage and loss, 1/Pa
  for (i in 1 : n) {
    compliance[i] = kelvin_compliance([log(angular_frequency[i])
                                       + log_relaxation_time(parameter[i], temperature[i],
                                                             grain_size[i])]',
                                      parameter[i])[1];
  }
}
