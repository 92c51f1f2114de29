// Plain coordinates (functions/coordinates.stan).
int<lower=0, upper=n_parameters()> n_coordinates;
array[n_coordinates] int<lower=1, upper=n_parameters()> parameter_of_coordinate;
vector[n_coordinates] coordinate_shift;
vector[n_coordinates] coordinate_scale;
vector[n_coordinates] coordinate_lower;
vector[n_coordinates] coordinate_upper;
int<lower=0, upper=n_parameters()> replaced_parameter;
