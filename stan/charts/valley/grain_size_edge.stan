/**
 * The stretch of d_ss where grain size does all the softening of the dashpot.
 */

/** Softening of the dashpot, -ln F - (p/n) ln(d/d_0), after a path strain. */
real softening_after(real strain, vector parameter, real initial_grain_size) {
  real fabric = log_relative_microstructure(strain, 1 - parameter[i_steady_state_fabric_factor()],
                                            1 / parameter[i_critical_strain_fabric()]);
  real grain_size = log_relative_microstructure(strain,
    1 - parameter[i_steady_state_grain_size()] / initial_grain_size,
    1 / parameter[i_critical_strain_grain_size()]);
  return -fabric
         - parameter[i_grain_size_exponent()] / parameter[i_stress_exponent()] * grain_size;
}

/** Slope of the plain coordinate of d_ss where grain size does all the softening. */
real edge_slope() { return 0.25; }

/** Length of that stretch in the coordinate, and width of the bends at its ends. */
vector edge_shape() { return [4, 0.5]'; }

/** Softening of a curve from which on there is such an edge. */
real least_softening() { return 0.05; }

/** Share of the curve's softening at which that stretch starts. */
real edge_softening() { return 0.85; }

/**
 * Plain coordinate of d_ss, stretched where grain size does all the softening.
 *
 * The density of d_ss ends there, within a small part of its range: below, the dashpot would soften
 * by more than the curve does. Where the edge is depends on p/n.
 *
 * @param displaced plain coordinate without the stretch
 * @param exponent_ratio p/n
 * @param softening of the dashpot up to the last pin
 * @param quantity row of d_ss (charts/plain.stan), with a finite lower bound
 * @return plain coordinate, and ln of its derivative by the displacement
 */
vector grain_size_at_edge(real displaced, real exponent_ratio, data real softening,
                          data real initial_grain_size, data row_vector quantity) {
  real range = is_inf(quantity[i_upper()]) ? quantity[i_scale()]
               : quantity[i_upper()] - quantity[i_lower()];
  real edge = initial_grain_size * exp(-edge_softening() * softening / exponent_ratio);
  // A smooth floor: the bound may leave no room for an edge.
  real place = 0.003 * log1p_exp((edge - quantity[i_lower()]) / (0.003 * range));
  real b = edge_shape()[2];
  real from_edge = (displaced - log(place)) / b;
  real from_end = from_edge + edge_shape()[1] / b;
  return [displaced
          + (1 - edge_slope())
            * (edge_shape()[1] + b * (log1p_exp(from_edge) - log1p_exp(from_end))),
          log1m((1 - edge_slope()) * (inv_logit(from_end) - inv_logit(from_edge)))]';
}
