#ifndef BURGERS_FABRIC_STEP_HPP
#define BURGERS_FABRIC_STEP_HPP
/** The function of fabric_step.stan, with its derivatives by hand. */
#include "critical_strain.hpp"

namespace burgers {

/** Precisions of charts/valley/least_squares.stan, and what limits the amplitude in pins.stan. */
constexpr double precision_of_u = 0.5, precision_of_amplitude = 4;
constexpr double softest = 0.96, sharpness_of_limit = 50;

/** At a pin: ln F's derivatives, and what is left of the strength, all less their weighted means. */
struct FabricPin {
  double weight, left, by_u, by_amplitude;
  double slope_by_u, slope_by_amplitude, curvature, mixed; // of ln F, not centred
};

/** A step at values, and its derivatives. */
class FabricStep {
 public:
  static constexpr int n_outputs = 7;

  template <typename Strain, typename Bounds>
  FabricStep(double u, double amplitude, const double *rest, const double *weight,
             const Strain &strain, bool stress_given, const Bounds &bounds, FabricPin *pins)
      : pin_(pins), n_(strain.size()) {
    const Eigen::RowVectorXd range = bounds.row(1);
    const CriticalStrain critical(u, range);
    double total = 0, left = 0, by_u = 0, by_amplitude = 0; // weighted sums
    for (int k = 0; k < n_; ++k) {
      const Decay decay = critical.decay(strain[k]);
      const double growth = 1 - decay.value, fabric = 1 - amplitude * growth;
      FabricPin &p = pin_[k];
      p.weight = weight[k];
      p.slope_by_u = amplitude * decay.slope / fabric;
      p.slope_by_amplitude = -growth / fabric;
      p.curvature = amplitude * decay.curvature / fabric - p.slope_by_u * p.slope_by_u;
      p.mixed = decay.slope / (fabric * fabric);
      p.left = rest[k] - std::log(fabric);
      total += p.weight;
      left += p.weight * p.left;
      by_u += p.weight * p.slope_by_u;
      by_amplitude += p.weight * p.slope_by_amplitude;
    }
    const double share = stress_given ? 0 : 1 / total; // of the means that ln S_0 takes up
    c11 = precision_of_u;
    c22 = precision_of_amplitude;
    for (int k = 0; k < n_; ++k) {
      FabricPin &p = pin_[k];
      p.left -= share * left;
      p.by_u = p.slope_by_u - share * by_u;
      p.by_amplitude = p.slope_by_amplitude - share * by_amplitude;
      c11 += p.weight * p.by_u * p.by_u;
      c12 += p.weight * p.by_u * p.by_amplitude;
      c22 += p.weight * p.by_amplitude * p.by_amplitude;
      g1 += p.weight * p.left * p.by_u;
      by_misfit += p.weight * p.left * p.by_amplitude;
      misfit += p.weight * p.left * p.left;
    }
    share_of_range = critical.share;
    g1 += 1 - 2 * share_of_range;
    g2 = by_misfit + precision_of_amplitude * (0.5 - amplitude);
    determinant = c11 * c22 - c12 * c12;
    length = (c22 * g1 - c12 * g2) / determinant;
    slowing = std::sqrt(1 + length * length);
    after_u = u + length / slowing;
    const double free = amplitude + (c11 * g2 - c12 * g1) / determinant;
    last = CriticalStrain(after_u, range).decay(strain[n_ - 1]);
    const double above = sharpness_of_limit * (free - softest / (1 - last.value));
    limited = stan::math::inv_logit(above);
    after_amplitude = free - stan::math::log1p_exp(above) / sharpness_of_limit;
  }

  void values(double *output) const {
    const double all[] = {after_u, after_amplitude, c11, c12, c22, misfit, by_misfit};
    std::copy_n(all, n_outputs, output);
  }

  /** Add derivatives: by u and the amplitude, by the rest and by the weight of every pin. */
  void pull_back(const double *by_output, double *by_solved, double *by_rest,
                 double *by_weight) const {
    const double free = by_output[1] * (1 - limited);
    const double grown = 1 - last.value;
    const double step = by_output[0]
                        + by_output[1] * limited * softest / (grown * grown) * last.slope;
    const double d1 = step / (slowing * slowing * slowing * determinant);
    const double d2 = free / determinant; // by the numerators of the two steps
    const double d = -d1 * length - d2 * (c11 * g2 - c12 * g1) / determinant;
    const double by_g1 = d1 * c22 - d2 * c12, by_g2 = d2 * c11 - d1 * c12;
    const double a11 = by_output[2] + d2 * g2 + d * c22;
    const double a12 = by_output[3] - d1 * g2 - d2 * g1 - 2 * d * c12;
    const double a22 = by_output[4] + d1 * g1 + d * c11;
    const double of_misfit = by_output[5], of_slope = by_g2 + by_output[6];
    by_solved[0] = step - 2 * by_g1 * share_of_range * (1 - share_of_range);
    by_solved[1] = free - precision_of_amplitude * by_g2;
    for (int k = 0; k < n_; ++k) {
      const FabricPin &p = pin_[k];
      const double left = 2 * of_misfit * p.left + by_g1 * p.by_u + of_slope * p.by_amplitude;
      const double by_u = 2 * a11 * p.by_u + a12 * p.by_amplitude + by_g1 * p.left;
      const double by_amplitude = 2 * a22 * p.by_amplitude + a12 * p.by_u + of_slope * p.left;
      // Every sum is a sum of products of two, each of which is in two of these.
      by_weight[k] = 0.5 * (left * p.left + by_u * p.by_u + by_amplitude * p.by_amplitude);
      by_rest[k] = p.weight * left;
      by_solved[0] += p.weight * (by_u * p.curvature + by_amplitude * p.mixed - left * p.slope_by_u);
      by_solved[1] += p.weight
                      * (by_u * p.mixed - by_amplitude * p.slope_by_amplitude * p.slope_by_amplitude
                         - left * p.slope_by_amplitude);
    }
  }

 private:
  FabricPin *pin_;
  int n_;
  double c11 = 0, c12 = 0, c22 = 0, g1 = 0, g2 = 0, misfit = 0, by_misfit = 0;
  double share_of_range, determinant, length, slowing, after_u, after_amplitude, limited;
  Decay last;
};

template <typename T_solved, typename T_rest, typename Strain, typename T_weight, typename Bounds>
Eigen::Matrix<stan::promote_args_t<T_solved, T_rest, T_weight>, -1, 1> fabric_step(
    const Eigen::Matrix<T_solved, -1, 1> &solved, const Eigen::Matrix<T_rest, -1, 1> &rest,
    const Strain &strain, const Eigen::Matrix<T_weight, -1, 1> &weight, const int &stress_given,
    const Bounds &bounds, std::ostream *) {
  using stan::math::value_of;
  using T = stan::promote_args_t<T_solved, T_rest, T_weight>;
  const Eigen::VectorXd rest_value = value_of(rest), weight_value = value_of(weight);
  const double u = value_of(solved[0]), amplitude = value_of(solved[1]);
  const int n = strain.size();
  constexpr int n_outputs = FabricStep::n_outputs;
  double value[n_outputs];
  Eigen::Matrix<T, -1, 1> after(n_outputs);
  if constexpr (std::is_same<T, double>::value) {
    std::vector<FabricPin> pins(n);
    FabricStep(u, amplitude, rest_value.data(), weight_value.data(), strain, stress_given, bounds,
               pins.data())
        .values(value);
    std::copy_n(value, n_outputs, after.data());
  } else {
    using stan::math::vari;
    auto &memory = stan::math::ChainableStack::instance_->memalloc_;
    const FabricStep step(u, amplitude, rest_value.data(), weight_value.data(), strain,
                          stress_given, bounds, memory.alloc_array<FabricPin>(n));
    vari **output = memory.alloc_array<vari *>(n_outputs);
    vari **input = memory.alloc_array<vari *>(2 + 2 * n);
    double *by_input = memory.alloc_array<double>(2 + 2 * n);
    step.values(value);
    for (int i = 0; i < n_outputs; ++i) {
      output[i] = new vari(value[i], false);
      after[i] = T(output[i]);
    }
    for (int i = 0; i < 2; ++i) {
      input[i] = T(solved[i]).vi_;
    }
    for (int k = 0; k < n; ++k) {
      input[2 + k] = T(rest[k]).vi_;
      input[2 + n + k] = T(weight[k]).vi_;
    }
    stan::math::reverse_pass_callback([=]() {
      double by_output[n_outputs];
      for (int i = 0; i < n_outputs; ++i) {
        by_output[i] = output[i]->adj_;
      }
      step.pull_back(by_output, by_input, by_input + 2, by_input + 2 + n);
      for (int i = 0; i < 2 + 2 * n; ++i) {
        input[i]->adj_ += by_input[i];
      }
    });
  }
  return after;
}

}  // namespace burgers
#endif
