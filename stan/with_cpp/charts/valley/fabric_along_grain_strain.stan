// fabric_along_grain_strain.hpp has the body; charts/valley/fabric_along_grain_strain.stan of the folder
// above describes the function.
matrix fabric_along_grain_strain(vector grain_strain, vector asked, data vector reference,
                                 data vector strain, vector weight, data int stress_given,
                                 data matrix bounds);
