// The paper's six states at given parameters: what simulate() does for the two-state program.
functions {
#include functions/parameters.stan
#include functions/flow_law.stan
#include functions/microstructure.stan
#include functions/six_state_dynamics.stan
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
  vector[11] parameter; // the first in the order of functions/parameters.stan
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
                                        segment_rate[k], temperature, parameter[1],
                                        parameter[2], parameter[3], parameter[4], parameter[5],
                                        parameter[6], parameter[7], parameter[8], parameter[9],
                                        parameter[10], parameter[11]);
      start = state[last];
      first = last + 1;
    }
  }
}
