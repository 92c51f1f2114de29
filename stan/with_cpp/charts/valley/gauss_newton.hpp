#ifndef BURGERS_GAUSS_NEWTON_HPP
#define BURGERS_GAUSS_NEWTON_HPP
/** A Gauss-Newton step for a critical strain and an amplitude of softening, ln S_0 eliminated. */
#include <stan/math.hpp>
#include <cmath>

namespace burgers {

/** Constants of charts/valley/least_squares.stan; places in `reference` are from 0 here. */
constexpr int n_path_steps = 8;
constexpr int i_grain_strain = 0, i_fabric_strain = 1, i_fabric_amplitude = 2;
constexpr double softened_share = 0.25;
constexpr double precision_of_u = 0.5, precision_of_amplitude = 4;

/** What is left of the strength at a pin, and the derivatives of the softening by u and the amplitude. */
struct Pin {
  double weight, left, by_u, by_amplitude;
};

/**
 * Changes of u and the amplitude, the Gauss-Newton matrix (1, 1), (1, 2), (2, 2), the misfit before the
 * step and minus half of its derivative by the amplitude; or derivatives by these.
 */
struct Solved {
  double u, amplitude, c11, c12, c22, misfit, by_misfit;
};

/** A step at values, and its derivatives. */
class GaussNewton {
 public:
  /**
   * @param pin centred here unless ln S_0 is given; has to outlive the step
   * @param share inv_logit(u)
   * @param towards amplitude that is expected less that at the start
   */
  GaussNewton(Pin *pin, int n, bool stress_given, double share, double towards)
      : pin_(pin), share_(share) {
    if (!stress_given) {
      Pin mean = {};
      for (int k = 0; k < n; ++k) {
        mean.weight += pin[k].weight;
        mean.left += pin[k].weight * pin[k].left;
        mean.by_u += pin[k].weight * pin[k].by_u;
        mean.by_amplitude += pin[k].weight * pin[k].by_amplitude;
      }
      for (int k = 0; k < n; ++k) {
        pin[k].left -= mean.left / mean.weight;
        pin[k].by_u -= mean.by_u / mean.weight;
        pin[k].by_amplitude -= mean.by_amplitude / mean.weight;
      }
    }
    solved = {0, 0, precision_of_u, 0, precision_of_amplitude, 0, 0};
    g1_ = 1 - 2 * share;
    for (int k = 0; k < n; ++k) {
      const Pin &p = pin[k];
      solved.c11 += p.weight * p.by_u * p.by_u;
      solved.c12 += p.weight * p.by_u * p.by_amplitude;
      solved.c22 += p.weight * p.by_amplitude * p.by_amplitude;
      solved.misfit += p.weight * p.left * p.left;
      solved.by_misfit += p.weight * p.left * p.by_amplitude;
      g1_ += p.weight * p.left * p.by_u;
    }
    g2_ = solved.by_misfit + precision_of_amplitude * towards;
    determinant_ = solved.c11 * solved.c22 - solved.c12 * solved.c12;
    length_ = (solved.c22 * g1_ - solved.c12 * g2_) / determinant_;
    slowing_ = std::sqrt(1 + length_ * length_);
    solved.u = length_ / slowing_;
    solved.amplitude = (solved.c11 * g2_ - solved.c12 * g1_) / determinant_;
  }

  Solved solved;

  /** Derivatives by the two gradients, the matrix and the misfit, in place of those by the outputs. */
  Solved pulled_back(const Solved &by) const {
    const double d1 = by.u / (slowing_ * slowing_ * slowing_ * determinant_);
    const double d2 = by.amplitude / determinant_; // by the numerators of the two changes
    const double d = -d1 * length_ - d2 * solved.amplitude;
    const double by_g1 = d1 * solved.c22 - d2 * solved.c12;
    const double by_g2 = d2 * solved.c11 - d1 * solved.c12;
    return {by_g1,
            by_g2,
            by.c11 + d2 * g2_ + d * solved.c22,
            by.c12 - d1 * g2_ - d2 * g1_ - 2 * d * solved.c12,
            by.c22 + d1 * g1_ + d * solved.c11,
            by.misfit,
            by_g2 + by.by_misfit};
  }

  /** Derivatives by a pin, given those of pulled_back(). */
  Pin by_pin(int k, const Solved &by) const {
    const Pin &p = pin_[k];
    const double left = 2 * by.misfit * p.left + by.u * p.by_u + by.by_misfit * p.by_amplitude;
    const double by_u = 2 * by.c11 * p.by_u + by.c12 * p.by_amplitude + by.u * p.left;
    const double by_amplitude
        = 2 * by.c22 * p.by_amplitude + by.c12 * p.by_u + by.by_misfit * p.left;
    // Every sum is a sum of products of two, each of which is in two of these.
    return {0.5 * (left * p.left + by_u * p.by_u + by_amplitude * p.by_amplitude),
            p.weight * left, p.weight * by_u, p.weight * by_amplitude};
  }

  /** Derivative by u of the prior of u, given those of pulled_back(). */
  double by_u(const Solved &by) const { return -2 * by.u * share_ * (1 - share_); }

  /** The same by the amplitude. */
  static double by_amplitude(const Solved &by) { return -precision_of_amplitude * by.amplitude; }

 private:
  const Pin *pin_;
  double share_, g1_, g2_, determinant_, length_, slowing_;
};

}  // namespace burgers
#endif
