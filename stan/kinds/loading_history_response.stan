        // States of a history, and its readings without and with scatter of this deviation.
        matrix[output_end[e + 1] - output_end[e], 6 + n_summed(element)] states
          = history_states(parameter[e], prior_location[e], varying, leg[part(leg_end, e)],
                           fixed[part(leg_end, e)], test[e], element,
                           output_time_in_leg[part(output_end, e)],
                           n_outputs_in_leg[part(leg_end, e)], initial_grain_size[e], solver, tolerance,
                           max_num_steps);
        vector[size(points)] response
          = history_readings(history_response(states[output_of_point[points]], parameter[e],
                                              test[e]),
                             is_strain[points], parameter[e]);
        vector[size(points)] noise = reading_noise(is_strain[points], parameter[e]);
