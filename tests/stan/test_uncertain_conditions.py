"""Errors of temperature and load cell: what they do to a solution, density and coordinates."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE
from history_twins import PIEZOMETER
from jacobians import assert_jacobian_is_that_of_the_map, parameters_named
from kind_examples import short_twin
from log_density import Program, assert_gradient_is_slope, program_with
from scipy import stats
from stan_data import parameters_in
from truth_as_mode import problem_at_truth

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.experiment import Experiment, UncertainCondition
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import chart_block, program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.pooling import pooling_of
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import with_variant

pytestmark = pytest.mark.usefixtures("programs")

TIGHT = SolverOptions(tolerance=1e-12, max_num_steps=1_000_000)
OLIVINE = ICE.parent / "olivine" / "olivine_twin.toml"
TEMPERATURE, CALIBRATION = "temperature_error", "stress_calibration_error"
SD = {ICE / "PIL40.toml": (2.0, 0.02), OLIVINE: (50.0, 0.02)}
SOURCES = tuple(SD)


def short(source: Path) -> Experiment:
    """A curve, or the first cycles of a record: the density is asked for a hundred times."""
    return short_twin("kept") if source == OLIVINE else load_experiment(source)


def uncertain(source: Path) -> Experiment:
    temperature, calibration = SD[source]
    return replace(
        short(source),
        uncertain=(
            UncertainCondition(TEMPERATURE, temperature, "furnace"),
            UncertainCondition(CALIBRATION, calibration, "cell"),
        ),
    )


@pytest.mark.parametrize("source", SOURCES)
def test_an_error_of_the_temperature_is_another_temperature(source: Path) -> None:
    experiment = load_experiment(source)
    truth, error = dict(experiment.true_parameters or {}), SD[source][0]
    # The Kelvin viscosity is thermally activated, too.
    truth |= {"kelvin_activation_enthalpy": 3e4, "kelvin_reference_temperature": 300.0}
    at = experiment.position[::7]
    found = simulate(experiment, {**truth, TEMPERATURE: error}, at=at)
    hotter = replace(experiment, temperature=experiment.temperature + error)
    expected = simulate(hotter, truth, at=at)
    for column in found:
        np.testing.assert_allclose(found[column], expected[column], rtol=1e-12, err_msg=column)
    assert found.attrs == pytest.approx(expected.attrs, rel=1e-12)
    assert np.ptp(found["stress_Pa"] - simulate(experiment, truth, at=at)["stress_Pa"]) > 1e4


LAWS: Mapping[str, Mapping[str, float]] = {
    "of the paper": {},
    "power-law Kelvin element": {"kelvin_stress_exponent": 2.5, "kelvin_reference_stress": 2e6},
    "hyperbolic sine": {"breakdown_stress": 4e6},
    "threshold stress": {"threshold_stress": 1e6},
    "piezometer": PIEZOMETER,
}


@pytest.mark.parametrize("law", LAWS)
def test_a_load_cell_reads_in_proportion(law: str) -> None:
    """Where a law has a stress of its own, too."""
    experiment = load_experiment(ICE / "PIL40.toml")
    truth, at = {**(experiment.true_parameters or {}), **LAWS[law]}, experiment.position[::7]
    found = simulate(experiment, {**truth, CALIBRATION: 0.03}, at=at)
    right = simulate(experiment, truth, at=at)
    right["stress_Pa"] *= 1.03
    for column in found:
        # The solver's unit of stresses is a reading, so that it takes other steps.
        size = np.abs(right[column]).max()
        np.testing.assert_allclose(
            found[column], right[column], rtol=0, atol=1e-8 * size, err_msg=column
        )
    assert found.attrs == right.attrs  # of the stress itself


def test_the_bias_of_an_oscillation_is_a_reading_too() -> None:
    experiment = load_forced_oscillation(OLIVINE)
    truth, at = dict(experiment.true_parameters or {}), experiment.position[::7]
    found = simulate(experiment, {**truth, CALIBRATION: 0.03}, at=at)
    expected = simulate(starting_at(experiment, 1 / 1.03), truth, at=at)
    np.testing.assert_allclose(found["stress_Pa"], 1.03 * expected["stress_Pa"], rtol=1e-7)
    np.testing.assert_allclose(found["grain_size_m"], expected["grain_size_m"], rtol=1e-6)
    np.testing.assert_allclose(found["kelvin_strain"], expected["kelvin_strain"], rtol=1e-6)


def starting_at(experiment: OscillationExperiment, factor: float) -> OscillationExperiment:
    """The record with the stress where the model starts changed by a factor."""
    prepared = experiment.prepared
    return replace(
        experiment, prepared=replace(prepared, start_stress=factor * prepared.start_stress)
    )


def program_in(
    problem: Problem, system: str, folder: Path, solver: SolverOptions = TIGHT
) -> tuple[Program, FloatArray]:
    """The program in plain coordinates or in its chart, and the coordinates of the truths."""
    data = program_data(problem, solver=solver)
    references: list[object] = []
    centre, chart = np.zeros(problem.layout.size), problem.likelihood.chart
    for one, places in zip(problem.alone(), problem.layout.position, strict=True):
        test = problem_at_truth(one, SolverOptions())
        centre[places] = test.mode.coordinate
        if system != "plain":  # whatever the chart, the posterior is one
            reference, centre[places] = chart.reference(test)
            references.append(chart.rescaled(reference, test, 0.04 * np.eye(len(places))))
    data |= chart_block(problem, references)
    return program_with(problem.likelihood.program, data, folder), centre


@pytest.mark.parametrize("source", SOURCES)
def test_the_density_is_the_same_in_both_coordinates(source: Path, tmp_path: Path) -> None:
    """Less the Jacobian's logarithm, and it holds the priors of the errors."""
    problem = problem_of([uncertain(source)], default_priors(load_experiment(source).material))
    (experiment,), (coordinates,), (priors,) = (
        problem.experiments,
        problem.coordinates,
        problem.priors,
    )
    # At 1e-12 the last digit of a number changes steps, and the density by 1e-9 of it.
    solver = replace(TIGHT, tolerance=1e-13)
    plain, _ = program_in(problem, "plain", tmp_path / "plain", solver)
    chart, centre = program_in(problem, "chart", tmp_path / "chart", solver)
    rng = np.random.default_rng(5)
    name = problem.likelihood.reference.name
    for width in (0.1, 0.3, 0.6):
        point = centre + width * rng.standard_normal(centre.size)
        there = chart.values_at(point)
        values = parameters_in(there)
        assert values[TEMPERATURE] != 0
        assert values[CALIBRATION] != 0
        prior = sum(priors[free].distribution().logpdf(values[free]) for free in priors.free)
        assert there["lprior"] == pytest.approx(prior, rel=1e-8)
        same = coordinates.at({**values, name: float(np.exp(there["log_reference.1"]))})
        same = np.append(same, point[point.size - experiment.n_driving_errors :])
        here = plain.values_at(same)
        assert parameters_in(here) == pytest.approx(values, rel=1e-9)
        densities = [one["log_density"] - one["log_jacobian"] for one in (here, there)]
        assert densities[0] == pytest.approx(densities[1], rel=1e-9)


@pytest.mark.parametrize("system", ["plain", "chart"])
@pytest.mark.parametrize("source", SOURCES)
def test_the_jacobian_is_that_of_the_map(source: Path, system: str, tmp_path: Path) -> None:
    problem = problem_of([uncertain(source)], default_priors(load_experiment(source).material))
    # The map knows of no solution.
    program, centre = program_in(problem, system, tmp_path, SolverOptions())
    start = centre + 0.2 * np.random.default_rng(7).standard_normal(centre.size)
    assert_jacobian_is_that_of_the_map(program, start, parameters_named(problem.free))


@pytest.mark.parametrize("kelvin", ["linear", "power_law"])
@pytest.mark.parametrize("source", SOURCES)
def test_the_gradient_is_the_slope_of_the_density(
    source: Path, kelvin: str, tmp_path: Path
) -> None:
    experiment = uncertain(source)
    priors = with_variant(default_priors(experiment.material), experiment, {"kelvin": kelvin})
    if kelvin == "power_law":
        truth = {
            **(experiment.true_parameters or {}),
            "kelvin_stress_exponent": 2.0,
            "kelvin_reference_stress": priors["kelvin_reference_stress"].location,
        }
        experiment = replace(experiment, true_parameters=truth)
    problem = problem_of([experiment], priors)
    program, centre = program_in(problem, "chart", tmp_path)
    point = centre + 0.1 * np.random.default_rng(8).standard_normal(centre.size)
    names = (TEMPERATURE, CALIBRATION, "stress_exponent")
    assert_gradient_is_slope(program, point, [problem.layout.names.index(name) for name in names])


def test_tests_of_one_furnace_have_one_value_and_one_prior(tmp_path: Path) -> None:
    """And the density of three tests is that made by hand."""
    conditions = (("big", 2.0), (None, 1.0), ("big", 2.0))
    tests = [
        replace(
            load_experiment(ICE / f"{name}.toml"),
            uncertain=(UncertainCondition(TEMPERATURE, sd, furnace),),
        )
        for name, (furnace, sd) in zip(("PIL40", "PIL72", "PIL105"), conditions, strict=True)
    ]
    pooling = pooling_of({"all": "separate"})
    problem = problem_of(tests, default_priors("ice"), pooling)
    program, centre = program_in(problem, "chart", tmp_path)
    point = centre + 0.2 * np.random.default_rng(9).standard_normal(centre.size)
    columns = program.values_at(point)
    values = [parameters_in(columns, e) for e in (1, 2, 3)]
    errors = [own[TEMPERATURE] for own in values]
    assert errors[0] == errors[2] != errors[1]
    prior = sum(
        priors[name].distribution().logpdf(own[name])
        for own, priors in zip(values, problem.priors, strict=True)
        for name in priors.free
    )
    prior -= stats.norm.logpdf(errors[0], 0, 2.0)  # counted twice
    assert columns["lprior"] == pytest.approx(prior, rel=1e-9)
