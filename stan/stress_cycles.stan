// Closed forms of a material under a hold at a median stress and stress cycles about it, the
// microstructure frozen (docs/attenuation.md). Every draw of the posterior is one `material`;
// generated quantities are all that is computed. All values are SI.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/environment.stan
#include physics/composite_law.stan
#include physics/dashpot_mechanisms.stan
#include physics/dashpot_laws.stan
#include physics/kelvin_laws.stan
#include physics/relaxation.stan
#include physics/microstructure.stan
#include physics/stress_cycles.stan
#include kinds/material_at_stress.stan
#include kinds/cycle_strain.stan
}
data {
  real<lower=0> temperature; // K
  int<lower=0> n_frequencies;
  vector<lower=0>[n_frequencies] frequency; // Hz
  int<lower=0> n_regimes;
  vector<lower=0>[n_regimes] median_stress; // Pa
  vector<lower=0>[n_regimes] amplitude; // Pa
  // Integral of the fluidity: columns sine and weight of every regime (physics/stress_cycles.stan).
  array[n_regimes + 1] int<lower=0> node_end;
  matrix[node_end[n_regimes + 1], 2] node;
  // sin(omega t) where the strain of a cycle is summed; none: it is not computed.
  int<lower=0> n_sines;
  vector[n_sines] sine;
  // Elements of the Kelvin part (physics/relaxation.stan).
  int<lower=1> n_elements;
  matrix[n_elements, 3] element;
  int<lower=0> n_delays; // frequencies at which a peak of many relaxation times is looked for
  real<lower=0> hold_time; // s
  int<lower=0> n_times;
  vector[n_times] log_time; // ln(relaxation time/s) at which their density is asked for
}
parameters {
  vector[n_parameters() + 3] material; // parameters, grain size (m), fabric factor, a stress (Pa)
}
generated quantities {
  real maxwell_modulus; // at the temperature, Pa
  real dashpot_rate; // at the stress, 1/s
  vector[n_frequencies] storage_compliance; // 1/Pa
  vector[n_frequencies] kelvin_loss; // of the Kelvin part, 1/Pa
  vector[n_regimes] fluidity; // B, 1/(Pa s)
  array[n_regimes] int has_peak;
  vector[n_regimes] held_rate; // of the dashpot at the median stress, 1/s
  vector[n_regimes] steepness; // d ln(rate)/d ln(stress) of the dashpot at the peak; 0: it rests
  vector[n_regimes] wanted_grain_size; // in the end, at the median stress, m
  matrix[n_sines > 0 ? n_regimes : 0, n_frequencies] cycle_strain; // path strain of a cycle
  real longest_time; // tau of the Kelvin part, s
  real kelvin_creep_of_hold; // strain over stress, 1/Pa
  vector[n_times] time_density; // compliance over ln(relaxation time), 1/Pa
  matrix[n_times > 0 ? n_elements : 0, 2] elements; // relaxation time (s), compliance (1/Pa)
  {
    vector[n_parameters()] parameter = head(material, n_parameters());
    real grain_size = material[n_parameters() + 1];
    real fabric_factor = material[n_parameters() + 2];
    vector[n_frequencies] log_frequency = log(2 * pi() * frequency);
    real log_longest = log_relaxation_time(parameter, temperature, grain_size);
    matrix[n_frequencies, 2] kelvin = kelvin_compliance(log_frequency + log_longest, parameter);
    matrix[n_elements, 2] decays = relaxation_elements(element, relaxation_numbers(parameter));
    vector[n_delays] log_delay = log(1e-3)
                                 + linspaced_vector(n_delays, 0,
                                                    log(1e6) + log(max(decays[ : , 1])));
    matrix[n_delays, 2] away = kelvin_compliance(log_delay, parameter);
    longest_time = exp(log_longest);
    kelvin_creep_of_hold = kelvin_creep(hold_time / longest_time, parameter, element);
    time_density = relaxation_density(log_longest - log_time, parameter);
    if (n_times > 0) {
      elements = append_col(longest_time ./ decays[ : , 1],
                            decays[ : , 2] / parameter[i_kelvin_modulus()]);
    }
    maxwell_modulus = maxwell_modulus_at(parameter, rep_vector(temperature, 1))[1];
    dashpot_rate = dashpot_rate_at(material[n_parameters() + 3], 0, grain_size, fabric_factor,
                                   parameter, temperature);
    storage_compliance = 1 / maxwell_modulus + kelvin[ : , 1];
    kelvin_loss = kelvin[ : , 2];
    for (r in 1 : n_regimes) {
      // Stresses over F act as on isotropic material, in which strain per stress is F times as much.
      fluidity[r]
        = exp(log_fluidity_of_stress(median_stress[r] / fabric_factor,
                                     amplitude[r] / fabric_factor,
                                     parameter[i_stress_exponent()],
                                     parameter[i_breakdown_stress()],
                                     node[node_end[r] + 1 : node_end[r + 1], 1],
                                     node[node_end[r] + 1 : node_end[r + 1], 2])
              - log(fabric_factor)
              + log_rate_factor_at(parameter, temperature)
              - parameter[i_grain_size_exponent()] * log(grain_size));
      fluidity[r] = exp(log_fluidity_of_all(log(fluidity[r]), median_stress[r], amplitude[r],
                                            grain_size, parameter, temperature,
                                            node[node_end[r] + 1 : node_end[r + 1], 1],
                                            node[node_end[r] + 1 : node_end[r + 1], 2]));
      has_peak[r] = n_delays > 0
                    ? rises_somewhere((away[ : , 2] + fluidity[r] * exp(log_longest - log_delay))
                                      ./ (1 / maxwell_modulus + away[ : , 1]))
                    : element_has_peak(parameter[i_kelvin_modulus()] / maxwell_modulus,
                                       fluidity[r] * parameter[i_kelvin_modulus()]
                                       * longest_time);
      held_rate[r] = dashpot_rate_at(median_stress[r], 0, grain_size, fabric_factor, parameter,
                                     temperature);
      {
        real step = 1e-4; // of ln(stress)
        real peak = median_stress[r] + amplitude[r];
        real rate = dashpot_rate_at(peak, 0, grain_size, fabric_factor, parameter, temperature);
        real faster = dashpot_rate_at(exp(step) * peak, 0, grain_size, fabric_factor, parameter,
                                      temperature);
        steepness[r] = rate > 0 ? log(faster / rate) / step : 0;
      }
      wanted_grain_size[r] = preferred_grain_size(median_stress[r], parameter);
      if (n_sines > 0) {
        vector[n_sines] rate;
        for (k in 1 : n_sines) {
          rate[k] = dashpot_rate_at(median_stress[r] + amplitude[r] * sine[k], 0, grain_size,
                                    fabric_factor, parameter, temperature);
        }
        for (i in 1 : n_frequencies) {
          cycle_strain[r, i] = settled_cycle_strain(rate / frequency[i], sine,
                                                    amplitude[r] * storage_compliance[i],
                                                    amplitude[r] * kelvin_loss[i]);
        }
      }
    }
  }
}
