// Main of a program's class: leapfrog steps of given length from given points, and where one of them
// goes wrong. CmdStan says that a trajectory diverged, not where.
#include <cmdstan/io/json/json_data.hpp>
#include <stan/model/log_prob_grad.hpp>
#include <cmath>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <random>
#include <sstream>

stan::model::model_base &new_model(stan::io::var_context &, unsigned int, std::ostream *);

namespace {
// Log density and gradient; NaN where there is no solution.
double log_density(stan::model::model_base &model, Eigen::VectorXd point, Eigen::VectorXd &slope) {
  std::ostringstream messages;
  try {
    return stan::model::log_prob_grad<true, true>(model, point, slope, &messages);
  } catch (const std::exception &) {
    stan::math::recover_memory();
    return std::nan("");
  }
}
}  // namespace

// Arguments: data (JSON), points (one a line), Cholesky factor of the inverse mass matrix, step, steps
// of a trajectory, seed, the change of the energy's error in one step that is told.
int main(int, char **arguments) {
  std::ifstream data_file(arguments[1]), points(arguments[2]), factor_file(arguments[3]);
  const double step = std::atof(arguments[4]), told = std::atof(arguments[7]);
  cmdstan::json::json_data data(data_file);
  stan::model::model_base &model = new_model(data, 1, &std::cerr);
  const int n = model.num_params_r();
  Eigen::MatrixXd factor(n, n);
  for (int i = 0; i < n * n; ++i) {
    factor_file >> factor(i / n, i % n);
  }
  std::mt19937 random(std::atoi(arguments[6]));
  std::normal_distribution<double> normal;
  std::string line;
  while (std::getline(points, line)) {
    std::istringstream cells(line);
    Eigen::VectorXd point(n), momentum(n), slope(n), before;
    for (int i = 0; i < n; ++i) {
      cells >> point[i];
      momentum[i] = normal(random);
    }
    // In coordinates in which the metric is 1.
    const double start = 0.5 * momentum.squaredNorm() - log_density(model, point, slope);
    double error = 0;
    int k = 0;
    bool wrong = false;
    while (k++ < std::atoi(arguments[5]) && !wrong) {
      before = point;
      momentum += 0.5 * step * (factor.transpose() * slope);
      point += step * (factor * momentum);
      const double density = log_density(model, point, slope);
      momentum += 0.5 * step * (factor.transpose() * slope);
      const double now = 0.5 * momentum.squaredNorm() - density - start;
      wrong = !(std::abs(now - error) < told);
      error = now;
    }
    // Steps made, whether the last one went wrong, error of the energy, both ends of the last step.
    std::printf("%d %d %.6g", k - 1, wrong, error);
    for (int i = 0; i < 2 * n; ++i) {
      std::printf(" %.17g", i < n ? before[i] : point[i - n]);
    }
    std::printf("\n");
  }
}
