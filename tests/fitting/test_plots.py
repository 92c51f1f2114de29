"""What a fit shows in a notebook: tables in units that people use, figures in given axes."""

from collections.abc import Iterator
from dataclasses import replace
from typing import Any

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


@pytest.mark.parametrize("units", ["si", "x", "", 5])
def test_other_units_of_a_summary_are_refused(units: Any, small_fit: Fit) -> None:
    with pytest.raises(InputError, match=f"units is {units!r}, expected 'display' or 'SI'"):
        small_fit.summary(units)


def test_a_fit_is_shown_in_a_line(small_fit: Fit, joint: Fit) -> None:
    where = small_fit.directory.path
    assert repr(small_fit) == f"<Fit of PIL40: 2 chains x 100 draws, {where}>"
    assert repr(joint).startswith("<Fit of PIL40+other: 2 chains x ")
    assert repr(joint["other"]).startswith("<Fit of other in PIL40+other: 2 chains x ")


def test_to_show_a_fit_checks_nothing(small_fit: Fit, monkeypatch: pytest.MonkeyPatch) -> None:
    def fail(*_: object) -> None:
        raise AssertionError("checked")

    monkeypatch.setattr("pyburgers.fitting.sampled_fit.run_checks", fail)
    assert "PIL40" in repr(replace(small_fit))


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
    with pytest.raises(InputError, match="5 was not sampled, expected one of maxwell_modulus"):
        small_fit.plot.posterior(5)  # type: ignore[arg-type]
