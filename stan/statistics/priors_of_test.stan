/**
 * Log density of the priors of one test, that of its flow law included where it is counted here.
 *
 * @param parameter and the others as for joint_prior_log_density()
 * @param has_flow_law 1: the joint prior of the flow law counts here
 * @param flow_law_mean, flow_law_factor, flow_law_conditions see flow_law_prior_log_density()
 */
real test_prior_log_density(vector parameter, data array[] int family, data vector location,
                            data vector scale, data vector lower_bound, data vector upper_bound,
                            data vector log_mass, data int has_flow_law,
                            data vector flow_law_mean, data matrix flow_law_factor,
                            data vector flow_law_conditions) {
  real log_density = joint_prior_log_density(parameter, family, location, scale, lower_bound,
                                             upper_bound, log_mass);
  return has_flow_law
         ? log_density
           + flow_law_prior_log_density(parameter[i_stress_exponent()],
                                        parameter[i_grain_size_exponent()],
                                        parameter[i_activation_enthalpy()], parameter[i_beta()],
                                        flow_law_mean, flow_law_factor, flow_law_conditions)
         : log_density;
}
