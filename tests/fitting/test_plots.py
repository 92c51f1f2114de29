"""What a fit shows in a notebook: tables in units that people use, figures in given axes."""

from collections.abc import Iterator

import matplotlib.pyplot as plt
import numpy as np
import pytest

from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit


@pytest.fixture(autouse=True)
def _close_figures() -> Iterator[None]:
    plt.switch_backend("agg")
    yield
    plt.close("all")


def test_a_summary_is_in_display_units_unless_si_is_asked_for(small_fit: Fit) -> None:
    shown, si = small_fit.summary(), small_fit.summary("SI")
    assert list(shown) == list(si)
    assert shown["unit"]["maxwell_modulus"] == "GPa"
    assert si["unit"]["maxwell_modulus"] == "Pa"
    for column in ("mean", "sd", "q5", "q95", "prior_mean", "prior_sd"):
        ratio = (si[column] / shown[column])["maxwell_modulus"]
        assert ratio == pytest.approx(1e9)
    np.testing.assert_array_equal(shown["rhat"], si["rhat"])


def test_a_notebook_shows_verdicts_and_table(small_fit: Fit) -> None:
    text = small_fit._repr_html_()
    assert "<b>PIL40</b>" in text
    assert "Was the posterior sampled well?" in text
    assert "maxwell_modulus" in text
    assert "<table" in text


def test_figures_go_into_given_axes(small_fit: Fit) -> None:
    _, axes = plt.subplots()
    assert small_fit.plot.stress_strain(ax=axes) is axes
    assert "stress" in axes.get_ylabel()
    assert small_fit.plot.residuals() is not axes
    drawn = small_fit.plot.posterior("maxwell_modulus")
    assert "GPa" in drawn.get_xlabel()
    low, high = drawn.get_xlim()
    assert low < float(small_fit.summary()["mean"]["maxwell_modulus"]) < high
    with pytest.raises(InputError, match="did you mean 'maxwell_modulus'"):
        small_fit.plot.posterior("maxwel_modulus")
