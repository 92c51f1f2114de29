"""Quantities that span decades are shown by their logarithm, their priors with them."""

from itertools import pairwise
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from scipy import stats
from synthetic_fit import make_fit, make_prior, uniform

from pyburgers.drawing.style import few_ticks_of_decades, style
from pyburgers.model.display import shown_quantity
from pyburgers.page.decades import PriorOfLogarithm, logarithm_of, shown_draws, spans_decades
from pyburgers.page.figure_results import narrowed
from pyburgers.page.posterior_figures import prior_posterior


def test_decades_are_counted_between_the_ends_of_most_draws() -> None:
    rng = np.random.default_rng(1)
    assert not spans_decades(rng.uniform(1.0, 500.0, 4000))
    assert spans_decades(10 ** rng.uniform(0.0, 2.0, 4000))
    assert not spans_decades(rng.normal(0.0, 1.0, 4000))
    assert not spans_decades(np.full(10, 3.0))


def test_what_lies_evenly_in_its_own_unit_is_shown_in_it() -> None:
    rng = np.random.default_rng(1)
    assert not spans_decades(rng.beta(1.0, 1.5, 4000))  # a share, most of whose decades are empty
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


def test_names_say_of_what_the_logarithm_is() -> None:
    assert logarithm_of(shown_quantity("stress_exponent")).symbol == r"\log_{10}(n)"
    assert logarithm_of(shown_quantity("kelvin_viscosity")).symbol == (
        r"\log_{10}(\eta_K/\mathrm{Pa\,s})"
    )


def test_a_panel_over_decades_has_the_logarithm_and_the_truth_in_it(tmp_path: Path) -> None:
    fit = make_fit(tmp_path, chains=2, draws=200)
    draws = fit.posterior["posterior"].to_dataset()
    spread = 10 ** np.random.default_rng(3).uniform(9.0, 11.6, draws["kelvin_viscosity"].shape)
    fit.posterior["posterior"] = draws.assign(
        kelvin_viscosity=draws["kelvin_viscosity"].copy(data=spread)
    )
    (panel,) = (axes for axes in prior_posterior(fit).axes if "eta_K" in axes.get_xlabel())
    assert "log" in panel.get_xlabel()
    assert fit.experiment.true_parameters is not None
    truth = np.log10(fit.experiment.true_parameters["kelvin_viscosity"])
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
