// Peak stresses of the nonlinear Burgers model at constant strain rate, and how far the material
// has softened at them (Maor, Hansen, Jerolmack and Goldsby, Eqs. 1, 3 and 4).
//
// At its peak a test is weaker than undeformed material: grain size and fabric have evolved, and
// the Kelvin element takes a part of the imposed rate. The softening is ln(S_0/peak stress), S_0
// being the stress at which undeformed material flows at the imposed rate (physics/flow_law.stan).
//
// All values are SI. Every material is tested at every condition. There are no parameters to
// sample (algorithm = fixed_param).
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
#include solvers/radau_leg.stan
#include physics/hardening.stan
#include kinds/loading_history_rates.stan
#include kinds/loading_history_legs.stan
#include kinds/loading_history_dynamics.stan
#include kinds/stress_at_constant_rate.stan

  /**
   * Largest stress of a test from rest, by a parabola in ln(strain) through the three outputs
   * about it; the last stress where a test still hardens there.
   *
   * @param parameter, constant, stress_scale, kelvin_law see stress_at_constant_rate()
   * @param strain output strains, a geometric series
   * @return [ln(peak stress/Pa), strain of the peak]
   */
  vector peak_of_test(vector parameter, data vector constant, data array[] real strain,
                      data real strain_rate, data real stress_scale,
                      data real initial_grain_size, data real temperature,
                      data int kelvin_law, data real tolerance, data int max_num_steps) {
    int n = size(strain);
    vector[n] stress = stress_at_constant_rate(parameter, constant, strain, strain_rate,
                                               stress_scale, initial_grain_size, temperature,
                                               kelvin_law, tolerance, max_num_steps);
    int i = sort_indices_desc(stress)[1];
    real rise;
    real fall;
    real shift; // of the parabola's top from the largest output, in outputs
    if (i == 1 || i == n) {
      return [log(stress[i]), strain[i]]';
    }
    rise = stress[i] - stress[i - 1];
    fall = stress[i] - stress[i + 1];
    shift = 0.5 * (rise - fall) / (rise + fall);
    return [log(stress[i] + 0.25 * (rise - fall) * shift),
            strain[i] * pow(strain[i + 1] / strain[i], shift)]';
  }

  /** Relative precision to which a wanted peak stress is met. */
  real peak_precision() { return 1e-4; }

  /** Attempts after which the search for a wanted peak stress ends. */
  int n_attempts() { return 30; }

  /**
   * As peak_of_test(), after Q_M has been changed so that the test has a given peak stress.
   *
   * The softening changes less than the peak stress does, so that a stress S_0 that is raised by
   * what the peak misses comes closer each time.
   *
   * @param log_peak_stress ln(wanted peak stress/Pa)
   * @return [ln(S_0/Pa), ln(peak stress/Pa), strain of the peak]
   */
  vector test_with_peak(data real log_peak_stress, vector parameter, data vector constant,
                        data array[] real strain, data real strain_rate,
                        data real initial_grain_size, data real temperature,
                        data int kelvin_law, data real tolerance,
                        data int max_num_steps) {
    vector[n_parameters()] moved = parameter;
    real log_reference = log_peak_stress;
    vector[2] peak = rep_vector(negative_infinity(), 2);
    for (attempt in 1 : n_attempts()) {
      if (fabs(log_peak_stress - peak[1]) > peak_precision()) {
        if (attempt > 1) {
          log_reference += log_peak_stress - peak[1];
        }
        moved[i_activation_enthalpy()]
          = activation_enthalpy_from_flow(log(strain_rate), log_reference, initial_grain_size,
                                          temperature, parameter[i_stress_exponent()],
                                          parameter[i_grain_size_exponent()],
                                          parameter[i_beta()]);
        peak = peak_of_test(moved, constant, strain, strain_rate, exp(log_peak_stress),
                            initial_grain_size, temperature, kelvin_law, tolerance,
                            max_num_steps);
      }
    }
    return append_row(log_reference, peak);
  }
}
data {
  int<lower=1> n_materials;
  array[n_materials] vector[n_parameters()] parameter; // in the order of physics/parameters.stan
  int<lower=1> n_conditions;
  vector<lower=0>[n_conditions] strain_rate; // 1/s
  vector<lower=0>[n_conditions] grain_size; // at the start, m
  vector<lower=0>[n_conditions] temperature; // K
  // Pa; above 0: Q_M of every material is changed so that this is its peak stress.
  vector<lower=0>[n_conditions] wanted_peak_stress;
  int<lower=3> n_strains;
  array[n_strains] real<lower=0> strain; // at which stress is known, a geometric series
#include data/solver.stan
}
generated quantities {
  matrix[n_materials, n_conditions] log_peak_stress; // ln(Pa)
  matrix[n_materials, n_conditions] peak_strain;
  matrix[n_materials, n_conditions] softening; // ln(S_0/peak stress)
  for (m in 1 : n_materials) {
    for (i in 1 : n_conditions) {
      vector[3] found; // ln(S_0/Pa), ln(peak stress/Pa), strain of the peak
      if (wanted_peak_stress[i] > 0) {
        found = test_with_peak(log(wanted_peak_stress[i]), parameter[m], parameter[m], strain,
                               strain_rate[i], grain_size[i], temperature[i],
                               kelvin_law_at(parameter[m]), tolerance, max_num_steps);
      } else {
        found[1] = log_reference_stress_at(parameter[m], strain_rate[i], grain_size[i],
                                           temperature[i]);
        found[2 : 3] = peak_of_test(parameter[m], parameter[m], strain, strain_rate[i],
                                    exp(found[1]), grain_size[i], temperature[i],
                                    kelvin_law_at(parameter[m]), tolerance, max_num_steps);
      }
      log_peak_stress[m, i] = found[2];
      peak_strain[m, i] = found[3];
      softening[m, i] = found[1] - found[2];
    }
  }
}
