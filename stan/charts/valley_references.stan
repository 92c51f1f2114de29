  // What the valley coordinates of each test are set up with.
  array[coordinate_system == 2 ? n_tests : 0] vector[7] conditions; // see plain_from_valley()
  array[n_tests + 1] int reference_end; // of the valley's references
  vector[pin_end[n_tests + 1] + n_tests * n_reference()] reference;
  for (e in 1 : n_tests) {
    reference_end[e] = pin_end[e] + (e - 1) * n_reference();
    reference_end[e + 1] = pin_end[e + 1] + e * n_reference();
    if (coordinate_system == 2 && pin_end[e + 1] > pin_end[e]) {
      conditions[e] = [reference_rate[e], initial_grain_size[e], temperature[e],
                       loading_time[e], reference_stress_rate[e] > 0 ? 0 : stress_scale[e],
                       seen_flow[e], replaced_deviation[e]]';
      reference[part(reference_end, e)]
        = valley_reference(reference_parameter[e], guide[part(own_end, e), 1], own_place[e],
                           {replaced_parameter[e], noise_parameter[e]}, conditions[e],
                           knot[part(knot_end, e)], pin[part(pin_end, e)], element);
    }
  }
