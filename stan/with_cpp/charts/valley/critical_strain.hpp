#ifndef BURGERS_CRITICAL_STRAIN_HPP
#define BURGERS_CRITICAL_STRAIN_HPP
/** A critical strain behind a real number, and what has decayed with it: charts/valley/pins.stan. */
#include <stan/math.hpp>
#include <cmath>

namespace burgers {

/** exp(-strain/critical) and its derivatives by the real number. */
struct Decay {
  double value, slope, curvature;
};

/** critical = lower + (upper - lower) inv_logit(u), with the bounds of a row. */
class CriticalStrain {
 public:
  CriticalStrain(double u, const Eigen::MatrixXd &bounds, int row) {
    const double range = bounds(row, 1) - bounds(row, 0);
    share = stan::math::inv_logit(u);
    value_ = bounds(row, 0) + range * share;
    slope_ = range * share * (1 - share);
    curvature_ = slope_ * (1 - 2 * share);
  }

  Decay decay(double strain) const {
    const double x = strain / (value_ * value_);
    const double left = std::exp(-strain / value_);
    return {left, left * x * slope_,
            left * x * (curvature_ + slope_ * slope_ * (x - 2 / value_))};
  }

  double share; // inv_logit(u)

 private:
  double value_, slope_, curvature_;
};

}  // namespace burgers
#endif
