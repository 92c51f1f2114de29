// One record of a test at oscillating strain rate; times in periods since the clock's zero.
real<lower=0> temperature; // K
real<lower=0> initial_grain_size; // m, at the start of the record
real<lower=0> period; // s
int<lower=1> n_harmonics;
vector[n_harmonics] strain_sine; // amplitudes of the strain's harmonics, fraction
vector[n_harmonics] strain_cosine;
int<lower=0> n_background; // 0: the background is removed
vector[n_background] background; // d strain/d tau, coefficients of a polynomial
real background_middle;
real<lower=0> background_half;
real start_tau; // of the spin-up
real start_stress; // Pa
real<lower=start_tau> first_tau; // of the record
real<lower=0> stress_scale; // Pa
real<lower=0> strain_scale;
real<lower=0> stress_amplitude; // Pa, of the fundamental
real storage_compliance; // strain over stress of the fundamental, 1/Pa
real loss_compliance;
real<lower=0> typical_path_strain; // of the record, up to its middle
int<lower=0> n_points;
array[n_points] real<lower=first_tau> tau;
vector[n_points] stress_observed; // Pa
vector<lower=0>[n_points] relative_noise; // standard deviation of a point over stress_noise
// The part of a series of stresses that counts as trend is trend_shape * (trend_fit * series):
// taken out of the model's stress as it was out of the observed one. No columns: nothing is.
int<lower=0> n_trend;
matrix[n_points, n_trend] trend_shape;
matrix[n_trend, n_points] trend_fit;
int<lower=0, upper=1> use_likelihood; // 0: prior only
