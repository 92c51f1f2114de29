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

/** States at each time; NaN if there is no solution. */
template <int N>
Outputs solve_leg(const Leg &leg, const std::vector<double> &time, double tolerance,
                  const Eigen::VectorXd &start, const Eigen::VectorXd &argument) {
  const Trajectory<LegRates<N>> trajectory({leg, argument}, tolerance);
  std::vector<Step<LegRates<N>>> steps;
  steps.reserve(time.size() + 16);
  Outputs states;
  const bool solved = trajectory.solve(
      start, time, steps,
      [&](const typename Trajectory<LegRates<N>>::State &state, std::size_t) {
        states.push_back(state);
      });
  return solved ? states : without_solution<double>(time.size(), N);
}

/** The same with derivatives by the start and the arguments. */
template <int N>
std::vector<stan::math::vector_v> solve_leg(const Leg &leg, const std::vector<double> &time,
                                            double tolerance,
                                            const stan::math::vector_v &start,
                                            const stan::math::vector_v &argument) {
  using stan::math::vari;
  using Rates = LegRates<N>;
  using State = typename Trajectory<Rates>::State;
  const State start_value = start.val();
  const Eigen::VectorXd argument_value = argument.val();
  const Trajectory<Rates> trajectory({leg, argument_value}, tolerance);
  // In the arena, which Stan frees; the callback below holds pointers alone.
  std::vector<Step<Rates>, stan::math::arena_allocator<Step<Rates>>> steps;
  steps.reserve(time.size() + 16);
  auto &memory = stan::math::ChainableStack::instance_->memalloc_;
  const std::size_t n_times = time.size();
  vari **output = memory.alloc_array<vari *>(n_times * N);
  std::size_t *n_steps = memory.alloc_array<std::size_t>(n_times);
  std::vector<stan::math::vector_v> states;
  const bool solved
      = trajectory.solve(start_value, time, steps, [&](const State &state, std::size_t n) {
          n_steps[states.size()] = n;
          stan::math::vector_v value(N);
          for (int a = 0; a < N; ++a) {
            output[states.size() * N + a] = new vari(state[a], false);
            value[a] = output[states.size() * N + a];
          }
          states.push_back(value);
        });
  if (!solved) {
    return without_solution<stan::math::var>(n_times, N);
  }
  const int n_given = argument.size();
  vari **input = memory.alloc_array<vari *>(N + n_given);
  for (int a = 0; a < N; ++a) {
    input[a] = start[a].vi_;
  }
  for (int k = 0; k < n_given; ++k) {
    input[N + k] = argument[k].vi_;
  }
  const Step<Rates> *step = steps.data();
  stan::math::reverse_pass_callback([=]() {
    double by_state[N] = {}, by_argument[n_arguments] = {};
    for (std::size_t i = n_times; i-- > 0;) {
      for (int a = 0; a < N; ++a) {
        by_state[a] += output[i * N + a]->adj_;
      }
      for (std::size_t k = n_steps[i], before = i > 0 ? n_steps[i - 1] : 0; k-- > before;) {
        trajectory.pull_back(step[k], by_state, by_argument);
      }
    }
    for (int a = 0; a < N; ++a) {
      input[a]->adj_ += by_state[a];
    }
    for (int k = 0; k < n_given; ++k) {
      input[N + k]->adj_ += by_argument[k];
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
  const Leg leg(law, known);
  const int n_states = leg.is_known() ? start.size() : 0;
  switch (n_states) {
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
