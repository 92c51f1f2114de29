"""Readings as true measures, and beside what is imposed: before loads, at jumps, in stages."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from scipy.special import lambertw

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.kinds.experiment_file import departure
from pyburgers.kinds.limits import MAX_UNLOADED_SHARE, MAX_ZERO_SHARE
from pyburgers.kinds.loading_history.driver import reading_error
from pyburgers.kinds.loading_history.readings import Readings, Response
from pyburgers.kinds.loading_history.stages import (
    Driven,
    Leg,
    Measure,
    Stage,
    imposed_strains,
    imposed_stresses,
    legs_of,
)


def true_readings(
    path: Path,
    readings: Readings,
    stress: Measure,
    strain: Measure,
    zero: float = 0.0,
    compliance: float = 0.0,
) -> Readings:
    """Turn engineering measures into true ones.

    The true strain is -ln(1 - e), with e the shortening over the first length less the strain
    `zero` of a sample at rest, which is put back. `compliance`: of the apparatus (1/Pa).
    """
    true_strain = readings.strain - zero
    if strain == "engineering":
        if np.any(true_strain >= 1):
            raise InputError(
                f"{readings.source}: found an engineering strain of {np.nanmax(true_strain):g},"
                " expected less than 1 (fraction) in compression: check its unit."
            )
        true_strain = -np.log1p(-true_strain)
    stresses = readings.stress
    if stress == "engineering":
        if np.any(np.isfinite(readings.stress) & np.isnan(true_strain)):
            raise InputError(
                f"{path}: key 'stress_measure': found 'engineering' and a stress without a strain "
                f"in {readings.source}, expected the strain of every reading, which tells the area."
            )
        stresses = true_stress(readings.stress, true_strain, compliance, where=str(path))
    return replace(readings, stress=stresses, strain=true_strain + zero)


def true_stress(
    force: FloatArray, strain: FloatArray, compliance: float, *, where: str
) -> FloatArray:
    """Return the true stress σ = f exp(C σ - ε) of a force f over the first area (Pa)."""
    rigid = force * np.exp(-strain)
    if compliance == 0:
        return np.asarray(rigid)
    if np.any(compliance * rigid > np.exp(-1)):
        raise InputError(
            f"{where}: key 'compliance_per_Pa': found {compliance:g}, by which the apparatus takes "
            f"up a strain of more than {np.exp(-1):.2f} under {np.nanmax(rigid):.3g} Pa, expected "
            "a smaller compliance: check its unit."
        )
    return np.asarray(-lambertw(-compliance * rigid, 0).real / compliance)


MIN_STAGE_READINGS = 3
"""Of a stage behind its start, where a reading may still be that of the stage before."""


def unlike_imposed(readings: Readings, stages: Sequence[Stage]) -> list[str]:
    """Say in which stages what was read of the imposed quantity is another one."""
    legs = legs_of(stages)
    found = []
    for number, stage in enumerate(stages):
        time, read = readings.of(stage.driven, number)
        time, read = time[time > stage.start_time], read[time > stage.start_time]
        if time.size < MIN_STAGE_READINGS:
            continue
        imposed = _imposed(legs, number, time)
        if stage.driven == "strain":
            read, imposed = read - read[0], imposed - imposed[0]
        elsewhere = imposed_stresses(legs) if stage.driven == "stress" else imposed_strains(legs)
        far = departure(read, imposed, float(np.abs([*read, *imposed, *elsewhere]).max()))
        if far is not None:
            largest, first = far
            shown = f"{largest / 1e6:.3g} MPa" if stage.driven == "stress" else f"{largest:.3g}"
            found.append(
                f"Stage {number + 1}: the {stage.driven} that was read lies up to "
                f"{shown} from the one that is imposed, which it leaves at {time[first]:.4g} s; "
                "check units, signs and what is imposed."
            )
    return found


def _imposed(legs: Sequence[Leg], number: int, time: FloatArray) -> FloatArray:
    """Stress (Pa) that a stage imposes at times (s) in it, or strain since its start."""
    own = [leg for leg in legs if leg.stage == number]
    starts = np.array([leg.start_time for leg in own])
    values = np.array([leg.start_value for leg in own])
    if own[0].driven == "strain":
        values = np.array([0.0, *imposed_strains(own)[:-1]])
    k = np.searchsorted(starts, time, side="right") - 1
    return np.asarray(values[k] + np.array([leg.rate for leg in own])[k] * (time - starts[k]))


MAX_EQUAL_DISTANCE = 3.0
"""How far a reading may be from a state that it is taken for, in standard deviations."""

MAX_SAME_STRESS_DIFFERENCE = 1e-6
"""Relative difference of stresses that is no jump."""


def without_start(found: Response, stages: Sequence[Stage]) -> tuple[Response, list[str]]:
    """Leave out a reading at the start, where the model is at rest, unless a stress jumps there."""
    time, stage, value = found
    at_start = time == 0
    if legs_of(stages)[0].start_value != 0 or not at_start.any():
        return found, []
    size = float(np.abs(value[at_start]).max())
    alike = value[stage == stage[0]]
    how_large = ""
    if size > MAX_ZERO_SHARE * float(np.abs(alike).max()):
        how_large = f", {_shown(float(value[at_start][0]), stages[0].driven)},"
    sentence = f"The reading at the start{how_large} was dropped: the model starts at rest."
    return (time[~at_start], stage[~at_start], value[~at_start]), [sentence]


def without_states_before(
    found: Response,
    stages: Sequence[Stage],
    rest: tuple[float, float],
    stated: float | None,
    *,
    side_is_said: bool,
) -> tuple[Response, list[str]]:
    """Leave out strains at the time of a jump of the stress that are of the state before it.

    Such a reading equals that state as far as its error tells, and is nearer to it than to the
    next. Later than the first load the state lies between the last reading and the line through
    two.
    """
    time, stage, value = found
    legs = legs_of(stages)
    kept = np.ones(time.size, dtype=np.bool_)
    notices = []
    for k in np.flatnonzero(np.diff(stage, prepend=-1) > 0):
        number = int(stage[k])
        if time[k] != stages[number].start_time or not _jumps(legs, number):
            continue
        own = stage == number
        error = reading_error(time[own], value[own]) if stated is None else stated
        if number == 0:
            low, high, sd = rest[0], rest[0], float(np.hypot(rest[1], error))
        elif side_is_said or stages[number - 1].driven == "strain":
            continue
        else:
            low, high = _state_at(time[k], time[stage == number - 1], value[stage == number - 1])
            sd = np.sqrt(2) * error
        next_one = abs(value[own][1] - value[k]) if np.count_nonzero(own) > 1 else np.inf
        distance = max(low - value[k], value[k] - high, 0.0)
        if distance <= MAX_EQUAL_DISTANCE * sd and distance < next_one:
            kept[k] = False
            where = "start" if number == 0 else f"start of stage {number + 1}"
            notices.append(
                f"The reading at the {where}, {_shown(float(value[k]), 'stress')}, was dropped: it "
                "is of the state before the load."
            )
    return (time[kept], stage[kept], value[kept]), notices


def _jumps(legs: Sequence[Leg], number: int) -> bool:
    """Whether the stress jumps at the start of a stage that imposes it."""
    first = next(k for k, leg in enumerate(legs) if leg.stage == number)
    if legs[first].driven == "strain":
        return False
    before = 0.0
    if first > 0:
        if legs[first - 1].driven == "strain":
            return True
        before = legs[first - 1].end_value
    after = legs[first].start_value
    return abs(after - before) > MAX_SAME_STRESS_DIFFERENCE * max(abs(after), abs(before))


def _state_at(now: float, time: FloatArray, strain: FloatArray) -> tuple[float, float]:
    """Return between which strains it is at a time (s) after readings; none for no readings."""
    if time.size == 0:
        return np.inf, -np.inf
    last = float(strain[-1])
    earlier = np.flatnonzero(time < time[-1])
    if earlier.size == 0:
        return last, last
    k = earlier[-1]
    drawn = last + (strain[-1] - strain[k]) * (now - time[-1]) / (time[-1] - time[k])
    return min(last, float(drawn)), max(last, float(drawn))


def check_loaded(path: Path, found: Response, stages: Sequence[Stage]) -> None:
    """Refuse a test in which nothing is imposed, or stresses are read before anything is."""
    time, stage, value = found
    legs = legs_of(stages)
    first = next((leg for leg in legs if leg.rate != 0 or leg.start_value != 0), None)
    idle_until = np.inf if first is None else first.start_time
    is_stress = np.array([one.driven == "strain" for one in stages])[stage]
    stresses = np.concatenate([imposed_stresses(legs), value[is_stress]])
    largest = float(np.abs(stresses).max(initial=0.0))
    idle = is_stress & (time < idle_until) & (np.abs(value) > MAX_UNLOADED_SHARE * largest)
    if idle.any():
        raise InputError(
            f"{path}: [[stages]] number {stage[idle][0] + 1}: found a stress of "
            f"{_shown(float(value[idle][0]), 'strain')} although nothing was imposed up to it, "
            "expected the loading as a stage ahead of it, such as control 'strain_rate' with the "
            "strain and the time that it took: time counts from where the sample is at rest."
        )
    if first is None:
        raise InputError(
            f"{path}: [[stages]]: found zero wherever a stress or a strain is imposed, expected "
            "another value somewhere because a model at rest tells nothing."
        )


def _shown(value: float, driven: Driven) -> str:
    """Return a reading of what answers to what is imposed, with its unit."""
    return f"{value / 1e6:.4g} MPa" if driven == "strain" else f"a strain of {value:.4g}"
