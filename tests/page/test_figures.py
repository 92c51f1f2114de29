"""What every figure of every report has: units, legends, headings, letters, the same bytes."""

import re
from collections.abc import Mapping
from io import BytesIO
from pathlib import Path

import numpy as np
import pytest
from figure_texts import legend_texts, texts
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from PIL import Image
from synthetic_fit import make_fit
from synthetic_olivine_fit import make_olivine_fit

from pyburgers.drawing.panels import band_text
from pyburgers.drawing.style import image
from pyburgers.fitting.fit import Fit
from pyburgers.page.posterior_figures import CHAIN_COLOURS, figures_for, rank

FEW = ("maxwell_modulus", "kelvin_viscosity", "activation_enthalpy", "beta")
STEPS = ((0.0, 1e-4), (0.03, 1e-5), (0.1, 3e-4))

CONSTANT_RATE = ("stress_strain", "prior_posterior", "softening", "pairs", "rank")
OSCILLATION = (
    "stress_time",
    "prior_posterior",
    "stress_loop",
    "amplitude_phase",
    "microstructure",
    "pairs",
    "rank",
)
NAMES: Mapping[str, tuple[str, ...]] = {
    "curve": CONSTANT_RATE,
    "stepped": CONSTANT_RATE,
    "removed": OSCILLATION,
    "kept": OSCILLATION,
}

each_figure = pytest.mark.parametrize(
    ("test", "name"), [(test, name) for test, names in NAMES.items() for name in names]
)
RENDERED = ("stepped", "kept")
each_rendered_figure = pytest.mark.parametrize(
    ("test", "name"), [(test, name) for test in RENDERED for name in NAMES[test]]
)
each_kind_of_figure = pytest.mark.parametrize(
    ("test", "name"), {name: (test, name) for test in RENDERED for name in NAMES[test]}.values()
)
"""One of each name, whatever the protocol."""


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fit]:
    """A curve, a measured one with rate steps and a stuck chain, and two oscillations."""
    path = tmp_path_factory.mktemp("runs")
    return {
        "curve": make_fit(path / "curve", chains=3, draws=200, divergences=7),
        "stepped": make_fit(
            path / "stepped",
            kind="measured",
            segments=STEPS,
            fixed=FEW,
            stuck_chain=True,
            draws=100,
        ),
        "removed": make_olivine_fit(path / "removed", "removed", chains=2, draws=60),
        "kept": make_olivine_fit(path / "kept", "kept", chains=2, draws=60),
    }


@pytest.fixture(scope="module")
def figures(fits: dict[str, Fit]) -> dict[tuple[str, str], Figure]:
    """Every figure of every fit."""
    return {
        (test, recipe.name): recipe.draw()
        for test, fit in fits.items()
        for recipe in figures_for(fit)
    }


@pytest.fixture(scope="module")
def rendered(figures: dict[tuple[str, str], Figure]) -> dict[tuple[str, str], bytes]:
    """Some of the figures as vector files, after which letters have their places and sizes."""
    return {
        (test, name): image(figures[test, name], "svg") for test in RENDERED for name in NAMES[test]
    }


def axis_labels(figure: Figure, axes: Axes) -> dict[str, str]:
    """Label of each axis that shows numbers, the figure's own label standing in."""
    labels = {}
    if axes.get_xticks().size > 0 and axes.xaxis.get_tick_params()["labelbottom"]:
        labels["x"] = axes.get_xlabel() or figure.get_supxlabel()
    if axes.yaxis.get_tick_params()["labelleft"] or axes.yaxis.get_tick_params()["labelright"]:
        labels["y"] = axes.get_ylabel() or figure.get_supylabel()
    return labels


@pytest.mark.parametrize("test", NAMES)
def test_the_protocol_decides_which_figures_there_are(test: str, fits: dict[str, Fit]) -> None:
    recipes = figures_for(fits[test])
    assert tuple(recipe.name for recipe in recipes) == NAMES[test]
    for recipe in recipes:
        assert len(recipe.caption.split()) > 30
        assert "\n" not in recipe.caption


@each_figure
def test_every_axis_with_numbers_has_a_unit(
    test: str, name: str, figures: dict[tuple[str, str], Figure]
) -> None:
    figure = figures[test, name]
    for axes in figure.axes:
        for label in axis_labels(figure, axes).values():
            assert re.search(r"\(.+\)$", label), f"{name}: {label!r}"


@each_figure
def test_every_figure_has_a_legend_and_names_the_experiment_and_the_kind_of_data(
    test: str, name: str, figures: dict[tuple[str, str], Figure], fits: dict[str, Fit]
) -> None:
    figure, experiment = figures[test, name], fits[test].experiment
    assert legend_texts(figure)
    written = " ".join(text.get_text() for text in texts(figure))
    assert experiment.title in written
    assert f"{experiment.provenance.kind} data" in written
    if experiment.provenance.kind == "measured":
        assert "synthetic" not in written


@each_rendered_figure
def test_letters_have_at_least_nine_points(
    test: str,
    name: str,
    figures: dict[tuple[str, str], Figure],
    rendered: dict[tuple[str, str], bytes],
) -> None:
    assert (test, name) in rendered
    for text in texts(figures[test, name]):
        assert float(text.get_fontsize()) >= 9.0, text.get_text()


@each_figure
def test_headings_and_legends_are_not_cut_off(
    test: str,
    name: str,
    figures: dict[tuple[str, str], Figure],
    rendered: dict[tuple[str, str], bytes],
) -> None:
    figure = figures[test, name]
    if (test, name) not in rendered:
        figure.draw_without_rendering()
    for legend in figure.legends:
        extent = legend.get_window_extent()
        assert extent.x0 >= 0
        assert extent.x1 <= figure.bbox.x1


@each_kind_of_figure
def test_the_same_fit_gives_the_same_bytes(
    test: str, name: str, rendered: dict[tuple[str, str], bytes], fits: dict[str, Fit]
) -> None:
    (recipe,) = (r for r in figures_for(fits[test]) if r.name == name)
    again = image(recipe.draw(), "svg")
    assert again == rendered[test, name]
    assert b"<svg" in again


def test_titles_name_the_conditions_of_each_protocol(fits: dict[str, Fit]) -> None:
    assert fits["stepped"].experiment.title == (
        r"PIL40: ice, 260 K, first $1.00\times10^{-4}$ s$^{-1}$, measured data"
    )
    assert fits["kept"].experiment.title == (
        "olivine_kept: olivine, 1423 K, synthetic data\n"
        "period 300 s, strain amplitude 0.2 %, background kept"
    )


def test_a_picture_keeps_the_colours_of_its_chains(tmp_path: Path) -> None:
    n_chains = len(CHAIN_COLOURS)
    figure = rank(make_fit(tmp_path, chains=n_chains, draws=60, fixed=FEW))
    picture = Image.open(BytesIO(image(figure, "png")))
    colours = np.unique(np.asarray(picture.convert("RGB")).reshape(-1, 3), axis=0).astype(int)
    for wanted in CHAIN_COLOURS:
        rgb = [int(wanted[k : k + 2], 16) for k in (1, 3, 5)]
        assert np.abs(colours - rgb).max(axis=1).min() <= 8, wanted
    assert [255, 255, 255] in colours.tolist()


def test_vector_files_hold_few_decimals_but_whole_numbers_in_their_text() -> None:
    figure = Figure(figsize=(2.0, 2.0))
    figure.text(0.3333333, 0.3333333, "0.123456")
    vector = image(figure, "svg").decode()
    assert ">0.123456<" in vector
    assert not re.search(r'[xy]="-?\d+\.\d{3}', vector)
    # What has no unit has no gap for one.
    assert band_text(np.array([2.0, 2.0]), "") == "2 (2 to 2)"
    assert band_text(np.array([2.0, 2.0]), "µm") == "2 µm (2 to 2)"
