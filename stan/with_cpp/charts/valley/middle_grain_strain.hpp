#ifndef BURGERS_MIDDLE_GRAIN_STRAIN_HPP
#define BURGERS_MIDDLE_GRAIN_STRAIN_HPP
/** The function of middle_grain_strain.stan, with its derivatives by hand. */
#include "by_hand.hpp"
#include "gauss_newton.hpp"
#include "rest_of_strength.hpp"

namespace burgers {

/** u_1 and its standard deviation, of the numbers asked and weights. */
class MiddleGrainStrain {
 public:
  MiddleGrainStrain(const Eigen::VectorXd &number, const Eigen::VectorXd &reference,
                    const Eigen::VectorXd &strain, bool stress_given,
                    const Eigen::MatrixXd &bounds)
      : n_(strain.size()), linear_(-strain / strain.maxCoeff()), u_(reference[i_grain_strain]),
        pins_((n_path_steps + 1) * n_) {
    const double *asked = number.data(), *weight = asked + n_ + 2;
    double amplitude = 0;
    for (int k = 1; k <= n_path_steps + 1; ++k) {
      // The last pass is for the standard deviation, at full weight.
      const bool is_last = k > n_path_steps;
      Pin *pins = pins_.data() + (k - 1) * n_;
      rest_.emplace_back(u_, is_last ? 1 : k * 1.0 / n_path_steps, asked, reference, strain,
                         bounds);
      for (int m = 0; m < n_; ++m) {
        pins[m] = {(is_last ? 1 : softened_share) * weight[m],
                   rest_.back().value[m] - amplitude * linear_[m], rest_.back().slope(m),
                   linear_[m]};
      }
      step_.emplace_back(pins, n_, stress_given, stan::math::inv_logit(u_), -amplitude);
      if (!is_last) {
        u_ += step_.back().solved.u;
        amplitude += step_.back().solved.amplitude;
      }
    }
    const Solved &last = step_.back().solved;
    deviation_ = 1 / std::sqrt(last.c11 - last.c12 * last.c12 / last.c22);
  }

  Eigen::VectorXd outputs() const { return Eigen::Vector2d(u_, deviation_); }

  Eigen::VectorXd pull_back(const Eigen::VectorXd &by) const {
    Eigen::VectorXd found = Eigen::VectorXd::Zero(2 * n_ + 2);
    double *by_asked = found.data(), *by_weight = by_asked + n_ + 2;
    const Solved &last = step_.back().solved;
    const double ratio = last.c12 / last.c22;
    const double c = -0.5 * by[1] * deviation_ * deviation_ * deviation_;
    double by_u = by[0], by_amplitude = 0;
    std::vector<double> by_rest(n_), by_slope(n_);
    for (int k = n_path_steps; k >= 0; --k) {
      const bool is_last = k == n_path_steps;
      const Solved back = step_[k].pulled_back(
          is_last ? Solved{0, 0, c, -2 * c * ratio, c * ratio * ratio, 0, 0}
                  : Solved{by_u, by_amplitude, 0, 0, 0, 0, 0});
      by_u += step_[k].by_u(back);
      by_amplitude += GaussNewton::by_amplitude(back);
      for (int m = 0; m < n_; ++m) {
        const Pin p = step_[k].by_pin(m, back);
        by_weight[m] += (is_last ? 1 : softened_share) * p.weight;
        by_rest[m] = p.left;
        by_slope[m] = p.by_u;
        by_amplitude -= p.left * linear_[m];
      }
      by_u += rest_[k].pull_back(by_rest.data(), by_slope.data(), by_asked);
    }
    return found;
  }

 private:
  int n_;
  Eigen::VectorXd linear_; // softening by fabric at an amplitude of 1
  double u_, deviation_;
  std::vector<Pin> pins_;
  std::vector<RestOfStrength> rest_;
  std::vector<GaussNewton> step_;
};

template <typename T, typename Reference, typename Strain, typename Weight, typename Bounds>
auto middle_grain_strain(const Vector<T> &asked, const Reference &reference, const Strain &strain,
                         const Weight &weight, const int &stress_given, const Bounds &bounds,
                         std::ostream *) {
  return by_hand<MiddleGrainStrain>(numbers(asked, weight), Eigen::VectorXd(reference),
                                    Eigen::VectorXd(strain), stress_given,
                                    Eigen::MatrixXd(bounds));
}

}  // namespace burgers
#endif
