"""The program against the paper's form: log density and gradient in six and in two states."""

import json
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import oracle
import pytest
from conftest import ICE, resolved_priors
from log_density import Program, assert_gradient_is_slope
from oracle import GAS_CONSTANT
from scipy import stats
from scipy.special import logit
from stan_data import one_test_data, parameter_in

from pyburgers.cmdstan.program import compile_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.kinds.constant_rate.experiment import (
    ConstantRateExperiment,
    RateSegment,
    load_constant_rate,
)
from pyburgers.kinds.coordinates import REFERENCE_STRESS, PlainCoordinates
from pyburgers.kinds.problem import plain_coordinates
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.parameters import PARAMETERS
from pyburgers.model.priors import PriorSet

FloatArray = npt.NDArray[np.float64]
ComplexArray = npt.NDArray[np.complex128]
MakePair = Callable[[ConstantRateExperiment], "Pair"]
pytestmark = pytest.mark.usefixtures("programs")


@dataclass(frozen=True)
class Pair:
    """Both programs with the same data."""

    experiment: ConstantRateExperiment
    priors: PriorSet
    coordinates: PlainCoordinates
    reduced: Program
    six_state: Program


@pytest.fixture
def make_pair(tmp_path: Path) -> MakePair:
    def make(experiment: ConstantRateExperiment) -> Pair:
        priors = resolved_priors(experiment)
        data = one_test_data(
            experiment, priors, solver=SolverOptions(tolerance=1e-10, max_num_steps=1_000_000)
        )
        data_file = tmp_path / "data.json"
        data_file.write_text(json.dumps(data), encoding="utf-8")
        size = len(PARAMETERS)

        def position(columns: Mapping[str, float]) -> FloatArray:
            return np.array([columns[f"coordinate.{k}"] for k in range(1, size + 1)])

        def unconstrained(columns: Mapping[str, float]) -> FloatArray:
            return np.array([_unconstrained(priors, p.name, columns[p.name]) for p in PARAMETERS])

        # The six-state program samples unbounded parameters in SI.
        scale = [
            1.0 if np.isfinite(priors[p.name].lower) else priors[p.name].scale for p in PARAMETERS
        ]
        return Pair(
            experiment,
            priors,
            plain_coordinates(experiment, priors),
            Program(
                compile_program(stan_directory() / "constant_rate.stan"),
                data_file,
                tmp_path,
                position,
                np.ones(size),
            ),
            Program(
                compile_program(stan_directory() / "reference" / "six_state.stan"),
                data_file,
                tmp_path,
                unconstrained,
                np.array(scale),
            ),
        )

    return make


def _unconstrained(priors: PriorSet, name: str, value: float) -> float:
    """Stan's own transform of a bounded parameter."""
    prior = priors[name]
    if np.isinf(prior.lower):
        return value
    if np.isinf(prior.upper):
        return float(np.log(value - prior.lower))
    return float(logit((value - prior.lower) / (prior.upper - prior.lower)))


def six_state_position(pair: Pair, coordinate: ComplexArray) -> tuple[ComplexArray, complex]:
    """Coordinates of the six-state program at plain ones, and ln of the map's determinant.

    Written out for ice, where all parameters are free and ln S_0 stands for Q_M. Takes complex
    numbers, so that a step along the imaginary axis gives exact derivatives.
    """
    value: dict[str, complex] = {}
    position: dict[str, complex] = {}
    log_determinant: complex = 0.0
    plain = pair.coordinates
    for k, name in enumerate(plain.quantities):
        u, low, high = coordinate[k], plain.lower[k], plain.upper[k]
        if np.isinf(low):
            value[name] = position[name] = plain.shift[k] + plain.scale[k] * u
            log_determinant += np.log(plain.scale[k])
        elif np.isinf(high):
            value[name] = low + plain.scale[k] * np.exp(u)
            position[name] = np.log(plain.scale[k]) + u
        else:
            value[name] = low + (high - low) / (1 + np.exp(-u))
            position[name] = u
    inverse_rt = 1 / (GAS_CONSTANT * pair.experiment.temperature)
    position["activation_enthalpy"] = (
        np.log(pair.experiment.segments[0].strain_rate)
        + value["grain_size_exponent"] * np.log(pair.experiment.initial_grain_size)
        - value["stress_exponent"] * value[REFERENCE_STRESS]
    ) / (value["beta"] - inverse_rt)
    log_determinant += np.log(value["stress_exponent"]) - np.log(inverse_rt - value["beta"])
    return np.array([position[p.name] for p in PARAMETERS]), log_determinant


def log_reference_stress(experiment: ConstantRateExperiment, values: Mapping[str, float]) -> float:
    log_factor = values["activation_enthalpy"] * (
        values["beta"] - 1 / (GAS_CONSTANT * experiment.temperature)
    )
    log_grain_size = np.log(experiment.initial_grain_size)
    return (
        float(
            np.log(experiment.segments[0].strain_rate)
            + values["grain_size_exponent"] * log_grain_size
            - log_factor
        )
        / values["stress_exponent"]
    )


def prior_draws(pair: Pair, seed: int, number: int) -> list[dict[str, float]]:
    rng = np.random.default_rng(seed)
    return [
        {name: prior.sample(rng) for name, prior in pair.priors.priors.items()}
        for _ in range(number)
    ]


def assert_programs_agree(pair: Pair, points: Sequence[Mapping[str, float]]) -> None:
    assert pair.coordinates.replaced_parameter == "activation_enthalpy"
    for values in points:
        reference_stress = np.exp(log_reference_stress(pair.experiment, values))
        coordinate = pair.coordinates.at({**values, REFERENCE_STRESS: reference_stress})
        reduced = pair.reduced.at({"coordinate": coordinate.tolist()})
        paper = pair.six_state.at(values)

        np.testing.assert_allclose(
            [parameter_in(reduced.columns, p.name) for p in PARAMETERS],
            list(values.values()),
            rtol=1e-9,
        )
        _, log_determinant = six_state_position(pair, coordinate.astype(np.complex128))
        assert reduced.log_density == pytest.approx(
            paper.log_density + log_determinant.real, rel=1e-6
        )

        jacobian, slope = np.empty((coordinate.size,) * 2), np.empty(coordinate.size)
        for k in range(coordinate.size):
            shifted = coordinate.astype(np.complex128)
            shifted[k] += 1e-30j
            position, logarithm = six_state_position(pair, shifted)
            jacobian[:, k], slope[k] = position.imag / 1e-30, logarithm.imag / 1e-30
        terms = jacobian * paper.gradient[:, None]
        # Relative to the largest of the terms that make up a component.
        size = np.abs(terms).max(axis=0)
        deviation = np.abs(reduced.gradient - terms.sum(axis=0) - slope) / size
        assert deviation.max() < 1e-6


def test_programs_agree_at_prior_draws(make_pair: MakePair) -> None:
    pair = make_pair(load_constant_rate(ICE / "PIL72.toml"))
    assert_programs_agree(pair, prior_draws(pair, seed=3, number=10))


def test_density_with_rate_steps(make_pair: MakePair) -> None:
    """Against an independent solver, since the six states in SI are too stiff to restart."""
    segments = ((0.0, 8e-5), (0.04, 2e-5), (0.1, 3e-4))
    stepped = replace(
        load_constant_rate(ICE / "PIL72.toml"),
        segments=tuple(RateSegment(start, rate) for start, rate in segments),
    )
    pair = make_pair(stepped)
    truth = stepped.true_parameters
    assert truth is not None
    for draw in prior_draws(pair, seed=4, number=3):
        values = {name: truth[name] + 0.1 * (draw[name] - truth[name]) for name in draw}
        stress = oracle.six_states(
            values, stepped.temperature, stepped.initial_grain_size, segments, stepped.strain
        )[0]
        residual = stats.norm.logpdf(stepped.stress, stress, values["stress_noise"])
        prior = sum(
            prior.distribution().logpdf(values[name]) for name, prior in pair.priors.priors.items()
        )
        reference_stress = np.exp(log_reference_stress(stepped, values))
        coordinate = pair.coordinates.at({**values, REFERENCE_STRESS: reference_stress})
        columns = pair.reduced.columns_at({"coordinate": coordinate.tolist()})
        expected = residual.sum() + prior + columns["log_jacobian"]
        assert columns["lp__"] == pytest.approx(expected, rel=1e-6)
        assert_gradient_is_slope(pair.reduced, coordinate)
