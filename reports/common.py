"""Helpers that the studies share."""

import json
import logging
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Protocol

import arviz as az
import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from matplotlib.axes import Axes

from pyburgers import Comparison, Experiment, PriorSet, rounded

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

DATA = Path(__file__).parents[1] / "data"

# The palette of Okabe and Ito (2008), as in the figures of the package.
BLACK, GREY = "#000000", "#b8b8b8"
ORANGE, SKY_BLUE, GREEN = "#E69F00", "#56B4E9", "#009E73"
BLUE, VERMILION, PURPLE = "#0072B2", "#D55E00", "#CC79A7"

VERDICT_COLUMNS: Mapping[str, str] = {
    "sampled_well": "sampled well?",
    "describes_data": "describes the data?",
}
"""Columns of tables with both verdicts on fits, and how a page names them."""


class Fitted(Protocol):
    """A test with draws and their solutions: a fit, a prediction, or draws of the prior."""

    @property
    def experiment(self) -> Experiment:
        """The test."""

    @property
    def priors(self) -> PriorSet:
        """Its resolved priors."""

    @property
    def posterior(self) -> xr.DataTree:
        """Its labelled draws."""


def tell_progress() -> None:
    """Print the progress of long calls."""
    logging.basicConfig(format="%(message)s")
    logging.getLogger("pyburgers").setLevel(logging.INFO)


def write_json(file: Path, content: object, *, indent: int = 2, allow_nan: bool = True) -> None:
    """Write a file, and its folder if there is none."""
    file.parent.mkdir(parents=True, exist_ok=True)
    text = json.dumps(content, indent=indent, ensure_ascii=False, allow_nan=allow_nan)
    file.write_text(f"{text}\n", encoding="utf-8")


def flat(values: xr.DataArray) -> FloatArray:
    """Return the draws of all chains along the first axis."""
    ordered = values.transpose("chain", "draw", ...).to_numpy()
    return np.asarray(ordered.reshape(-1, *ordered.shape[2:]), dtype=np.float64)


def parameter_draws(fit: Fitted, name: str) -> FloatArray:
    """All draws of a parameter (SI), shape (n_draws,)."""
    return flat(fit.posterior["posterior"].to_dataset()[name])


def prediction_draws(fit: Fitted, name: str) -> FloatArray:
    """All draws of a solution along the clock (SI), shape (n_draws, n_grid)."""
    return flat(fit.posterior["predictions"].to_dataset()[name])


def central(draws: FloatArray) -> FloatArray:
    """Return the quantiles of 5, 50 and 95 % over the draws, NaN left out, shape (3, ...)."""
    return np.asarray(np.nanquantile(draws, [0.05, 0.5, 0.95], axis=0))


def interval(draws: FloatArray, digits: str, unit: str = "") -> str:
    """Return median and central 90 % of draws as text, numbers in the given format."""
    low, median, high = (format(float(end), digits) for end in central(draws))
    return f"{median} [{low}, {high}]{unit}"


def with_error(value: float, error: float) -> str:
    """Return a number ± its standard deviation or error."""
    return f"{rounded(value, error)} ± {rounded(error, error)}"


def moments(draws: FloatArray) -> tuple[float, float]:
    """Mean and standard deviation of draws."""
    return float(draws.mean()), float(draws.std(ddof=1))


def rhat(draws: xr.Dataset) -> dict[str, float]:
    """R-hat of each variable; NaN of a single chain."""
    if draws.sizes["chain"] == 1:
        return dict.fromkeys(map(str, draws), np.nan)
    found = az.rhat(draws)
    return {str(name): float(found[name]) for name in draws}


def draw_band(axes: Axes, x: FloatArray, draws: FloatArray, colour: str, label: str) -> None:
    """Draw median and central 90 % of draws, shape (n_draws, n)."""
    low, median, high = central(draws)
    axes.fill_between(x, low, high, color=colour, alpha=0.22, linewidth=0)
    axes.plot(x, median, color=colour, linewidth=1.6, label=label)


def shown_verdicts(table: pd.DataFrame) -> dict[str, list[str]]:
    """Return the columns of verdicts of a table as a page shows them."""
    return {
        shown: ["NO" if answer == "no" else answer for answer in table[name]]
        for name, shown in VERDICT_COLUMNS.items()
    }


def bad_verdicts(table: pd.DataFrame) -> dict[str, list[bool]]:
    """Say in which rows a verdict is not yes, by the column of the page."""
    return {
        shown: [answer != "yes" for answer in table[name]]
        for name, shown in VERDICT_COLUMNS.items()
    }


UNSURE_BEST = "highest, not sampled well"


def against_best(
    fits: Iterable[str], comparison: Comparison | None
) -> dict[str, tuple[float, float, str]]:
    """Return by fit the difference of elpd to the best, its standard error, and the outcome.

    The outcome of the best itself is "best", or `UNSURE_BEST` if a check of its draws failed. Of
    one fit, which is compared with none, nothing is known.
    """
    if comparison is None:
        return dict.fromkeys(fits, (np.nan, np.nan, ""))
    best = next(iter(comparison.results))
    worse = {
        pair.worse: (
            pair.difference,
            pair.error,
            "worse" if pair.outcome == "better" else pair.outcome.value,
        )
        for pair in comparison.pairs()
        if pair.better == best
    }
    outcome = UNSURE_BEST if comparison.results[best].doubts else "best"
    return {best: (0.0, 0.0, outcome), **worse}


def shown_differences(table: pd.DataFrame) -> list[str]:
    """Return elpd_difference and standard_error of a table as text, empty where there is none."""
    pairs = zip(table["elpd_difference"], table["standard_error"], strict=True)
    return ["" if np.isnan(value) else f"{value:.1f} ± {error:.1f}" for value, error in pairs]
