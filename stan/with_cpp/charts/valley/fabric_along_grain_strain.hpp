#ifndef BURGERS_FABRIC_ALONG_GRAIN_STRAIN_HPP
#define BURGERS_FABRIC_ALONG_GRAIN_STRAIN_HPP
/** The function of fabric_along_grain_strain.stan, with its derivatives by hand. */
#include "density_of_fit.hpp"
#include "fabric_step.hpp"
#include "rest_of_strength.hpp"

namespace burgers {

/** Columns u_2, amplitude and ln density of places, of the numbers u_1 there, asked and weights. */
class FabricAlongGrainStrain {
 public:
  FabricAlongGrainStrain(const Eigen::VectorXd &number, const Eigen::VectorXd &reference,
                         const Eigen::VectorXd &strain, bool stress_given,
                         const Eigen::MatrixXd &bounds)
      : n_(strain.size()), n_places_(number.size() - 2 * n_ - 2),
        range_(bounds(2, 1) - bounds(2, 0)), pins_((n_path_steps + 2 * n_places_) * n_),
        fabric_pins_(pins_.size()) {
    const double *u_1 = number.data(), *asked = u_1 + n_places_, *weight = asked + n_ + 2;
    const double start = reference[i_grain_strain];
    const int middle = n_places_ / 2;
    int n_steps = 0;
    const auto step = [&](const Fabric &from, const RestOfStrength &rest, double share) {
      const int first = n_ * n_steps++;
      return FabricStep(from, rest.value.data(), weight, share, strain, stress_given, bounds,
                        &pins_[first], &fabric_pins_[first]);
    };
    /** Move from the solution of the visit before, -1: from the reference point. */
    const auto visit = [&](int before, double u, double part_of_way, int place) {
      const Fabric from
          = before < 0 ? Fabric{reference[i_fabric_strain], reference[i_fabric_amplitude]}
                       : visits_[before].moved.fabric();
      RestOfStrength rest(u, part_of_way, asked, reference, strain, bounds);
      const FabricStep moved = step(from, rest, softened_share);
      visits_.push_back({before, part_of_way, place, std::move(rest), moved});
    };
    visits_.reserve(n_path_steps + n_places_);
    for (int k = 1; k <= n_path_steps; ++k) {
      const double part = k * 1.0 / n_path_steps;
      visit(k - 2, start + part * (u_1[middle] - start), part, middle);
    }
    for (int sign : {-1, 1}) {
      int before = n_path_steps - 1;
      for (int k = sign < 0 ? 0 : 1; k <= middle; ++k) {
        const int i = middle + sign * k;
        visit(before, u_1[i], 1, i);
        before = visits_.size() - 1;
        const Fabric solved = visits_[before].moved.fabric();
        const FabricStep there = step(solved, visits_[before].rest, 1);
        places_.push_back({there, solved, {there.after, solved, bounds(2, 0), range_}});
      }
    }
  }

  Eigen::VectorXd outputs() const {
    Eigen::VectorXd found(3 * n_places_);
    for (std::size_t j = 0; j < places_.size(); ++j) {
      const Fabric &solved = places_[j].solved;
      found.segment<3>(3 * visits_[n_path_steps + j].place)
          << solved.u, solved.amplitude, places_[j].density.value;
    }
    return found;
  }

  Eigen::VectorXd pull_back(const Eigen::VectorXd &by) const {
    Eigen::VectorXd found = Eigen::VectorXd::Zero(n_places_ + 2 * n_ + 2);
    double *by_asked = found.data() + n_places_, *by_weight = by_asked + n_ + 2;
    std::vector<Fabric> by_moved(visits_.size());
    std::vector<double> by_rest(n_);
    for (int v = visits_.size() - 1; v >= 0; --v) {
      const Visit &visit = visits_[v];
      std::fill(by_rest.begin(), by_rest.end(), 0);
      if (v >= n_path_steps) {
        const Place &place = places_[v - n_path_steps];
        const auto by_place = by.segment<3>(3 * visit.place);
        by_moved[v] += {by_place[0], by_place[1]};
        by_moved[v] += place.density.by_fabric(by_place[2]);
        by_moved[v] += place.evaluated.pull_back(place.density.by_step(by_place[2]),
                                                 by_rest.data(), by_weight);
      }
      const Fabric by_start = visit.moved.pull_back(
          {by_moved[v].u, by_moved[v].amplitude, 0, 0, 0, 0, 0}, by_rest.data(), by_weight);
      if (visit.before >= 0) {
        by_moved[visit.before] += by_start;
      }
      found[visit.place]
          += visit.part_of_way * visit.rest.pull_back(by_rest.data(), nullptr, by_asked);
    }
    return found;
  }

 private:
  /** Density of a solution, and its derivatives. */
  class Density {
   public:
    Density(const Solved &step, const Fabric &solved, double lowest, double range)
        : step_(step), range_(range), share_(stan::math::inv_logit(solved.u)),
          determinant_(step.c11 * step.c22 - step.c12 * step.c12),
          c_(std::sqrt(step.c11 / determinant_) / range),
          fit_(step.misfit, (1 - solved.amplitude - lowest) / range, c_) {
      value = fit_.value - 0.5 * std::log(determinant_) + stan::math::log_inv_logit(solved.u)
              + stan::math::log1m_inv_logit(solved.u);
    }

    double value;

    Fabric by_fabric(double by) const {
      return {by * (1 - 2 * share_), -by * fit_.by_place / range_};
    }

    Solved by_step(double by) const {
      const double by_log_c = 0.5 * by * fit_.by_c * c_;
      const double by_determinant = -(by_log_c + 0.5 * by) / determinant_;
      return {0,
              0,
              by_log_c / step_.c11 + by_determinant * step_.c22,
              -2 * by_determinant * step_.c12,
              by_determinant * step_.c11,
              by * fit_.by_misfit,
              0};
    }

   private:
    Solved step_;
    double range_, share_, determinant_, c_;
    DensityOfFit fit_;
  };

  /** A step to a place, on the way to the middle with a part of what is asked. */
  struct Visit {
    int before;
    double part_of_way;
    int place;
    RestOfStrength rest;
    FabricStep moved;
  };

  struct Place {
    FabricStep evaluated;
    Fabric solved;
    Density density;
  };

  int n_, n_places_;
  double range_;
  std::vector<Pin> pins_;
  std::vector<FabricPin> fabric_pins_;
  std::vector<Visit> visits_;
  std::vector<Place> places_; // of the visits after the path
};

template <typename GrainStrain, typename T, typename Reference, typename Strain,
          typename Weight, typename Bounds>
auto fabric_along_grain_strain(const GrainStrain &grain_strain, const Vector<T> &asked,
                               const Reference &reference, const Strain &strain,
                               const Weight &weight, const int &stress_given,
                               const Bounds &bounds, std::ostream *) {
  return in_rows(3, by_hand<FabricAlongGrainStrain>(
                        numbers(grain_strain, asked, weight), Eigen::VectorXd(reference),
                        Eigen::VectorXd(strain), stress_given, Eigen::MatrixXd(bounds)));
}

}  // namespace burgers
#endif
