"""The point of the flow law that plain coordinates of a loading history hold (hyperbolic sine)."""

from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
from conftest import DUNITE
from halite import LAWS, RECORD, SINE, SINE_HARDENING, halite_priors

from pyburgers.cmdstan.program import load_program
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.files import load_loading_history
from pyburgers.kinds.loading_history.stan_data import strain_scale, stress_scale
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.parameters import PROGRAM_PARAMETERS

FloatArray = npt.NDArray[np.float64]

GAS_CONSTANT = 8.314462618


def few_readings(name: str) -> Problem:
    """The first readings, whose solution takes no time."""
    record = load_loading_history(DUNITE.parent / "halite" / f"{RECORD}.toml")
    priors = halite_priors(record, name)
    few = replace(
        record,
        time=record.time[:3],
        reading=record.reading[:3],
        reading_stage=record.reading_stage[:3],
    )
    return problem_of([few], priors)


def evaluated(problem: Problem, coordinate: FloatArray) -> tuple[dict[str, float], float, float]:
    """Parameters, ln of the reference flow rate, and ln of the Jacobian."""
    data = program_data(problem, solver=SolverOptions(), use_likelihood=False)
    program = load_program(problem.likelihood.program)
    found = program.evaluate(data, {"coordinate": coordinate.tolist()})
    (row,) = found["parameter"]
    values = {p.name: float(value) for p, value in zip(PROGRAM_PARAMETERS, row, strict=True)}
    return values, float(found["log_reference"][0]), float(np.ravel(found["log_jacobian"])[0])


def somewhere(problem: Problem) -> FloatArray:
    return 0.3 * np.random.default_rng(3).standard_normal(problem.layout.size)


@pytest.mark.parametrize("name", LAWS)
def test_it_is_the_rate_of_the_material_that_the_law_is_written_for(name: str) -> None:
    """Hardened by the largest strain with a hyperbolic sine, undeformed with a power law."""
    problem = few_readings(name)
    (test,) = problem.experiments
    assert isinstance(test, HistoryExperiment)
    at = somewhere(problem)
    values, log_rate, _ = evaluated(problem, at)
    stress, n = stress_scale(test), values["stress_exponent"]
    factor = 1.0
    flow_stress = stress
    if name in (SINE, SINE_HARDENING):
        final, critical = (
            values[part] for part in ("steady_state_fabric_factor", "critical_strain_fabric")
        )
        factor = final + (1 - final) * np.exp(-strain_scale(test) / critical)
        limit = values["breakdown_stress"]
        flow_stress = factor * limit * np.sinh(stress / (factor * limit))
    expected = (
        n * np.log(flow_stress / factor)
        - values["grain_size_exponent"] * np.log(test.initial_grain_size)
        + values["activation_enthalpy"] * (values["beta"] - 1 / (GAS_CONSTANT * test.temperature))
    )
    assert log_rate == pytest.approx(expected, rel=1e-9)
    (coordinates,) = problem.coordinates
    sampled = coordinates.quantities.index(problem.likelihood.reference.name)
    assert coordinates.value(sampled, at[sampled]) == pytest.approx(expected, rel=1e-9)


def test_the_jacobian_is_that_of_the_map() -> None:
    problem = few_readings(SINE_HARDENING)
    at, step = somewhere(problem), 1e-3

    def parameters(coordinate: FloatArray) -> FloatArray:
        values, *_ = evaluated(problem, coordinate)
        return np.array([values[name] for name in problem.free])

    scale = np.abs(parameters(at))
    slopes = [
        (parameters(at + shift) - parameters(at - shift)) / (2 * step) / scale
        for shift in step * np.eye(at.size)
    ]
    _, logarithm = np.linalg.slogdet(np.column_stack(slopes))
    _, _, found = evaluated(problem, at)
    assert found == pytest.approx(logarithm + np.log(scale).sum(), abs=1e-4)
