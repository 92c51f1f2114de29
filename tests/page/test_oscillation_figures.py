"""Figures of the fit of a forced oscillation test."""

from pathlib import Path

import numpy as np
import pytest
from figure_texts import legend_texts
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from synthetic_fit import make_fit
from synthetic_olivine_fit import make_olivine_fit

from pyburgers.common.draws import central_band
from pyburgers.common.errors import InputError
from pyburgers.drawing.page_parts import FigureRecipe
from pyburgers.drawing.views.forced_oscillation import (
    VIEW,
    amplitude_phase,
    microstructure,
    stress_loop,
    stress_time,
)
from pyburgers.drawing.views.oscillation_response import replicated_response
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment


@pytest.fixture(scope="module", params=["removed", "kept"])
def fit(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Fit:
    path = tmp_path_factory.mktemp("olivine")
    return make_olivine_fit(path, request.param, chains=2, draws=100)


def line(lines: list[Line2D], label: str) -> Line2D:
    (found,) = (drawn for drawn in lines if drawn.get_label() == label)
    return found


def test_residuals_are_in_units_of_the_noise_of_each_reading(fit: Fit) -> None:
    prepared = of_kind(fit.experiment, OscillationExperiment).prepared
    points = line(list(stress_time(fit).axes[1].lines), "data minus predictive median")
    predicted = fit.posterior["model_response"]["stress"].median(("chain", "draw")).to_numpy()
    typical = float(np.sqrt(np.mean(prepared.uncertainty**2)))
    noise = float(fit.posterior["posterior"]["stress_noise"].mean())
    expected = (prepared.stress - predicted) / (noise * prepared.uncertainty / typical)
    np.testing.assert_allclose(np.asarray(points.get_ydata()), expected)
    np.testing.assert_allclose(np.asarray(points.get_xdata()), prepared.time)


def test_the_solid_line_is_the_predictive_median(fit: Fit) -> None:
    drawn = line(list(stress_time(fit).axes[0].lines), "predictive median")
    stress = fit.posterior["predictions"].to_dataset()["stress"]
    expected = np.median(stress.to_numpy().reshape(-1, stress.sizes["time"]), axis=0) / 1e6
    np.testing.assert_allclose(np.asarray(drawn.get_ydata()), expected, rtol=1e-5)
    assert "200 retrodictions" in legend_texts(stress_time(fit))


def test_data_and_solutions_of_the_loop_lie_at_the_driving_strain(fit: Fit) -> None:
    prepared = of_kind(fit.experiment, OscillationExperiment).prepared
    axes = stress_loop(fit).axes[0]
    readings = axes.collections[-1]
    expected = np.stack([100 * prepared.strain(prepared.time), prepared.stress / 1e6], axis=1)
    np.testing.assert_allclose(np.asarray(readings.get_offsets()), expected)
    np.testing.assert_allclose(np.asarray(readings.get_array()), prepared.time)
    (curves,) = (
        c
        for c in axes.collections
        if isinstance(c, LineCollection) and len(c.get_segments()) == 200
    )
    time = fit.posterior["predictions"]["time"].to_numpy()
    strain = np.asarray(curves.get_segments()[0])[:, 0]
    np.testing.assert_allclose(strain, 100 * prepared.strain(time))


def test_dashed_lines_enclose_the_replicated_amplitudes_and_lags(fit: Fit) -> None:
    axes = amplitude_phase(fit).axes[0]
    replicated = replicated_response(fit)
    dashed = [drawn for drawn in axes.lines if drawn.get_linestyle() == "--"][:4]
    vertical = [float(np.asarray(drawn.get_xdata())[0]) for drawn in dashed[:2]]
    horizontal = [float(np.asarray(drawn.get_ydata())[0]) for drawn in dashed[2:]]
    low, _, high = central_band(replicated.amplitude / 1e6)
    assert vertical == pytest.approx([low, high])
    low, _, high = central_band(np.degrees(replicated.lag))
    assert horizontal == pytest.approx([low, high])


def test_grain_size_starts_where_the_record_says(fit: Fit) -> None:
    of_grains = microstructure(fit).axes[0]
    assert float(np.asarray(line(list(of_grains.lines), "median").get_ydata())[0]) == (
        pytest.approx(10.0)
    )
    start = line(list(of_grains.lines), "at the start of the record")
    assert float(np.asarray(start.get_ydata())[0]) == pytest.approx(10.0)


@pytest.mark.parametrize("recipe", VIEW.figures, ids=lambda recipe: recipe.name)
def test_a_stress_strain_curve_has_no_figures_of_an_oscillation(
    recipe: FigureRecipe, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="PIL40: found a test of protocol 'constant_rate'"):
        recipe.draw(make_fit(tmp_path, chains=1, draws=5))
