"""Figures of any posterior: densities, ranks, trade-offs."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from figure_texts import legend_texts
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from scipy import integrate, stats
from synthetic_fit import make_fit
from synthetic_olivine_fit import make_olivine_fit, redrawn

from pyburgers.fitting.fit import Fit
from pyburgers.kinds.coordinates import REFERENCE_FLOW_RATE
from pyburgers.page.posterior_figures import density, pairs, prior_posterior, rank

FEW = (
    "maxwell_modulus",
    "kelvin_viscosity",
    "activation_enthalpy",
    "beta",
    "steady_state_fabric_factor",
    "critical_strain_fabric",
)


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("run"), chains=3, draws=200, divergences=7)


@pytest.fixture(scope="module")
def stuck(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    """Several fixed parameters, one chain stuck."""
    path = tmp_path_factory.mktemp("stuck")
    return make_fit(path, fixed=FEW, stuck_chain=True, draws=100)


@pytest.fixture(scope="module")
def densities(fit: Fit) -> Figure:
    return prior_posterior(fit)


@pytest.fixture(scope="module")
def trade_offs(fit: Fit) -> Figure:
    return pairs(fit)


@pytest.fixture(scope="module")
def stuck_densities(stuck: Fit) -> Figure:
    return prior_posterior(stuck)


@pytest.mark.parametrize("chains", [1, 3, 8])
@pytest.mark.parametrize("draw", [prior_posterior, rank])
def test_every_chain_is_in_the_legend_with_a_style_of_its_own(
    draw: Callable[[Fit], Figure], chains: int, tmp_path: Path
) -> None:
    figure = draw(make_fit(tmp_path, chains=chains, draws=60, fixed=FEW))
    (legend,) = figure.legends
    styles = {
        line.get_label(): (line.get_color(), line.get_linestyle())
        for line in legend.get_lines()
        if str(line.get_label()).startswith("chain")
    }
    assert list(styles) == [f"chain {k}" for k in range(1, chains + 1)]
    assert len(set(styles.values())) == chains


def test_prior_and_posterior_has_a_panel_for_each_free_quantity(
    densities: Figure, stuck_densities: Figure
) -> None:
    assert len(densities.axes) == 13
    assert len(stuck_densities.axes) == 13 - len(FEW)


def test_the_true_value_lies_inside_its_panel(densities: Figure, trade_offs: Figure) -> None:
    panels = {axes.get_xlabel(): axes for axes in densities.axes}
    low, high = panels["$E_K$ (GPa)"].get_xlim()
    assert low < 0.527 < high
    assert "true value" in legend_texts(densities)
    assert "true value" in legend_texts(trade_offs)


def test_a_posterior_much_narrower_than_its_prior_gets_limits_of_its_own(
    densities: Figure,
) -> None:
    panels = {axes.get_xlabel(): axes for axes in densities.axes}
    viscosity = panels[r"$\eta_K$ (GPa s)"]
    assert viscosity.get_xlim()[1] < 100
    assert "prior spans 1 to 500" in viscosity.get_title(loc="left")
    low, high = panels["$n$ (–)"].get_xlim()
    assert low < 2.7
    assert high > 4.5


def test_a_stuck_chain_does_not_flatten_the_others(stuck_densities: Figure) -> None:
    axes = stuck_densities.axes[0]
    peaks = sorted(float(np.max(np.asarray(line.get_ydata()))) for line in axes.lines[:4])
    assert peaks[-1] > 5 * peaks[0]
    assert axes.get_ylim()[1] < 5 * peaks[0]


def test_density_keeps_its_mass_at_hard_bounds() -> None:
    draws = np.random.default_rng(3).uniform(2.0, 5.0, 4000)
    x, height = density(draws, 2.0, 5.0)
    assert integrate.trapezoid(height, x) == pytest.approx(1.0, abs=0.02)
    assert height[0] == pytest.approx(1 / 3, rel=0.2)
    assert height[-1] == pytest.approx(1 / 3, rel=0.2)
    assert x[0] >= 2.0
    assert x[-1] <= 5.0


def test_density_agrees_with_the_normal_it_was_drawn_from() -> None:
    draws = np.random.default_rng(3).normal(-7.29e-4, 1e-6, 20_000)
    x, height = density(draws, -np.inf, np.inf)
    expected = stats.norm(-7.29e-4, 1e-6).pdf(x)
    np.testing.assert_allclose(height, expected, atol=0.06 * expected.max())


def test_density_of_equal_draws_is_a_spike() -> None:
    x, height = density(np.full(50, 3.0), 0.0, np.inf)
    assert x[height.argmax()] == pytest.approx(3.0, rel=1e-4)


def test_ranks_count_every_draw_and_show_a_chain_that_sits_higher(tmp_path: Path) -> None:
    apart = make_fit(tmp_path, chains=2, draws=100, apart=2.0, fixed=FEW)
    axes = rank(apart).axes[0]
    stairs = [patch for patch in axes.patches if isinstance(patch, StepPatch)]
    counts = [np.asarray(patch.get_data()[0]) for patch in stairs]
    assert [c.sum() for c in counts] == [100, 100]
    assert counts[0][0] < counts[0][-1]


def test_divergent_draws_are_counted_and_drawn_last(trade_offs: Figure, stuck: Fit) -> None:
    assert "divergent draw (7)" in legend_texts(trade_offs)
    assert len(np.asarray(trade_offs.axes[0].collections[-1].get_offsets())) == 7
    assert "divergent draw (none)" in legend_texts(pairs(stuck))


def test_pairs_hold_few_draws_as_one_picture(tmp_path: Path) -> None:
    figure = pairs(make_fit(tmp_path, chains=4, draws=500, fixed=FEW))
    for axes in figure.axes:
        assert len(np.asarray(axes.collections[0].get_offsets())) == 1000
        assert all(collection.get_rasterized() for collection in axes.collections)


def test_a_prior_far_from_zero_does_not_stretch_its_panel_to_zero(
    densities: Figure, tmp_path: Path
) -> None:
    of_olivine = prior_posterior(make_olivine_fit(tmp_path)).axes[0]
    assert of_olivine.get_xlabel() == densities.axes[0].get_xlabel() == "$E_M$ (GPa)"
    assert of_olivine.get_xlim()[0] > 150  # N(200, 10) GPa, > 0
    assert densities.axes[0].get_xlim()[0] < 0.5  # N(4, 2) GPa, > 0


def test_a_flow_rate_that_spans_decades_is_shown_by_its_logarithm(tmp_path: Path) -> None:
    made = make_olivine_fit(tmp_path, chains=2, draws=100)
    rate = 10.0 ** np.random.default_rng(1).uniform(-12.0, -6.0, (2, 100))
    fit = redrawn(made, **{REFERENCE_FLOW_RATE: rate})
    panel = prior_posterior(fit).axes[-1]
    assert panel.get_xlabel() == r"$\log_{10}(\dot\epsilon_0\,\mathrm{s})$ (–)"
    low, high = panel.get_xlim()
    assert low < -11
    assert -7 < high < -3
    position = next(
        axes for axes in pairs(fit).axes if "dot" in axes.get_ylabel() and axes.get_ylabel()
    )
    offsets = np.asarray(position.collections[0].get_offsets())
    np.testing.assert_allclose(np.sort(offsets[:, 1]), np.sort(np.log10(rate).ravel()))
