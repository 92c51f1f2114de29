import re
from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.patches import StepPatch
from matplotlib.text import Text
from scipy import integrate, stats
from synthetic_fit import make_fit

from pyburgers.figures import (
    FIGURES,
    FigureRecipe,
    density,
    image,
    pairs,
    prior_posterior,
    rank,
    softening,
    stress_strain,
)
from pyburgers.fitting import Fit

FEW = (
    "maxwell_modulus",
    "kelvin_viscosity",
    "activation_enthalpy",
    "beta",
    "steady_state_fabric_factor",
    "critical_strain_fabric",
)
RESIDUAL_LABEL = "data minus mean prediction"
STEPS = ((0.0, 1e-4), (0.03, 1e-5), (0.1, 3e-4))

each_figure = pytest.mark.parametrize("recipe", FIGURES, ids=lambda recipe: recipe.name)


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("run"), chains=3, draws=200, divergences=7)


@pytest.fixture(scope="module")
def stepped(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    """A measured test with rate steps and several fixed parameters, one chain stuck."""
    path = tmp_path_factory.mktemp("stepped")
    return make_fit(path, kind="measured", segments=STEPS, fixed=FEW, stuck_chain=True, draws=100)


@pytest.fixture(scope="module")
def figures(fit: Fit) -> dict[str, Figure]:
    """Every figure of `fit`, by name."""
    return {recipe.name: recipe.draw(fit) for recipe in FIGURES}


@pytest.fixture(scope="module")
def stepped_figures(stepped: Fit) -> dict[str, Figure]:
    """Every figure of `stepped`, by name."""
    return {recipe.name: recipe.draw(stepped) for recipe in FIGURES}


def legend_texts(figure: Figure) -> list[str]:
    legends = [*figure.legends, *(axes.get_legend() for axes in figure.axes)]
    return [text.get_text() for legend in legends if legend for text in legend.get_texts()]


def texts(figure: Figure) -> list[Text]:
    """Everything written on a figure."""
    found = [artist for artist in figure.findobj(Text) if isinstance(artist, Text)]
    return [text for text in found if text.get_text() and text.get_visible()]


def axis_labels(figure: Figure, axes: Axes) -> dict[str, str]:
    """Label of each axis that shows numbers, the figure's own label standing in."""
    labels = {}
    if axes.xaxis.get_tick_params()["labelbottom"]:
        labels["x"] = axes.get_xlabel() or figure.get_supxlabel()
    if axes.yaxis.get_tick_params()["labelleft"]:
        labels["y"] = axes.get_ylabel() or figure.get_supylabel()
    return labels


@each_figure
def test_every_axis_with_numbers_has_a_unit(
    recipe: FigureRecipe, figures: dict[str, Figure]
) -> None:
    figure = figures[recipe.name]
    for axes in figure.axes:
        for label in axis_labels(figure, axes).values():
            assert re.search(r"\(.+\)$", label), f"{recipe.name}: {label!r}"


@each_figure
def test_every_figure_has_a_legend_and_a_caption(
    recipe: FigureRecipe, figures: dict[str, Figure]
) -> None:
    assert legend_texts(figures[recipe.name])
    assert len(recipe.caption.split()) > 30
    assert "\n" not in recipe.caption


@each_figure
def test_every_figure_names_the_experiment_and_the_kind_of_data(
    recipe: FigureRecipe, figures: dict[str, Figure], stepped_figures: dict[str, Figure]
) -> None:
    synthetic, measured = (
        " ".join(text.get_text() for text in texts(drawn[recipe.name]))
        for drawn in (figures, stepped_figures)
    )
    assert "synthetic data" in synthetic
    assert "PIL40" in measured
    assert "measured data" in measured
    assert "synthetic" not in measured


@each_figure
def test_letters_have_at_least_nine_points(
    recipe: FigureRecipe, stepped_figures: dict[str, Figure]
) -> None:
    figure = stepped_figures[recipe.name]
    image(figure, "svg")
    for text in texts(figure):
        assert float(text.get_fontsize()) >= 9.0, text.get_text()


@each_figure
def test_the_same_fit_gives_the_same_bytes(
    recipe: FigureRecipe, stepped: Fit, stepped_figures: dict[str, Figure]
) -> None:
    again = recipe.draw(stepped)
    assert image(again, "svg") == image(stepped_figures[recipe.name], "svg")
    assert image(again, "png").startswith(b"\x89PNG")


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


def test_retrodictions_are_thinned_to_a_thousand(tmp_path: Path) -> None:
    many = make_fit(tmp_path / "many", chains=2, draws=750, fixed=FEW)
    few = make_fit(tmp_path / "few", chains=2, draws=30, fixed=FEW)
    assert "1000 retrodictions" in legend_texts(stress_strain(many))
    assert "60 retrodictions" in legend_texts(stress_strain(few))


def test_rate_steps_are_marked_with_their_rate(fit: Fit, stepped: Fit) -> None:
    marks = [annotation.get_text() for annotation in stress_strain(stepped).axes[0].texts]
    assert marks == [r"$1.00\times10^{-5}$ s$^{-1}$", r"$3.00\times10^{-4}$ s$^{-1}$"]
    assert not stress_strain(fit).axes[0].texts


def test_residuals_are_data_minus_mean_prediction_in_megapascal(fit: Fit) -> None:
    (points,) = (
        line for line in stress_strain(fit).axes[1].lines if line.get_label() == RESIDUAL_LABEL
    )
    predicted = fit.posterior["posterior_predictive"]["stress"].mean(("chain", "draw"))
    expected = (fit.experiment.stress - predicted.to_numpy()) / 1e6
    np.testing.assert_allclose(np.asarray(points.get_ydata()), expected)
    np.testing.assert_allclose(np.asarray(points.get_xdata()), 100 * fit.experiment.strain)


def test_prior_and_posterior_has_a_panel_for_each_free_quantity(
    figures: dict[str, Figure], stepped_figures: dict[str, Figure]
) -> None:
    assert len(figures["prior_posterior"].axes) == 13
    assert len(stepped_figures["prior_posterior"].axes) == 13 - len(FEW)


def test_the_true_value_lies_inside_its_panel(figures: dict[str, Figure]) -> None:
    panels = {axes.get_xlabel(): axes for axes in figures["prior_posterior"].axes}
    low, high = panels["$E_K$ (GPa)"].get_xlim()
    assert low < 0.527 < high
    assert "true value" in legend_texts(figures["prior_posterior"])
    assert "true value" in legend_texts(figures["pairs"])


def test_a_posterior_much_narrower_than_its_prior_gets_limits_of_its_own(
    figures: dict[str, Figure],
) -> None:
    panels = {axes.get_xlabel(): axes for axes in figures["prior_posterior"].axes}
    viscosity = panels[r"$\eta_K$ (GPa s)"]
    assert viscosity.get_xlim()[1] < 100
    assert "prior spans 1 to 500" in viscosity.get_title(loc="left")
    low, high = panels["$n$ (–)"].get_xlim()
    assert low < 2.7
    assert high > 4.5


def test_a_stuck_chain_does_not_flatten_the_others(stepped_figures: dict[str, Figure]) -> None:
    axes = stepped_figures["prior_posterior"].axes[0]
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


def test_divergent_draws_are_counted_and_drawn_last(
    figures: dict[str, Figure], stepped_figures: dict[str, Figure]
) -> None:
    figure = figures["pairs"]
    assert "divergent draw (7)" in legend_texts(figure)
    assert len(np.asarray(figure.axes[0].collections[-1].get_offsets())) == 7
    assert "divergent draw (none)" in legend_texts(stepped_figures["pairs"])


def test_pairs_hold_few_draws_as_one_picture(tmp_path: Path) -> None:
    figure = pairs(make_fit(tmp_path, chains=4, draws=500, fixed=FEW))
    for axes in figure.axes:
        assert len(np.asarray(axes.collections[0].get_offsets())) == 1000
        assert all(collection.get_rasterized() for collection in axes.collections)


def test_all_softening_is_by_grains_where_the_fabric_stays_isotropic(tmp_path: Path) -> None:
    fit = make_fit(tmp_path, chains=2, draws=50)
    predictions = fit.posterior["predictions"].to_dataset()
    predictions["fabric_softening"] = predictions["fabric_softening"] * 0 + 1
    fit.posterior["predictions"] = xr.DataTree(predictions)
    assert "median 1.00" in legend_texts(softening(fit))


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
