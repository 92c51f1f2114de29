// Records of tests at oscillating strain rate; times in periods since the clock's zero.
vector[point_end[n_tests + 1]] stress_observed; // Pa
array[n_tests] real<lower=0> period; // s
int<lower=1> n_harmonics;
array[n_tests] vector[n_harmonics] strain_sine; // amplitudes of the strain's harmonics, fraction
array[n_tests] vector[n_harmonics] strain_cosine;
int<lower=0> n_background; // 0: the background is removed
array[n_tests] vector[n_background] background; // d strain/d tau, coefficients of a polynomial
array[n_tests] vector[2] background_range; // middle and half of the record
// Errors of the driving strain, standard normal, the last coordinates: what one unit of each adds
// to sines, cosines and background. None where the strain is known well enough.
array[n_tests + 1] int<lower=0> error_end;
matrix[error_end[n_tests + 1], 2 * n_harmonics + n_background] strain_error;
array[n_tests] real start_tau; // of the spin-up
array[n_tests] real start_stress; // Pa
array[n_tests] real first_tau; // of the record
array[n_tests] real<lower=0> stress_scale; // Pa
array[n_tests] real<lower=0> strain_scale;
array[point_end[n_tests + 1]] real tau;
vector<lower=0>[point_end[n_tests + 1]] relative_noise; // deviation of a point over stress_noise
// The part of a test's residuals that counts as trend is trend_shape * (trend_fit' * residuals), by
// weighted least squares: what is left is orthogonal to every trend. Columns of 0 behind the
// coefficients of a test: the others have more.
array[n_tests] int<lower=0> n_trend; // coefficients; 0: nothing is taken out
matrix[point_end[n_tests + 1], max(n_trend)] trend_shape;
matrix[point_end[n_tests + 1], max(n_trend)] trend_fit;
