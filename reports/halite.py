"""Measured creep of rock salt: laws that are fitted to it, and where in the history they miss it.

The record is that of Honorio et al. (2024) that comes with the package (`data/halite`). Run as a
script, this fits all four laws and writes a page about them; those that harden take long to
sample::

    python reports/halite.py --out halite
"""

import argparse
import shlex
import sys
from collections.abc import Mapping
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import cast

import numpy as np
import numpy.typing as npt
import pandas as pd
from common import (
    BLUE,
    DATA,
    GREEN,
    GREY,
    ORANGE,
    SKY_BLUE,
    VERDICT_COLUMNS,
    VERMILION,
    FloatArray,
    against_best,
    bad_verdicts,
    shown_differences,
    shown_verdicts,
    tell_progress,
)
from matplotlib.figure import Figure

import pyburgers
from pyburgers import Fit, HistoryExperiment, PageFigure, PageSection, PageTable, Prior, PriorSet

RECORD = "halite_z3"

POWER_LAW, SINE, POWER_LAW_HARDENING, SINE_HARDENING = (
    f"halite_{law}" for law in ("power_law", "sine", "power_law_hardening", "sine_hardening")
)

LAWS: Mapping[str, str] = {
    POWER_LAW: "power law",
    SINE: "hyperbolic sine",
    POWER_LAW_HARDENING: "power law that hardens",
    SINE_HARDENING: "hyperbolic sine that hardens",
}
"""Fits by the names of their runs, and what the page calls their laws."""

QUICK = (POWER_LAW, SINE, SINE_HARDENING)
"""Laws that are sampled in some minutes of one core; the power law that hardens takes longer."""

SHORT = pyburgers.SamplerOptions(chains=2, warmup=100, draws=700, adapt_delta=0.95, seed=1)
"""Draws as far as they are needed for 400 independent ones: 0.4 of them or more are. Nothing
diverges here at 0.95, and the default of histories would take several times the gradients; so would
a warm-up of 150, whose first phase leaves the metric fewer draws than that of 100 does."""

LONG = pyburgers.SamplerOptions(chains=2, warmup=200, draws=600, adapt_delta=0.95, seed=1)
"""For laws that harden. A warm-up of 100 leaves the metric of the sine so few draws that chains of
400 still disagree."""

KEPT_OF_GRAIN_SIZE_EXPONENT = 0.1
"""Of the width of p's prior. A record of one grain size says nothing of it, and where the prior
reaches down to 0, a sixth of its draws were independent ones."""

CORRELATION = Prior.of_family(
    "residual_correlation_time",
    "lognormal",
    {"location": 1.0e5, "scale": 0.7},
    unit=pyburgers.shown_quantity("residual_correlation_time").si_unit,
    source="Misfits of one load, which lasts four days: 90 % of the prior lies between 9 h and "
    "3.7 days. Residuals that drift for weeks would take over the strain that a law does not reach",
)

HOUR, DAY = 3600.0, 86400.0

RAMP = 0.5e6 / HOUR
"""Stress rate (Pa/s) from which the sample counts as loaded or unloaded; here it was 2 MPa/h."""

PARTS: Mapping[str, str] = {
    "loading": ORANGE,
    "first day under load": VERMILION,
    "later under load": BLUE,
    "unloading": SKY_BLUE,
    "unloaded": GREEN,
}
"""Parts of the history, with their colours."""


PRIORS = DATA / "priors"


def halite_tasks() -> dict[str, pyburgers.Task]:
    """Return the fits of the measured creep, by the names of their runs; they are short."""
    test = cast(HistoryExperiment, pyburgers.load_experiment(DATA / "halite" / f"{RECORD}.toml"))
    return {
        name: pyburgers.task_of(
            [replace(test, id=name)],
            halite_priors(test, name),
            LONG if name in (SINE_HARDENING, POWER_LAW_HARDENING) else SHORT,
        )
        for name in LAWS
    }


def halite_priors(test: HistoryExperiment, name: str) -> PriorSet:
    """Return the priors of a fit of the record, by a key of `LAWS`.

    Grains stay as they are in 1.6 % of strain. Residuals are correlated in time, but for those of
    the sine that hardens: it follows each load more closely, and a drift over weeks would take the
    place of flow there.
    """
    hardening = pyburgers.load_priors(PRIORS / "hardening" / f"{test.material}.toml")
    plain = _of_one_grain_size(pyburgers.load_priors(PRIORS / f"{test.material}.toml"))
    of_fabric = ("steady_state_fabric_factor", "critical_strain_fabric")
    # The element of the plain priors takes all of a load's transient, which hardening takes else.
    of_element = ("kelvin_modulus", "kelvin_viscosity")
    priors = {
        POWER_LAW: plain,
        SINE: hardening.exchanging(*(plain[parameter] for parameter in of_element)),
        POWER_LAW_HARDENING: plain.exchanging(*(hardening[parameter] for parameter in of_fabric)),
        SINE_HARDENING: hardening,
    }[name]
    laws = {"grain_size": "constant"}
    if name in (POWER_LAW, SINE):
        laws["fabric"] = "constant"
    if name == SINE_HARDENING:
        return pyburgers.with_variant(priors, test, {**laws, "residuals": "independent"})
    return pyburgers.with_variant(priors, test, {**laws, "residuals": "autocorrelated"}).exchanging(
        CORRELATION
    )


def _of_one_grain_size(priors: PriorSet) -> PriorSet:
    """Hold p near the mean of the joint prior of the flow law."""
    flow_law = priors.flow_law
    assert flow_law is not None  # the shipped priors of rock salt have one
    share = np.where(
        np.array(flow_law.quantities) == "grain_size_exponent", KEPT_OF_GRAIN_SIZE_EXPONENT, 1.0
    )
    narrow = replace(flow_law, covariance=flow_law.covariance * np.outer(share, share))
    return pyburgers.with_flow_law(priors, narrow, priors.title)


def parts_of_readings(test: HistoryExperiment) -> npt.NDArray[np.str_]:
    """Tell in which of `PARTS` each reading of a history of imposed stress is."""
    legs = test.legs
    starts, ends = (
        np.array([getattr(leg, f"{end}_time") for leg in legs]) for end in ("start", "end")
    )
    rates = np.array([leg.rate for leg in legs])
    before = np.array([leg.start_value for leg in legs])
    leg = np.clip(np.searchsorted(ends, test.time), 0, len(legs) - 1)
    stress = before[leg] + rates[leg] * (test.time - starts[leg])
    loading_ends = ends[(rates > RAMP) & (np.append(rates[1:], 0.0) <= RAMP)]
    last = np.searchsorted(loading_ends, test.time, side="right") - 1
    since = np.where(last < 0, np.inf, test.time - loading_ends[last])
    return np.select(
        [rates[leg] > RAMP, rates[leg] < -RAMP, stress < 0.1 * before.max(), since < DAY],
        ["loading", "unloading", "unloaded", "first day under load"],
        "later under load",
    )


def left_over(test: HistoryExperiment, residual: FloatArray) -> pd.DataFrame:
    """Return what a model leaves over of strain readings, shape (n_points,), by part of a history.

    The last part is "all"; columns readings, rms, mean and largest (of either sign).
    """
    part = parts_of_readings(test)
    chosen = {name: residual[part == name] for name in PARTS} | {"all": residual}
    rows = {
        name: {
            "readings": values.size,
            "rms": float(np.sqrt(np.mean(values**2))),
            "mean": float(np.mean(values)),
            "largest": float(values[np.argmax(np.abs(values))]),
        }
        for name, values in chosen.items()
        if values.size
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("part")


def halite_section(fits: Mapping[str, Fit]) -> PageSection:
    """Say how much of the measured creep each law leaves over, and where.

    Fits, at least two, are of the same readings, by keys of `LAWS`.
    """
    residuals = {name: _residual(fit) for name, fit in fits.items()}
    tests = {name: _history(fit) for name, fit in fits.items()}
    parts = {name: left_over(tests[name], residuals[name]) for name in fits}
    comparison = pyburgers.compare(fits)
    laws = _laws_table(fits, parts, comparison)
    closest = str(laws["left_over"].idxmin())
    test, table = tests[closest], parts[closest]
    rms, mean = (
        dict(zip(table.index, table[name].to_numpy(), strict=True)) for name in ("rms", "mean")
    )
    whole, worst = rms["all"], max(PARTS, key=lambda part: rms.get(part, 0.0))
    largest = float(np.max(test.response))
    return PageSection(
        key="measured_creep",
        title=f"Measured creep: {test.material} under five loads",
        paragraphs=(
            f"Of {len(fits)} laws the {LAWS[closest]} leaves least over: {whole:.2g} (root mean "
            f"square) of a strain of {largest:.2g}, {100 * whole / largest:.1f} %. It is worst in "
            f"the part '{worst}': {pyburgers.rounded(rms[worst], rms[worst])}, on the mean "
            f"{pyburgers.rounded(mean[worst], rms[worst])}.",
            " ".join(_answers(laws, *about) for about in VERDICT_COLUMNS.items()),
        ),
        details=(
            f"Measured: {test.provenance.source} ({test.provenance.licence}). Differential stress "
            "was imposed and is taken as it was measured; axial strain is the response. What is "
            "left over is measured strain minus the median of the model's, all of it: nothing is "
            "taken off for residuals that correlate in time. Verdicts take the mean square over "
            "all draws, which is a little more.",
            *comparison.gap_sentences(LAWS),
            *_not_tried(fits),
            *(
                f"{LAWS[name]}: {verdict.sentence}"
                for name, fit in fits.items()
                for verdict in fit.verdicts().values()
            ),
        ),
        tables=(
            PageTable(
                "laws",
                "Laws that were tried",
                _shown_laws(laws),
                laws.reset_index(),
                words=("law", *VERDICT_COLUMNS.values()),
                bad=bad_verdicts(laws),
            ),
            PageTable(
                "left_over",
                f"What the {LAWS[closest]} leaves over, by part of the history",
                _shown(table),
                table.reset_index(),
                words=("part",),
            ),
        ),
        figures=(
            PageFigure(
                "left_over",
                "Where the model misses the record",
                "Top: imposed stress, the measured one as lines. Bottom: measured strain minus the "
                f"median of the {LAWS[closest]}, by part of the history; runs of one sign are what "
                "the model misses.",
                partial(_draw, test, residuals[closest]),
                f"the root mean square is {whole:.2g} of strain, worst in the part '{worst}'.",
            ),
        ),
    )


def _not_tried(fits: Mapping[str, Fit]) -> tuple[str, ...]:
    """Say which laws there are no fits of."""
    missing = [f"a {law}" for name, law in LAWS.items() if name not in fits]
    return (f"Not fitted here: {' and '.join(missing)}.",) if missing else ()


def _laws_table(
    fits: Mapping[str, Fit], parts: Mapping[str, pd.DataFrame], comparison: pyburgers.Comparison
) -> pd.DataFrame:
    """Return what each law leaves over and how it predicts, by fit.

    Columns law, model, both verdicts, left_over (rms), unloading (rms there), largest,
    elpd_difference to the best, its standard_error.
    """
    elpd = against_best(fits, comparison)
    rows = {
        name: {
            "law": LAWS[name],
            "model": fit.variant.short_text,
            "sampled_well": fit.sampled_well.value,
            "describes_data": fit.describes_data.value,
            "left_over": parts[name].loc["all", "rms"],
            "unloading": parts[name].loc["unloading", "rms"],
            "largest": parts[name].loc["all", "largest"],
            "elpd_difference": elpd[name][0],
            "standard_error": elpd[name][1],
        }
        for name, fit in fits.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("fit")


def _answers(laws: pd.DataFrame, verdict: str, column: str) -> str:
    """Say which laws a verdict is yes for."""
    yes = [law for law, answer in zip(laws["law"], laws[verdict], strict=True) if answer == "yes"]
    asked = column[:-1].capitalize()
    return f"{asked}: {', '.join(yes) or 'none of them'}."


def _in_1e_4(values: "pd.Series[float]", sign: str = "") -> list[str]:
    """Return strains as text in 1e-4."""
    return [f"{1e4 * value:{sign}.1f}" for value in values]


def _shown_laws(laws: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "law": laws["law"].tolist(),
            **shown_verdicts(laws),
            "left over, rms (1e-4)": _in_1e_4(laws["left_over"]),
            "unloading, rms (1e-4)": _in_1e_4(laws["unloading"]),
            "largest (1e-4)": _in_1e_4(laws["largest"]),
            "elpd below the best": shown_differences(laws),
        }
    )


def _history(fit: Fit) -> HistoryExperiment:
    """Return the test of a fit; all that this study fits are loading histories."""
    return cast(HistoryExperiment, fit.experiment)


def _residual(fit: Fit) -> FloatArray:
    """Strain readings minus the median of the model's, shape (n_points,)."""
    (response,) = fit.posterior["model_response"].to_dataset().data_vars.values()
    model = response.median(("chain", "draw")).to_numpy()
    residual: FloatArray = fit.experiment.response - model
    return residual


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    return pd.DataFrame(
        {
            "part": table.index.to_list(),
            "readings": [f"{n:.0f}" for n in table["readings"]],
            "rms (1e-4)": _in_1e_4(table["rms"]),
            "mean (1e-4)": _in_1e_4(table["mean"], "+"),
            "largest (1e-4)": _in_1e_4(table["largest"], "+"),
        }
    )


def _draw(test: HistoryExperiment, residual: FloatArray) -> Figure:
    part = parts_of_readings(test)
    with pyburgers.style():
        figure = Figure(figsize=(8.0, 5.0), layout="constrained")
        upper, lower = figure.subplots(2, 1, sharex=True, height_ratios=[1, 2])
        for leg in test.legs:
            days = np.array([leg.start_time, leg.end_time]) / DAY
            upper.plot(days, np.array([leg.start_value, leg.end_value]) / 1e6, color=BLUE)
        lower.axhline(0.0, color=GREY, linewidth=1.0)
        for name, colour in PARTS.items():
            own = part == name
            lower.plot(
                test.time[own] / DAY,
                1e4 * residual[own],
                "o",
                markersize=3,
                color=colour,
                label=name,
            )
        upper.set_ylabel("stress (MPa)")
        lower.set_ylabel("strain left over (1e-4)")
        lower.set_xlabel("time (days)")
        figure.legend(ncols=len(PARTS), loc="outside lower center")
    return figure


def main() -> None:
    """Fit all laws, and write the page."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("halite"), help="folder of runs and page")
    out = parser.parse_args().out
    tell_progress()
    command = shlex.join(["python", *sys.argv])
    fits = pyburgers.fit_side_by_side(halite_tasks(), out / "runs", command=command)
    page = pyburgers.write_report(
        list(fits.values()),
        out,
        title="Measured creep of rock salt",
        command=command,
        extras=[halite_section(fits)],
    )
    print(page)


if __name__ == "__main__":
    main()
