"""Figures of a fit at imposed strain rate: the curve and what softens the material."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from figure_texts import legend_texts
from matplotlib.figure import Figure
from synthetic_fit import make_fit
from synthetic_olivine_fit import make_olivine_fit

from pyburgers.common.errors import InputError
from pyburgers.drawing.style import image
from pyburgers.drawing.views.constant_rate import softening, stress_strain
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment

FEW = (
    "maxwell_modulus",
    "kelvin_viscosity",
    "activation_enthalpy",
    "beta",
    "steady_state_fabric_factor",
    "critical_strain_fabric",
)
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


def test_all_softening_is_by_grains_where_the_fabric_stays_isotropic(tmp_path: Path) -> None:
    fit = make_fit(tmp_path, chains=2, draws=50)
    predictions = fit.posterior["predictions"].to_dataset()
    predictions["fabric_softening"] = predictions["fabric_softening"] * 0 + 1
    fit.posterior["predictions"] = xr.DataTree(predictions)
    assert "median 1.00" in legend_texts(softening(fit))


def test_shares_of_next_to_no_softening_do_not_stretch_the_axis(tmp_path: Path) -> None:
    fit = make_fit(tmp_path, chains=2, draws=50)
    predictions = fit.posterior["predictions"].to_dataset()
    grains, fabric = predictions["grain_size_softening"], predictions["fabric_softening"]
    predictions["grain_size_softening"] = grains * 0 + 0.9
    # Of five draws of 50 in each chain the fabric takes back what the grains soften, nearly.
    factors = xr.DataArray(np.where(np.arange(50) < 5, 1.1, 0.9), dims="draw")
    predictions["fabric_softening"] = fabric * 0 + factors
    fit.posterior["predictions"] = xr.DataTree(predictions)
    figure = softening(fit)
    (axes,) = (one for one in figure.axes if "share" in one.get_title("left"))
    assert axes.get_xlim() == (0.0, 2.0)
    assert {"median 0.50", "10 % of draws lie beyond"} <= set(legend_texts(figure))


def test_a_fabric_that_hardens_stays_inside_its_panel(tmp_path: Path) -> None:
    fit = make_fit(tmp_path, chains=2, draws=50)
    predictions = fit.posterior["predictions"].to_dataset()
    predictions["fabric_factor"] = predictions["fabric_factor"] * 0 + 2.5
    fit.posterior["predictions"] = xr.DataTree(predictions)
    (axes,) = (one for one in softening(fit).axes if "fabric" in one.get_title("left"))
    low, high = axes.get_ylim()
    assert low == 0.0
    assert all(np.max(line.get_ydata()) < high for line in axes.lines)


def test_softening_without_any_softening_draws_no_share(tmp_path: Path) -> None:
    fit = make_fit(tmp_path, chains=2, draws=50)
    predictions = fit.posterior["predictions"].to_dataset()
    for name in ("fabric_softening", "grain_size_softening"):
        predictions[name] = predictions[name] * 0 + 1
    fit.posterior["predictions"] = xr.DataTree(predictions)
    figure = softening(fit)
    image(figure, "png")
    assert not any(text.startswith("median") for text in legend_texts(figure))


def test_a_figure_that_cannot_be_drawn_raises(tmp_path: Path) -> None:
    fit = make_fit(tmp_path, chains=1, draws=20)
    del fit.posterior["predictions"]
    with pytest.raises(KeyError):
        stress_strain(fit)


@pytest.mark.parametrize("draw", [stress_strain, softening])
def test_an_oscillation_has_no_stress_strain_curve(
    draw: Callable[[Fit], Figure], tmp_path: Path
) -> None:
    with pytest.raises(InputError, match="olivine_removed: found a test of protocol 'forced"):
        draw(make_olivine_fit(tmp_path, chains=1, draws=5))
