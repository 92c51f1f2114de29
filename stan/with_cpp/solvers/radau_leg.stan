// radau_leg.hpp has the body; solvers/radau_leg.stan of the folder above describes the function.
array[] vector radau_leg(data array[] int law, data array[] real known, data array[] real time,
                         data real tolerance, vector start, vector argument);
