#ifndef BURGERS_REST_OF_STRENGTH_HPP
#define BURGERS_REST_OF_STRENGTH_HPP
/** rest_of_strength() of charts/valley/least_squares.stan, with its derivatives. */
#include "critical_strain.hpp"
#include <vector>

namespace burgers {

/** ln(d/d_0) and its derivatives by u (twice), by h = ln(d_ss/d_0), and by both. */
struct GrainSize {
  double log, by_u, by_u_u, by_h, by_u_h;

  GrainSize(const Decay &decay, double ratio) {
    const double size = ratio + (1 - ratio) * decay.value;
    log = std::log(size);
    by_u = (1 - ratio) * decay.slope / size;
    by_u_u = (1 - ratio) * decay.curvature / size - by_u * by_u;
    by_h = ratio * (1 - decay.value) / size;
    by_u_h = -ratio * decay.slope / size - by_u * by_h;
  }
};

/** What is left at the pins, and the derivative of the softening by grain size by u. */
class RestOfStrength {
 public:
  /** At a part of the way from the reference point: asked_along_path(). */
  RestOfStrength(double u, double part_of_way, const double *asked,
                 const Eigen::VectorXd &reference, const Eigen::VectorXd &strain,
                 const Eigen::MatrixXd &bounds)
      : part_of_way_(part_of_way) {
    const int n = strain.size();
    const double *from = reference.data() + reference.size() - n - 2;
    const auto here = [&](int k) { return part_of_way * asked[k] + (1 - part_of_way) * from[k]; };
    const CriticalStrain critical(u, bounds, 0);
    const double ratio = std::exp(here(1));
    exponent_ratio_ = here(0);
    grain_.reserve(n);
    value.reserve(n);
    for (int k = 0; k < n; ++k) {
      grain_.emplace_back(critical.decay(strain[k]), ratio);
      value.push_back(here(2 + k) - exponent_ratio_ * grain_[k].log);
    }
  }

  std::vector<double> value;

  double slope(int k) const { return exponent_ratio_ * grain_[k].by_u; }

  /** Add derivatives by what is asked, and return that by u; those by slopes may be missing. */
  double pull_back(const double *by_value, const double *by_slope, double *by_asked) const {
    double by_u = 0, by_exponent = 0, by_h = 0;
    for (std::size_t k = 0; k < value.size(); ++k) {
      const double left = by_value[k], slope = by_slope == nullptr ? 0 : by_slope[k];
      by_asked[2 + k] += part_of_way_ * left;
      by_exponent += slope * grain_[k].by_u - left * grain_[k].log;
      by_u += slope * grain_[k].by_u_u - left * grain_[k].by_u;
      by_h += slope * grain_[k].by_u_h - left * grain_[k].by_h;
    }
    by_asked[0] += part_of_way_ * by_exponent;
    by_asked[1] += part_of_way_ * exponent_ratio_ * by_h;
    return exponent_ratio_ * by_u;
  }

 private:
  double part_of_way_, exponent_ratio_;
  std::vector<GrainSize> grain_;
};

}  // namespace burgers
#endif
