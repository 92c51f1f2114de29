// Strain of nonlinear Burgers materials at imposed stress: a hold at the median stress, then a
// sinusoid on top of it; the microstructure is frozen or evolves with strain. A forward simulation at
// given parameters (algorithm=fixed_param); there is nothing to sample. All values are SI.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/environment.stan
#include physics/composite_law.stan
#include physics/dashpot_mechanisms.stan
#include physics/dashpot_laws.stan
#include physics/kelvin_laws.stan
#include physics/microstructure.stan
#include kinds/material_at_stress.stan
#include kinds/imposed_stress_dynamics.stan
}
data {
  int<lower=1> n_materials;
  array[n_materials] vector[n_parameters()] parameter; // in the order of physics/parameters.stan
  real<lower=0> temperature; // K
  array[n_materials] vector<lower=0>[2] initial; // grain size (m), fabric factor (1 = isotropic)
  int<lower=0, upper=1> evolves; // 0: the microstructure stays what it is initially
  real<lower=0> median_stress; // Pa
  real<lower=0> amplitude; // Pa
  real<lower=0> frequency; // Hz
  real<lower=0> hold_time; // s, before the cycles start
  // Times since the cycles started, s, increasing; 0, the end of the hold, is one of them.
  int<lower=1> n_times;
  array[n_times] real<lower=-hold_time> time;
  int<lower=1, upper=n_times> n_in_hold; // times up to 0
#include data/solver.stan
}
transformed data {
  array[n_materials] vector[n_parameters()] material = parameter; // under the conditions
  for (k in 1 : n_materials) {
    material[k][i_maxwell_modulus()]
      = maxwell_modulus_at(parameter[k], rep_vector(temperature, 1))[1];
    // Of the grain size at the start, as in loading histories.
    material[k][i_kelvin_viscosity()] *= exp(log_kelvin_coarsening(parameter[k], initial[k][1]));
  }
}
generated quantities {
  vector[n_times] stress; // Pa
  array[n_materials] vector[n_times] strain; // elastic + Kelvin + dashpot
  array[n_materials] vector[n_times] kelvin_strain;
  array[n_materials] vector[n_times] dashpot_strain;
  array[n_materials] vector[evolves ? n_times : 0] path_strain; // since rest
  array[n_materials] vector[evolves ? n_times : 0] grain_size; // m
  array[n_materials] vector[evolves ? n_times : 0] fabric_factor;
  for (i in 1 : n_times) {
    stress[i] = cyclic_stress(time[i], median_stress, i > n_in_hold ? amplitude : 0,
                              2 * pi() * frequency);
  }
  for (k in 1 : n_materials) {
    array[n_times] vector[evolves ? 4 : 2] solution
      = imposed_stress_solution(time, n_in_hold, hold_time, median_stress, amplitude,
                                2 * pi() * frequency, material[k], temperature, initial[k],
                                evolves, tolerance, max_num_steps);
    for (i in 1 : n_times) {
      kelvin_strain[k, i] = solution[i][1];
      dashpot_strain[k, i] = solution[i][2];
      strain[k, i] = stress[i] / material[k][i_maxwell_modulus()] + kelvin_strain[k, i]
                     + dashpot_strain[k, i];
      if (evolves) {
        path_strain[k, i] = solution[i][3];
        grain_size[k, i] = solution[i][4];
        fabric_factor[k, i]
          = microstructure_at(solution[i][3], initial[k][2],
                              material[k][i_steady_state_fabric_factor()],
                              material[k][i_critical_strain_fabric()]);
      }
    }
  }
}
