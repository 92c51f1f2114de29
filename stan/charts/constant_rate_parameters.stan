    // Parameters of a test, ln |d(these)/d(coordinate)|, and the log density of the pooled ones.
#include charts/given_parameters.stan
#include charts/valley_or_plain.stan
    vector[n_parameters() + 2] mapped
      = append_row(parameters_from_plain(head(plain, size(own)), own_parameter[own],
                                         quantity[own], given, replaced_parameter[e], 1,
                                         log(segment_rate[segment_end[e] + 1]),
                                         initial_grain_size[e], temperature[e]),
                   pooled[n_parameters() + 2]);
    mapped[n_parameters() + 1] += pooled[n_parameters() + 1] + plain[size(own) + 1];
