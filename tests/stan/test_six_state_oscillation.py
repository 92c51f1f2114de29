"""The program for oscillating tests against the paper's form: the same likelihood."""

import json
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE, resolved_priors
from log_density import Program
from stan_data import one_test_data

from pyburgers.cmdstan.program import compile_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.kinds.forced_oscillation.experiment import (
    load_forced_oscillation,
    with_background,
    with_known_strain,
)
from pyburgers.kinds.forced_oscillation.preparation import Background
from pyburgers.kinds.problem import plain_coordinates
from pyburgers.kinds.program_data import solve
from pyburgers.kinds.stan_data import REFERENCE_SOLVER
from pyburgers.model.priors import PriorSet

pytestmark = pytest.mark.usefixtures("programs")

TWIN = ICE.parent / "olivine" / "olivine_twin.toml"

ELSEWHERE = {
    "kelvin_modulus": 1.2,
    "kelvin_viscosity": 0.7,
    "stress_exponent": 0.9,
    "grain_size_exponent": 1.3,
    "critical_strain_grain_size": 0.4,
}
"""Factors on the true parameters."""


def log_jacobian_of_bounds(priors: PriorSet, values: dict[str, float]) -> float:
    """Stan's own transforms of parameters declared within bounds."""
    total = 0.0
    for name in priors.free:
        low, high, value = priors[name].lower, priors[name].upper, values[name]
        if np.isfinite(low) and np.isfinite(high):
            total += np.log((value - low) * (high - value) / (high - low))
        elif np.isfinite(low):
            total += np.log(value - low)
    return total


@pytest.mark.parametrize("background", ["removed", "kept"])
@pytest.mark.parametrize("factors", [{}, ELSEWHERE], ids=["truth", "elsewhere"])
def test_both_forms_have_the_same_likelihood(
    background: Background, factors: dict[str, float], tmp_path: Path
) -> None:
    experiment = with_known_strain(with_background(load_forced_oscillation(TWIN), background))
    assert experiment.true_parameters is not None
    values = {name: v * factors.get(name, 1.0) for name, v in experiment.true_parameters.items()}
    priors = resolved_priors(experiment)
    data = one_test_data(experiment, priors, solver=REFERENCE_SOLVER)
    data_file = tmp_path / "data.json"
    data_file.write_text(json.dumps(data), encoding="utf-8")
    (log_rate,) = solve(experiment, values, experiment.prepared.time[:1], solver=REFERENCE_SOLVER)[
        "log_reference"
    ]
    coordinate = plain_coordinates(experiment, priors).at(
        {**values, "reference_flow_rate": float(np.exp(log_rate))}
    )

    def columns(program: str, position: dict[str, object]) -> dict[str, float]:
        executable = compile_program(stan_directory() / program)
        free = np.ones(len(priors.free))
        found = Program(executable, data_file, tmp_path, lambda _: free, free).columns_at
        return dict(found(position))

    reduced = columns("forced_oscillation.stan", {"coordinate": coordinate.tolist()})
    paper = columns(
        "reference/six_state_oscillation.stan", {name: values[name] for name in priors.free}
    )
    assert paper["lprior"] == pytest.approx(reduced["lprior"], rel=1e-9)
    likelihood = reduced["lp__"] - reduced["lprior"] - reduced["log_jacobian"]
    of_paper = paper["lp__"] - paper["lprior"] - log_jacobian_of_bounds(priors, values)
    # The paper's form knows nothing of the noise that went with the trend.
    taken = data["n_trend"][0] * (np.log(values["stress_noise"]) + 0.5 * np.log(2.0 * np.pi))
    assert of_paper + taken == pytest.approx(likelihood, rel=1e-6)
