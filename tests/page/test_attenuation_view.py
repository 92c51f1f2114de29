"""Figures of a fit of a table of attenuation."""

from dataclasses import dataclass, replace

import numpy as np
import pytest
import xarray as xr
from kind_examples import EXAMPLES
from matplotlib.axes import Axes
from matplotlib.container import ErrorbarContainer

from pyburgers.common.array_types import FloatArray
from pyburgers.drawing.views.attenuation import arrhenius, master_curves, residuals
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.model.priors import PriorSet, default_priors
from pyburgers.model.variants import with_variant

SHAPE = (2, 1000)


@dataclass(frozen=True)
class Drawn:
    """A test with draws of readings whose errors are known."""

    experiment: AttenuationExperiment
    priors: PriorSet
    posterior: xr.DataTree
    error: FloatArray


@pytest.fixture(scope="module")
def fit() -> Drawn:
    """Readings a tenth of their errors above the model, of which some are upper limits."""
    read: AttenuationExperiment = EXAMPLES["attenuation"].load("A1802")
    readings = replace(read.readings, modulus_error=0.02 * read.readings.modulus)
    experiment = replace(read, readings=readings)
    rng = np.random.default_rng(1)
    n_points, places = experiment.n_points, np.unique(experiment.position)
    error = rng.uniform(0.05, 0.9, n_points)
    response = np.broadcast_to(experiment.response - 0.1 * error, (*SHAPE, n_points))
    at_points = {
        "model_response": response,
        "posterior_predictive": response + error * rng.normal(size=(*SHAPE, n_points)),
    }
    place = np.searchsorted(np.sort(experiment.position), places)
    along = response[..., np.argsort(experiment.position)][..., place]
    names = ("log_reading", "log_relaxation_time", "log_maxwell_time")
    predictions = dict.fromkeys(names, (("chain", "draw", "place"), along))
    tree = {
        name: xr.Dataset({"log_reading": (("chain", "draw", "point"), values)})
        for name, values in at_points.items()
    }
    tree["predictions"] = xr.Dataset(predictions, {"place": places})
    return Drawn(experiment, default_priors("olivine"), xr.DataTree.from_dict(tree), error)


@pytest.mark.parametrize(
    ("law", "times"), [("linear", ["Kelvin part"]), ("extended", ["Kelvin part"]), ("andrade", [])]
)
def test_a_law_without_longest_time_has_no_relaxation_time(
    fit: Drawn, law: str, times: list[str]
) -> None:
    priors = with_variant(fit.priors, fit.experiment, {"kelvin": law})
    drawn = {line.get_label() for line in arrhenius(replace(fit, priors=priors)).axes[0].lines}
    assert drawn == {*times, "Maxwell time of the dashpot"}


def test_a_line_of_relaxation_times_is_of_one_stress(fit: Drawn) -> None:
    """The dashpot's time depends on it, so that a line through two would have a false slope."""
    conditions = fit.experiment.conditions
    hot = conditions.temperature > np.median(conditions.temperature)
    of_two = replace(conditions, median_stress=np.where(hot, 2e6, 1e6))
    experiment = replace(fit.experiment, conditions=of_two)
    lines = arrhenius(replace(fit, experiment=experiment)).axes[0].lines
    temperatures = [set(np.round(1e4 / np.asarray(line.get_xdata()), 3)) for line in lines]
    assert len(lines) == 4
    assert all(min(one) > max(other) for one, other in (temperatures[1::-1], temperatures[3:1:-1]))
    named = {str(line.get_label()).split(", ")[1] for line in lines}
    assert {name.split(" ")[0] for name in named} == {"1", "2"}


def test_residuals_are_over_the_error_of_each_reading_and_leave_limits_out(fit: Drawn) -> None:
    figure = residuals(fit)
    for axes, count in zip(
        figure.axes, ((~fit.experiment.readings.is_limit).sum(), 70), strict=True
    ):
        drawn = [line for line in axes.lines if line.get_marker() == "o"]
        shown = np.concatenate([np.asarray(line.get_ydata()) for line in drawn])
        assert shown.size == count
        np.testing.assert_allclose(shown, 0.1, rtol=0.1)


def half_lengths(axes: Axes) -> FloatArray:
    """Of the bars of readings, in rising order."""
    whole = [one for one in axes.containers if isinstance(one, ErrorbarContainer)]
    ends = [path.vertices[:, 1] for one in whole for bar in one[2] for path in bar.get_paths()]
    return np.sort(np.ptp(ends, axis=1)) / 2


def test_stated_errors_are_bars_but_for_limits(fit: Drawn) -> None:
    readings = fit.experiment.readings
    upper, lower = master_curves(fit).axes
    error = np.where(readings.is_limit, 0.0, readings.tan_delta_error)
    assert error.max() > 0
    np.testing.assert_allclose(half_lengths(upper), np.sort(error), atol=1e-12)
    np.testing.assert_allclose(half_lengths(lower), np.sort(readings.modulus_error) * 1e-9)
