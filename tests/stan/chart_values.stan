// Values of the functions of the charts, on their own.
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
#include charts/plain.stan
#include charts/parted_rates.stan
#include charts/sheared.stan
#include charts/valley/pins.stan
#include charts/valley/mechanisms.stan
#include charts/valley/least_squares.stan
#include charts/valley/quantiles.stan
#include charts/valley/softening.stan
#include charts/valley/elastic_rise.stan
#include charts/valley/grain_size_edge.stan
#include charts/valley/valley.stan
}
data {
  int<lower=0> n;
  real stress_exponent;
  int<lower=2> n_solutions;
  vector[n_solutions] log_dashpot_compliance; // at 0, 0.5, 1, ...
  int<lower=0> n_rates;
  vector[n_rates] log_rate;
  real<lower=0> period;
  real<lower=0> maxwell_modulus;
  real<lower=0> dashpot;
  vector[2] compliance;
  vector[2 * n_places() + 1] log_density; // at the places
  vector[n] log_odds;
  real place; // of a bounded parameter in its range
  real<lower=0> deviation;
  vector[n] remainder;
  int<lower=1> n_pins;
  vector<lower=0>[n_pins] strain;
  matrix[3, 2] bounds;
  vector[2] u; // real numbers behind (epsilon_c1, epsilon_c2)
  real fabric_amplitude; // 1 - F_ss
  real exponent_ratio;
  real log_grain_size_ratio;
  real softening; // of the whole curve
  real<lower=0> initial_grain_size;
  row_vector[4] grain_size_prior; // row of d_ss (charts/plain.stan)
  vector[n_pins] strength;
  vector<lower=0>[n_pins] time_spent;
  vector[n_pins] dashpot_rate; // over that of the reference curve
  real expected_stress; // ln S_0
  vector<lower=0>[2] seen; // see stress_from_flow()
  int<lower=0> n_values;
  vector[n_values] value; // of a parameter, within its bounds or beyond them
  row_vector[4] quantity; // row of that parameter (charts/plain.stan)
  // Strength at the pins of a test (charts/valley/pins.stan).
  vector[n_parameters()] parameter;
  real<lower=0> temperature;
  int<lower=1> n_elements;
  matrix[n_elements, 3] element;
  int<lower=0> n_knots;
  matrix[n_knots, 3] knot;
  int<lower=0> n_at_knots;
  matrix[n_at_knots, 10] pin;
  real<lower=0> rise_time;
}
transformed data {
  vector[n_record() + n_solutions] record = append_row(rep_vector(0, n_record()),
                                                       log_dashpot_compliance);
  matrix[n_pins, 10] timed = rep_matrix(1, n_pins, 10);
  record[r_log_rate_step()] = 0.5;
  timed[ : , 8] = time_spent;
}
generated quantities {
  // Of every network, a whole rate of 1 from that of its first mechanism.
  vector[6] whole_again;
  vector[n_rates] dashpot_loss;
  vector[n_values] real_number;
  vector[2] kelvin = kelvin_left_over(maxwell_modulus, dashpot, compliance, period);
  vector[n] quantile_place;
  vector[n] quantile_log_slope;
  vector[n] bounded;
  vector[n] bounded_log_slope;
  vector[n] stress_of_flow;
  vector[n] stress_of_flow_log_slope;
  vector[n] at_edge;
  vector[n] at_edge_log_slope;
  matrix[n_pins, 2] grain = grain_softening(u[1], exponent_ratio, log_grain_size_ratio, strain,
                                            bounds);
  real stress_of_time = reference_stress_of_time(strength, time_spent, stress_exponent);
  matrix[n_elements, 2] element_of_test = kelvin_elements(parameter, element, temperature,
                                                          initial_grain_size);
  real rise_compliance = loading_compliance(element_of_test, rise_time);
  vector[n_at_knots] strength_at_pins
    = log_strength_at_pins(knot, pin,
                           dashpot_rate_at_pins(knot, pin, parameter[i_maxwell_modulus()],
                                                element_of_test, 1),
                           parameter[i_stress_exponent()], 1);
  matrix[n_pins, 3] fabric = fabric_softening(u[2], fabric_amplitude, strain, bounds);
  {
    array[6] int act = {1, 2, 4, 5, 7, 8};
    matrix[6, 2] further = [[0.2, 1], [3, 1], [0.2, 0.1], [3, 0.1], [0.4, 0.6], [5, 6]];
    for (i in 1 : 6) {
      vector[2] own = further[i]';
      whole_again[i] = rate_of_mechanisms(first_of_mechanisms(1, own, act[i], least_first_share()), own,
                                          act[i]);
    }
  }
  for (i in 1 : n_values) {
    real_number[i] = real_from_bounded(value[i], quantity);
  }
  for (i in 1 : n_rates) {
    dashpot_loss[i] = dashpot_compliance(log_rate[i], record);
  }
  for (i in 1 : n) {
    vector[2] quantile = place_of_quantile(log_odds[i], log_density);
    vector[2] from_remainder = bounded_from_remainder(place, deviation, remainder[i]);
    vector[2] stretched = grain_size_at_edge(log_odds[i], exponent_ratio, softening,
                                             initial_grain_size, grain_size_prior);
    vector[2] of_flow = stress_from_flow(remainder[i], strength, dashpot_rate, expected_stress,
                                         timed, 1, stress_exponent, seen);
    stress_of_flow[i] = of_flow[1];
    stress_of_flow_log_slope[i] = of_flow[2];
    at_edge[i] = stretched[1];
    at_edge_log_slope[i] = stretched[2];
    quantile_place[i] = quantile[1];
    quantile_log_slope[i] = quantile[2];
    bounded[i] = from_remainder[1];
    bounded_log_slope[i] = from_remainder[2];
  }
}
