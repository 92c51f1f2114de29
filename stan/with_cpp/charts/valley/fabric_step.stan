// fabric_step.hpp has the body; charts/valley/fabric_step.stan of the folder above describes the function.
vector fabric_step(vector solved, vector rest, data vector strain, vector weight,
                   data int stress_given, data matrix bounds);
