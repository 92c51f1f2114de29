#ifndef BURGERS_DENSITY_OF_FIT_HPP
#define BURGERS_DENSITY_OF_FIT_HPP
/** Densities of charts/valley/softening.stan, with their derivatives. */
#include <stan/math.hpp>
#include <cmath>

namespace burgers {

constexpr double misfit_tail = 6;

/** Where most of a normal density's mass above 0 lies: compressed() of charts/valley/quantiles.stan. */
struct Compressed {
  double value, slope;

  explicit Compressed(double mean) {
    const double root = std::sqrt(mean * mean + 4);
    const double middle = mean > 0 ? (root + mean) / 2 : 2 / (root - mean);
    value = middle + stan::math::log1m_exp(-middle);
    slope = -middle / (root * std::expm1(-middle));
  }
};

/** distance_beyond() of charts/valley/quantiles.stan. */
struct DistanceBeyond {
  double value, by_place, by_c;

  DistanceBeyond(double place, double c) {
    using stan::math::inv_logit;
    using stan::math::log1p_exp;
    const double x = place / c, y = (1 - place) / c;
    const Compressed below(x), above(y);
    const double a = below.value - above.value + y, b = a - 1 / c;
    value = x - (log1p_exp(a) - log1p_exp(b));
    const double by_a = inv_logit(b) - inv_logit(a);
    const double by_x = 1 - inv_logit(b) + by_a * below.slope;
    const double by_y = -inv_logit(b) + by_a * (1 - above.slope);
    by_place = (by_x - by_y) / c;
    by_c = -(x * by_x + y * by_y) / c;
  }
};

/** log_fit() of a misfit and of the square of a distance beyond bounds. */
struct DensityOfFit {
  double value, by_misfit, by_place, by_c;

  DensityOfFit(double misfit, double place, double c) {
    const DistanceBeyond beyond(place, c);
    const double share = (misfit + beyond.value * beyond.value) / misfit_tail;
    value = -0.5 * misfit_tail * std::log1p(share);
    by_misfit = -0.5 / (1 + share);
    by_place = 2 * by_misfit * beyond.value * beyond.by_place;
    by_c = 2 * by_misfit * beyond.value * beyond.by_c;
  }
};

}  // namespace burgers
#endif
