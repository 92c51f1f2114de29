"""Steps of the valley coordinates: those in C++ beside those in Stan."""

from pathlib import Path

import numpy as np
import pytest
from log_density import program_with

from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.kinds.stan_data import StanData

PROGRAM = """
functions {
#include charts/valley/pins.stan
#include charts/valley/least_squares.stan
BODIES
}
data {
  int n_coordinates;
  int<lower=0, upper=1> in_stan;
  int<lower=0, upper=1> stress_given;
  int<lower=1> n;
  vector[n] strain;
  matrix[3, 2] bounds;
  vector[7] by_step;
  matrix[n, 2] by_rest;
}
parameters {
  // u_1, ln of exponent ratio and of grain sizes; u_2, amplitude; strengths; ln of weights.
  vector[n_coordinates] coordinate;
}
model {
  vector[2] solved = coordinate[4 : 5];
  vector[n] strength = segment(coordinate, 6, n);
  vector[n] weight = exp(tail(coordinate, n));
  vector[n + 2] asked = append_row([exp(coordinate[2]), coordinate[3]]', strength);
  matrix[n, 2] rest = in_stan
                      ? rest_of_strength_in_stan(coordinate[1], asked, strain, bounds)
                      : rest_of_strength(coordinate[1], asked, strain, bounds);
  vector[n] left = col(rest, 1);
  vector[7] step = in_stan
                   ? fabric_step_in_stan(solved, left, strain, weight, stress_given, bounds)
                   : fabric_step(solved, left, strain, weight, stress_given, bounds);
  target += dot_product(by_step, step) + sum(by_rest .* rest);
}
"""

N_PINS = 5


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A program with both forms of the functions."""
    names = ("rest_of_strength", "fabric_step")
    bodies = [
        (stan_directory() / "charts" / "valley" / f"{name}.stan")
        .read_text()
        .replace(f" {name}(", f" {name}_in_stan(")
        for name in names
    ]
    file = tmp_path_factory.mktemp("steps") / "valley_steps.stan"
    file.write_text(PROGRAM.replace("BODIES", "".join(bodies)))
    return file


@pytest.mark.parametrize("stress_given", [0, 1])
@pytest.mark.parametrize("seed", range(3))
def test_steps_in_cpp_are_those_in_stan(
    seed: int, stress_given: int, source: Path, tmp_path: Path
) -> None:
    rng = np.random.default_rng(seed)
    coordinate = np.concatenate(
        [
            [rng.normal(), rng.normal(-2, 0.5), rng.normal(-1, 0.5)],
            [rng.normal(), rng.uniform(0.1, 0.8)],
            np.sort(rng.normal(15, 0.2, N_PINS))[::-1],
            rng.normal(5, 1, N_PINS),
        ]
    )
    data: StanData = {
        "n_coordinates": coordinate.size,
        "stress_given": stress_given,
        "n": N_PINS,
        "strain": np.linspace(0.01, 0.2, N_PINS).tolist(),
        "bounds": [[0.005, 0.1], [0.01, 0.5], [0.2, 1.0]],
        "by_step": (rng.normal(size=7) / [1, 1, 1e3, 1e3, 1e3, 1e1, 1e2]).tolist(),
        "by_rest": rng.normal(size=(N_PINS, 2)).tolist(),
    }
    in_cpp, in_stan = (
        program_with(source, {**data, "in_stan": form}, tmp_path / str(form)).at(
            {"coordinate": coordinate.tolist()}
        )
        for form in (0, 1)
    )
    assert in_cpp.log_density == pytest.approx(in_stan.log_density, rel=1e-9)
    limit = 1e-6 * np.abs(in_stan.gradient).max()
    assert in_cpp.gradient == pytest.approx(in_stan.gradient, rel=1e-6, abs=limit)
    assert np.all(in_stan.gradient != 0)
