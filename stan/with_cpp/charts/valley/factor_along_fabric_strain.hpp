#ifndef BURGERS_FACTOR_ALONG_FABRIC_STRAIN_HPP
#define BURGERS_FACTOR_ALONG_FABRIC_STRAIN_HPP
/** The function of factor_along_fabric_strain.stan, with its derivatives by hand. */
#include "density_of_fit.hpp"
#include "fabric_step.hpp"

namespace burgers {

/** F_ss that solves (*) at u_2: solve_fabric_factor() with one step, and its density. */
class FactorAt {
 public:
  /** Derivatives. */
  struct By {
    double u, total;
  };

  FactorAt(double u, double total_before, const double *rest, const double *weight,
           const Eigen::VectorXd &strain, bool stress_given, const Eigen::MatrixXd &bounds,
           Pin *pins, FabricPin *fabric)
      : range_(bounds(2, 1) - bounds(2, 0)), left_(std::exp(-total_before)),
        decay_(CriticalStrain(u, bounds, 1).decay(strain[strain.size() - 1])),
        grown_(1 - decay_.value), amplitude_(-std::expm1(-total_before) / grown_),
        step_({u, amplitude_}, rest, weight, 1, strain, stress_given, bounds, pins, fabric),
        precision_(step_.after.c22), change_(step_.after.by_misfit / precision_),
        limited_(amplitude_ + change_, decay_), c_(1 / (range_ * std::sqrt(precision_))),
        fit_(step_.after.misfit - precision_ * change_ * change_,
             (1 - amplitude_ - change_ - bounds(2, 0)) / range_, c_) {
    total = -std::log1p(-limited_.value * grown_);
    log_density = fit_.value + std::log(c_);
  }

  double total, log_density;

  /** Add derivatives by the rest and the weight of every pin; return the others. */
  By pull_back(double by_total, double by_density, double *by_rest, double *by_weight) const {
    const double by_softening = by_total / (1 - limited_.value * grown_); // amplitude times growth
    const double by_limited = by_softening * grown_;
    const double by_solved
        = by_limited * limited_.by_amplitude - by_density * fit_.by_place / range_;
    const double by_misfit = by_density * fit_.by_misfit;
    const double by_log_c = by_density * (1 + fit_.by_c * c_);
    const double by_precision
        = by_misfit * change_ * change_ - (0.5 * by_log_c + by_solved * change_) / precision_;
    const Fabric by_start
        = step_.pull_back({0, 0, 0, 0, by_precision, by_misfit,
                           by_solved / precision_ - 2 * by_misfit * change_},
                          by_rest, by_weight);
    const double by_amplitude = by_solved + by_start.amplitude;
    const double by_grown
        = by_softening * limited_.value - by_amplitude * amplitude_ / grown_;
    return {by_start.u + by_limited * limited_.by_u - by_grown * decay_.slope,
            by_amplitude * left_ / grown_};
  }

 private:
  double range_, left_;
  Decay decay_;
  double grown_, amplitude_;
  FabricStep step_;
  double precision_, change_;
  LimitedAmplitude limited_;
  double c_;
  DensityOfFit fit_;
};

/** Rows of places: -ln F at the last pin, ln density; of the numbers u_2, total, rest and weights. */
class FactorAlongFabricStrain {
 public:
  FactorAlongFabricStrain(const Eigen::VectorXd &number, const Eigen::VectorXd &strain,
                          bool stress_given, const Eigen::MatrixXd &bounds)
      : n_(strain.size()), n_places_(number.size() - 1 - 2 * n_), pins_(n_places_ * n_),
        fabric_(pins_.size()) {
    const double *u_2 = number.data(), *rest = u_2 + n_places_ + 1, *weight = rest + n_;
    const int middle = n_places_ / 2;
    places_.reserve(n_places_);
    for (int sign : {-1, 1}) {
      int before = -1; // from the middle
      for (int k = sign < 0 ? 0 : 1; k <= middle; ++k) {
        const int i = middle + sign * k, first = n_ * places_.size();
        places_.push_back(
            {i, before,
             {u_2[i], before < 0 ? u_2[n_places_] : places_[before].factor.total, rest, weight,
              strain, stress_given, bounds, &pins_[first], &fabric_[first]}});
        before = places_.size() - 1;
      }
    }
  }

  Eigen::VectorXd outputs() const {
    Eigen::VectorXd found(2 * n_places_);
    for (const Place &place : places_) {
      found.segment<2>(2 * place.number) << place.factor.total, place.factor.log_density;
    }
    return found;
  }

  Eigen::VectorXd pull_back(const Eigen::VectorXd &by) const {
    Eigen::VectorXd found = Eigen::VectorXd::Zero(n_places_ + 1 + 2 * n_);
    double *by_rest = found.data() + n_places_ + 1, *by_weight = by_rest + n_;
    std::vector<double> by_total(n_places_);
    for (int k = n_places_ - 1; k >= 0; --k) {
      const Place &place = places_[k];
      const auto back
          = place.factor.pull_back(by_total[k] + by[2 * place.number], by[2 * place.number + 1],
                                   by_rest, by_weight);
      found[place.number] += back.u;
      (place.before < 0 ? found[n_places_] : by_total[place.before]) += back.total;
    }
    return found;
  }

 private:
  struct Place {
    int number, before;
    FactorAt factor;
  };

  int n_, n_places_;
  std::vector<Pin> pins_;
  std::vector<FabricPin> fabric_;
  std::vector<Place> places_; // in the order in which they are solved
};

template <typename FabricStrain, typename Total, typename T, typename Strain, typename Weight,
          typename Bounds>
auto factor_along_fabric_strain(const FabricStrain &fabric_strain, const Total &total_softening,
                                const Vector<T> &rest, const Strain &strain, const Weight &weight,
                                const int &stress_given, const Bounds &bounds, std::ostream *) {
  return in_rows(2, by_hand<FactorAlongFabricStrain>(
                        numbers(fabric_strain, total_softening, rest, weight),
                        Eigen::VectorXd(strain), stress_given, Eigen::MatrixXd(bounds)));
}

}  // namespace burgers
#endif
