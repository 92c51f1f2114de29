"""Solutions of the valley coordinates: those in C++ beside those in Stan."""

import re
from pathlib import Path

import numpy as np
import pytest
from log_density import program_with

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.kinds.stan_data import StanData

FORMS = (
    "middle_grain_strain",
    "fabric_step",
    "fabric_along_grain_strain",
    "factor_along_fabric_strain",
)
"""Functions that have both forms."""

PROGRAM = """
functions {
#include physics/parameters.stan
#include physics/flow_law.stan
#include physics/environment.stan
#include charts/plain.stan
#include charts/valley/pins.stan
#include charts/valley/least_squares.stan
#include charts/valley/quantiles.stan
#include charts/valley/softening.stan
BODIES
}
data {
  int n_coordinates;
  int<lower=0, upper=1> in_stan;
  int<lower=0, upper=1> stress_given;
  int<lower=1> n;
  vector[n] strain;
  matrix[3, 2] bounds;
  vector[n + 11] reference;
  vector[7] by_step;
  vector[2] by_middle;
  matrix[3, n_all_places()] by_fabric;
  matrix[2, n_all_places()] by_factor;
}
parameters {
  // u_1 and ln of its deviation, ln of the exponent ratio and of grain sizes; u_2, amplitude;
  // -ln F; strengths; ln of weights.
  vector[n_coordinates] coordinate;
}
model {
  vector[2] solved = coordinate[5 : 6];
  vector[n] strength = segment(coordinate, 8, n);
  vector[n] weight = exp(tail(coordinate, n));
  vector[n + 2] asked = append_row([exp(coordinate[3]), coordinate[4]]', strength);
  vector[n] left = col(rest_of_strength(coordinate[1], asked, strain, bounds), 1);
  vector[n_all_places()] place
    = col(numbers_at(quantile_places(), [coordinate[1], exp(coordinate[2])]'), 1);
  if (in_stan) {
    TARGET_IN_STAN
  } else {
    TARGET
  }
}
"""

TARGET = """
    target += dot_product(by_middle, middle_grain_strain(asked, reference, strain, weight,
                                                         stress_given, bounds));
    target += dot_product(by_step, fabric_step(solved, left, strain, weight, stress_given,
                                               bounds));
    target += sum(by_fabric .* fabric_along_grain_strain(place, asked, reference, strain, weight,
                                                         stress_given, bounds));
    target += sum(by_factor .* factor_along_fabric_strain(place, coordinate[7], left, strain,
                                                          weight, stress_given, bounds));
"""

N_PINS = 5


def in_stan(text: str) -> str:
    """Call the forms in Stan in place of those in C++."""
    return re.sub(rf"\b({'|'.join(FORMS)})\(", r"\1_in_stan(", text)


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program with both forms of the functions."""
    folder = stan_directory() / "charts" / "valley"
    steps = (folder / "least_squares.stan").read_text()
    solve = steps[steps.index("vector solve_fabric_factor(") :]
    bodies = [(folder / f"{name}.stan").read_text() for name in FORMS]
    bodies.insert(FORMS.index("fabric_step") + 1, solve[: solve.index("\n}\n") + 3])
    text = "".join(map(in_stan, bodies)).replace("solve_fabric_factor(", "factor_in_stan(")
    file = tmp_path_factory.mktemp("steps") / "valley_steps.stan"
    file.write_text(
        PROGRAM.replace("BODIES", text)
        .replace("TARGET_IN_STAN", in_stan(TARGET))
        .replace("TARGET", TARGET)
    )
    assert load_program(file).has_cpp
    return file


@pytest.mark.parametrize("stress_given", [0, 1])
@pytest.mark.parametrize("seed", range(4))
def test_solutions_in_cpp_are_those_in_stan(
    seed: int, stress_given: int, source: Path, tmp_path: Path
) -> None:
    rng = np.random.default_rng(seed)
    strength = np.sort(rng.normal(15, 0.2, N_PINS))[::-1]
    coordinate = np.concatenate(
        [
            [rng.normal(), rng.normal(-1, 0.5), rng.normal(-2, 0.5), rng.normal(-1, 0.5)],
            [rng.normal(), rng.uniform(0.1, 0.8), rng.uniform(0.1, 0.6)],
            strength,
            rng.normal(5, 1, N_PINS),
        ]
    )
    data: StanData = {
        "n_coordinates": coordinate.size,
        "stress_given": stress_given,
        "n": N_PINS,
        "strain": np.linspace(0.01, 0.2, N_PINS).tolist(),
        "bounds": [[0.005, 0.1], [0.01, 0.5], [0.2, 1.0]],
        "reference": np.concatenate(
            [
                [rng.normal(), rng.normal(), rng.uniform(0.1, 0.6), 15, 0, 0, 0.3, 0, 1],
                [0.2, -0.8],
                strength + rng.normal(0, 0.05, N_PINS),
            ]
        ).tolist(),
        "by_step": (rng.normal(size=7) / [1, 1, 1e3, 1e3, 1e3, 1e1, 1e2]).tolist(),
        "by_middle": rng.normal(size=2).tolist(),
        "by_fabric": rng.normal(size=(3, 13)).tolist(),
        "by_factor": rng.normal(size=(2, 13)).tolist(),
    }
    cpp, stan = (
        program_with(source, {**data, "in_stan": form}, tmp_path / str(form)).at(
            {"coordinate": coordinate.tolist()}
        )
        for form in (0, 1)
    )
    assert cpp.log_density == pytest.approx(stan.log_density, rel=1e-9)
    limit = 1e-6 * np.abs(stan.gradient).max()
    assert cpp.gradient == pytest.approx(stan.gradient, rel=1e-6, abs=limit)
    assert np.all(stan.gradient != 0)
