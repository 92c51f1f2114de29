"""Where along a loading history the microstructure of the sample was measured."""

from collections.abc import Sequence
from typing import Annotated, Literal

import numpy as np
from pydantic import Field, PlainValidator
from pydantic_core import PydanticCustomError

from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stage_tables import StageSource
from pyburgers.kinds.loading_history.stages import Conventions, Leg, StageTable
from pyburgers.kinds.microstructure import (
    MeasuredMicrostructure,
    MeasuredTable,
    check_increasing,
    measured_row,
    row_text,
    strain_factor,
)
from pyburgers.model.prior_families import is_fixed_at
from pyburgers.model.priors import PriorSet
from pyburgers.model.variants import variant_of

END: Literal["end"] = "end"
"""Of the test, in the place of a time: the sample was sectioned after it."""

ROUNDING = 1e-9
"""Share of a path strain by which it may lie beyond the end: units were converted."""


def _checked_time(found: object) -> float | Literal["end"]:
    if found == END:
        return END
    if isinstance(found, bool) or not isinstance(found, int | float) or not np.isfinite(found):
        raise PydanticCustomError("time", 'a number or "end"')
    return float(found)


SectionTime = Annotated[float | Literal["end"], PlainValidator(_checked_time)]
"""A time in the unit of the stages, or the end of the test."""


class _PlaceTable(Table):
    """Where it was measured: at a time or a path strain."""

    time: SectionTime | None = Field(
        None, description='the time in the unit stage_time_unit, or "end" of the test'
    )
    strain: float | None = Field(
        None, gt=0, description="the path strain, in the place of the time"
    )


class SectionTable(MeasuredTable, _PlaceTable):
    """One of the tables [[microstructure]] of a loading history."""


def read_sections(
    test: StageSource,
    tables: Sequence[SectionTable],
    stage_tables: Sequence[StageTable],
    legs: Sequence[Leg],
    *,
    strain_unit: str | None,
    is_rigid: bool,
) -> tuple[MeasuredMicrostructure, ...]:
    """Check the tables [[microstructure]] of a loading history.

    `test`: the file, and how its numbers are meant.
    `tables`: its tables.
    `stage_tables`: its stages, whose times bound those of the tables.
    `legs`: what is imposed.
    `strain_unit`: of the strains in [data]; None: path strains are fractions.
    `is_rigid`: whether an imposed strain is all the specimen's.

    Raise InputError if a place is missing or given twice, lies outside the test or does not
    increase, or what was measured makes no sense.
    """
    factor = strain_factor(test.path, strain_unit)
    start, end = stage_tables[0].start_time, stage_tables[-1].end_time
    times = [end if table.time == END else table.time for table in tables]
    for number, (table, time) in enumerate(zip(tables, times, strict=True), start=1):
        where = row_text(test.path, number)
        _check_one_place(where, table)
        if time is not None and not start < time <= end:
            raise InputError(
                f"{where}: key 'time': found {time:g}, expected more than {start:g} and at most "
                f"{end:g} {test.conventions.time_unit}, where the test starts and ends."
            )
        if table.strain is not None:
            _check_strain(where, table.strain, factor, test.conventions, legs, is_rigid=is_rigid)
    check_increasing(test.path, "time", times)
    check_increasing(test.path, "strain", [table.strain for table in tables])
    return tuple(
        measured_row(
            test.path,
            number,
            table,
            strain=None if table.strain is None else table.strain * factor,
            time=None if time is None else time * test.conventions.time - float(test.bounds[0]),
        )
        for number, (table, time) in enumerate(zip(tables, times, strict=True), start=1)
    )


def _check_one_place(where: str, table: SectionTable) -> None:
    if (table.time is None) == (table.strain is None):
        found = "neither" if table.time is None else "both"
        raise InputError(
            f"{where}: found {found} of the keys 'time' and 'strain', expected one of them "
            '(time = "end" for a sample that was sectioned after the test).'
        )


def _check_strain(
    where: str,
    strain: float,
    factor: float,
    conventions: Conventions,
    legs: Sequence[Leg],
    *,
    is_rigid: bool,
) -> None:
    """Check a path strain, which adds up whatever its sign, and is a true one."""
    if conventions.strain_measure == "engineering":
        raise InputError(
            f"{where}: key 'strain': found {strain:g} with engineering strains, expected the key "
            "'time' because a path strain is a true one."
        )
    imposed = [abs(leg.end_value) for leg in legs if leg.driven == "strain"]
    is_known = is_rigid and len(imposed) == len(legs)
    if is_known and strain * factor > (1 + ROUNDING) * sum(imposed):
        raise InputError(
            f"{where}: key 'strain': found {strain:g}, expected at most {sum(imposed) / factor:g}, "
            "the path strain at the end of the test."
        )


def section_times(experiment: HistoryExperiment, priors: PriorSet) -> list[float | None]:
    """Return the time (s) at which each section needs the solution of a test fitted with `priors`.

    A time is None if the path strain alone says the microstructure. Raise InputError if grains
    follow the stress, and it is not known in advance when a path strain is reached.
    """
    if variant_of(priors, experiment).grain_size != "piezometric":
        return [one.time for one in experiment.microstructure]
    is_rigid = experiment.apparatus_compliance is None and (
        "apparatus_compliance" not in priors.priors
        or is_fixed_at(priors["apparatus_compliance"], 0.0)
    )
    times: list[float | None] = []
    for number, one in enumerate(experiment.microstructure, start=1):
        time = one.time
        if one.strain is not None:
            time = _time_at(experiment.legs, one.strain) if is_rigid else None
        if time is None:
            raise InputError(
                f"{experiment.id}: [[microstructure]] number {number}: found the key 'strain' with "
                "grain_size = piezometric, expected 'time' because the grain size depends on the "
                "stress on the way, and when the path strain is reached is not known in advance."
            )
        times.append(time)
    return times


def _time_at(legs: Sequence[Leg], path_strain: float) -> float | None:
    """Return the time (s) of a path strain; None where a stress imposed before makes it unknown."""
    before = 0.0
    for leg in legs:
        if leg.driven == "stress":
            return None
        after = before + abs(leg.end_value)
        if before < path_strain <= (1 + ROUNDING) * after:
            return min(leg.start_time + (path_strain - before) / abs(leg.rate), leg.end_time)
        before = after
    return None
