    // Readings of a table: without scatter, replicated, and their log densities.
#include kinds/attenuation_law.stan
    int n_readings = size(readings);
    // What would be read without scatter: the stated error or the limit, where the model lies below.
    vector[n_readings] read;
    vector[n_readings] replicated;
    vector[n_readings] log_density_of_readings
      = log_reading_densities(log_reading_observed[readings], is_limit[readings], law);
    for (i in 1 : n_readings) {
      real limit = log_limit[readings[i]];
      read[i] = fmax(law[i], limit);
      replicated[i] = fmax(normal_rng(law[i], law[n_readings + i]), limit);
    }
