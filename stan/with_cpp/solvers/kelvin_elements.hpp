#ifndef BURGERS_KELVIN_ELEMENTS_HPP
#define BURGERS_KELVIN_ELEMENTS_HPP
/**
 * Linear Kelvin elements in a step of radau.hpp: z_k that follow one quantity y,
 *
 *   dz_k/dt = c_k (y - z_k),  z = sum of w_k z_k.
 *
 * Their equations are linear, so that with y at the stages of a step of length h, the differences
 * there are
 *
 *   y - z_k = U(h c_k) (y - z_k at the start),  U(x) = (1 + x A)^-1,
 *
 * A the matrix of the method. By Cayley and Hamilton U is a sum of three constant matrices:
 *
 *   U(x) = sum of f_j(x) B_j,  f_j(x) = x^j/det(1 + x A),  j = 0, 1, 2.
 */
#include "radau_coefficients.hpp"

namespace burgers {

/** f_j and their slopes. */
struct Relaxation {
  double value[3], slope[3];

  explicit Relaxation(double x) {
    const double *d = radau().invariant;
    value[0] = 1 / (1 + x * (d[0] + x * (d[1] + x * d[2])));
    value[1] = x * value[0];
    value[2] = x * value[1];
    const double steepness = (d[0] + x * (2 * d[1] + x * 3 * d[2])) * value[0];
    slope[0] = -value[0] * steepness;
    slope[1] = value[0] - value[1] * steepness;
    slope[2] = 2 * value[1] - value[2] * steepness;
  }
};

/** A weighted sum of y - z_k over the stages, and its slope by x = h c_k. */
class StageSum {
 public:
  StageSum(const Stages &weight, const Stages &y) {
    for (int j = 0; j < 3; ++j) {
      const Stages row = radau().b[j].transpose() * weight;
      of_y_[j] = row.dot(y);
      of_start_[j] = row.sum();
    }
  }

  double value(const Relaxation &f, double start) const { return times(f.value, start); }
  double slope(const Relaxation &f, double start) const { return times(f.slope, start); }

  /** Derivative of the value by z_k at the start. */
  double by_start(const Relaxation &f) const {
    return -(f.value[0] * of_start_[0] + f.value[1] * of_start_[1] + f.value[2] * of_start_[2]);
  }

 private:
  double of_y_[3], of_start_[3];

  double times(const double *f, double start) const {
    return f[0] * (of_y_[0] - of_start_[0] * start) + f[1] * (of_y_[1] - of_start_[1] * start)
           + f[2] * (of_y_[2] - of_start_[2] * start);
  }
};

/** dz/dt at the stages, by_y y - rest. */
struct SumRates {
  Block by_y;
  Stages rest;
};

/** Error of z in a step, constant + by_drive error of y; and of dz/dt, scale error of z - shift. */
struct SumError {
  double constant, by_drive, scale, shift;
};

/** The elements. All functions with y have that at the stages. */
struct KelvinElements {
  int number;
  const double *decay, *weight; // c_k, w_k

  /** z. */
  double sum(const double *z) const {
    double found = 0;
    for (int k = 0; k < number; ++k) {
      found += weight[k] * z[k];
    }
    return found;
  }

  /** dz/dt. */
  double sum_rate(double y, const double *z) const {
    double found = 0;
    for (int k = 0; k < number; ++k) {
      found += weight[k] * decay[k] * (y - z[k]);
    }
    return found;
  }

  SumRates sum_rates(double length, const double *start) const {
    double of_y[3] = {}, of_start[3] = {};
    for (int k = 0; k < number; ++k) {
      const Relaxation f(length * decay[k]);
      for (int j = 0; j < 3; ++j) {
        const double part = weight[k] * decay[k] * f.value[j];
        of_y[j] += part;
        of_start[j] += part * start[k];
      }
    }
    SumRates rates;
    rates.by_y = of_y[0] * radau().b[0] + of_y[1] * radau().b[1] + of_y[2] * radau().b[2];
    rates.rest = (of_start[0] * radau().b[0] + of_start[1] * radau().b[1]
                  + of_start[2] * radau().b[2]).rowwise().sum();
    return rates;
  }

  /** Replace z_k at the start of a step by those at its end. */
  void advance(double length, const Stages &y, double *z) const {
    const StageSum at_end(Stages::UnitZ(), y);
    for (int k = 0; k < number; ++k) {
      z[k] = y[2] - at_end.value(Relaxation(length * decay[k]), z[k]);
    }
  }

  /** Estimate of the error, as that of the states in radau.hpp; y_0 is y at the start. */
  SumError error(double length, double y_0, const Stages &y, const double *start) const {
    const double scale = radau().eigenvalue / length;
    const double weights = radau().estimate.sum(), whole = radau().estimate.dot(y);
    const StageSum lag(radau().estimate, y);
    SumError error = {0, 0, scale, 0};
    for (int k = 0; k < number; ++k) {
      const double defect
          = decay[k] * (y_0 - start[k])
            + (whole - weights * start[k] - lag.value(Relaxation(length * decay[k]), start[k]))
                  / length;
      const double part = weight[k] / (scale + decay[k]);
      error.constant += part * defect;
      error.by_drive += part * decay[k];
      error.shift += weight[k] * defect;
    }
    return error;
  }

  /** Derivatives by y of the z_k at the end, times their adjoints, added up. */
  Stages end_by_y(double length, const double *by_end) const {
    double all = 0, of_lag[3] = {};
    for (int k = 0; k < number; ++k) {
      const Relaxation f(length * decay[k]);
      all += by_end[k];
      for (int j = 0; j < 3; ++j) {
        of_lag[j] += by_end[k] * f.value[j];
      }
    }
    return all * Stages::UnitZ()
           - (of_lag[0] * radau().b[0] + of_lag[1] * radau().b[1] + of_lag[2] * radau().b[2])
                 .row(2)
                 .transpose();
  }

  /**
   * Adjoint of a step, y given: the derivatives by the z_k at its end become those by the z_k at
   * its start, those by c_k and w_k are added up.
   *
   * @param by_rate, by_sum derivatives by dz/dt at the stages, and by z at the start
   */
  void pull_back(double length, const Stages &y, const double *start, const Stages &by_rate,
                 double by_sum, double *by_z, double *by_decay, double *by_weight) const {
    const StageSum at_end(Stages::UnitZ(), y), rated(by_rate, y);
    for (int k = 0; k < number; ++k) {
      const double x = length * decay[k];
      const Relaxation f(x);
      const double lag = rated.value(f, start[k]);
      by_weight[k] += decay[k] * lag + by_sum * start[k];
      by_decay[k] += weight[k] * (lag + x * rated.slope(f, start[k]))
                     - by_z[k] * length * at_end.slope(f, start[k]);
      by_z[k] = weight[k] * (by_sum + decay[k] * rated.by_start(f)) - by_z[k] * at_end.by_start(f);
    }
  }
};

}  // namespace burgers
#endif
