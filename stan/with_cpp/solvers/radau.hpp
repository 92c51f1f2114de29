#ifndef BURGERS_RADAU_HPP
#define BURGERS_RADAU_HPP
/**
 * Radau IIA of order 5 (three stages) for a few states, with the adjoint of its steps.
 *
 * Readings are the grid. An interval is split where the error estimate of its step is too large.
 * Newton's method solves the stages with the Jacobian of the rates. Its unknowns are ordered by
 * states, so its matrix has a 3 x 3 block for each pair of states.
 *
 * A class `Rates` of rates has n_states and a type Point of what is known at a stage: t, state,
 * rate. Its functions are
 *
 *   prepare(point)                   what follows from the time alone
 *   evaluate(point)                  the rates
 *   pull_back<args>(point, rate_adjoint, state_adjoint, argument_adjoint)
 *                                    derivatives of the rates times rate_adjoint, added up;
 *                                    those by arguments if `args`
 */
#include <stan/math.hpp>
#include <algorithm>
#include <cmath>
#include <limits>
#include <vector>

namespace burgers {

using Stages = Eigen::Vector3d;
using Block = Eigen::Matrix3d;

/** Coefficients of the method. */
struct Radau {
  Block a;           // weights of the rates in each stage
  Block inverse;     // of a
  Stages c;          // places of the stages in a step
  Stages estimate;   // weights of the stages in the error estimate
  double eigenvalue; // the real one of inverse

  Radau() {
    const double r = std::sqrt(6.0);
    a << (88 - 7 * r) / 360, (296 - 169 * r) / 1800, (-2 + 3 * r) / 225,
        (296 + 169 * r) / 1800, (88 + 7 * r) / 360, (-2 - 3 * r) / 225, (16 - r) / 36,
        (16 + r) / 36, 1.0 / 9;
    c << (4 - r) / 10, (4 + r) / 10, 1;
    inverse = a.inverse();
    estimate << -(13 + 7 * r) / 3, (-13 + 7 * r) / 3, -1.0 / 3;
    eigenvalue = 3.637834252744496;
  }
};

inline const Radau &radau() {
  static const Radau coefficients;
  return coefficients;
}

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

/** A step that was taken: all that its adjoint needs. */
template <class Rates>
struct Step {
  double start[Rates::n_states]; // state
  double length;
  typename Rates::Point stage[3];
  StageEquations<Rates::n_states> equations; // eliminated
};

/** Solution of dy/dt = rates along times. */
template <class Rates>
class Trajectory {
 public:
  static constexpr int N = Rates::n_states;
  using State = Eigen::Matrix<double, N, 1>;

  /** The tolerance is relative and absolute, of the solution. */
  Trajectory(const Rates &rates, double tolerance)
      : rates_(rates), limit_(0.1 * tolerance), // of a step: errors of steps add up
        // The change after this one would be about its square.
        last_change_(0.01 * std::sqrt(limit_)) {}

  /**
   * Solve from t = 0 and tell whether there is a solution.
   *
   * @param steps all steps, one after the other
   * @param output called with the state and the number of steps at each time
   */
  template <class Steps, class Output>
  bool solve(const State &start, const std::vector<double> &time, Steps &steps,
             const Output &output) const {
    State state = start;
    State slope = slope_at(0, start);
    // More than a solution takes; then another solver is faster.
    const std::size_t max_steps = 1000 + 10 * time.size();
    std::size_t n_trials = 0;
    double t = 0;
    double length = 0.2 / largest(slope, state); // of a first step, from the slope
    bool extrapolates = false; // guesses stages from the step before
    for (double end : time) {
      while (end - t > 1e-14 * end) {
        const double parts = std::ceil((end - t) / length - 1e-9);
        const double trial = parts > 1 ? (end - t) / parts : end - t;
        if (!std::isfinite(parts) || ++n_trials > max_steps) {
          return false;
        }
        steps.emplace_back();
        Step<Rates> &step = steps.back();
        step.length = trial;
        std::copy_n(state.data(), N, step.start);
        guess(slope, t, extrapolates ? &steps[steps.size() - 2] : nullptr, step);
        double error = std::numeric_limits<double>::infinity();
        Jacobian jacobian; // at the first stage
        if (newton(step, jacobian)) {
          error = error_estimate(slope, step, jacobian) / limit_;
        }
        const double factor = error < 1e8 ? 0.9 / std::sqrt(std::sqrt(error + 1e-8)) : 0.1;
        if (!(error <= 1)) {
          steps.pop_back();
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
        t = parts > 1 ? t + trial : end;
        extrapolates = true;
      }
      output(state, steps.size());
    }
    return true;
  }

  /**
   * Adjoint of a step: the derivatives by the state at its end become those by the state at its
   * start, those by the arguments are added up.
   */
  void pull_back(const Step<Rates> &step, double *state_adjoint, double *argument_adjoint) const {
    Stages adjoint[N];
    for (int a = 0; a < N; ++a) {
      adjoint[a] << 0, 0, state_adjoint[a];
    }
    step.equations.solve_transposed(adjoint);
    for (int a = 0; a < N; ++a) {
      state_adjoint[a] = adjoint[a].sum();
      adjoint[a] = Stages(step.length * radau().a.transpose() * adjoint[a]);
    }
    for (int i = 0; i < 3; ++i) {
      double rate_adjoint[N], unused[N] = {};
      for (int a = 0; a < N; ++a) {
        rate_adjoint[a] = adjoint[a][i];
      }
      rates_.template pull_back<true>(step.stage[i], rate_adjoint, unused, argument_adjoint);
    }
  }

 private:
  /** Derivatives of each rate. */
  struct Jacobian {
    double by_state[N][N];
  };

  Rates rates_;
  double limit_, last_change_;

  State slope_at(double t, const State &state) const {
    typename Rates::Point point;
    point.t = t;
    std::copy_n(state.data(), N, point.state);
    rates_.prepare(point);
    rates_.evaluate(point);
    return Eigen::Map<State>(point.rate);
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
        const double node[4] = {0, c[0], c[1], 1};
        const double place = 1 + c[i] * step.length / last->length;
        double weight[4];
        for (int j = 0; j < 4; ++j) {
          weight[j] = 1;
          for (int k = 0; k < 4; ++k) {
            weight[j] *= k == j ? 1 : (place - node[k]) / (node[j] - node[k]);
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
  bool newton(Step<Rates> &step, Jacobian &first) const {
    const Block weights = step.length * radau().a;
    for (int iteration = 0; iteration < 8; ++iteration) {
      Stages residual[N];
      Jacobian jacobian[3] = {};
      for (int i = 0; i < 3; ++i) {
        rates_.evaluate(step.stage[i]);
        for (int a = 0; a < N; ++a) {
          double unit[N] = {};
          unit[a] = 1;
          rates_.template pull_back<false>(step.stage[i], unit, jacobian[i].by_state[a], nullptr);
        }
      }
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
            block.col(j) = -jacobian[j].by_state[a][b] * weights.col(j);
          }
          if (a == b) {
            block.diagonal().array() += 1;
          }
        }
      }
      step.equations.eliminate();
      step.equations.solve(residual);
      double change = 0;
      for (int a = 0; a < N; ++a) {
        for (int i = 0; i < 3; ++i) {
          step.stage[i].state[a] -= residual[a][i];
          change = std::max(change, std::fabs(residual[a][i]) / (1 + std::fabs(step.start[a])));
          if (!std::isfinite(residual[a][i])) {
            return false;
          }
        }
      }
      if (change < last_change_) {
        first = jacobian[0];
        return true;
      }
    }
    return false;
  }

  /** Estimate of order 3 of the error of a step, the largest over 1 + |state|. */
  double error_estimate(const State &slope, const Step<Rates> &step,
                        const Jacobian &jacobian) const {
    State defect = slope;
    Eigen::Matrix<double, N, N> matrix;
    for (int a = 0; a < N; ++a) {
      for (int b = 0; b < N; ++b) {
        matrix(a, b) = (a == b ? radau().eigenvalue / step.length : 0) - jacobian.by_state[a][b];
      }
      for (int i = 0; i < 3; ++i) {
        defect[a] += radau().estimate[i] * (step.stage[i].state[a] - step.start[a]) / step.length;
      }
    }
    return largest(matrix.inverse() * defect, Eigen::Map<const State>(step.start));
  }
};

}  // namespace burgers
#endif
