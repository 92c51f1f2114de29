#ifndef BURGERS_FABRIC_STEP_HPP
#define BURGERS_FABRIC_STEP_HPP
/** The function of fabric_step.stan, with its derivatives by hand. */
#include "by_hand.hpp"
#include "critical_strain.hpp"
#include "gauss_newton.hpp"
#include <vector>

namespace burgers {

/** limited_amplitude() of charts/valley/pins.stan, given what has decayed up to the last pin. */
struct LimitedAmplitude {
  double value, by_amplitude, by_u;

  LimitedAmplitude(double amplitude, const Decay &decay) {
    constexpr double softest = 0.96, sharpness = 50;
    const double limit = softest / (1 - decay.value), above = sharpness * (amplitude - limit);
    value = amplitude - stan::math::log1p_exp(above) / sharpness;
    by_amplitude = stan::math::inv_logit(-above);
    by_u = (1 - by_amplitude) * limit / (1 - decay.value) * decay.slope;
  }
};

/** Derivatives of ln F at a pin. */
struct FabricPin {
  double by_u, by_amplitude, curvature, mixed;
};

/** u_2 and the amplitude, or derivatives by these. */
struct Fabric {
  double u, amplitude;

  Fabric &operator+=(const Fabric &other) {
    u += other.u;
    amplitude += other.amplitude;
    return *this;
  }
};

/** A step at values, and its derivatives. */
class FabricStep {
 public:
  /**
   * @param share of the weights that counts
   * @param memory for each pin, which has to outlive the step
   */
  FabricStep(const Fabric &at, const double *rest, const double *weight, double share,
             const Eigen::VectorXd &strain, bool stress_given, const Eigen::MatrixXd &bounds,
             Pin *pins, FabricPin *fabric)
      : fabric_(fabric), n_(strain.size()), share_(share), critical_(at.u, bounds, 1),
        step_(prepared(at, rest, weight, strain, pins), n_, stress_given, critical_.share,
              0.5 - at.amplitude),
        limited_(at.amplitude + step_.solved.amplitude,
                 CriticalStrain(at.u + step_.solved.u, bounds, 1).decay(strain[n_ - 1])) {
    after = step_.solved;
    after.u += at.u;
    after.amplitude = limited_.value;
  }

  /** The solution after the step, and the rest of the outputs. */
  Solved after;

  Fabric fabric() const { return {after.u, after.amplitude}; }

  /** Add derivatives by the rest and the weight of every pin; return those by the start. */
  Fabric pull_back(Solved by, double *by_rest, double *by_weight) const {
    by.u += by.amplitude * limited_.by_u;
    by.amplitude *= limited_.by_amplitude;
    const Solved back = step_.pulled_back(by);
    Fabric found = {by.u + step_.by_u(back), by.amplitude + step_.by_amplitude(back)};
    for (int k = 0; k < n_; ++k) {
      const FabricPin &f = fabric_[k];
      const Pin p = step_.by_pin(k, back);
      by_weight[k] += share_ * p.weight;
      by_rest[k] += p.left;
      found.u += p.by_u * f.curvature + p.by_amplitude * f.mixed - p.left * f.by_u;
      found.amplitude += p.by_u * f.mixed - p.by_amplitude * f.by_amplitude * f.by_amplitude
                         - p.left * f.by_amplitude;
    }
    return found;
  }

 private:
  FabricPin *fabric_;
  int n_;
  double share_;
  CriticalStrain critical_;
  GaussNewton step_;
  LimitedAmplitude limited_;

  Pin *prepared(const Fabric &at, const double *rest, const double *weight,
                const Eigen::VectorXd &strain, Pin *pins) const {
    for (int k = 0; k < n_; ++k) {
      const Decay decay = critical_.decay(strain[k]);
      const double growth = 1 - decay.value, factor = 1 - at.amplitude * growth;
      FabricPin &f = fabric_[k];
      f.by_u = at.amplitude * decay.slope / factor;
      f.by_amplitude = -growth / factor;
      f.curvature = at.amplitude * decay.curvature / factor - f.by_u * f.by_u;
      f.mixed = decay.slope / (factor * factor);
      pins[k] = {share_ * weight[k], rest[k] - std::log(factor), f.by_u, f.by_amplitude};
    }
    return pins;
  }
};

/** A step by itself, of the numbers u_2, amplitude, rest and weights. */
class OneFabricStep {
 public:
  OneFabricStep(const Eigen::VectorXd &number, const Eigen::VectorXd &strain, bool stress_given,
                const Eigen::MatrixXd &bounds)
      : n_(strain.size()), pins_(n_), fabric_(n_),
        step_({number[0], number[1]}, number.data() + 2, number.data() + 2 + n_, 1, strain,
              stress_given, bounds, pins_.data(), fabric_.data()) {}

  Eigen::VectorXd outputs() const {
    const Solved &all = step_.after;
    return (Eigen::VectorXd(7) << all.u, all.amplitude, all.c11, all.c12, all.c22, all.misfit,
            all.by_misfit)
        .finished();
  }

  Eigen::VectorXd pull_back(const Eigen::VectorXd &by) const {
    Eigen::VectorXd found = Eigen::VectorXd::Zero(2 + 2 * n_);
    const Fabric by_start
        = step_.pull_back({by[0], by[1], by[2], by[3], by[4], by[5], by[6]}, found.data() + 2,
                          found.data() + 2 + n_);
    found.head(2) << by_start.u, by_start.amplitude;
    return found;
  }

 private:
  int n_;
  std::vector<Pin> pins_;
  std::vector<FabricPin> fabric_;
  FabricStep step_;
};

template <typename T, typename Rest, typename Strain, typename Weight, typename Bounds>
auto fabric_step(const Vector<T> &solved, const Rest &rest, const Strain &strain,
                 const Weight &weight, const int &stress_given, const Bounds &bounds,
                 std::ostream *) {
  return by_hand<OneFabricStep>(numbers(solved, rest, weight), Eigen::VectorXd(strain),
                                stress_given, Eigen::MatrixXd(bounds));
}

}  // namespace burgers
#endif
