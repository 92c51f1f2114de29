"""Figures of a fit at imposed strain rate, and of one of a forced oscillation."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from figure_texts import legend_texts
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from synthetic_fit import FEW, make_fit
from synthetic_olivine_fit import make_olivine_fit

from pyburgers.common.draws import central_band
from pyburgers.common.errors import InputError
from pyburgers.drawing.style import image
from pyburgers.drawing.views.constant_rate import softening, stress_strain
from pyburgers.drawing.views.forced_oscillation import (
    VIEW,
    amplitude_phase,
    microstructure,
    stress_loop,
    stress_time,
)
from pyburgers.drawing.views.oscillation_response import (
    predicted_response,
    replicated_response,
    response_table,
)
from pyburgers.drawing.views.softening import softening_caption
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment

RESIDUAL_LABEL = "data minus predictive median"
STEPS = ((0.0, 1e-4), (0.03, 1e-5), (0.1, 3e-4))


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("run"), chains=3, draws=200)


@pytest.fixture(scope="module")
def stepped(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("stepped"), segments=STEPS, fixed=FEW, draws=100)


def test_retrodictions_are_thinned_to_a_thousand(tmp_path: Path) -> None:
    many = make_fit(tmp_path / "many", chains=2, draws=750, fixed=FEW)
    few = make_fit(tmp_path / "few", chains=2, draws=30, fixed=FEW)
    assert "1000 retrodictions" in legend_texts(stress_strain(many))
    assert "60 retrodictions" in legend_texts(stress_strain(few))


def test_rate_steps_are_marked_with_their_rate(fit: Fit, stepped: Fit) -> None:
    marks = [annotation.get_text() for annotation in stress_strain(stepped).axes[0].texts]
    assert marks == [r"then $1.00\times10^{-5}$ s$^{-1}$", r"then $3.00\times10^{-4}$ s$^{-1}$"]
    assert not stress_strain(fit).axes[0].texts


def test_the_line_is_the_predictive_median_whatever_the_mean_of_the_parameters(fit: Fit) -> None:
    (line,) = (
        line for line in stress_strain(fit).axes[0].lines if line.get_label() == "predictive median"
    )
    solutions = fit.posterior["predictions"]["stress"]
    median = solutions.median(("chain", "draw")).to_numpy() / 1e6
    np.testing.assert_allclose(np.asarray(line.get_ydata()), median, rtol=1e-5)
    # On a bent posterior the solution at the mean can lie anywhere: it takes no part.
    bent = fit.posterior.copy()
    del bent["posterior_mean_solution"]
    stress_strain(replace(fit, posterior=bent))


def test_residuals_are_data_minus_predictive_median_in_megapascal(fit: Fit) -> None:
    (points,) = (
        line for line in stress_strain(fit).axes[1].lines if line.get_label() == RESIDUAL_LABEL
    )
    predicted = fit.posterior["model_response"]["stress"].median(("chain", "draw"))
    assert isinstance(fit.experiment, ConstantRateExperiment)
    expected = (fit.experiment.stress - predicted.to_numpy()) / 1e6
    np.testing.assert_allclose(np.asarray(points.get_ydata()), expected)
    np.testing.assert_allclose(np.asarray(points.get_xdata()), 100 * fit.experiment.strain)


def softened(fit: Fit, **values: float | xr.DataArray) -> Figure:
    """The figure where quantities along the test are some numbers."""
    predictions = fit.posterior["predictions"].to_dataset()
    changed = {name: 0 * predictions[name] + value for name, value in values.items()}
    posterior = fit.posterior.copy()
    posterior["predictions"] = xr.DataTree(predictions.assign(changed))
    return softening(replace(fit, posterior=posterior))


def test_the_figure_of_softening_shows_shares_and_factors_within_its_panels(tmp_path: Path) -> None:
    fit = make_fit(tmp_path, chains=2, draws=50)
    assert "median 1.00" in legend_texts(softened(fit, fabric_softening=1.0))  # all by grains
    # Of five draws of 50 in each chain the fabric takes back what the grains soften, nearly.
    factors = xr.DataArray(np.where(np.arange(50) < 5, 1.1, 0.9), dims="draw")
    figure = softened(fit, grain_size_softening=0.9, fabric_softening=factors)
    (axes,) = (one for one in figure.axes if "share" in one.get_title("left"))
    assert axes.get_xlim() == (0.0, 2.0)
    assert {"median 0.50", "10 % of draws lie beyond"} <= set(legend_texts(figure))
    assert "legend counts draws beyond" in softening_caption("end")
    hardened = softened(fit, fabric_factor=2.5)
    (axes,) = (one for one in hardened.axes if "fabric" in one.get_title("left"))
    low, high = axes.get_ylim()
    assert low == 0.0
    assert all(np.max(line.get_ydata()) < high for line in axes.lines)
    none = softened(fit, fabric_softening=1.0, grain_size_softening=1.0)
    image(none, "png")
    assert not any(text.startswith("median") for text in legend_texts(none))


@pytest.mark.parametrize("draw", [stress_strain, softening])
def test_an_oscillation_has_no_stress_strain_curve(
    draw: Callable[[Fit], Figure], tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="olivine_removed: found a test of protocol 'forced"):
        draw(make_olivine_fit(tmp_path, chains=1, draws=5))


@pytest.fixture(scope="module", params=["removed", "kept"])
def record(request: pytest.FixtureRequest, tmp_path_factory: pytest.TempPathFactory) -> Fit:
    path = tmp_path_factory.mktemp("olivine")
    return make_olivine_fit(path, request.param, chains=2, draws=100)


def line_of(lines: list[Line2D], label: str) -> Line2D:
    (found,) = (drawn for drawn in lines if drawn.get_label() == label)
    return found


def test_residuals_are_in_units_of_the_noise_of_each_reading(record: Fit) -> None:
    prepared = of_kind(record.experiment, OscillationExperiment).prepared
    points = line_of(list(stress_time(record).axes[1].lines), "data minus predictive median")
    predicted = record.posterior["model_response"]["stress"].median(("chain", "draw")).to_numpy()
    typical = float(np.sqrt(np.mean(prepared.uncertainty**2)))
    noise = float(record.posterior["posterior"]["stress_noise"].mean())
    expected = (prepared.stress - predicted) / (noise * prepared.uncertainty / typical)
    np.testing.assert_allclose(np.asarray(points.get_ydata()), expected)
    np.testing.assert_allclose(np.asarray(points.get_xdata()), prepared.time)


def test_the_solid_line_is_the_predictive_median(record: Fit) -> None:
    drawn = line_of(list(stress_time(record).axes[0].lines), "predictive median")
    stress = record.posterior["predictions"].to_dataset()["stress"]
    expected = np.median(stress.to_numpy().reshape(-1, stress.sizes["time"]), axis=0) / 1e6
    np.testing.assert_allclose(np.asarray(drawn.get_ydata()), expected, rtol=1e-5)
    assert "200 retrodictions" in legend_texts(stress_time(record))


def test_data_and_solutions_of_the_loop_lie_at_the_driving_strain(record: Fit) -> None:
    prepared = of_kind(record.experiment, OscillationExperiment).prepared
    axes = stress_loop(record).axes[0]
    readings = axes.collections[-1]
    expected = np.stack([100 * prepared.strain(prepared.time), prepared.stress / 1e6], axis=1)
    np.testing.assert_allclose(np.asarray(readings.get_offsets()), expected)
    np.testing.assert_allclose(np.asarray(readings.get_array()), prepared.time)
    (curves,) = (
        c
        for c in axes.collections
        if isinstance(c, LineCollection) and len(c.get_segments()) == 200
    )
    time = record.posterior["predictions"]["time"].to_numpy()
    strain = np.asarray(curves.get_segments()[0])[:, 0]
    np.testing.assert_allclose(strain, 100 * prepared.strain(time))


def test_dashed_lines_enclose_the_replicated_amplitudes_and_lags(record: Fit) -> None:
    axes = amplitude_phase(record).axes[0]
    replicated = replicated_response(record)
    dashed = [drawn for drawn in axes.lines if drawn.get_linestyle() == "--"][:4]
    vertical = [float(np.asarray(drawn.get_xdata())[0]) for drawn in dashed[:2]]
    horizontal = [float(np.asarray(drawn.get_ydata())[0]) for drawn in dashed[2:]]
    low, _, high = central_band(replicated.amplitude / 1e6)
    assert vertical == pytest.approx([low, high])
    low, _, high = central_band(np.degrees(replicated.lag))
    assert horizontal == pytest.approx([low, high])


def test_grain_size_starts_where_the_record_says(record: Fit) -> None:
    of_grains = microstructure(record).axes[0]
    assert float(np.asarray(line_of(list(of_grains.lines), "median").get_ydata())[0]) == (
        pytest.approx(10.0)
    )
    start = line_of(list(of_grains.lines), "at the start of the record")
    assert float(np.asarray(start.get_ydata())[0]) == pytest.approx(10.0)


def test_a_stress_strain_curve_has_no_figures_of_an_oscillation(tmp_path: Path) -> None:
    curve = make_fit(tmp_path, chains=1, draws=5)
    of_responses = (predicted_response, replicated_response, response_table)
    drawers: tuple[Callable[[Fit], object], ...] = (*VIEW.figures, *of_responses)
    for draw in drawers:
        with pytest.raises(InputError, match="PIL40: found a test of protocol 'constant_rate'"):
            draw(curve)
