"""Measured dunite: its fits, and which law describes what follows a step of the strain rate.

The tests are those of Chopra and Paterson (1984) that come with the package (`data/dunite`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
from matplotlib.figure import Figure

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.common.units import with_error
from pyburgers.comparison.by_points import compare
from pyburgers.comparison.conclusions import about_gaps, pair_of
from pyburgers.comparison.pairs import PairOutcome
from pyburgers.comparison.results import LeaveOneOut
from pyburgers.comparison.same_data import data_hash
from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable
from pyburgers.drawing.panels import FittedCurve, curve_result, curve_with_residuals
from pyburgers.drawing.view import view_of
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.side_by_side import Task, task_of
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import with_variant
from pyburgers.protocols.protocol import load_experiment
from pyburgers.sampling.options import SamplerOptions

ONE_RATE = "dunite_4506"
"""A test at one rate, with a peak."""

ONE_RATE_DRAWS = 1000
"""Of each chain of its fit at least. Few readings leave long tails: with 500 draws a chain, 318 to
873 of them were independent in the tails of S_0 (three fits), and 400 are wanted."""

STEPPED: Mapping[str, tuple[str, Mapping[str, str]]] = MappingProxyType(
    {
        "dunite_4580": ("dunite_4580", {}),
        "dunite_4581": ("dunite_4581", {}),
        "dunite_4581_kelvin_power_law": ("dunite_4581", {"kelvin": "power_law"}),
        "dunite_4581_autocorrelated": ("dunite_4581", {"residuals": "autocorrelated"}),
    }
)
"""Fits of tests with two steps of the rate: by name the test, and what is not the standard law.

The standard one of a test comes first. Laws that need plain coordinates would take hours."""

TOGETHER = ("dunite_4580", "dunite_4469")
JOINT_RUN = "dunite_joint"
APPARATUS = ("maxwell_modulus", "kelvin_modulus", "kelvin_viscosity")
"""What tests fitted together do not share: loading curves also hold the apparatus."""

RATE_STEPS_KEY = "rate_steps"

_ANSWER_COLUMNS = {"sampled_well": "sampled well?", "describes_data": "describes the data?"}


def dunite_tasks(folder: Path, options: SamplerOptions) -> dict[str, Task]:
    """Return the fits of measured dunite, by the names of their runs.

    Parameters
    ----------
    folder : Path
        Of the shipped experiments.
    options : SamplerOptions
        Of every fit, that of `ONE_RATE` with `ONE_RATE_DRAWS` at least.
    """
    ids = (ONE_RATE, *(test for test, _ in STEPPED.values()), *TOGETHER)
    tests = {name: load_experiment(folder / f"{name}.toml") for name in ids}
    priors = default_priors("dunite")
    of_steps = {
        name: task_of(
            (replace(tests[test], id=name),), with_variant(priors, tests[test], laws), options
        )
        for name, (test, laws) in STEPPED.items()
    }
    joint = task_of(
        [tests[name] for name in TOGETHER],
        priors,
        options,
        pool=dict.fromkeys(APPARATUS, "separate"),
    )
    longer = replace(options, draws=max(options.draws, ONE_RATE_DRAWS))
    return {ONE_RATE: task_of([tests[ONE_RATE]], priors, longer), **of_steps, JOINT_RUN: joint}


def rate_steps_section(fits: Mapping[str, Fit]) -> PageSection:
    """Say which laws describe tests with steps of the strain rate, and how wide n is then.

    Parameters
    ----------
    fits : mapping of str to Fit
        By name, of one or several tests; the standard one of each test before its others.
    """
    groups = [LawsTried.of(group) for group in _by_data(fits)]
    first = groups[0].standard.experiment
    table = pd.concat([group.table() for group in groups])
    return PageSection(
        key=RATE_STEPS_KEY,
        title=f"A measured rock: {first.material} and steps of the strain rate",
        paragraphs=tuple(group.conclusion() for group in groups),
        details=(
            f"Measured: {'; '.join(g.standard.experiment.provenance.source for g in groups)}. The "
            "imposed rate changes twice in each test, so that the curve shows how stress goes over "
            "from one rate to the next, which a test at one rate does not.",
            *dict.fromkeys(sentence for group in groups for sentence in group.about_gaps()),
        ),
        tables=(
            PageTable(
                "variants",
                "Models that were tried",
                _shown(table),
                table.reset_index(),
                words=("test", "model", *_ANSWER_COLUMNS.values(), "against the best"),
                bad={
                    column: [answer != Outcome.YES.value for answer in table[name]]
                    for name, column in _ANSWER_COLUMNS.items()
                },
            ),
        ),
        figures=tuple(
            PageFigure(
                f"curve_{group.standard.experiment.id}",
                f"{group.standard.experiment.id}, {group.fits[group.chosen].variant.short_text} "
                "model",
                CURVE_CAPTION,
                partial(_curve, group.fits[group.chosen]),
                curve_result(_fitted_curve(group.fits[group.chosen])),
            )
            for group in groups
        ),
    )


CURVE_CAPTION = (
    "Measured stress (circles) with the predictive median (solid line), retrodictions (thin lines) "
    "and the band that should hold 90 % of new readings; dotted lines mark steps of the rate. "
    "Below: data minus the predictive median; runs of one sign are what the model misses."
)


def _by_data(fits: Mapping[str, Fit]) -> list[dict[str, Fit]]:
    """Put fits of the same data together, in the order of the first of each."""
    groups: dict[str, dict[str, Fit]] = {}
    for name, fit in fits.items():
        groups.setdefault(data_hash(fit), {})[name] = fit
    return list(groups.values())


@dataclass(frozen=True, eq=False)
class LawsTried:
    """Fits of one test by laws of their own.

    Attributes
    ----------
    fits : mapping of str to Fit
        By name; the standard one first.
    elpd : mapping of str to LeaveOneOut
        How each predicts, the best first; empty for a single fit.
    """

    fits: Mapping[str, Fit]
    elpd: Mapping[str, LeaveOneOut]

    @classmethod
    def of(cls, fits: Mapping[str, Fit]) -> "LawsTried":
        """Compare fits."""
        return cls(fits, compare(fits).results if len(fits) > 1 else {})

    @property
    def standard(self) -> Fit:
        """The fit with the standard laws."""
        return next(iter(self.fits.values()))

    @property
    def describing(self) -> list[str]:
        """Fits whose model describes the data."""
        return [name for name, fit in self.fits.items() if fit.describes_data is Outcome.YES]

    @property
    def chosen(self) -> str:
        """The fit that predicts best of those that describe the data, or else of all."""
        able = self.describing or list(self.fits)
        return next((name for name in self.elpd if name in able), able[0])

    def about_gaps(self) -> tuple[str, ...]:
        """Say what elpd compares where residuals correlate under some laws alone."""
        variants = [fit.variant for fit in self.fits.values()]
        correlated = [one.short_text for one in variants if one.residuals_correlate]
        return about_gaps(correlated, len(variants))

    def conclusion(self) -> str:
        """Say which laws describe the data and how wide n is, against the standard one."""
        fit, able, n_fits = self.fits[self.chosen], self.describing, len(self.fits)
        (mean, sd), (standard_mean, standard_sd) = _exponent(fit), _exponent(self.standard)
        width = f"n = {with_error(mean, sd)}"
        if fit is not self.standard:
            width += (
                f", {sd / standard_sd:.1f} times as wide as with the standard model "
                f"(n = {with_error(standard_mean, standard_sd)})"
            )
        name, model = self.standard.experiment.id, fit.variant.short_text
        tried = f"{n_fits} models" if n_fits > 1 else "one model"
        answers = fit.verdicts()
        if able:
            listed = ", ".join(self.fits[one].variant.short_text for one in able)
            verb = "describes" if len(able) == 1 else "describe"
            said = [
                f"{name}: of {tried}, {listed} {verb} the data as far as the "
                f"checks see. With {model}, {width}."
            ]
        else:
            tried, best = (
                (f"none of {tried} is shown to describe the data", "The one that predicts best is")
                if n_fits > 1
                else ("the one model that was fitted is not shown to describe the data", "It is")
            )
            said = [
                f"{name}: {tried}. {best} {model}, with "
                f"{width}, an interval that leaves out what the model misses."
            ]
        if answers[CheckKind.SAMPLING].outcome is not Outcome.YES:
            said.append(answers[CheckKind.SAMPLING].sentence)
        if fit.variant.residuals_correlate:
            said.append(
                "Correlated residuals say how far a smooth misfit may have moved n, not which "
                "physics is missing."
            )
        return " ".join(said)

    def table(self) -> pd.DataFrame:
        """Return what each model says of n and how it predicts.

        Returns
        -------
        DataFrame
            Index fit; columns test, model, sampled_well, describes_data, n_mean, n_sd, sd_ratio
            (over the standard fit's), stress_noise (Pa), elpd_difference to the best, its
            standard_error, outcome against the best ("best" for itself, "" without others).
        """
        _, standard_sd = _exponent(self.standard)
        rows = {}
        for name, fit in self.fits.items():
            mean, sd = _exponent(fit)
            rows[name] = {
                "test": self.standard.experiment.id,
                "model": fit.variant.short_text,
                "sampled_well": fit.sampled_well.value,
                "describes_data": fit.describes_data.value,
                "n_mean": mean,
                "n_sd": sd,
                "sd_ratio": sd / standard_sd,
                "stress_noise": float(fit.posterior["posterior"]["stress_noise"].mean()),
                **self._against_best(name),
            }
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("fit")

    def _against_best(self, name: str) -> dict[str, Any]:
        if not self.elpd:
            return {"elpd_difference": np.nan, "standard_error": np.nan, "outcome": ""}
        best = next(iter(self.elpd))
        if name == best:
            return {"elpd_difference": 0.0, "standard_error": 0.0, "outcome": "best"}
        pair = pair_of({best: self.elpd[best], name: self.elpd[name]})
        worse = "worse" if pair.outcome is PairOutcome.BETTER else pair.outcome.value
        return {
            "elpd_difference": pair.difference,
            "standard_error": pair.error,
            "outcome": worse,
        }


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    """Return tables of `LawsTried` as text."""
    noise = PARAMETER_BY_NAME["stress_noise"]
    errors = [with_error(*pair) for pair in zip(table["n_mean"], table["n_sd"], strict=True)]
    elpd = [
        "" if np.isnan(difference) else f"{difference:.1f} ± {error:.1f}"
        for difference, error in zip(table["elpd_difference"], table["standard_error"], strict=True)
    ]
    answers = {
        column: [answer.upper() if answer == Outcome.NO.value else answer for answer in table[name]]
        for name, column in _ANSWER_COLUMNS.items()
    }
    return pd.DataFrame(
        {
            "test": table["test"].tolist(),
            "model": table["model"].tolist(),
            **answers,
            "stress exponent n": errors,
            "sd / standard": table["sd_ratio"].map("{:.2f}".format).tolist(),
            f"residual s ({noise.display_unit})": [
                f"{value * noise.display_factor:.1f}" for value in table["stress_noise"]
            ],
            "elpd below the best": elpd,
            "against the best": table["outcome"].tolist(),
        }
    )


def _exponent(fit: Fit) -> tuple[float, float]:
    """Mean and standard deviation of n."""
    draws = fit.posterior["posterior"]["stress_exponent"]
    return float(draws.mean()), float(draws.std(ddof=1))


def _fitted_curve(fit: Fit) -> FittedCurve:
    return view_of(fit.experiment).curve(fit)


def _curve(fit: Fit) -> Figure:
    return curve_with_residuals(_fitted_curve(fit))
