"""Figures of any posterior: densities, ranks, trade-offs, quantities that span decades."""

from collections.abc import Callable
from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from figure_texts import legend_texts
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from scipy import integrate, stats
from synthetic_fit import FEW, make_fit, make_prior, uniform
from synthetic_olivine_fit import make_olivine_fit, redrawn
from truths import truth_of

from pyburgers.drawing.style import few_ticks_of_decades, style
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.stan_data import REFERENCE_FLOW_RATE
from pyburgers.model.display import shown_quantity
from pyburgers.page.decades import PriorOfLogarithm, logarithm_of, shown_draws, spans_decades
from pyburgers.page.posterior_figures import density, narrowed, prior_posterior, rank
from pyburgers.page.trade_offs import pairs


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


def test_each_free_quantity_has_a_panel_with_its_true_value(
    densities: Figure, trade_offs: Figure, stuck_densities: Figure, fit: Fit, stuck: Fit
) -> None:
    for figure, one in ((densities, fit), (stuck_densities, stuck)):
        assert len(figure.axes) == len(one.priors.free) + 1  # and the reference stress
    panels = {axes.get_xlabel(): axes for axes in densities.axes}
    low, high = panels["$E_K$ (GPa)"].get_xlim()
    assert low < 0.527 < high
    assert "true value" in legend_texts(densities)
    assert "true value" in legend_texts(trade_offs)


def test_a_posterior_much_narrower_than_its_prior_gets_limits_of_its_own(densities: Figure) -> None:
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


def test_density_is_that_of_the_law_and_keeps_its_mass_at_hard_bounds() -> None:
    draws = np.random.default_rng(3).uniform(2.0, 5.0, 4000)
    x, height = density(draws, 2.0, 5.0)
    assert integrate.trapezoid(height, x) == pytest.approx(1.0, abs=0.02)
    assert height[0] == pytest.approx(1 / 3, rel=0.2)
    assert height[-1] == pytest.approx(1 / 3, rel=0.2)
    assert x[0] >= 2.0
    assert x[-1] <= 5.0
    draws = np.random.default_rng(3).normal(-7.29e-4, 1e-6, 20_000)
    x, height = density(draws, -np.inf, np.inf)
    expected = stats.norm(-7.29e-4, 1e-6).pdf(x)
    np.testing.assert_allclose(height, expected, atol=0.06 * expected.max())
    x, height = density(np.full(50, 3.0), 0.0, np.inf)  # a spike
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


def test_decades_are_counted_between_the_ends_of_most_draws() -> None:
    rng = np.random.default_rng(1)
    assert not spans_decades(rng.uniform(1.0, 500.0, 4000))
    assert spans_decades(10 ** rng.uniform(0.0, 2.0, 4000))
    assert not spans_decades(rng.normal(0.0, 1.0, 4000))
    assert not spans_decades(np.full(10, 3.0))
    # What lies evenly in its own unit: a share, most of whose decades are empty.
    assert not spans_decades(rng.beta(1.0, 1.5, 4000))
    assert not spans_decades(np.abs(rng.normal(0.0, 1.0, 4000)))
    assert spans_decades(np.exp(rng.normal(0.0, 1.0, 4000)))


def test_the_logarithm_of_a_prior_is_its_distribution() -> None:
    prior = PriorOfLogarithm(make_prior("kelvin_viscosity", "lognormal", 3e10, 1.2, 0.0))
    of_log = stats.norm(np.log10(3e10), 1.2 / np.log(10))
    x = np.linspace(9.0, 12.0, 50)
    np.testing.assert_allclose(prior.pdf(x), of_log.pdf(x), rtol=1e-9)
    np.testing.assert_allclose(
        prior.ppf(np.array([0.01, 0.5, 0.99])), of_log.ppf([0.01, 0.5, 0.99])
    )
    assert prior.std() == pytest.approx(of_log.std(), rel=0.01)
    assert prior.lower == -np.inf
    bounded = PriorOfLogarithm(uniform("kelvin_viscosity", 1e9, 1e11))
    assert (bounded.lower, bounded.upper) == (9.0, 11.0)
    assert logarithm_of(shown_quantity("stress_exponent")).symbol == r"\log_{10}(n)"
    assert logarithm_of(shown_quantity("kelvin_viscosity")).symbol == (
        r"\log_{10}(\eta_K/\mathrm{Pa\,s})"
    )


def test_a_panel_over_decades_has_the_logarithm_and_the_truth_in_it(tmp_path: Path) -> None:
    spread = 10 ** np.random.default_rng(3).uniform(9.0, 11.6, (2, 200))
    fit = redrawn(make_fit(tmp_path, chains=2, draws=200), kelvin_viscosity=spread)
    (panel,) = (axes for axes in prior_posterior(fit).axes if "eta_K" in axes.get_xlabel())
    assert "log" in panel.get_xlabel()
    truth = np.log10(truth_of(fit.experiment)["kelvin_viscosity"])
    (line,) = (one for one in panel.lines if one.get_linestyle() == "--")
    assert np.asarray(line.get_xdata()).tolist() == pytest.approx([truth, truth])
    low, high = panel.get_xlim()
    assert 8.5 < low < truth < high < 12.5
    (only,) = (word for word in panel.get_title(loc="left").split() if word.isdigit())
    law = PriorOfLogarithm(fit.priors["kelvin_viscosity"])
    assert int(only) == round(100 * np.log10(spread).std(ddof=1) / law.std())
    # Words beside the figure are of the same numbers.
    shares = {name: shown_draws(fit, name).width_beside_prior for name in fit.priors.free}
    assert shares["kelvin_viscosity"] == pytest.approx(int(only) / 100, abs=0.005)
    assert f"{min(shares.values()):.0%}" in narrowed(fit)


@pytest.mark.parametrize("decades", [1.6, 2.0, 3.0, 5.0])
def test_labels_of_decades_in_a_small_panel_stand_apart(decades: float) -> None:
    with style():
        figure = Figure(figsize=(2.6, 1.6), layout="constrained")
        axes = figure.subplots()
        axes.set_xscale("log")
        axes.set_xlim(13.0, 13.0 * 10**decades)
        few_ticks_of_decades(axes)
        figure.draw_without_rendering()
    labels = [one for one in axes.get_xticklabels(which="both") if one.get_text()]
    low, high = axes.get_xlim()
    boxes = [
        label.get_window_extent() for label in labels if low <= label.get_position()[0] <= high
    ]
    assert len(boxes) >= 2
    assert all(one.x1 < other.x0 for one, other in pairwise(boxes))
