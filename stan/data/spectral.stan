// Spectral coordinates (charts/spectral.stan).
array[n_tests] vector[2] spectral_reference; // see plain_from_spectral()
