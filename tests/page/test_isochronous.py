"""Isochronous view of creep tests that are fitted together."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from conftest import with_fixed
from history_twins import TRUTH, history_twin
from matplotlib.container import ErrorbarContainer

from pyburgers.drawing.view import views
from pyburgers.drawing.views.creep import isochronous, isochronous_figure
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.forward import simulate_data
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.model.display import STRAIN_FACTOR, STRESS_FACTOR
from pyburgers.model.priors import PriorSet, default_priors
from pyburgers.sampling.options import SamplerOptions

pytestmark = pytest.mark.usefixtures("programs")

LOADS = (3e6, 5e6)


def creep_at(stress: float) -> HistoryExperiment:
    twin = history_twin("creep", 20)
    loaded = replace(
        twin, id=f"creep_{stress / 1e6:g}", stages=(replace(twin.stages[0], value=stress),)
    )
    return simulate_data(loaded, dict(TRUTH), np.random.default_rng(1), source="test")


@pytest.fixture(scope="module")
def joint(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    known = {name: TRUTH[name] for name in default_priors("ice").free if name in TRUTH}
    known = {name: v for name, v in known.items() if name not in ("kelvin_modulus", "stress_noise")}
    return fit(
        [creep_at(stress) for stress in LOADS],
        with_fixed(default_priors("ice"), known),
        out=tmp_path_factory.mktemp("fit") / "run",
        options=SamplerOptions(chains=2, warmup=40, draws=30, seed=4, adapt_delta=0.8),
    )


def test_strains_stand_over_the_loads(joint: Fit) -> None:
    (figure,) = isochronous_figure(list(joint.tests().values()))
    (axes,) = figure.draw().axes
    drawn = [np.asarray(line.get_xydata()) for line in axes.get_lines()]
    over_loads = [points for points in drawn if len(points) == len(LOADS)]
    assert over_loads
    for points in over_loads:
        np.testing.assert_allclose(points[:, 1], STRESS_FACTOR * np.array(LOADS))
    last = creep_at(LOADS[1])
    strain = max(points[:, 0].max() for points in over_loads)
    assert strain == pytest.approx(STRAIN_FACTOR * last.reading[-1], rel=0.1)
    legend = axes.get_legend()
    assert legend is not None
    assert len(legend.get_texts()) == 4
    # One load has no such view, nor have two that differ by as much as one varies.
    fit = joint["creep_3"]
    assert isochronous_figure([fit]) == ()
    assert isochronous_figure([fit, under_series(fit, (0.0, 1.0), (4000.0, 1.02))]) == ()


RAMP = 20.0
"""Seconds; half a percent of the creep of the twin."""


@dataclass(frozen=True)
class UnderSeries:
    """A fit of a test whose load is said to have been a series."""

    experiment: HistoryExperiment
    posterior: xr.DataTree
    priors: PriorSet


def under_series(fit: Fit, *shares_of_load: tuple[float, float]) -> UnderSeries:
    """As if the stress had been, at some times (s), shares of the load, linear in between."""
    test = fit.experiment
    assert isinstance(test, HistoryExperiment)
    (stage,) = test.stages
    knots = tuple((time, share * stage.value) for time, share in shares_of_load)
    series = replace(stage, control="stress_series", value=0.0, knots=knots)
    return UnderSeries(replace(test, stages=(series,)), fit.posterior, fit.priors)


def bars_of(fits: Sequence[FittedTest]) -> dict[str, np.ndarray]:
    """Strains (%) and stresses (MPa) of the lines, by their time."""
    (axes,) = isochronous(fits).axes
    found = {}
    for bars, label in zip(*axes.get_legend_handles_labels(), strict=True):
        assert isinstance(bars, ErrorbarContainer)
        found[label] = np.asarray(bars.lines[0].get_xydata())
    return found


def test_a_series_of_constant_stress_is_a_load(joint: Fit) -> None:
    fits = list(joint.tests().values())
    steady = [under_series(fit, (0.0, 1.0), (4000.0, 1.0)) for fit in fits]
    (figure,) = isochronous_figure(steady)
    assert figure.name == "isochronous"
    as_stages, as_series = bars_of(fits), bars_of(steady)
    assert len(as_stages) == 4
    assert list(as_stages) == list(as_series)
    for label, points in as_stages.items():
        np.testing.assert_allclose(as_series[label], points)


def test_times_count_from_the_end_of_a_short_ramp(joint: Fit) -> None:
    fits = list(joint.tests().values())
    ramped = [under_series(fit, (0.0, 0.0), (RAMP, 1.0), (4000.0, 0.99)) for fit in fits]
    last = list(bars_of(ramped).values())[-1]
    np.testing.assert_allclose(last[:, 1], STRESS_FACTOR * 0.995 * np.array(LOADS))
    first, at_once = (next(iter(bars_of(one).values()))[:, 0] for one in (ramped, fits))
    assert (first > at_once).all()
    # A tenth of the test is no start, and a part of a stage no first load.
    for knots in (
        ((0.0, 0.0), (400.0, 1.0), (4000.0, 1.0)),
        ((0.0, 1.0), (3000.0, 1.0), (4000.0, 0.0)),
    ):
        assert isochronous_figure([under_series(fit, *knots) for fit in fits]) == ()


def test_the_page_of_the_joint_fit_has_it(joint: Fit, tmp_path: Path) -> None:
    isochronous(list(joint.tests().values())).savefig(tmp_path / "view.png")
    figures = views()[joint.problem.likelihood.name].joint_figures(list(joint.tests().values()))
    assert [figure.name for figure in figures] == ["isochronous"]
