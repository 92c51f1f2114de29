// Coordinates (functions/coordinates.stan): one for each free parameter.
int<lower=0, upper=n_parameters()> n_coordinates;
array[n_coordinates] int<lower=1, upper=n_parameters()> parameter_of_coordinate;
vector[n_coordinates] quantity_shift; // SI; ln Pa for the reference stress
vector[n_coordinates] quantity_scale;
vector[n_coordinates] quantity_lower;
vector[n_coordinates] quantity_upper;
int<lower=0, upper=n_parameters()> replaced_parameter;
