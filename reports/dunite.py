"""Measured dunite: its fits, and which law describes what follows a step of the strain rate.

The tests are those of Chopra and Paterson (1984) that come with the package (`data/dunite`).
"""

from collections.abc import Mapping
from dataclasses import dataclass, replace

import pandas as pd
from common import (
    DATA,
    VERDICT_COLUMNS,
    against_best,
    bad_verdicts,
    moments,
    parameter_draws,
    shown_differences,
    shown_verdicts,
    with_error,
)

import pyburgers
from pyburgers import Comparison, Fit, Outcome, PageFigure, PageSection, PageTable, SamplerOptions

ONE_RATE = "dunite_4506"
"""A test at one rate, with a peak."""

ONE_RATE_DRAWS = 750
"""Of each chain of its fit at least. Few readings leave long tails: with 500 draws a chain, 318 to
873 of them were independent in the tails of S_0 (three fits), with 1000 draws 1237, and 400 are
wanted."""

STEPPED: Mapping[str, tuple[str, Mapping[str, str]]] = {
    "dunite_4580": ("dunite_4580", {}),
    "dunite_4581": ("dunite_4581", {}),
    "dunite_4581_kelvin_power_law": ("dunite_4581", {"kelvin": "power_law"}),
    "dunite_4581_autocorrelated": ("dunite_4581", {"residuals": "autocorrelated"}),
}
"""Fits of tests with two steps of the rate: by name the test, and what is not the standard law.

The standard one of a test comes first. Laws that need plain coordinates would take hours."""

TOGETHER = ("dunite_4580", "dunite_4469")
JOINT_RUN = "dunite_joint"
APPARATUS = ("maxwell_modulus", "kelvin_modulus", "kelvin_viscosity")
"""What tests fitted together do not share: loading curves also hold the apparatus."""

CURVE_CAPTION = (
    "Measured stress (circles) with the predictive median (solid line), retrodictions (thin lines) "
    "and the band that should hold 90 % of new readings; dotted lines mark steps of the rate. "
    "Below: data minus the predictive median; runs of one sign are what the model misses."
)


def dunite_tasks(options: SamplerOptions) -> dict[str, pyburgers.Task]:
    """Return the fits of measured dunite, by the names of their runs.

    All have the given options, that of `ONE_RATE` at least `ONE_RATE_DRAWS` draws.
    """
    ids = (ONE_RATE, *(test for test, _ in STEPPED.values()), *TOGETHER)
    tests = {name: pyburgers.load_experiment(DATA / "dunite" / f"{name}.toml") for name in ids}
    priors = pyburgers.priors("dunite")
    of_steps = {
        name: pyburgers.task_of(
            (replace(tests[test], id=name),),
            pyburgers.with_variant(priors, tests[test], laws),
            options,
        )
        for name, (test, laws) in STEPPED.items()
    }
    joint = pyburgers.task_of(
        [tests[name] for name in TOGETHER],
        priors,
        options,
        pool=dict.fromkeys(APPARATUS, "separate"),
    )
    longer = replace(options, draws=max(options.draws, ONE_RATE_DRAWS))
    return {
        ONE_RATE: pyburgers.task_of([tests[ONE_RATE]], priors, longer),
        **of_steps,
        JOINT_RUN: joint,
    }


def rate_steps_section(fits: Mapping[str, Fit]) -> PageSection:
    """Say which laws describe tests with steps of the strain rate, and how wide n is then.

    Fits are by name, of one or several tests; the standard one of each test before its others.
    """
    groups = [LawsTried.of(group) for group in _by_data(fits)]
    first = groups[0].standard.experiment
    table = pd.concat([group.table() for group in groups])
    return PageSection(
        key="rate_steps",
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
                words=("test", "model", *VERDICT_COLUMNS.values(), "against the best"),
                bad=bad_verdicts(table),
            ),
        ),
        figures=tuple(group.figure() for group in groups),
    )


def _by_data(fits: Mapping[str, Fit]) -> list[dict[str, Fit]]:
    """Put fits of the same readings together, in the order of the first of each."""
    groups: dict[bytes, dict[str, Fit]] = {}
    for name, fit in fits.items():
        groups.setdefault(fit.experiment.response.tobytes(), {})[name] = fit
    return list(groups.values())


@dataclass(frozen=True, eq=False)
class LawsTried:
    """Fits of one test by laws of their own, the standard one first, and how several predict."""

    fits: Mapping[str, Fit]
    comparison: Comparison | None

    @classmethod
    def of(cls, fits: Mapping[str, Fit]) -> "LawsTried":
        """Compare fits."""
        return cls(fits, pyburgers.compare(fits) if len(fits) > 1 else None)

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
        best_first = self.comparison.results if self.comparison else self.fits
        return next(name for name in best_first if name in able)

    def about_gaps(self) -> tuple[str, ...]:
        """Say what elpd compares where residuals correlate under some laws alone."""
        return self.comparison.gap_sentences(self.comparison.variants) if self.comparison else ()

    def figure(self) -> PageFigure:
        """Return the curve of the chosen fit."""
        fit = self.fits[self.chosen]
        name, model = self.standard.experiment.id, fit.variant.short_text
        return replace(
            pyburgers.page_figure(fit, "stress_strain"),
            name=f"curve_{name}",
            title=f"{name}, {model} model",
            caption=CURVE_CAPTION,
        )

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
        sampling, _ = fit.verdicts().values()
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
        if sampling.outcome is not Outcome.YES:
            said.append(sampling.sentence)
        if fit.variant.residuals_correlate:
            said.append(
                "Correlated residuals say how far a smooth misfit may have moved n, not which "
                "physics is missing."
            )
        return " ".join(said)

    def table(self) -> pd.DataFrame:
        """Return what each model says of n and how it predicts, by fit.

        Columns test, model, sampled_well, describes_data, n_mean, n_sd, sd_ratio (over the standard
        fit's), stress_noise (Pa), elpd_difference to the best, its standard_error, outcome against
        the best ("best" for itself, "" without others).
        """
        _, standard_sd = _exponent(self.standard)
        differences = against_best(self.fits, self.comparison)
        rows = {}
        for name, fit in self.fits.items():
            mean, sd = _exponent(fit)
            difference, error, outcome = differences[name]
            rows[name] = {
                "test": self.standard.experiment.id,
                "model": fit.variant.short_text,
                "sampled_well": fit.sampled_well.value,
                "describes_data": fit.describes_data.value,
                "n_mean": mean,
                "n_sd": sd,
                "sd_ratio": sd / standard_sd,
                "stress_noise": float(parameter_draws(fit, "stress_noise").mean()),
                "elpd_difference": difference,
                "standard_error": error,
                "outcome": outcome,
            }
        return pd.DataFrame.from_dict(rows, orient="index").rename_axis("fit")


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    """Return tables of `LawsTried` as text."""
    noise = pyburgers.shown_quantity("stress_noise")
    rows = table.to_dict("records")
    return pd.DataFrame(
        {
            "test": table["test"].tolist(),
            "model": table["model"].tolist(),
            **shown_verdicts(table),
            "stress exponent n": [with_error(row["n_mean"], row["n_sd"]) for row in rows],
            "sd / standard": [f"{row['sd_ratio']:.2f}" for row in rows],
            f"residual s ({noise.display_unit})": [
                f"{row['stress_noise'] * noise.display_factor:.1f}" for row in rows
            ],
            "elpd below the best": shown_differences(table),
            "against the best": table["outcome"].tolist(),
        }
    )


def _exponent(fit: Fit) -> tuple[float, float]:
    """Mean and standard deviation of n."""
    return moments(parameter_draws(fit, "stress_exponent"))
