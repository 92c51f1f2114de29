// Values of the functions for oscillating tests, one row of data each.
functions {
#include functions/parameters.stan
#include functions/flow_law.stan
#include functions/kelvin_element.stan
#include functions/microstructure.stan
#include functions/coordinates.stan
#include functions/forced_oscillation_dynamics.stan
#include functions/sheared_coordinates.stan
}
data {
  real stress_exponent;
  real<lower=0> rate_at_scale;
  real<lower=0> stress_scale;
  real bias;
  real<lower=0> amplitude;
  real<lower=0> period;
  real<lower=0> maxwell_modulus;
  real<lower=0> dashpot;
  vector[2] compliance;
}
generated quantities {
  real dashpot_loss = dashpot_compliance(rate_at_scale, stress_exponent, stress_scale, bias,
                                         amplitude, period);
  vector[2] kelvin = kelvin_left_over(maxwell_modulus, dashpot, compliance, period);
}
