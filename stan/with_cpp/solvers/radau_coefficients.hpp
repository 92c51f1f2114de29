#ifndef BURGERS_RADAU_COEFFICIENTS_HPP
#define BURGERS_RADAU_COEFFICIENTS_HPP
/** Coefficients of Radau IIA of order 5. */
#include <Eigen/Dense>
#include <algorithm>
#include <cmath>

namespace burgers {

using Stages = Eigen::Vector3d;
using Block = Eigen::Matrix3d;

struct Radau {
  Block a;             // weights of the rates in each stage
  Block inverse;       // of a
  Stages c;            // places of the stages in a step
  Stages estimate;     // weights of the stages in the error estimate
  double eigenvalue;   // the real one of inverse
  double invariant[3]; // det(1 + x a) = 1 + sum of invariant[j] x^(j + 1)
  Block b[3];          // adjugate of 1 + x a, by powers of x
  double node[4];      // start and stages of a step
  double share[4];     // of the polynomial through these: 1/product of distances from the others

  Radau() : eigenvalue(3.637834252744496), invariant{3.0 / 5, 3.0 / 20, 1.0 / 60} {
    const double r = std::sqrt(6.0);
    a << (88 - 7 * r) / 360, (296 - 169 * r) / 1800, (-2 + 3 * r) / 225,
        (296 + 169 * r) / 1800, (88 + 7 * r) / 360, (-2 - 3 * r) / 225, (16 - r) / 36,
        (16 + r) / 36, 1.0 / 9;
    c << (4 - r) / 10, (4 + r) / 10, 1;
    inverse = a.inverse();
    estimate << -(13 + 7 * r) / 3, (-13 + 7 * r) / 3, -1.0 / 3;
    b[0].setIdentity();
    b[1] = invariant[0] * b[0] - a;
    b[2] = invariant[2] * inverse;
    node[0] = 0;
    std::copy_n(c.data(), 3, node + 1);
    for (int j = 0; j < 4; ++j) {
      share[j] = 1;
      for (int k = 0; k < 4; ++k) {
        share[j] /= k == j ? 1 : node[j] - node[k];
      }
    }
  }
};

inline const Radau &radau() {
  static const Radau coefficients;
  return coefficients;
}

}  // namespace burgers
#endif
