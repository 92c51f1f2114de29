"""What `pyburgers new` writes for a loading history: creep, or a test driven by its readings."""

import itertools
import math
import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.common.units import UNITS, units_text
from pyburgers.kinds.column_names import ENGINEERING, plain
from pyburgers.kinds.experiment_file import slope_of
from pyburgers.kinds.loading_history.driver import is_at_one_rate, is_driven_by_rates
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.new_file import (
    LAYOUT,
    STRAIN_RATE,
    Columns,
    Description,
    Facts,
    NewFile,
    Question,
    compression_of,
    facts_of,
    filled,
    read_together,
    with_comment,
)

JUMP_DURATION_SHARE = 1e-3
"""Time that loading in no time is given, in shares of the time until the first reading."""

MAX_EARLY_SHARE = 0.05
"""Share of a relaxation before its first reading up to which time counts from the hold."""

MIN_LEAD_OF_CLOCK = 100.0
"""Durations of a test that its first reading lies behind zero, if its clock started long before."""

MIN_HELD_SHARE, MIN_FALL_RATIO, MAX_SHARE_AT_ONCE = 0.2, 3.0, 0.8
"""Of a strain that is held: the least share of the test, and by how much more the stress falls then
than the strain changes, relatively. A load that goes down does more than this share at once."""

STRESS = Question("stress_MPa", "imposed stress in MPa", float, example=1.0, key="stress")
HOLD_START = Question(
    "hold_start_time",
    "time from which the strain is held, in the unit of times (inf: it never is)",
    float,
    default=math.inf,
    key="end_time",
)
HELD_STRAIN = Question(
    "held_strain", "strain that is held, a fraction", float, example=1e-3, key="strain_rate_per_s"
)
LOADING_TIME = Question(
    "loading_time",
    "how long the strain was imposed until then, in the unit of times (0: in no time)",
    float,
    example=1.0,
    key="end_time",
)
"""Of a relaxation: the loading ahead of it may have been read or not."""

CONTROL_COMMENTS = {
    "stress_series": "the readings of the stress drive the test",
    "strain_series": "the readings of the strain drive the test",
    "hold_strain": "relaxation: the strain stays",
}


TEMPLATE = f"""
stage_time_unit = {{time_unit}}  # of the stages; {{time_units}}
stage_stress_unit = "MPa"  # of the stages; {{stress_units}}
compression = {{compression}}  # positive or negative: of stages and data
strain_measure = {{strain_measure}}  # true or engineering
stress_measure = {{stress_measure}}  # true or engineering

{{stages}}
[data]
file = {{file}}
{LAYOUT}\
time_column = {{time_column}}  # on the clock of the stages
time_unit = {{time_unit}}
strain_column = {{strain_column}}
strain_unit = {{strain_unit}}
stress_column = {{stress_column}}
stress_unit = {{stress_unit}}
relaxation_strain = {{relaxation_strain}}  # the stress column is the stress over this strain
{{reading_error}}
# [[microstructure]]  # measured in the sample, at one time or more
# time = "end"  # of the test; else in stage_time_unit
# grain_size_m = 165e-6
# grain_size_sd_m = 8e-6
"""

STAGE_TEMPLATE = """\
[[stages]]  # one after the other, without gaps
control = {control}  # {comment}
start_time = {start_time}
end_time = {end_time}
stress = {stress}  # in stage_stress_unit
strain_rate_per_s = {strain_rate_per_s}

"""


class LoadingHistoryFile(NewFile):
    """Stages of a stress, of a rate and a hold, or of readings; a rate turns with the strain."""

    experiment = HistoryExperiment
    needed = (("time",), ("strain", "stress", "relaxation_modulus"))
    quantities = frozenset({"time", "strain", "stress", "relaxation_modulus"})
    questions = (STRAIN_RATE, STRESS, HOLD_START, HELD_STRAIN, LOADING_TIME)
    template = TEMPLATE

    def recognise(self, columns: Columns) -> str | None:
        """Return what the stress and the strain do that is neither at one rate nor a cycle."""
        if "time" not in columns or not {"strain", "stress", "relaxation_modulus"} & columns.keys():
            return None
        strain = facts_of(columns["strain"]) if "strain" in columns else None
        if _hold_of(columns) is not None:
            return "the stress falls while the strain is held"
        if "stress" not in columns:
            return "there are time and strain but no stress"
        stress = facts_of(columns["stress"])
        if strain is None or strain.oscillates:
            return None
        # A load comes on at once: where the stress is read on its way up, a straight line of the
        # strain from there on is a rate that is imposed, also behind slack or friction.
        rises = stress.held_from > 1 and is_at_one_rate(*_rows(columns, "time", "strain"))
        if stress.is_steady and not rises:
            return "the stress stays the same while strain grows"
        by_rates = rises or is_driven_by_rates(*_rows(columns, "time", "strain", "stress"))
        if stress.is_in_levels and not by_rates:
            return "the stress goes in steps and stays the same between"
        return "the strain turns back" if strain.turns else None

    def select_columns(self, columns: Columns) -> Columns:
        """Return time, strain and stress, of which a modulus of relaxation takes the place."""
        found = super().select_columns(columns)
        needless = "relaxation_modulus" if "stress" in found else ""
        return {name: one for name, one in found.items() if name != needless}

    def propose_answers(self, columns: Columns, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return when a strain is held, and its size and loading as far as they were read."""
        first = _hold_of(columns)
        if first is None:
            return {}
        second = _second(columns)
        time, strain = _rows(columns, "time", "strain" if "strain" in columns else "time")
        if first:
            start = _end_of_loading(time, strain, first)
        else:
            start = 0.0 if 0 <= time[0] <= MAX_EARLY_SHARE * time[-1] else float(time[0])
        known = {HOLD_START.name: start / second}
        if "strain" in columns:
            held = float(f"{strain[-1] - (strain[0] if first else 0.0):.4g}")
            known[HELD_STRAIN.name] = held
            rate = given[STRAIN_RATE.name]
            if rate and not first:
                known[LOADING_TIME.name] = float(f"{abs(held / rate) / second:.4g}")
        if first:
            known[LOADING_TIME.name] = (start - float(time[0])) / second
        return known

    def allowed_answers(self, columns: Columns, given: Mapping[str, Any]) -> Collection[str]:
        """Return what belongs to the one that drives it, a stress or a rate.

        A stress needs readings of the strain, a rate those of the stress. Of rate, strain and time
        of the loading ahead of a hold two say all.
        """
        by_stress = {STRESS.name} if "strain" in columns else set()
        has_stress = "stress" in columns or "relaxation_modulus" in columns
        by_rate = {STRAIN_RATE.name, HOLD_START.name} if has_stress else set()
        if by_rate and _is_held(columns, given):
            loading = (STRAIN_RATE.name, HELD_STRAIN.name, LOADING_TIME.name)
            stated = [name for name in loading if given[name] is not None]
            by_rate |= set(stated[:2] if len(stated) > 1 else loading)
        for names in (by_stress, by_rate):
            if any(given[name] is not None for name in names):
                return names
        return by_stress | by_rate

    def required_answers(self, columns: Columns, given: Mapping[str, Any]) -> Collection[str]:
        """Return the stress, unless a rate is given or there are readings to drive the test.

        Without a column of the strain a rate drives it. Where a stress falls at a strain that is
        held, the hold is asked for, and its loading.
        """
        allowed = self.allowed_answers(columns, given)
        by_rate = given[STRESS.name] is None and HOLD_START.name in allowed
        if by_rate and _is_held(columns, given):
            if given[HOLD_START.name] is None:
                return (HOLD_START.name,)
            other = HELD_STRAIN.name if given[STRAIN_RATE.name] is None else STRAIN_RATE.name
            return (other, LOADING_TIME.name) if given[LOADING_TIME.name] is None else (other,)
        if "strain" not in columns:
            return (STRAIN_RATE.name, HOLD_START.name)
        driven = given[STRAIN_RATE.name] is not None or "stress" in columns
        return () if driven else (STRESS.name,)

    def describe_decisions(self, test: Description) -> Sequence[str]:
        """Say where the strain turns, and how loading in no time is written."""
        values, columns, unit = test.values, test.columns, test.columns["time"].unit
        is_held, start = _is_held(columns, values), f"{max(0.0, _start_of(columns)):.10g}"
        starts = f"the test starts with its first reading, at {start} {unit} of its clock"
        decided = () if is_held or start == "0" else (starts,)
        if values[STRESS.name] is not None:
            return decided
        if is_held:
            is_jump = values[LOADING_TIME.name] == 0
            lasted = f"loading in no time is written as a stage of {_loading(test)[1]:.3g} {unit}"
            return (lasted,) if is_jump else ()
        turns = ", ".join(f"{time:g}" for time in _turning_times(test.columns))
        stages = f"the readings of the strain drive the test, from rest at time {start}"
        if values[STRAIN_RATE.name] is not None:
            stages = "stages end there, and the rate changes its sign"
        turned = (f"the strain turns back at {turns} {unit}: {stages}",) if turns else ()
        return (*decided, *turned)

    def filling(self, test: Description) -> Mapping[str, object]:
        """Return the stages, measures and signs, and a modulus of relaxation as a stress."""
        stages = _stage_lines(test)
        reads_strain = any(one.startswith('control = "stress') for one in stages)
        error = "strain_uncertainty = 0.002" if reads_strain else "stress_uncertainty = 0.05"
        found: dict[str, object] = {
            "time_units": units_text("time"),
            "stress_units": units_text("stress"),
            "compression": compression_of(test, test.values[STRESS.name]),
            "strain_measure": _measure(test.columns, "strain"),
            "stress_measure": _measure(test.columns, "stress"),
            "stages": stages,
            "reading_error": [with_comment(f"# {error}", "of a reading, in its unit")],
        }
        modulus = test.columns.get("relaxation_modulus")
        if modulus is not None:
            rate, lasted = _loading(test)
            held = abs(rate) * lasted * _second(test.columns)
            found["stress_column"], found["stress_unit"] = modulus.column, modulus.unit
            found["relaxation_strain"] = float(f"{held:.6g}")
        return found


def _measure(columns: Columns, quantity: str) -> str:
    """Return the measure that the name of a column says."""
    name = plain(columns[quantity].name) if quantity in columns else ""
    return "engineering" if re.search(ENGINEERING, name) else "true"


def _rows(columns: Columns, *names: str) -> tuple[FloatArray, ...]:
    """Return what was read in SI, of the rows in which all of some quantities were."""
    return read_together(*(columns[name].si for name in names))


def _hold_of(columns: Columns) -> int | None:
    """Return the first reading, from 0, from which strain is held while stress falls, else None."""
    stress = "stress" if "stress" in columns else "relaxation_modulus"
    if not {stress, "time"} <= columns.keys():
        return None
    if "strain" not in columns:
        return 0 if Facts(_rows(columns, "time", stress)[1]).only_falls else None
    time, strain, falling = _rows(columns, "time", "strain", stress)
    if time.size == 0:  # read in turn
        return None
    first = Facts(strain).held_from
    if first:  # a stress that rises still is of the loading
        first += int(np.argmax(np.abs(falling[first:])))
    stress_then, strain_then = Facts(falling[first:]), Facts(strain[first:])
    is_long = time[-1] - time[first] >= MIN_HELD_SHARE * (time[-1] - time[0]) > 0
    largest_step = np.abs(np.diff(stress_then.values)).max(initial=0.0)
    at_once = largest_step > MAX_SHARE_AT_ONCE * np.ptp(stress_then.values)
    falls_more = stress_then.relative_range > MIN_FALL_RATIO * strain_then.relative_range
    falls = stress_then.only_falls and falls_more and not (first and at_once)
    return first if is_long and falls and np.any(strain_then.values) else None


def _end_of_loading(time: FloatArray, strain: FloatArray, first: int) -> float:
    """Return when (s) a strain reached the one that is held from a reading on, by its rate."""
    rate = slope_of(time[:first], strain[:first])
    left = (strain[-1] - strain[first - 1]) / rate if rate else math.inf
    return float(f"{min(time[first - 1] + max(left, 0.0), time[first]):.6g}")


def _is_held(columns: Columns, given: Mapping[str, Any]) -> bool:
    """Whether the strain is held from some time on, by answers or else by what was read."""
    start = given[HOLD_START.name]
    return _hold_of(columns) is not None if start is None else bool(start != math.inf)


def _stage_lines(test: Description) -> list[str]:
    """Return the stages of a stress, of a rate with a hold behind it, or of readings."""
    values, columns = test.values, test.columns
    start, end = _start_of(columns), float(np.nanmax(columns["time"].numbers))
    stress, rate = values[STRESS.name], values[STRAIN_RATE.name]
    if stress is not None:
        return _stage("stress", start, end, stress=stress)
    if _is_held(columns, values):
        hold_start, (rate, lasted) = values[HOLD_START.name], _loading(test)
        return [
            *_stage("strain_rate", hold_start - lasted, hold_start, strain_rate_per_s=rate),
            *_stage("hold_strain", hold_start, end),
        ]
    turns = _turning_times(columns)
    if rate is None and not turns:
        return _stage("stress_series", start, end)
    if rate is None:
        return [
            *_unread_loading(columns),
            *_stage("strain_series", float(np.nanmin(columns["time"].numbers)), end),
        ]
    return [
        text
        for k, (first, last) in enumerate(itertools.pairwise([start, *turns, end]))
        for text in _stage("strain_rate", first, last, strain_rate_per_s=rate * (-1) ** k)
    ]


def _start_of(columns: Columns) -> float:
    """Return when the test starts, in the unit of times: at 0, or earlier, or by another clock."""
    first, last = (float(end(columns["time"].numbers)) for end in (np.nanmin, np.nanmax))
    return first if first > MIN_LEAD_OF_CLOCK * (last - first) > 0 else min(0.0, first)


def _unread_loading(columns: Columns) -> list[str]:
    """Return the stage that leads from rest to a first reading of the strain behind time zero."""
    time, strain = _rows(columns, "time", "strain")
    if not (time[0] > 0 == _start_of(columns) and strain[0]):
        return []
    rate = float(f"{strain[0] / time[0]:.6g}")
    return _stage("strain_rate", 0.0, float(time[0]) / _second(columns), strain_rate_per_s=rate)


def _second(columns: Columns) -> float:
    """Return the unit (s) of the column of times."""
    return UNITS["time"][columns["time"].unit or "s"]


def _turning_times(columns: Columns) -> list[float]:
    """Return when the strain turns back, in the unit of times; not under loads or in cycles."""
    if not {"strain", "stress"} <= columns.keys():
        return []
    time, strain, stress = _rows(columns, "time", "strain", "stress")
    loads, facts = Facts(stress), Facts(strain)
    if loads.is_steady or loads.is_in_levels:
        return []
    return [float(time[k]) / _second(columns) for k in facts.turns]


def _loading(test: Description) -> tuple[float, float]:
    """Return rate (1/s) and duration (in the unit of times), never 0, of the loading of a hold."""
    values, times, second = test.values, test.columns["time"].numbers, _second(test.columns)
    rate, strain = values[STRAIN_RATE.name], values[HELD_STRAIN.name]
    lasted = values[LOADING_TIME.name]
    if lasted is None:
        return rate, abs(strain / rate) / second
    if lasted == 0:  # short beside the time to the first reading
        behind = times[times > values[HOLD_START.name]]
        lasted = JUMP_DURATION_SHARE * float(behind.min() - values[HOLD_START.name])
    return rate if strain is None else strain / (lasted * second), lasted


def _stage(control: str, start: float, end: float, **imposed: float) -> list[str]:
    comment = CONTROL_COMMENTS.get(control, "what is imposed; others: docs/loading_history.md")
    values = {"control": control, "comment": comment, "start_time": start, "end_time": end}
    return list(filled(STAGE_TEMPLATE, {**values, **imposed}))


NEW_FILE = LoadingHistoryFile()
