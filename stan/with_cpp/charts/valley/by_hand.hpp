#ifndef BURGERS_BY_HAND_HPP
#define BURGERS_BY_HAND_HPP
/** Functions of Stan whose derivatives are by hand. */
#include <stan/math.hpp>

namespace burgers {

/**
 * A vector that is no expression. A function with one is chosen before the one that stanc declares, in
 * which every type is open.
 */
template <typename T>
using Vector = Eigen::Matrix<T, -1, 1>;

/** Numbers one after the other, in one vector. */
template <class... Parts>
Vector<stan::return_type_t<Parts...>> numbers(const Parts &...parts) {
  Vector<stan::return_type_t<Parts...>> all((stan::math::size(parts) + ...));
  int place = 0;
  const auto append = [&](const auto &part) {
    if constexpr (stan::is_stan_scalar<std::decay_t<decltype(part)>>::value) {
      all[place++] = part;
    } else {
      for (int k = 0; k < part.size(); ++k) {
        all[place++] = part.coeff(k);
      }
    }
  };
  (append(parts), ...);
  return all;
}

/** A vector as columns of a matrix with so many rows. */
template <typename T>
Eigen::Matrix<T, -1, -1> in_rows(int n_rows, const Vector<T> &all) {
  return Eigen::Map<const Eigen::Matrix<T, -1, -1>>(all.data(), n_rows, all.size() / n_rows);
}

/**
 * Outputs of a class at given numbers and data.
 *
 * `Solution` is made of them. It has outputs(), and pull_back(by_output), the derivatives by the
 * numbers of a sum of outputs times by_output.
 */
template <class Solution, typename T, class... Data>
Vector<T> by_hand(const Vector<T> &number, const Data &...data) {
  if constexpr (std::is_same<T, double>::value) {
    return Solution(number, data...).outputs();
  } else {
    stan::arena_t<stan::math::vector_v> input = number;
    const Solution &solution = *stan::math::make_chainable_ptr(Solution(number.val(), data...));
    stan::arena_t<stan::math::vector_v> output
        = solution.outputs().template cast<stan::math::var>();
    stan::math::reverse_pass_callback(
        [=, &solution]() mutable { input.adj() += solution.pull_back(output.adj()); });
    return output;
  }
}

}  // namespace burgers
#endif
