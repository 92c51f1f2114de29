"""Figures of attenuation spectra, and measured points over them."""

import re
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from figure_texts import texts
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.container import ErrorbarContainer
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from synthetic_fit import make_fit

from pyburgers.drawing.style import image
from pyburgers.predictions.attenuation import predict_attenuation
from pyburgers.predictions.evolving import evolving_attenuation
from pyburgers.predictions.figures import (
    AMPLITUDE_CAPTION,
    ATTENUATION_CAPTION,
    DRAWS_CAPTION,
    FAILING_LABEL,
    HOLDING_LABEL,
    amplitude_dependence,
    attenuation,
    attenuation_draws,
)
from pyburgers.predictions.material import fitted_material, likely_fails
from pyburgers.predictions.measured_attenuation import load_measured_attenuation
from pyburgers.predictions.stress_cycles import Regime

Draw = Callable[[xr.Dataset], Figure]

DRAWERS: Mapping[Draw, str] = {
    attenuation: ATTENUATION_CAPTION,
    attenuation_draws: DRAWS_CAPTION,
    amplitude_dependence: AMPLITUDE_CAPTION,
}
each_figure = pytest.mark.parametrize("draw", DRAWERS, ids=lambda draw: draw.__name__)


@pytest.fixture(scope="module")
def spectrum(tmp_path_factory: pytest.TempPathFactory) -> xr.Dataset:
    """Five regimes that share a median stress."""
    fit = make_fit(tmp_path_factory.mktemp("run"), chains=2, draws=80)
    regimes = [Regime(2e6, amplitude) for amplitude in (0.5e6, 0.1e6, 1e6, 1.5e6, 2e6)]
    found = predict_attenuation(fit, np.geomspace(1e-4, 1.0, 20), regimes)
    return found.assign_attrs(title="a heading")


@pytest.fixture(scope="module")
def figures(spectrum: xr.Dataset) -> Mapping[Draw, Figure]:
    return {draw: draw(spectrum) for draw in DRAWERS}


@pytest.fixture(scope="module")
def rendered(figures: Mapping[Draw, Figure]) -> Mapping[Draw, bytes]:
    """Vector files of the figures, whose letters then have their places and sizes."""
    return {draw: image(figure, "svg") for draw, figure in figures.items()}


@each_figure
def test_axes_have_units_and_the_legend_names_every_regime(
    draw: Draw, figures: Mapping[Draw, Figure], spectrum: xr.Dataset
) -> None:
    figure = figures[draw]
    written = words(figure)
    for axes in figure.axes:
        for label in (
            axes.get_xlabel() or figure.get_supxlabel(),
            axes.get_ylabel() or figure.get_supylabel(),
        ):
            assert re.search(r"\((Hz|–)\)$", label), label
    for regime in spectrum["regime"].to_numpy():
        assert any(str(regime) in text for text in written)
    assert any("a heading" in text for text in written)
    assert any("median stress ± amplitude" in text for text in written)
    assert len(DRAWERS[draw].split()) > 30
    assert "\n" not in DRAWERS[draw]


@each_figure
def test_letters_have_at_least_nine_points(
    draw: Draw, figures: Mapping[Draw, Figure], rendered: Mapping[Draw, bytes]
) -> None:
    assert draw in rendered
    for text in texts(figures[draw]):
        assert float(text.get_fontsize()) >= 9.0, text.get_text()


def words(figure: Figure) -> list[str]:
    return [text.get_text() for text in texts(figure)]


def medians_in(axes: Axes) -> list[Line2D]:
    """The lines with all frequencies, one for each regime."""
    return [line for line in axes.lines if line.get_label() != HOLDING_LABEL]


def test_lines_are_thin_and_pale_where_frozen_microstructure_fails(
    spectrum: xr.Dataset, figures: Mapping[Draw, Figure]
) -> None:
    fails = likely_fails(spectrum)
    assert fails.any()
    for banded in (attenuation, amplitude_dependence):
        for axes in figures[banded].axes:
            thick = [line for line in axes.lines if line.get_label() == HOLDING_LABEL]
            for k, (line, thin) in enumerate(zip(thick, medians_in(axes), strict=True)):
                drawn = np.isfinite(np.asarray(line.get_ydata(), dtype=np.float64))
                np.testing.assert_array_equal(drawn, ~fails[k])
                assert line.get_linewidth() > thin.get_linewidth()
                assert (thin.get_alpha() or 1.0) < 1.0
    holding = spectrum.assign(frozen_fails=0 * spectrum["frozen_fails"])
    for draw in DRAWERS:
        assert FAILING_LABEL in words(figures[draw])
        assert FAILING_LABEL not in words(draw(holding))


def test_regimes_differ_in_colour_and_in_dashes(figures: Mapping[Draw, Figure]) -> None:
    lines = medians_in(figures[attenuation].axes[0])
    assert len(lines) == 5
    assert len({line.get_color() for line in lines}) == 5
    assert len({line.get_linestyle() for line in lines[:4]}) == 4


def test_the_lines_are_medians_inside_their_bands(
    spectrum: xr.Dataset, figures: Mapping[Draw, Figure]
) -> None:
    (axes,) = figures[attenuation].axes
    medians = spectrum["tan_delta"].median(("chain", "draw")).to_numpy()
    low = spectrum["tan_delta"].quantile(0.05, ("chain", "draw")).to_numpy()
    for k, line in enumerate(medians_in(axes)):
        np.testing.assert_allclose(np.asarray(line.get_ydata()), medians[k])
        widest = axes.collections[2 * k].get_paths()[0].vertices
        assert np.asarray(widest)[:, 1].min() == pytest.approx(low[k].min())
    assert axes.get_xscale() == axes.get_yscale() == "log"


def test_a_panel_for_each_regime_shows_at_most_150_draws(
    spectrum: xr.Dataset, figures: Mapping[Draw, Figure]
) -> None:
    figure = figures[attenuation_draws]
    assert len(figure.axes) == 5
    for axes in figure.axes:
        (curves,) = (c for c in axes.collections if isinstance(c, LineCollection))
        assert len(curves.get_segments()) == 150
        assert curves.get_rasterized()
    assert "150 single draws" in words(figure)
    few = attenuation_draws(spectrum.isel(draw=slice(0, 10)))
    assert "20 single draws" in words(few)


def test_ratios_are_to_the_smallest_amplitude(figures: Mapping[Draw, Figure]) -> None:
    _, right = figures[amplitude_dependence].axes
    np.testing.assert_allclose(np.asarray(medians_in(right)[1].get_ydata()), 1.0)
    assert (np.asarray(medians_in(right)[4].get_ydata()) > 1.0).all()
    assert "2 ± 0.1 MPa" in right.get_ylabel()


@each_figure
def test_the_same_spectrum_in_any_order_gives_the_same_bytes(
    draw: Draw, spectrum: xr.Dataset, rendered: Mapping[Draw, bytes]
) -> None:
    shuffled = spectrum.isel(frequency=[3, 1, 0, 2, *range(19, 3, -1)])
    assert image(draw(shuffled), "svg") == rendered[draw]
    for one in ({"regime": [0]}, {"frequency": [3]}):
        draw(spectrum.isel(one)).draw_without_rendering()


POINTS = """# made up for a test
frequency_Hz, tan_delta, tan_delta_sd, series
1e-3, 0.41, 0.03, 1 MPa
1e-2, 0.22, , 1 MPa
1e-1, 0.11, 0.01,
"""


def write(folder: Path, text: str) -> Path:
    path = folder / "points.csv"
    path.write_text(text, encoding="utf-8")
    return path


def test_points_are_read_with_and_without_what_is_optional(tmp_path: Path) -> None:
    points = load_measured_attenuation(write(tmp_path, POINTS))
    assert points.frequency.tolist() == [1e-3, 1e-2, 1e-1]
    assert points.tan_delta.tolist() == [0.41, 0.22, 0.11]
    assert points.standard_deviation.tolist() == [0.03, 0.0, 0.01]
    assert points.series == ("1 MPa", "1 MPa", "measured")
    bare = load_measured_attenuation(str(write(tmp_path, "frequency_Hz,tan_delta\n0.01,0.2\n")))
    assert bare.series == ("measured",)
    assert bare.standard_deviation.tolist() == [0.0]


def test_bars_at_a_single_frequency_have_room(tmp_path: Path) -> None:
    fit = make_fit(tmp_path / "run", draws=30)
    regimes = [Regime(4e6, 1.5e6)]
    solved = evolving_attenuation(fitted_material(fit), [1e-2], regimes, max_draws=2)
    figure = attenuation(predict_attenuation(fit, [1e-2], regimes), solved)
    image(figure, "png")  # a warning would be an error
    low, high = figure.axes[0].get_xlim()
    assert low < 1e-2 < high


def test_points_are_drawn_over_the_spectrum(tmp_path: Path) -> None:
    spectrum = predict_attenuation(make_fit(tmp_path / "run", draws=30))
    points = load_measured_attenuation(write(tmp_path, POINTS))
    axes = attenuation(spectrum, measured=points).axes[0]
    containers = [one for one in axes.containers if isinstance(one, ErrorbarContainer)]
    drawn = {one.get_label(): one.lines[0].get_xydata() for one in containers}
    assert set(drawn) == {"1 MPa", "measured"}
    assert drawn["1 MPa"] == pytest.approx(np.array([[1e-3, 0.41], [1e-2, 0.22]]))
    (legend,) = axes.figure.legends
    assert {"1 MPa", "measured"} <= {text.get_text() for text in legend.get_texts()}
    assert not attenuation(spectrum).axes[0].containers
