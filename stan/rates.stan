// Flow law from tables of steady rates: one row for each test, at its minimum rate, its peak stress
// or in its steady state.
//
// Stress or strain rate is imposed, the other is read. Specimens differ by a factor of their rate,
//
//   ln(rate) = ln f(stress, grain size, temperature) + bias of the source + enhancement + scatter,
//
// with f a composite flow law (physics/composite_law.stan). If the rate is imposed, the density of
// ln(stress) is that of the scatter times |d ln f/d ln(stress)|: no equation is solved. Errors of
// temperature and grain size, and errors of reading, change ln(rate) by the slopes of f, to first
// order, and add to the variance of the scatter.
//
// A source (a paper or a laboratory) is off by a factor of all its rates and by a temperature, and
// has a scatter of its own; these are normal, in ln for factors, about none and about the scatter
// of all. A rate in the steady state is larger than the least one by an enhancement.
//
// At its peak, or its minimum rate, a test is weaker than undeformed material by a softening h. With
// its prior (statistics/softening.stan, simulated by peaks.stan) the stress in f is that of
// undeformed material, larger than the stress of the test by exp(h),
//
//   h = h_1 + h_2 x_rate + h_3 x_stress + h_4 x_grain_size,
//
// x being distances from the mean conditions. Only laws of one mechanism have it.
//
// All values are SI. Rows that are not used have no likelihood: they are predicted.
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/environment.stan
#include physics/composite_law.stan
#include statistics/priors.stan
#include statistics/softening.stan
#include charts/plain.stan

  // Parameters that follow those of the mechanisms, see n_of_mechanism().
  int n_of_tables() { return 6; }
  int s_scatter() { return 1; } // standard deviation of ln(rate) of specimens
  int s_source_rate() { return 2; } // of ln(rate) of sources
  int s_source_temperature() { return 3; } // of the temperature of sources, K
  int s_source_scatter() { return 4; } // of ln(scatter) of sources
  int s_enhancement() { return 5; } // axial, then in shear

  /** ln of what multiplies the rates of rows: bias of the source and enhancement (0: none). */
  vector log_offset(vector source_rate, data array[] int source, vector enhancement,
                    data array[] int enhancement_place) {
    vector[size(source)] offset = source_rate[source];
    for (i in 1 : size(source)) {
      if (enhancement_place[i] > 0) {
        offset[i] += log(enhancement[enhancement_place[i]]);
      }
    }
    return offset;
  }
}
data {
  int<lower=1> n_rows;
  vector<lower=0>[n_rows] stress; // axial equivalent, Pa
  vector<lower=0>[n_rows] strain_rate; // axial equivalent, 1/s
  vector<lower=0>[n_rows] temperature; // K
  vector<lower=0>[n_rows] grain_size; // m
  array[n_rows] int<lower=0, upper=1> stress_is_imposed;
  array[n_rows] int<lower=0, upper=1> is_used; // by the likelihood
  array[n_rows] int<lower=0, upper=2> enhancement_place; // 0: none
  vector<lower=0>[n_rows] reading_error; // of the read quantity, relative
  vector<lower=0>[n_rows] temperature_error; // K
  vector<lower=0>[n_rows] grain_size_error; // relative
  int<lower=0, upper=3> n_environment; // columns, 3 or none (physics/composite_law.stan)
  matrix[n_rows, n_environment] environment;
  int<lower=1> n_sources;
  array[n_rows] int<lower=1, upper=n_sources> source;
  // 1: the bias of a source is sampled as it is, 0: over its standard deviation; between: both.
  vector<lower=0, upper=1>[n_sources] centring;
  vector[n_sources] typical_slope; // of ln(rate) by temperature, 1/K: speed only
  // The law and its priors.
  int<lower=1> n_mechanisms;
  array[n_mechanisms] int<lower=1, upper=n_mechanisms> process; // see composite_law()
  // 1: beta = ln(A)/Q (mol/J, physics/flow_law.stan) is the parameter in place of the rate.
  array[n_mechanisms] int<lower=0, upper=1> has_beta;
  vector<lower=0>[n_mechanisms] premelting_temperature; // K; 0: none
  real<lower=0> reference_stress; // Pa
  real<lower=0> reference_grain_size; // m
  real<lower=0> reference_temperature; // K
  array[n_mechanisms * n_of_mechanism() + n_of_tables()] int<lower=0, upper=3> prior_family;
  vector[n_mechanisms * n_of_mechanism() + n_of_tables()] prior_location;
  vector[n_mechanisms * n_of_mechanism() + n_of_tables()] prior_scale;
  vector[n_mechanisms * n_of_mechanism() + n_of_tables()] prior_lower;
  vector[n_mechanisms * n_of_mechanism() + n_of_tables()] prior_upper;
  // Coordinates (charts/plain.stan). One of a mechanism may be its rate at mean_conditions, from
  // which its parameter (the rate, Q or beta) follows.
  int<lower=0, upper=n_mechanisms * n_of_mechanism() + n_of_tables()> n_coordinates;
  array[n_coordinates] int<lower=1> own_parameter;
  array[n_coordinates] int<lower=0, upper=n_mechanisms> flow_of; // the mechanism; 0: none
  matrix[n_coordinates, 4] quantity;
  vector[3] mean_conditions; // mean ln(S/S_1), ln(d/d_1), 1/T - 1/T_1 of the used rows
  matrix[1, n_environment] mean_environment; // of the used rows; P is the mean P/T by the mean T
  // Prior of the softening, see softening_at().
  int<lower=0, upper=1> is_softened;
  real mean_log_rate; // of the used rows, ln(rate s)
  matrix[n_softening(), 3] softening_coefficients;
  vector[2] softening_centre; // ln n, ln p
  matrix[n_softening(), n_softening()] softening_factor;
  int<lower=0, upper=1> use_likelihood; // 0: prior only
  // Conditions at which generated quantities report rates.
  int<lower=0> n_grid;
  vector<lower=0>[n_grid] grid_stress;
  vector<lower=0>[n_grid] grid_grain_size;
  vector<lower=0>[n_grid] grid_temperature;
  matrix[n_grid, n_environment] grid_environment;
}
transformed data {
  vector[n_rows] stress_imposed = to_vector(stress_is_imposed); // 1: yes
  int n_quantities = n_mechanisms * n_of_mechanism() + n_of_tables();
  int n_of_law = n_mechanisms * n_of_mechanism();
  int has_sources = n_sources > 1;
  real mean_stress = reference_stress * exp(mean_conditions[1]);
  real mean_grain_size = reference_grain_size * exp(mean_conditions[2]);
  real mean_temperature = inv(1 / reference_temperature + mean_conditions[3]);
  vector[n_rows] x = log(stress) - log(reference_stress);
  vector[n_rows] y = log(grain_size) - log(reference_grain_size);
  vector[n_rows] log_rate = log(strain_rate);
  vector[n_quantities] prior_mass
    = prior_log_masses({prior_family}, {prior_location}, {prior_scale}, {prior_lower},
                       {prior_upper})[1];
  // Distances of ln(rate), ln(stress) and ln(grain size) from the mean conditions.
  matrix[n_rows, 3] shift = append_col(append_col(log_rate - mean_log_rate,
                                                  x - mean_conditions[1]),
                                       y - mean_conditions[2]);
}
parameters {
  vector[n_coordinates] coordinate;
  vector[has_sources * n_sources] rate_coordinate;
  vector[has_sources * n_sources] temperature_coordinate;
  vector[has_sources * n_sources] scatter_coordinate;
  vector[is_softened * n_softening()] softening_coordinate;
}
transformed parameters {
  vector[n_quantities] parameter = prior_location;
  matrix[n_mechanisms, n_of_mechanism()] law;
  vector[n_sources] source_rate = rep_vector(0, n_sources); // in ln(rate)
  vector[n_sources] source_temperature = rep_vector(0, n_sources); // K
  vector[n_sources] source_scatter; // standard deviation of ln(rate) of specimens
  vector[n_softening()] softening = rep_vector(0, n_softening());
  vector[n_rows] read_slope; // |d residual/d ln(read quantity)|
  vector[n_rows] residual; // of ln(rate)
  vector[n_rows] deviation; // of ln(rate), with errors of reading
  vector[n_rows] log_lik; // of ln(stress) or ln(rate), the one that was read
  real lprior; // log density of the priors on the physical parameters
  real log_jacobian = 0; // ln |d(physical parameters)/d(coordinates)|
  {
    for (i in 1 : n_coordinates) {
      if (flow_of[i] == 0) {
        parameter[own_parameter[i]] = bounded_from_real(coordinate[i], quantity[i]);
        log_jacobian += log_slope_of_bounded(coordinate[i], quantity[i]);
      }
    }
    if (is_softened) {
      softening = softening_at(softening_coordinate, parameter[m_stress_exponent()],
                               parameter[m_grain_size_exponent()], softening_coefficients,
                               softening_centre, softening_factor);
    }
    for (i in 1 : n_coordinates) {
      if (flow_of[i] > 0) {
        int k = own_parameter[i];
        int m = flow_of[i];
        row_vector[n_of_mechanism()] own
          = parameter[((m - 1) * n_of_mechanism() + 1) : (m * n_of_mechanism())]';
        real n = own[m_stress_exponent()];
        real p = own[m_grain_size_exponent()];
        // Undeformed material flows more slowly than the tests, whatever the softening.
        real u = coordinate[i] - n * softening[h_mean()];
        if (has_beta[m] && k % n_of_mechanism() == m_rate()) {
          real q = own[m_activation_enthalpy()];
          parameter[k] = beta_from_flow(u + mean_log_rate, log(mean_stress), mean_grain_size,
                                        mean_temperature, n, p, q);
          log_jacobian -= log(q);
        } else if (has_beta[m]) {
          real beta = own[m_rate()];
          parameter[k] = activation_enthalpy_from_flow(u + mean_log_rate, log(mean_stress),
                                                       mean_grain_size, mean_temperature, n, p,
                                                       beta);
          log_jacobian -= log(1 / (gas_constant() * mean_temperature) - beta);
        } else {
          vector[3] change = parameter[(k + 1) : (k + 3)] - prior_location[(k + 1) : (k + 3)];
          u += change[2] * mean_conditions[2] + change[3] * mean_conditions[3] / gas_constant()
               - change[1] * mean_conditions[1];
          if (n_environment > 0) {
            vector[3] others = parameter[(k + m_activation_volume() - m_rate())
                                         : (k + m_melt_factor() - m_rate())]
                               - prior_location[(k + m_activation_volume() - m_rate())
                                                : (k + m_melt_factor() - m_rate())];
            u += others[1] * mean_environment[1, 1] / (gas_constant() * mean_temperature)
                 - others[2] * mean_environment[1, 2] - others[3] * mean_environment[1, 3];
          }
          parameter[k] = bounded_from_real(u, quantity[i]);
          log_jacobian += log_slope_of_bounded(u, quantity[i]);
        }
      }
    }
    law = to_matrix(parameter[1 : n_of_law], n_mechanisms, n_of_mechanism(), 0);
    for (m in 1 : n_mechanisms) {
      law[m, m_rate()] = has_beta[m]
                         ? log_flow_rate(reference_stress, reference_grain_size,
                                         reference_temperature, law[m, m_stress_exponent()],
                                         law[m, m_grain_size_exponent()],
                                         law[m, m_activation_enthalpy()], law[m, m_rate()])
                         : log(law[m, m_rate()]);
    }
    lprior = joint_prior_log_density(parameter, prior_family, prior_location, prior_scale,
                                     prior_lower, prior_upper, prior_mass);
  }
  {
    vector[n_of_tables()] spread = parameter[(n_of_law + 1) : n_quantities];
    vector[n_rows] x_undeformed = x;
    vector[n_rows] coldness; // 1/T - 1/T_1 at the true temperatures
    matrix[n_rows, 4] at;
    source_scatter = rep_vector(spread[s_scatter()], n_sources);
    if (has_sources) {
      source_temperature = spread[s_source_temperature()] * temperature_coordinate;
      for (k in 1 : n_sources) {
        source_rate[k] = pow(spread[s_source_rate()], 1 - centring[k]) * rate_coordinate[k]
                         - centring[k] * typical_slope[k] * source_temperature[k];
      }
      source_scatter = source_scatter .* exp(spread[s_source_scatter()] * scatter_coordinate);
    }
    coldness = inv(temperature + source_temperature[source]) - 1 / reference_temperature;
    if (is_softened) {
      x_undeformed += softening[h_mean()] + shift * softening[h_rate() : h_grain_size()];
    }
    at = composite_law(law, process, premelting_temperature, reference_temperature,
                       x_undeformed, y, coldness, environment);
    residual = log_rate - at[ : , 1]
               - log_offset(source_rate, source,
                            spread[s_enhancement() : (s_enhancement() + 1)],
                            enhancement_place);
    read_slope = stress_imposed - softening[h_rate()] * stress_imposed .* at[ : , 2]
                 + (1 + softening[h_stress()]) * (1 - stress_imposed) .* at[ : , 2];
    deviation = sqrt(square(source_scatter[source]) + square(reading_error .* read_slope)
                     + square(grain_size_error .* at[ : , 3])
                     + square(temperature_error .* at[ : , 4] ./ square(temperature)
                              / gas_constant()));
    log_lik = -0.5 * square(residual ./ deviation) - log(deviation) + log(read_slope)
              - 0.5 * log(2 * pi());
  }
}
model {
  target += lprior + log_jacobian;
  if (has_sources) {
    for (k in 1 : n_sources) {
      // Of the bias over the factor of its coordinate.
      target += normal_lpdf(source_rate[k]
                            / pow(parameter[n_of_law + s_source_rate()], 1 - centring[k]) |
                            0, pow(parameter[n_of_law + s_source_rate()], centring[k]));
    }
    target += std_normal_lpdf(temperature_coordinate);
    target += std_normal_lpdf(scatter_coordinate);
  }
  target += std_normal_lpdf(softening_coordinate);
  if (use_likelihood) {
    target += dot_product(to_vector(is_used), log_lik);
  }
}
generated quantities {
  vector[n_rows] log_read_model; // ln(Pa) or ln(1/s), without scatter
  vector[n_rows] log_read_replicated;
  vector[n_rows] residual_replicated; // of ln(rate), of the same specimens and readings
  vector[n_grid] grid_log_rate; // of no source, at the least rate, of undeformed material
  vector[is_softened * n_grid] grid_test_log_rate; // the same of softened tests
  vector[n_mechanisms] beta; // mol/J, without premelting
  real mean_flow_log_rate; // the same at the mean conditions
  real mean_flow_log_rate_of_test; // of another specimen and source
  {
    vector[n_rows] coldness = inv(temperature + source_temperature[source])
                              - 1 / reference_temperature;
    vector[n_rows] log_law_rate // ln f at the imposed rates
      = log_rate - log_offset(source_rate, source,
                              parameter[(n_of_law + s_enhancement()) : n_quantities],
                              enhancement_place);
    vector[n_rows] noise; // of ln(rate) of another specimen
    array[2] vector[n_rows] read;
    for (i in 1 : n_rows) {
      noise[i] = normal_rng(0, sqrt(square(deviation[i])
                                    - square(reading_error[i] * read_slope[i])));
    }
    for (j in 1 : 2) {
      // The undeformed stress at the imposed rate, brought to the stress of the test.
      vector[n_rows] solved
        = log_stress_of_rate(log_law_rate - (j - 1) * noise, x, law, process,
                             premelting_temperature, reference_temperature, y, coldness,
                             environment);
      for (i in 1 : n_rows) {
        if (stress_is_imposed[i]) {
          // ln f is straight in the undeformed stress if there is a softening.
          read[j, i] = log_rate[i] - (residual[i] - (j == 2 ? noise[i] : 0)) / read_slope[i];
        } else {
          read[j, i] = mean_conditions[1] + log(reference_stress)
                       + (solved[i] - mean_conditions[1] - softening[h_mean()]
                          - softening[h_rate()] * shift[i, 1]
                          - softening[h_grain_size()] * shift[i, 3])
                         / (1 + softening[h_stress()]);
        }
      }
    }
    log_read_model = read[1];
    for (i in 1 : n_rows) {
      real misread = reading_error[i] * std_normal_rng();
      log_read_replicated[i] = read[2, i] + misread;
      residual_replicated[i] = noise[i] + read_slope[i] * misread;
    }
  }
  if (n_grid > 0) {
    vector[n_grid] grid_x = log(grid_stress) - log(reference_stress);
    vector[n_grid] grid_y = log(grid_grain_size) - log(reference_grain_size);
    matrix[n_grid, 4] at = composite_law(law, process, premelting_temperature,
                                         reference_temperature, grid_x, grid_y,
                                         inv(grid_temperature) - 1 / reference_temperature,
                                         grid_environment);
    grid_log_rate = at[ : , 1];
    if (is_softened) {
      // ln f is straight in the undeformed stress: solved for the rate, on which h depends.
      grid_test_log_rate
        = (at[ : , 1]
           + at[ : , 2]
             .* (softening[h_mean()] - softening[h_rate()] * mean_log_rate
                 + softening[h_stress()] * (grid_x - mean_conditions[1])
                 + softening[h_grain_size()] * (grid_y - mean_conditions[2])))
          ./ (1 - softening[h_rate()] * at[ : , 2]);
    }
  }
  for (m in 1 : n_mechanisms) {
    beta[m] = beta_from_flow(law[m, m_rate()], log(reference_stress), reference_grain_size,
                             reference_temperature, law[m, m_stress_exponent()],
                             law[m, m_grain_size_exponent()],
                             law[m, m_activation_enthalpy()]);
  }
  mean_flow_log_rate = composite_law(law, process, premelting_temperature,
                                     reference_temperature, [mean_conditions[1]]',
                                     [mean_conditions[2]]', [mean_conditions[3]]',
                                     mean_environment)[1, 1];
  {
    real scatter = parameter[n_of_law + s_scatter()]
                   * exp(parameter[n_of_law + s_source_scatter()] * std_normal_rng());
    mean_flow_log_rate_of_test = mean_flow_log_rate + scatter * std_normal_rng()
                                 + parameter[n_of_law + s_source_rate()] * std_normal_rng();
  }
}
