// The paper's six states at given parameters: what simulate() does for the two-state program.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/microstructure.stan
#include reference/six_state_dynamics.stan
}
data {
  real<lower=0> temperature;
  real<lower=0> initial_grain_size;
  int<lower=1> n_segments;
  array[n_segments] real<lower=0> segment_time; // start of each segment, s
  array[n_segments] real<lower=0> segment_rate; // 1/s
  int<lower=0> n_times;
  array[n_times] real<lower=0> time; // s
  array[n_segments] int<lower=1> n_times_in_segment;
  vector[11] parameter; // the first in the order of physics/parameters.stan
}
generated quantities {
  array[n_times] vector[6] state;
  {
    vector[6] start = [0, 0, 0, 0, initial_grain_size, 1]';
    int first = 1;
    for (k in 1 : n_segments) {
      int last = first + n_times_in_segment[k] - 1;
      state[first : last] = ode_bdf_tol(six_state_rhs, start, segment_time[k],
                                        time[first : last], 1e-11, 1e-12, 1000000,
                                        segment_rate[k], temperature,
                                        parameter[i_maxwell_modulus()],
                                        parameter[i_kelvin_modulus()],
                                        parameter[i_kelvin_viscosity()],
                                        parameter[i_stress_exponent()],
                                        parameter[i_grain_size_exponent()],
                                        parameter[i_activation_enthalpy()], parameter[i_beta()],
                                        parameter[i_steady_state_grain_size()],
                                        parameter[i_steady_state_fabric_factor()],
                                        parameter[i_critical_strain_grain_size()],
                                        parameter[i_critical_strain_fabric()]);
      start = state[last];
      first = last + 1;
    }
  }
}
