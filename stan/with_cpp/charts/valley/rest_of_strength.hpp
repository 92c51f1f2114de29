#ifndef BURGERS_REST_OF_STRENGTH_HPP
#define BURGERS_REST_OF_STRENGTH_HPP
/** The function of rest_of_strength.stan, with its derivatives by hand. */
#include "critical_strain.hpp"

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

template <typename T_u, typename T_asked, typename Strain, typename Bounds>
Eigen::Matrix<stan::promote_args_t<T_u, T_asked>, -1, -1> rest_of_strength(
    const T_u &u, const Eigen::Matrix<T_asked, -1, 1> &asked, const Strain &strain,
    const Bounds &bounds, std::ostream *) {
  using stan::math::value_of;
  using T = stan::promote_args_t<T_u, T_asked>;
  const Eigen::VectorXd asked_value = value_of(asked);
  const CriticalStrain critical(value_of(u), Eigen::RowVectorXd(bounds.row(0)));
  const double exponent_ratio = asked_value[0], ratio = std::exp(asked_value[1]);
  const int n = strain.size();
  Eigen::Matrix<T, -1, -1> rest(n, 2);
  if constexpr (std::is_same<T, double>::value) {
    for (int k = 0; k < n; ++k) {
      const GrainSize grain(critical.decay(strain[k]), ratio);
      rest(k, 0) = asked_value[2 + k] - exponent_ratio * grain.log;
      rest(k, 1) = exponent_ratio * grain.by_u;
    }
  } else {
    using stan::math::vari;
    auto &memory = stan::math::ChainableStack::instance_->memalloc_;
    GrainSize *grains = memory.alloc_array<GrainSize>(n);
    vari **output = memory.alloc_array<vari *>(2 * n), **input = memory.alloc_array<vari *>(n + 3);
    input[0] = T(u).vi_;
    for (int k = 0; k < n + 2; ++k) {
      input[1 + k] = T(asked[k]).vi_;
    }
    for (int k = 0; k < n; ++k) {
      grains[k] = GrainSize(critical.decay(strain[k]), ratio);
      output[2 * k] = new vari(asked_value[2 + k] - exponent_ratio * grains[k].log, false);
      output[2 * k + 1] = new vari(exponent_ratio * grains[k].by_u, false);
      rest(k, 0) = T(output[2 * k]);
      rest(k, 1) = T(output[2 * k + 1]);
    }
    stan::math::reverse_pass_callback([=]() {
      double by_u = 0, by_exponent = 0, by_h = 0;
      for (int k = 0; k < n; ++k) {
        const double left = output[2 * k]->adj_, slope = output[2 * k + 1]->adj_;
        input[3 + k]->adj_ += left;
        by_exponent += slope * grains[k].by_u - left * grains[k].log;
        by_u += exponent_ratio * (slope * grains[k].by_u_u - left * grains[k].by_u);
        by_h += exponent_ratio * (slope * grains[k].by_u_h - left * grains[k].by_h);
      }
      input[0]->adj_ += by_u;
      input[1]->adj_ += by_exponent;
      input[2]->adj_ += by_h;
    });
  }
  return rest;
}

}  // namespace burgers
#endif
