// Which mechanism of a composite flow law leads under given conditions, for draws of the law.
//
// The process with the largest rate leads, and in a process of several steps the slowest one, which
// controls it (physics/composite_law.stan).
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/environment.stan
#include physics/composite_law.stan
}
data {
  int<lower=1> n_draws;
  int<lower=1> n_mechanisms;
  array[n_draws] matrix[n_mechanisms, n_of_mechanism()] law;
  array[n_mechanisms] int<lower=1, upper=n_mechanisms> process;
  vector<lower=0>[n_mechanisms] premelting_temperature; // K; 0: none
  real<lower=0> reference_stress; // Pa
  real<lower=0> reference_grain_size; // m
  real<lower=0> reference_temperature; // K
  int<lower=1> n_conditions;
  vector<lower=0>[n_conditions] stress; // Pa
  vector<lower=0>[n_conditions] grain_size; // m
  vector<lower=0>[n_conditions] temperature; // K
  int<lower=0, upper=3> n_environment; // columns, 3 or none (physics/composite_law.stan)
  matrix[n_conditions, n_environment] environment;
  int<lower=0, upper=1> keeps_draws; // 1: report each draw too
}
generated quantities {
  matrix[n_conditions, n_mechanisms] probability = rep_matrix(0, n_conditions, n_mechanisms);
  vector[n_conditions] mean_log_rate = rep_vector(0, n_conditions); // ln(1/s)
  vector[n_conditions] sd_log_rate = rep_vector(0, n_conditions);
  matrix[keeps_draws * n_draws, n_conditions] log_rate; // ln(1/s)
  matrix[keeps_draws * n_draws, n_conditions] stress_exponent; // d ln(rate)/d ln(stress)
  {
    vector[n_conditions] x = log(stress / reference_stress);
    vector[n_conditions] y = log(grain_size / reference_grain_size);
    vector[n_conditions] coldness = inv(temperature) - 1 / reference_temperature;
    for (i in 1 : n_draws) {
      matrix[n_conditions, 4] at
        = composite_law(law[i], process, premelting_temperature, reference_temperature, x, y,
                        coldness, environment);
      vector[n_conditions] total = at[ : , 1];
      matrix[n_conditions, n_mechanisms] rate;
      for (m in 1 : n_mechanisms) {
        rate[ : , m] = log_mechanism_rate(law[i, m], x, y, coldness,
                                          premelted(coldness, premelting_temperature[m],
                                                    reference_temperature),
                                          reference_temperature, environment);
      }
      for (c in 1 : n_conditions) {
        array[max(process)] int slowest = rep_array(0, max(process));
        int leading = 0;
        for (m in 1 : n_mechanisms) {
          int k = process[m];
          if (slowest[k] == 0 || rate[c, m] < rate[c, slowest[k]]) {
            slowest[k] = m;
          }
        }
        for (m in slowest) {
          if (leading == 0 || rate[c, m] > rate[c, leading]) {
            leading = m;
          }
        }
        probability[c, leading] += 1.0 / n_draws;
      }
      if (keeps_draws) {
        log_rate[i] = total';
        stress_exponent[i] = at[ : , 2]';
      }
      mean_log_rate += total / n_draws;
      sd_log_rate += square(total) / n_draws;
    }
    sd_log_rate = sqrt(fmax(sd_log_rate - square(mean_log_rate), 0));
  }
}
