// Fluidity of the dashpot under stress cycles, whatever the median stress.
functions {
#include physics/flow_law.stan
#include physics/stress_cycles.stan
}
data {
  int<lower=0> n;
  vector[n] median_stress;
  vector[n] amplitude;
  vector[n] stress_exponent;
  vector[n] breakdown_stress;
  int n_nodes;
  array[n] matrix[n_nodes, 2] node; // rows of 0 behind those of a case
}
generated quantities {
  vector[n] log_fluidity;
  vector[n] log_fluidity_by_nodes;
  for (i in 1 : n) {
    log_fluidity[i] = log_fluidity_of_stress(median_stress[i], amplitude[i], stress_exponent[i],
                                             breakdown_stress[i], node[i][ : , 1],
                                             node[i][ : , 2]);
    log_fluidity_by_nodes[i] = log_fluidity_about(median_stress[i], amplitude[i],
                                                  stress_exponent[i], breakdown_stress[i],
                                                  node[i][ : , 1], node[i][ : , 2]);
  }
}
