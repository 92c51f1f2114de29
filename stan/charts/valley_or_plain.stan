    // Plain coordinates of a test's own parameters, and ln |d(these)/d(coordinate)|.
    vector[size(own) + 1] plain = append_row(coordinate[own_position[own]], 0);
    if (coordinate_system == 2 && pin_end[e + 1] > pin_end[e]) {
      plain = plain_from_valley(coordinate[own_position[own]], given, own_place[e],
                                append_col(quantity[own], guide[own]),
                                {replaced_parameter[e], noise_parameter[e]}, conditions[e],
                                knot[part(knot_end, e)], pin[part(pin_end, e)],
                                reference[part(reference_end, e)], element);
    } else if (coordinate_system == 1 && stretched_flow_reference[e][i_log_width()] > 0) {
      int flow = own_place[e, replaced_parameter[e]];
      plain = plain_from_stretched_flow(
        coordinate[own_position[own]], flow, stretched_flow_slope[own],
        stretched_flow_reference[e][i_exponent()] * quantity[own[flow]],
        stretched_flow_reference[e]);
    }
