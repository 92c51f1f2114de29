// rest_of_strength.hpp has the body; charts/valley/rest_of_strength.stan of the folder above describes
// the function.
matrix rest_of_strength(real u, vector asked, data vector strain, data matrix bounds);
