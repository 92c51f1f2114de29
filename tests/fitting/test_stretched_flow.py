"""Flow rates that data hardly see are stretched; the posterior stays the same."""

from collections.abc import Iterator, Mapping
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import pytest
from charts_at_modes import chart_at_mode
from conftest import search_little
from history_twins import TRUTH, history_twin
from scipy.optimize import brentq

from pyburgers.cmdstan.program import Density
from pyburgers.fitting.charts_at_modes import ChosenChart
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import density_of
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.priors import default_priors

ROOT = Path(__file__).parents[2]

SLOW = MappingProxyType({**TRUTH, "activation_enthalpy": TRUTH["activation_enthalpy"] + 2e4})
"""A dashpot slower by nine e-folds."""


def relaxation(values: Mapping[str, float]) -> Problem:
    test = history_twin("relaxation", 20, values=values)
    return problem_of([test], default_priors(test.material))


def elastic_rise() -> Problem:
    """The start of a curve, in which nothing flows: its strength is known from below alone."""
    curve = load_constant_rate(ROOT / "data" / "ice" / "PIL40.toml")
    start = replace(curve, strain=curve.strain[:15], stress=curve.stress[:15])
    return problem_of([start], default_priors(curve.material))


@pytest.fixture(scope="module", params=["relaxation", "elastic rise"])
def slow(request: pytest.FixtureRequest, programs: None) -> Problem:
    return relaxation(SLOW) if request.param == "relaxation" else elastic_rise()


def density_in_plain(problem: Problem) -> Density:
    return density_of(problem, SolverOptions())


def chart_of(problem: Problem, wanted: str = "auto") -> ChosenChart:
    return chart_at_mode(problem, dict(density_in_plain(problem).data), wanted=wanted)


@pytest.fixture(scope="module", autouse=True)
def _little_search() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        search_little(patch)
        yield


@pytest.fixture(scope="module")
def stretched(slow: Problem) -> ChosenChart:
    return chart_of(slow)


def test_the_run_says_so_and_starts_at_the_same_mode(slow: Problem, stretched: ChosenChart) -> None:
    plain = chart_of(slow, "plain")
    assert (stretched.name, plain.name, plain.reason) == ("plain", "plain", "asked for")
    assert "the flow rate is stretched" in stretched.reason
    there, here = (
        density_in_plain(slow).with_data(one.block).variables_at(one.centre)["parameter"]
        for one in (plain, stretched)
        if one.centre is not None
    )
    np.testing.assert_allclose(here, there, rtol=1e-6)


@pytest.mark.parametrize("flow_coordinate", [-2.0, 0.0, 0.8, 3.0])
def test_the_density_is_that_of_the_map(
    flow_coordinate: float, slow: Problem, stretched: ChosenChart
) -> None:
    """Below, near and above the rate that data can just tell from none."""
    (coordinates,) = slow.coordinates
    assert coordinates.replaced_parameter is not None
    flow = coordinates.parameters.index(coordinates.replaced_parameter)
    ((log_seen, at_mode, width, exponent),) = stretched.block["stretched_flow_reference"]
    shift, scale = (exponent * one[flow] for one in (coordinates.shift, coordinates.scale))
    assert stretched.centre is not None
    place = stretched.centre + 0.02 * np.random.default_rng(2).standard_normal(
        stretched.centre.size
    )
    place[flow] = flow_coordinate
    log_rate = brentq(lambda one: np.exp(one) + one / width - flow_coordinate, -100, 10, xtol=1e-14)
    by_rate, by_log_rate = np.transpose(stretched.block["stretched_flow_slope"])
    plain = place + by_rate * (np.exp(log_rate) - at_mode) + by_log_rate * log_rate
    plain[flow] = (log_seen + log_rate - shift) / scale
    density = density_in_plain(slow)
    slope = (np.exp(log_rate) + 1 / width) * abs(scale)
    expected = density.at(plain[np.newaxis])[0] - np.log(slope)
    (found,) = density.with_data(stretched.block).at(place[np.newaxis])
    assert found == pytest.approx(expected, rel=1e-9)


def test_a_flow_that_data_see_stays_as_it_is(programs: None) -> None:
    assert "stretched" not in chart_of(relaxation(TRUTH)).reason
