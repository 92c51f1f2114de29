#ifndef BURGERS_RADAU_LEG_HPP
#define BURGERS_RADAU_LEG_HPP
/**
 * The function radau_leg() that radau_leg.stan declares.
 */
#include "leg_rates.hpp"
#include "radau.hpp"

namespace burgers {

using Outputs = std::vector<Eigen::VectorXd>;

template <typename T>
std::vector<Eigen::Matrix<T, -1, 1>> without_solution(std::size_t n_times, int n_states) {
  const double nan = std::numeric_limits<double>::quiet_NaN();
  return std::vector<Eigen::Matrix<T, -1, 1>>(n_times, Eigen::VectorXd::Constant(n_states, nan));
}

/** What is solved along a leg, given its arguments, which have to outlive it. */
template <int N>
Trajectory<LegRates<N>> trajectory_of(const Leg &leg, double tolerance, const double *argument) {
  const double *decay = argument + n_arguments;
  return {{leg, argument}, {leg.n_elements, decay, decay + leg.n_elements}, tolerance};
}

/** States at each time; NaN if there is no solution. */
template <int N>
Outputs solve_leg(const Leg &leg, const std::vector<double> &time, double tolerance,
                  const Eigen::VectorXd &start, const Eigen::VectorXd &argument) {
  const int n_elements = leg.n_elements;
  const auto trajectory = trajectory_of<N>(leg, tolerance, argument.data());
  Steps<LegRates<N>, std::allocator> steps(time.size(), n_elements);
  Outputs states;
  const bool solved = trajectory.solve(
      start.head<N>(), {start.data() + N, start.data() + start.size()}, time, steps,
      [&](const typename Trajectory<LegRates<N>>::State &state, const double *z, std::size_t) {
        Eigen::VectorXd value(start.size());
        value << state, Eigen::Map<const Eigen::VectorXd>(z, n_elements);
        states.push_back(value);
      });
  return solved ? states : without_solution<double>(time.size(), start.size());
}

/** Pointers to numbers of Stan, in its arena. */
inline stan::math::vari **varis(const stan::math::vector_v &x) {
  auto **found = stan::math::ChainableStack::instance_->memalloc_.alloc_array<stan::math::vari *>(
      x.size());
  for (int k = 0; k < x.size(); ++k) {
    found[k] = x[k].vi_;
  }
  return found;
}

/** The same with derivatives by the start and the arguments. */
template <int N>
std::vector<stan::math::vector_v> solve_leg(const Leg &leg, const std::vector<double> &time,
                                            double tolerance,
                                            const stan::math::vector_v &start,
                                            const stan::math::vector_v &argument) {
  using stan::math::vari;
  using Rates = LegRates<N>;
  // In the arena, which Stan frees; the callback below holds pointers alone.
  auto &memory = stan::math::ChainableStack::instance_->memalloc_;
  const int n_all = start.size(), n_elements = leg.n_elements, n_given = argument.size();
  const std::size_t n_times = time.size();
  double *argument_value = memory.alloc_array<double>(n_given);
  Eigen::Map<Eigen::VectorXd>(argument_value, n_given) = argument.val();
  const auto trajectory = trajectory_of<N>(leg, tolerance, argument_value);
  Steps<Rates, stan::math::arena_allocator> steps(n_times, n_elements);
  vari **output = memory.alloc_array<vari *>(n_times * n_all);
  std::size_t *n_steps = memory.alloc_array<std::size_t>(n_times);
  std::vector<stan::math::vector_v> states;
  const Eigen::VectorXd from = start.val();
  const bool solved = trajectory.solve(
      from.head<N>(), {from.data() + N, from.data() + n_all}, time, steps,
      [&](const typename Trajectory<Rates>::State &state, const double *z, std::size_t n) {
        n_steps[states.size()] = n;
        vari **found = output + states.size() * n_all;
        stan::math::vector_v value(n_all);
        for (int a = 0; a < n_all; ++a) {
          found[a] = new vari(a < N ? state[a] : z[a - N], false);
          value[a] = found[a];
        }
        states.push_back(value);
      });
  if (!solved) {
    return without_solution<stan::math::var>(n_times, n_all);
  }
  vari **from_vari = varis(start), **given = varis(argument);
  const Step<Rates> *step = steps.taken.data();
  const double *z = steps.z.data();
  stan::math::reverse_pass_callback([=]() {
    std::vector<double> by_state(n_all), by_argument(n_given);
    double *by_decay = by_argument.data() + n_arguments;
    for (std::size_t i = n_times; i-- > 0;) {
      for (int a = 0; a < n_all; ++a) {
        by_state[a] += output[i * n_all + a]->adj_;
      }
      for (std::size_t k = n_steps[i], before = i > 0 ? n_steps[i - 1] : 0; k-- > before;) {
        trajectory.pull_back(step[k], z + k * n_elements, by_state.data(), by_state.data() + N,
                             by_argument.data(), by_decay, by_decay + n_elements);
      }
    }
    for (int a = 0; a < n_all; ++a) {
      from_vari[a]->adj_ += by_state[a];
    }
    for (int k = 0; k < n_given; ++k) {
      given[k]->adj_ += by_argument[k];
    }
  });
  return states;
}

/** The function of radau_leg.stan. */
template <typename T_start, typename T_argument>
std::vector<Eigen::Matrix<stan::promote_args_t<T_start, T_argument>, -1, 1>> radau_leg(
    const std::vector<int> &law, const std::vector<double> &known,
    const std::vector<double> &time, const double &tolerance,
    const Eigen::Matrix<T_start, -1, 1> &start, const Eigen::Matrix<T_argument, -1, 1> &argument,
    std::ostream *) {
  using Vector = Eigen::Matrix<stan::promote_args_t<T_start, T_argument>, -1, 1>;
  const Vector from = start, with = argument;
  const Leg leg(law, known, start.size(), argument.size());
  switch (leg.is_known() ? leg.n_states : 0) {
    case 1:
      return solve_leg<1>(leg, time, tolerance, from, with);
    case 2:
      return solve_leg<2>(leg, time, tolerance, from, with);
    case 3:
      return solve_leg<3>(leg, time, tolerance, from, with);
    case 4:
      return solve_leg<4>(leg, time, tolerance, from, with);
    case 5:
      return solve_leg<5>(leg, time, tolerance, from, with);
    default:
      return without_solution<stan::promote_args_t<T_start, T_argument>>(time.size(), start.size());
  }
}

}  // namespace burgers
#endif
