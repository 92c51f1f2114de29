// Main of a program's class: log density and gradient at points, by a Stan newer than CmdStan 2.27.
#include <stan/io/json/json_data.hpp>
#include <stan/model/log_prob_grad.hpp>
#include <cstdio>
#include <cstdlib>
#include <fstream>
#include <iostream>
#include <sstream>

stan::model::model_base &new_model(stan::io::var_context &, unsigned int, std::ostream *);

// Arguments: data (JSON), points (one a line), gradients at each point.
int main(int, char **arguments) {
  std::ifstream data_file(arguments[1]), points(arguments[2]);
  stan::json::json_data data(data_file);
  stan::model::model_base &model = new_model(data, 1, &std::cerr);
  std::string line;
  while (std::getline(points, line)) {
    std::istringstream cells(line);
    std::ostringstream messages;
    Eigen::VectorXd point(model.num_params_r()), gradient;
    for (int k = 0; k < point.size(); ++k) {
      cells >> point[k];
    }
    double density = 0;
    for (int r = 0; r < std::atoi(arguments[3]); ++r) {
      density = stan::model::log_prob_grad<false, true>(model, point, gradient, &messages);
    }
    std::printf("%.17g", density);
    for (double slope : gradient) {
      std::printf(" %.17g", slope);
    }
    std::printf("\n");
  }
}
