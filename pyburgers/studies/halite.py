"""Measured creep of rock salt: its fit, and where in the history the model misses it.

The record is that of Honorio et al. (2024) that comes with the package (`data/halite`).
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
from matplotlib.figure import Figure

from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable
from pyburgers.drawing.style import BLUE, GREEN, GREY, ORANGE, SKY_BLUE, VERMILION, style
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.side_by_side import Task, task_of
from pyburgers.model.priors import load_priors, shipped_prior_file
from pyburgers.model.variants import with_variant
from pyburgers.protocols.loading_history.experiment import LoadingHistory
from pyburgers.protocols.loading_history.files import load_loading_history
from pyburgers.protocols.protocol import protocol_of
from pyburgers.sampling.options import SamplerOptions

FloatArray = npt.NDArray[np.float64]

RUN = "halite_z3"

LAWS: Mapping[str, str] = {"grain_size": "constant"}
"""Grains do not change in 1.6 % of strain; hardening and the hyperbolic sine are in the priors."""

SHORT = SamplerOptions(chains=2, warmup=150, draws=150, seed=1)
"""Few draws: an iteration takes about a second."""

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


def halite_tasks(folder: Path) -> dict[str, Task]:
    """Return the fit of the measured creep, by the name of its run; it is short.

    Parameters
    ----------
    folder : Path
        Of the shipped record.
    """
    test = load_loading_history(folder / f"{RUN}.toml")
    priors = load_priors(shipped_prior_file(test.material, "hardening"))
    return {RUN: task_of([test], with_variant(priors, test, LAWS), SHORT)}


def parts_of_readings(test: LoadingHistory) -> npt.NDArray[np.str_]:
    """Tell in which of `PARTS` each reading of a history of imposed stress is, shape (n_points,).

    Parameters
    ----------
    test : LoadingHistory
        Stress is imposed in all its stages.
    """
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


def left_over(test: LoadingHistory, residual: FloatArray) -> pd.DataFrame:
    """Return what a model leaves over in each part of a history.

    Parameters
    ----------
    test : LoadingHistory
        Stress is imposed in all its stages.
    residual : array, shape (n_points,)
        Strain readings minus the model's.

    Returns
    -------
    DataFrame
        Index part, the last "all"; columns readings, rms, mean and largest (of either sign).
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


def halite_section(fit: Fit) -> PageSection:
    """Say how much of the measured creep the model leaves over, and where."""
    test = fit.experiment
    assert isinstance(test, LoadingHistory)
    residual = _residual(fit)
    table = left_over(test, residual)
    rms, mean = (
        dict(zip(table.index, table[name].to_numpy(), strict=True)) for name in ("rms", "mean")
    )
    whole, worst = rms["all"], max(PARTS, key=lambda part: rms.get(part, 0.0))
    largest = float(np.max(test.response))
    return PageSection(
        key="measured_creep",
        title=f"Measured creep: {test.material} under five loads",
        paragraphs=(
            f"The {fit.variant.short_text} model, whose fabric factor hardens the salt, leaves "
            f"{whole:.2g} (root mean square) of a strain of {largest:.2g}, "
            f"{100 * whole / largest:.1f} %. It is worst in the part '{worst}': "
            f"{rms[worst]:.2g}, on the mean {mean[worst]:+.2g}.",
        ),
        details=(
            f"Measured: {test.provenance.source} ({test.provenance.licence}). Differential stress "
            "was imposed and is taken as it was measured; axial strain is the response.",
            *(verdict.sentence for verdict in fit.verdicts().values()),
        ),
        tables=(
            PageTable(
                "left_over",
                "What is left over, by part of the history",
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
                "median of the model's, by part of the history; runs of one sign are what the "
                "model misses.",
                partial(_draw, test, residual),
                f"the root mean square is {whole:.2g} of strain, worst in the part '{worst}'.",
            ),
        ),
    )


def _residual(fit: Fit) -> FloatArray:
    """Strain readings minus the median of the model's, shape (n_points,)."""
    response = protocol_of(fit.experiment).response.name
    model = fit.posterior["model_response"][response].median(("chain", "draw")).to_numpy()
    residual: FloatArray = fit.experiment.response - model
    return residual


def _shown(table: pd.DataFrame) -> pd.DataFrame:
    scaled = {
        f"{name} (1e-4)": (1e4 * table[name]).map("{:+.1f}".format) for name in ("mean", "largest")
    }
    return pd.DataFrame(
        {
            "part": table.index,
            "readings": table["readings"].map("{:.0f}".format),
            "rms (1e-4)": (1e4 * table["rms"]).map("{:.1f}".format),
            **scaled,
        }
    ).reset_index(drop=True)


def _draw(test: LoadingHistory, residual: FloatArray) -> Figure:
    part = parts_of_readings(test)
    with style():
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
        lower.legend(ncols=3)
    return figure
