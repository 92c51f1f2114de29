// factor_along_fabric_strain.hpp has the body; charts/valley/factor_along_fabric_strain.stan of the
// folder above describes the function.
matrix factor_along_fabric_strain(vector fabric_strain, real total_softening, vector rest,
                                  data vector strain, vector weight, data int stress_given,
                                  data matrix bounds);
