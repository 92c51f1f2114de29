"""Data of a figure beside it."""

from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from matplotlib.figure import Figure
from page import html_of
from synthetic_fit import make_fit

from pyburgers.drawing.figure_data import COLUMNS, figure_data
from pyburgers.fitting.fit import Fit
from pyburgers.page.posterior_figures import figures_for


def rows(data: pd.DataFrame, series: str) -> list[list[float]]:
    return data.loc[data["series"] == series, ["x", "y"]].to_numpy().tolist()


def test_lines_dots_and_areas_are_there_in_units_of_the_axes() -> None:
    figure = Figure()
    upper, lower = figure.subplots(2, 1, sharex=True)
    upper.plot([1, 2], [3, np.nan], label="model")
    upper.errorbar([1, 2], [5, 6], yerr=0.5, label="readings", linestyle="none")
    upper.axhline(7.0)
    lower.scatter([1], [9])
    lower.fill_between([0, 1], [0, 0], [2, 2])
    lower.set(xlabel="strain (%)", ylabel="stress (MPa)", title="below")
    data = figure_data(figure)
    assert tuple(data.columns) == COLUMNS
    assert rows(data, "model") == [[1, 3]]
    readings = rows(data, "readings")
    assert readings[:2] == [[1, 5], [2, 6]]
    assert [1, 4.5] in readings
    assert rows(data, "dots 1") == [[1, 9]]
    assert [1, 2] in rows(data, "area 2")
    assert not (data["y"] == 7).any()
    assert set(data["x label"]) == {"strain (%)"}
    assert set(data["panel"]) == {"1", "2: below"}


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("run"), chains=2, draws=300)


def test_figures_of_single_draws_have_no_rows(fit: Fit) -> None:
    for recipe in figures_for(fit):
        data = figure_data(recipe.draw())
        assert (len(data) > 0) == (recipe.name != "pairs"), recipe.name
        assert np.isfinite(data[["x", "y"]].astype(float)).all(axis=None)


def test_the_file_beside_the_curve_has_the_readings(
    fit: Fit, sketched: None, tmp_path: Path
) -> None:
    html = html_of([fit], tmp_path)
    (file,) = (tmp_path / "figures").glob("*_stress_strain.csv")
    assert f'href="figures/{file.name}"' in html
    assert not list((tmp_path / "figures").glob("*_pairs.csv"))
    shown = np.array(rows(pd.read_csv(file), "synthetic data"))
    readings = fit.posterior["observed_data"].to_dataset()["stress"].to_numpy()
    np.testing.assert_allclose(shown[:, 1], readings * 1e-6, rtol=1e-6)
