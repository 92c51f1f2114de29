#ifndef BURGERS_RADAU_HPP
#define BURGERS_RADAU_HPP
/**
 * Radau IIA of order 5 (three stages) for a few states, with the adjoint of its steps.
 *
 * Readings are the grid. An interval is split where the error estimate of its step is too large.
 * Newton's method solves the stages with the Jacobian of the rates. Its unknowns are ordered by
 * states, so its matrix has a 3 x 3 block for each pair of states.
 *
 * Linear Kelvin elements that follow a quantity y (kelvin_elements.hpp) are solved exactly within a
 * step, given y at its stages. They add no unknowns.
 *
 * A class `Rates` of rates has n_states and a type Point of what is known at a stage: t, state,
 * rate, y and its slope by the first state, and z and dz/dt of the elements. Its functions are
 *
 *   prepare(point)                   what follows from the time alone
 *   drive(point)                     y and its slope
 *   evaluate(point)                  the rates
 *   pull_back<args>(point, rate_adjoint, adjoint, argument_adjoint)
 *                                    derivatives of the rates times rate_adjoint, added up;
 *                                    those by arguments if `args`
 */
#include "kelvin_elements.hpp"
#include <stan/math.hpp>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace burgers {

/** The linear equations of a Newton step, N x N blocks, solved by elimination. */
template <int N>
class StageEquations {
 public:
  Block block[N][N];

  /** Eliminate in place; diagonal blocks become their inverses. */
  void eliminate() {
    for (int k = 0; k < N; ++k) {
      block[k][k] = Block(block[k][k].inverse());
      for (int i = k + 1; i < N; ++i) {
        block[i][k] = Block(block[i][k] * block[k][k]);
        for (int j = k + 1; j < N; ++j) {
          block[i][j].noalias() -= block[i][k] * block[k][j];
        }
      }
    }
  }

  /** Replace the right-hand side by the solution. */
  void solve(Stages *x) const {
    for (int i = 1; i < N; ++i) {
      for (int j = 0; j < i; ++j) {
        x[i].noalias() -= block[i][j] * x[j];
      }
    }
    for (int i = N - 1; i >= 0; --i) {
      for (int j = i + 1; j < N; ++j) {
        x[i].noalias() -= block[i][j] * x[j];
      }
      x[i] = Stages(block[i][i] * x[i]);
    }
  }

  /** As solve(), with the transposed matrix. */
  void solve_transposed(Stages *x) const {
    for (int i = 0; i < N; ++i) {
      for (int j = 0; j < i; ++j) {
        x[i].noalias() -= block[j][i].transpose() * x[j];
      }
      x[i] = Stages(block[i][i].transpose() * x[i]);
    }
    for (int i = N - 1; i >= 0; --i) {
      for (int j = i + 1; j < N; ++j) {
        x[i].noalias() -= block[j][i].transpose() * x[j];
      }
    }
  }
};

/** Derivatives by the states at a stage, and by z and dz/dt of the Kelvin elements there. */
template <int N>
struct Adjoint {
  double state[N], z, z_rate;
};

/** A step that was taken: all that its adjoint needs beside z_k at its start. */
template <class Rates>
struct Step {
  double start[Rates::n_states]; // state
  double length;
  typename Rates::Point stage[3];
  SumRates z_rates;
  StageEquations<Rates::n_states> equations; // eliminated

  /** y at the stages. */
  Stages y() const { return {stage[0].y, stage[1].y, stage[2].y}; }

  /** Its derivatives by the first states. */
  Stages y_slopes() const { return {stage[0].y_slope, stage[1].y_slope, stage[2].y_slope}; }
};

/** Steps one after the other, and z_k of all elements at the start of each. */
template <class Rates, template <class> class Allocator>
struct Steps {
  std::vector<Step<Rates>, Allocator<Step<Rates>>> taken;
  std::vector<double, Allocator<double>> z;

  Steps(std::size_t n_times, int n_elements) {
    const std::size_t expected = 2 * n_times + 16;
    taken.reserve(expected);
    z.reserve(expected * n_elements);
  }
};

/** Solution of dy/dt = rates along times. */
template <class Rates>
class Trajectory {
 public:
  static constexpr int N = Rates::n_states;
  using State = Eigen::Matrix<double, N, 1>;

  /** The tolerance is relative and absolute, of the solution. */
  Trajectory(const Rates &rates, const KelvinElements &elements, double tolerance)
      : rates_(rates), elements_(elements),
        limit_(0.1 * tolerance), // of a step: errors of steps add up
        // The change after this one would be about its square.
        last_change_(0.01 * std::sqrt(limit_)) {}

  /**
   * Solve from t = 0 and tell whether there is a solution.
   *
   * @param start, z states and z_k at t = 0; z becomes those at the last time
   * @param output called with the states, z and the number of steps at each time
   */
  template <class Steps, class Output>
  bool solve(const State &start, std::vector<double> z, const std::vector<double> &time,
             Steps &steps, const Output &output) const {
    State state = start;
    typename Rates::Point point = at_start(state, z.data());
    State slope = Eigen::Map<State>(point.rate);
    double y = point.y;
    // More than a solution takes; then another solver is faster.
    const std::size_t max_steps = 1000 + 10 * time.size();
    std::size_t n_trials = 0;
    double t = 0;
    // Of a first step, from the slopes.
    double length = 0.2 / std::max(largest(slope, state), std::fabs(elements_.sum_rate(y, z.data()))
                                                              / (1 + std::fabs(point.z)));
    bool extrapolates = false; // guesses stages from the step before
    for (double end : time) {
      while (end - t > 1e-14 * end) {
        const double parts = std::ceil((end - t) / length - 1e-9);
        const double trial = parts > 1 ? (end - t) / parts : end - t;
        if (!std::isfinite(parts) || ++n_trials > max_steps) {
          return false;
        }
        steps.taken.emplace_back();
        Step<Rates> &step = steps.taken.back();
        step.length = trial;
        std::copy_n(state.data(), N, step.start);
        guess(slope, t, extrapolates ? &step - 1 : nullptr, step);
        double error = std::numeric_limits<double>::infinity();
        Jacobian jacobian; // at the first stage
        if (newton(z.data(), step, jacobian)) {
          error = error_estimate(slope, y, z.data(), step, jacobian) / limit_;
        }
        const double factor = error < 1e8 ? 0.9 / std::sqrt(std::sqrt(error + 1e-8)) : 0.1;
        if (!(error <= 1)) {
          steps.taken.pop_back();
          length = trial * std::max(0.1, std::min(0.7, factor));
          extrapolates = false;
          continue;
        }
        length = trial * std::min(8.0, std::max(0.2, factor));
        for (int a = 0; a < N; ++a) {
          Stages shift;
          for (int i = 0; i < 3; ++i) {
            shift[i] = step.stage[i].state[a] - state[a];
          }
          slope[a] = radau().inverse.row(2).dot(shift) / trial;
          state[a] = step.stage[2].state[a];
        }
        steps.z.insert(steps.z.end(), z.begin(), z.end());
        elements_.advance(trial, step.y(), z.data());
        y = step.stage[2].y;
        t = parts > 1 ? t + trial : end;
        extrapolates = true;
      }
      output(state, z.data(), steps.taken.size());
    }
    return true;
  }

  /**
   * Adjoint of a step: the derivatives by the states and z_k at its end become those by the states
   * and z_k at its start, those by the arguments, c_k and w_k are added up.
   *
   * @param z at the start
   */
  void pull_back(const Step<Rates> &step, const double *z, double *state_adjoint,
                 double *z_adjoint, double *argument_adjoint, double *decay_adjoint,
                 double *weight_adjoint) const {
    const Block weights = step.length * radau().a;
    Stages adjoint[N];
    for (int a = 0; a < N; ++a) {
      adjoint[a] << 0, 0, state_adjoint[a];
    }
    if (elements_.number > 0) {
      adjoint[0] += step.y_slopes().cwiseProduct(elements_.end_by_y(step.length, z_adjoint));
    }
    step.equations.solve_transposed(adjoint);
    for (int a = 0; a < N; ++a) {
      state_adjoint[a] = adjoint[a].sum();
      adjoint[a] = Stages(weights.transpose() * adjoint[a]);
    }
    Stages by_z, by_z_rate;
    for (int i = 0; i < 3; ++i) {
      double rate_adjoint[N];
      Adjoint<N> found = {};
      for (int a = 0; a < N; ++a) {
        rate_adjoint[a] = adjoint[a][i];
      }
      rates_.template pull_back<true>(step.stage[i], rate_adjoint, found, argument_adjoint);
      by_z[i] = found.z;
      by_z_rate[i] = found.z_rate;
    }
    if (elements_.number > 0) {
      by_z_rate += weights.transpose() * by_z; // z is that at the start and the integral of its rate
      elements_.pull_back(step.length, step.y(), z, by_z_rate, by_z.sum(), z_adjoint, decay_adjoint,
                          weight_adjoint);
    }
  }

 private:
  /** Derivatives of each rate. */
  using Jacobian = Adjoint<N>[N];

  Rates rates_;
  KelvinElements elements_;
  double limit_, last_change_;

  typename Rates::Point at_start(const State &state, const double *z) const {
    typename Rates::Point point;
    point.t = 0;
    std::copy_n(state.data(), N, point.state);
    rates_.prepare(point);
    rates_.drive(point);
    point.z = elements_.sum(z);
    point.z_rate = elements_.sum_rate(point.y, z);
    rates_.evaluate(point);
    return point;
  }

  /** Largest component over 1 + |state|, at least 1e-300; infinite if one is not finite. */
  static double largest(const State &x, const State &state) {
    double found = 1e-300;
    for (int a = 0; a < N; ++a) {
      found = std::max(found, std::fabs(x[a]) / (1 + std::fabs(state[a])));
    }
    return x.allFinite() ? found : std::numeric_limits<double>::infinity();
  }

  /** Times of the stages, and states there from the polynomial of the last step or the slope. */
  void guess(const State &slope, double t, const Step<Rates> *last, Step<Rates> &step) const {
    const Stages &c = radau().c;
    for (int i = 0; i < 3; ++i) {
      step.stage[i].t = t + c[i] * step.length;
      if (last == nullptr) {
        for (int a = 0; a < N; ++a) {
          step.stage[i].state[a] = step.start[a] + slope[a] * c[i] * step.length;
        }
      } else {
        const double place = 1 + c[i] * step.length / last->length;
        double weight[4];
        for (int j = 0; j < 4; ++j) {
          weight[j] = radau().share[j];
          for (int k = 0; k < 4; ++k) {
            weight[j] *= k == j ? 1 : place - radau().node[k];
          }
        }
        for (int a = 0; a < N; ++a) {
          step.stage[i].state[a]
              = weight[0] * last->start[a] + weight[1] * last->stage[0].state[a]
                + weight[2] * last->stage[1].state[a] + weight[3] * last->stage[2].state[a];
        }
      }
      rates_.prepare(step.stage[i]);
    }
  }

  /** Solve the stages; false if Newton's method does not converge. */
  bool newton(const double *z, Step<Rates> &step, Jacobian &first) const {
    const Block weights = step.length * radau().a;
    const double z_start = elements_.sum(z);
    step.z_rates = elements_.sum_rates(step.length, z);
    for (int iteration = 0; iteration < 8; ++iteration) {
      for (int i = 0; i < 3; ++i) {
        rates_.drive(step.stage[i]);
      }
      const Stages z_rate = step.z_rates.by_y * step.y() - step.z_rates.rest;
      const Stages z_gain = weights * z_rate;
      Stages residual[N];
      Jacobian jacobian[3] = {};
      for (int i = 0; i < 3; ++i) {
        step.stage[i].z = z_start + z_gain[i];
        step.stage[i].z_rate = z_rate[i];
        rates_.evaluate(step.stage[i]);
        for (int a = 0; a < N; ++a) {
          double unit[N] = {};
          unit[a] = 1;
          rates_.template pull_back<false>(step.stage[i], unit, jacobian[i][a], nullptr);
        }
      }
      const Block z_rate_by_state = step.z_rates.by_y * step.y_slopes().asDiagonal();
      for (int a = 0; a < N; ++a) {
        Stages rate;
        for (int i = 0; i < 3; ++i) {
          rate[i] = step.stage[i].rate[a];
          residual[a][i] = step.stage[i].state[a] - step.start[a];
        }
        residual[a].noalias() -= weights * rate;
        for (int b = 0; b < N; ++b) {
          Block &block = step.equations.block[a][b];
          for (int j = 0; j < 3; ++j) {
            block.col(j) = -jacobian[j][a].state[b] * weights.col(j);
          }
          if (a == b) {
            block.diagonal().array() += 1;
          }
        }
        if (elements_.number > 0) {
          Block by_z_rate = weights;
          for (int i = 0; i < 3; ++i) {
            by_z_rate.row(i) *= jacobian[i][a].z;
            by_z_rate(i, i) += jacobian[i][a].z_rate;
          }
          step.equations.block[a][0].noalias() -= weights * (by_z_rate * z_rate_by_state);
        }
      }
      step.equations.eliminate();
      step.equations.solve(residual);
      double change = 0;
      for (int a = 0; a < N; ++a) {
        for (int i = 0; i < 3; ++i) {
          step.stage[i].state[a] -= residual[a][i];
          // A state far below 1, as the stress of a weak dashpot, has to converge in its own scale.
          const double size = std::fabs(step.stage[i].state[a]);
          const double scale = std::min(1 + size, 10 * (1e-6 + size));
          change = std::max(change, std::fabs(residual[a][i]) / scale);
          if (!std::isfinite(residual[a][i])) {
            return false;
          }
        }
      }
      if (change < last_change_) {
        for (int i = 0; i < 3; ++i) {
          rates_.drive(step.stage[i]);
        }
        std::copy_n(jacobian[0], N, first);
        return true;
      }
    }
    return false;
  }

  /**
   * Estimate of order 3 of the error of a step, the largest over 1 + |state|.
   *
   * @param slope, y, z at the start
   */
  double error_estimate(const State &slope, double y, const double *z, const Step<Rates> &step,
                        const Jacobian &jacobian) const {
    const SumError of_z = elements_.error(step.length, y, step.y(), z);
    State defect = slope;
    Eigen::Matrix<double, N, N> matrix;
    for (int a = 0; a < N; ++a) {
      const double by_z = jacobian[a].z + jacobian[a].z_rate * of_z.scale;
      for (int b = 0; b < N; ++b) {
        matrix(a, b) = (a == b ? radau().eigenvalue / step.length : 0) - jacobian[a].state[b];
      }
      for (int i = 0; i < 3; ++i) {
        defect[a] += radau().estimate[i] * (step.stage[i].state[a] - step.start[a]) / step.length;
      }
      matrix(a, 0) -= by_z * of_z.by_drive * step.stage[0].y_slope;
      defect[a] += by_z * of_z.constant - jacobian[a].z_rate * of_z.shift;
    }
    const State error = matrix.inverse() * defect;
    const double z_error = of_z.constant + of_z.by_drive * step.stage[0].y_slope * error[0];
    return std::max(largest(error, Eigen::Map<const State>(step.start)),
                    std::fabs(z_error) / (1 + std::fabs(elements_.sum(z))));
  }
};

}  // namespace burgers
#endif
