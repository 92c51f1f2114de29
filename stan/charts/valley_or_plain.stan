    // Plain coordinates of a test's own parameters, and ln |d(these)/d(coordinate)|.
    vector[size(own) + 1] plain = append_row(coordinate[own_position[own]], 0);
    if (coordinate_system == 2 && pin_end[e + 1] > pin_end[e]) {
      plain = plain_from_valley(coordinate[own_position[own]], given, own_place[e],
                                append_col(quantity[own], guide[own]),
                                {replaced_parameter[e], noise_parameter[e]}, conditions[e],
                                knot[part(knot_end, e)], pin[part(pin_end, e)],
                                reference[part(reference_end, e)], element);
    }
