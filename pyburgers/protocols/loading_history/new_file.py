"""What `pyburgers new` writes for a loading history: creep, or a test driven by its readings."""

import math
from collections.abc import Collection, Mapping
from typing import Any

import numpy as np
import numpy.typing as npt

from pyburgers.common.text_tables import TextTable
from pyburgers.protocols.guessed_columns import GuessedColumn, goes_back_and_forth, numbers_of
from pyburgers.protocols.loading_history.experiment import LoadingHistory
from pyburgers.protocols.new_file import (
    STRAIN_RATE,
    Description,
    NewFile,
    Question,
    column_lines,
    compression_of,
    layout_lines,
    line,
    optional,
    with_comment,
)

STEADY_STRESS = 0.05
"""Relative range of a stress that counts as constant."""

LEAST_READINGS = 5
"""Of a load among several, for most of them."""

STRESS = Question("stress_MPa", "imposed stress in MPa", float)
HOLD_START = Question(
    "hold_start_time",
    "time from which the strain is held, in the unit of times (inf: it never is)",
    float,
    default=math.inf,
)
LOADING_TIME = Question(
    "loading_time", "how long the strain was imposed until then, in the unit of times", float
)
"""Of a relaxation: the loading ahead of it may have been read or not."""

CONTROL_COMMENTS = {
    "stress_series": "the readings of the stress drive the test",
    "hold_strain": "relaxation: the strain stays",
}


class LoadingHistoryFile(NewFile):
    """One stage, driven by a stress or a rate that is given, or by the readings of the stress.

    Behind a rate the strain may be held, which is a second stage.
    """

    experiment = LoadingHistory
    needed = (("time",), ("strain", "stress"))
    quantities = frozenset({"time", "strain", "stress"})
    questions = (STRAIN_RATE, STRESS, HOLD_START, LOADING_TIME)

    def suits(self, table: TextTable, columns: Mapping[str, GuessedColumn]) -> str | None:
        """Return that strain grows in time under a constant stress, or one that is not read."""
        if not {"time", "strain"} <= columns.keys():
            return None
        if "stress" not in columns:
            return "there are time and strain but no stress"
        if goes_back_and_forth(numbers_of(table, columns, "strain")):
            return None
        stress = numbers_of(table, columns, "stress")
        level = np.median(stress)
        if level and np.ptp(stress[stress.size // 10 :]) < STEADY_STRESS * abs(level):
            return "the stress stays the same while strain grows"
        return "the stress goes in steps and stays the same between" if _in_steps(stress) else None

    def taken(self, columns: Collection[str], given: Mapping[str, Any]) -> Collection[str]:
        """Return what belongs to the stress or the rate that drives it, of which there is one.

        A stress needs readings of the strain, a rate those of the stress.
        """
        by_stress = {STRESS.name} if "strain" in columns else set()
        by_rate = {STRAIN_RATE.name, HOLD_START.name} if "stress" in columns else set()
        if by_rate and _is_held(given):
            by_rate.add(LOADING_TIME.name)
        for names in (by_stress, by_rate):
            if any(given[name] is not None for name in names):
                return names
        return by_stress | by_rate

    def asked(self, columns: Collection[str], given: Mapping[str, Any]) -> Collection[str]:
        """Return the stress, unless a rate is given or there are readings to drive the test.

        Without a column of the strain a rate drives it: the stress is what was read.
        """
        if _is_held(given):
            return (STRAIN_RATE.name, LOADING_TIME.name)
        if "strain" not in columns:
            return (STRAIN_RATE.name, HOLD_START.name)
        driven = given[STRAIN_RATE.name] is not None or "stress" in columns
        return () if driven else (STRESS.name,)

    def lines(self, test: Description) -> list[str]:
        """Return the stages and the columns."""
        compression = compression_of(test, test.values[STRESS.name])
        return [
            line("stage_time_unit", test.columns["time"].unit, "of the stages; s, min or h"),
            line("stage_stress_unit", "MPa", "of the stages; Pa, MPa or GPa"),
            line("compression", compression, "positive or negative: of stages and data"),
            line("strain_measure", "true", "or engineering; stress_measure likewise"),
            "",
            *_stage_lines(test),
            "[data]",
            line("file", test.file),
            *layout_lines(test),
            *column_lines(test, "time", comment="on the clock of the stages"),
            *column_lines(test, "strain"),
            *column_lines(test, "stress"),
            optional("strain_uncertainty = 0.002", "of a reading, in its unit"),
            optional("[[microstructure]]", "measured in the sample, at one time or more"),
            optional('time = "end"', "of the test; else in stage_time_unit"),
            "# grain_size_m = 165e-6",
            "# grain_size_sd_m = 8e-6",
        ]


def _in_steps(stress: npt.NDArray[np.float64]) -> bool:
    """Whether a stress is several loads, each read a few times or more.

    A curve that is steep at first has many steps too, but of a reading each.
    """
    steady = STEADY_STRESS * np.max(np.abs(stress))
    loads = np.split(stress, np.flatnonzero(np.abs(np.diff(stress)) > steady) + 1)
    return (
        len(loads) > 1
        and np.median([load.size for load in loads]) >= LEAST_READINGS
        and all(np.ptp(load) < steady for load in loads)
    )


def _is_held(given: Mapping[str, Any]) -> bool:
    """Whether answers say that the strain is held from some time on."""
    return given[HOLD_START.name] not in (None, math.inf)


def _stage_lines(test: Description) -> list[str]:
    """Return the stage of a stress, of a rate with a hold behind it, or of readings."""
    values = test.values
    times = numbers_of(test.table, test.columns, "time")
    start, end = min(0.0, float(times.min())), float(times.max())
    stress, rate = values[STRESS.name], values[STRAIN_RATE.name]
    if stress is not None:
        return _stage("stress", start, end, line("stress", stress, "in stage_stress_unit"))
    if rate is None:
        return _stage("stress_series", start, end)
    loading = line(STRAIN_RATE.name, rate)
    if not _is_held(values):
        return _stage("strain_rate", start, end, loading)
    hold_start = values[HOLD_START.name]
    return [
        *_stage("strain_rate", hold_start - values[LOADING_TIME.name], hold_start, loading),
        *_stage("hold_strain", hold_start, end),
    ]


def _stage(control: str, start: float, end: float, *imposed: str) -> list[str]:
    comment = CONTROL_COMMENTS.get(control, "what is imposed; others: docs/loading_history.md")
    return [
        with_comment("[[stages]]", "one after the other, without gaps"),
        line("control", control, comment),
        line("start_time", start),
        line("end_time", end),
        *imposed,
        "",
    ]


NEW_FILE = LoadingHistoryFile()
