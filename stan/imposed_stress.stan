// Strain of a nonlinear Burgers material at imposed stress with frozen microstructure: a hold at
// the median stress, then a sinusoid on top of it. A forward simulation at given parameters
// (algorithm=fixed_param); there is nothing to sample. All values are SI.
functions {
#include physics/flow_law.stan
#include physics/kelvin_element.stan
#include protocols/imposed_stress_dynamics.stan
}
data {
  real<lower=0> temperature; // K
  real<lower=0> grain_size; // m
  real<lower=0> fabric_factor; // 1 = isotropic
  real<lower=0> median_stress; // Pa
  real<lower=0> amplitude; // Pa
  real<lower=0> frequency; // Hz
  real<lower=0> hold_time; // s, before the cycles start
  // Times since the cycles started, s, increasing; 0, the end of the hold, is one of them.
  int<lower=1> n_times;
  array[n_times] real<lower=-hold_time> time;
  int<lower=1, upper=n_times> n_in_hold; // times up to 0
  real<lower=0> maxwell_modulus;
  real<lower=0> kelvin_modulus;
  real<lower=0> kelvin_viscosity;
  real stress_exponent;
  real grain_size_exponent;
  real activation_enthalpy;
  real beta;
  real<lower=0> breakdown_stress; // Pa; 0: the dashpot is a power law
  real<lower=1> kelvin_stress_exponent;
  real<lower=0> kelvin_activation_enthalpy;
  real<lower=0> kelvin_reference_stress; // Pa
  real<lower=0> kelvin_reference_temperature; // K
#include data/solver.stan
}
generated quantities {
  vector[n_times] stress; // Pa
  vector[n_times] strain; // elastic + Kelvin + dashpot
  vector[n_times] kelvin_strain;
  vector[n_times] dashpot_strain;
  {
    real angular_frequency = 2 * pi() * frequency;
    array[n_times] vector[2] solution
      = imposed_stress_solution(time, n_in_hold, hold_time, median_stress, amplitude,
                                angular_frequency, kelvin_modulus,
                                kelvin_viscosity_at(kelvin_viscosity,
                                                    kelvin_activation_enthalpy, temperature,
                                                    kelvin_reference_temperature),
                                stress_exponent, grain_size_exponent, breakdown_stress,
                                grain_size, fabric_factor,
                                log_rate_factor(activation_enthalpy, beta, temperature),
                                kelvin_stress_exponent, kelvin_reference_stress,
                                tolerance, max_num_steps);
    for (i in 1 : n_times) {
      stress[i] = cyclic_stress(time[i], median_stress, i > n_in_hold ? amplitude : 0,
                                angular_frequency);
      kelvin_strain[i] = solution[i][1];
      dashpot_strain[i] = solution[i][2];
      strain[i] = stress[i] / maxwell_modulus + kelvin_strain[i] + dashpot_strain[i];
    }
  }
}
