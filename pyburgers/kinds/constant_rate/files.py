"""Files of tests at constant rate: keys, readings put in order, and such tests simulated."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
import numpy.typing as npt
from pydantic import Field

from pyburgers.common.array_types import FloatArray
from pyburgers.common.columns import Cell, Column, DataFile, TextFilesTable, read_columns
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table, all_of, read_toml
from pyburgers.common.units import count_points, units_text
from pyburgers.kinds.constant_rate.experiment import (
    ConstantRateExperiment,
    RateSegment,
    _strain_at,
    _time_at,
    remarks_on,
)
from pyburgers.kinds.experiment import MeasuredMicrostructure
from pyburgers.kinds.experiment_file import (
    SIGNS_WERE_TURNED,
    Compression,
    ExperimentFile,
    Kind,
    MaxReadings,
    MicrostructureTable,
    departure,
    measured_microstructure,
    shared_values,
    sign_of,
    slope_of,
)
from pyburgers.kinds.limits import MAX_UNLOADED_SHARE, MAX_ZERO_SHARE
from pyburgers.kinds.loading_history.driver import MAX_READINGS, thinned, thinning_told
from pyburgers.kinds.odd_readings import order_text


class SegmentTable(Table):
    """One of [[segments]]."""

    strain_rate_per_s: float = Field(gt=0, description="the imposed strain rate in 1/s")
    start_strain: float = Field(ge=0, description="the strain (fraction) at which the rate starts")
    file: DataFile | None = Field(None, description="the data file of this segment")
    rows: dict[str, Cell] | None = Field(
        None, description="the rows of the data file of the whole test that are of this segment"
    )


class DataTable(TextFilesTable):
    """The table [data]."""

    file: DataFile | None = Field(None, description="the data file of the whole test")
    strain_column: Column | None = None
    strain_unit: str | None = Field(None, description=units_text("strain"))
    time_column: Column | None = Field(
        None,
        description="the time, in place of the strain; beside it, to compare with the stated rates",
    )
    time_unit: str | None = Field(None, description=units_text("time"))
    stress_column: Column
    stress_unit: str = Field(description=units_text("stress"))
    stress_uncertainty: float | None = Field(
        None, gt=0, description="the standard deviation of a reading in the unit of the stress"
    )
    max_readings: MaxReadings = MAX_READINGS


class ConstantRateFile(ExperimentFile):
    """The keys of a file."""

    protocol: Literal["constant_rate"] = Field(description="the kind of test")
    compression: Compression = Field("positive", description="its sign in the data files")
    final_strain: float | None = Field(
        None, gt=0, description="the strain (fraction) at the end of the test"
    )
    segments: list[SegmentTable] = Field(min_length=1, description="one table for each rate")
    data: DataTable | None = Field(None, description="the table that names the data files")
    microstructure: list[MicrostructureTable] = Field(
        default_factory=list, description="one table for each strain; in the unit of [data]"
    )


def check_segments(path: Path, segments: Sequence[SegmentTable]) -> None:
    """Check that segments start at 0 and follow each other."""
    starts = [segment.start_strain for segment in segments]
    if starts[0] != 0:
        raise InputError(
            f"{path}: key 'start_strain' in [[segments]] number 1: found {starts[0]:g}, expected "
            "0, the start of the test."
        )
    for number, (before, after) in enumerate(itertools.pairwise(starts), start=2):
        if after <= before:
            raise InputError(
                f"{path}: key 'start_strain' in [[segments]] number {number}: found {after:g}, "
                f"expected more than {before:g}, where the segment before starts."
            )


def check_data_keys(path: Path, file: ConstantRateFile) -> None:
    """Check that keys about data files fit together."""
    data, with_file = file.data, [segment.file is not None for segment in file.segments]
    if data is None:
        if any(with_file) or any(segment.rows for segment in file.segments):
            raise InputError(
                f"{path}: table [data] is missing, expected it because a segment names its data."
            )
        if file.final_strain is None:
            raise InputError(
                f"{path}: key 'final_strain' is missing, expected the strain (fraction) at the "
                "end of the test because there is no [data]."
            )
        return
    if data.file is not None and any(with_file):
        raise InputError(
            f"{path}: key 'file': found it in [data] and in [[segments]], expected one of the two."
        )
    with_rows = [segment.rows is not None for segment in file.segments]
    if any(with_rows) and (data.file is None or not all(with_rows)):
        raise InputError(
            f"{path}: key 'rows' in [[segments]]: expected it in every one of them or in none, and "
            "with it one 'file' in [data]."
        )
    if data.file is None and not all(with_file):
        raise InputError(
            f"{path}: key 'file' is missing, expected it in [data] or in every one of [[segments]]."
        )
    if data.strain_column is None and data.time_column is None:
        raise InputError(f"{path}: [data] needs a key 'strain_column' or 'time_column'.")
    data.check_pairs(path, "strain", "time")


JITTER_SHARE = 0.01


JITTER_STRAIN = 1e-3
"""Largest misplacement of a strain that counts as reading error: 1 % of the test's strain range,
at most 1e-3. A curve digitised from a figure is good to about 1 % of the axis."""


@dataclass(frozen=True, eq=False)
class Curve:
    """Points of one data file, or of some of its rows, as read.

    `selection`: words about its rows that were taken, to follow its name; empty for all.
    `strain`, `stress` (n_rows,): fraction and Pa in the order of the file.
    `lower`, `upper`: strains between which the points have to lie.
    `notes`: sentences about what was done to read them.
    """

    path: Path
    selection: str
    strain: FloatArray
    stress: FloatArray
    lower: float
    upper: float
    notes: tuple[str, ...] = ()

    @property
    def name(self) -> str:
        """Name of the file and the rows, as notices give it: without the folder."""
        return f"{self.path.name}{self.selection}"

    @property
    def place(self) -> str:
        """The file and the rows in full, as errors give it."""
        return f"{self.path}{self.selection}"

    @property
    def range(self) -> str:
        """Strains between which the points have to lie, in words."""
        upper = "the end" if np.isinf(self.upper) else f"{self.upper:g}"
        return f"{self.lower:g} to {upper}"


def join_curves(
    curves: Sequence[Curve], final_strain: float
) -> tuple[FloatArray, FloatArray, list[str]]:
    """Return strain (fraction, not decreasing) and stress (Pa), (n_points,), and what was done."""
    tolerance = min(JITTER_STRAIN, JITTER_SHARE * final_strain)
    strains, stresses = [np.empty(0)], [np.empty(0)]
    notices: list[str] = []
    largest = max((float(np.abs(curve.stress).max()) for curve in curves), default=0.0)
    for curve in curves:
        strain, moved = _inside(curve, tolerance)
        order, sorted_ = _order(curve, strain, tolerance)
        loaded = order[strain[order] > 0]
        strains.append(strain[loaded])
        stresses.append(curve.stress[loaded])
        notices += [*curve.notes, *moved, *sorted_]
        if loaded.size < strain.size:
            notices += _dropped(curve.name, curve.stress[strain == 0], largest)
    strain, stress = np.concatenate(strains), np.concatenate(stresses)
    if curves and strain.size == 0:
        raise InputError(f"{curves[0].place}: every point is at zero strain, expected a curve.")
    if curves and not stress.any():
        raise InputError(f"{curves[0].place}: every stress is zero, expected a curve.")
    return strain, stress, notices


def _dropped(name: str, at_rest: FloatArray, largest: float) -> Iterator[str]:
    """Say that points at zero strain are left out, and what their stresses (n,) may be; all Pa."""
    size = float(np.abs(at_rest).max())
    how_large = f", of up to {size / 1e6:.4g} MPa" if size > MAX_ZERO_SHARE * largest else ""
    yield (
        f"{name}: dropped {count_points(at_rest.size)} at zero strain{how_large}: the model is at "
        "rest there, without stress."
    )
    if size > MAX_UNLOADED_SHARE * largest:
        yield (
            f"{name}: {size / 1e6:.4g} MPa at zero strain is {100 * size / largest:.0f} % of the "
            "largest stress: an offset of the load cell, a pre-load or a total stress. "
            "Subtract an offset or a confining pressure from all stresses; a pre-load is a stage "
            "of its own in a loading_history."
        )


def unlike_rates(
    name: str, time: FloatArray, strain: FloatArray, imposed: FloatArray
) -> tuple[str, ...]:
    """Say where times (s) go back, or strain is not the one that rates impose, each (n_rows,)."""
    back = np.flatnonzero(np.diff(time) < 0)
    if back.size:
        k = back[0]
        return (
            f"{name}: data row {k + 2}: the time {time[k + 1]:g} s comes after {time[k]:g} s: "
            "expected times that do not go back, to compare the strain with the stated rates.",
        )
    far = departure(strain, imposed, float(np.abs([*strain, *imposed]).max()))
    if far is None:
        return ()
    (largest, first), slope = far, slope_of(time, strain)
    by_slope = "" if slope is None else f" (its slope is {slope:.3g} 1/s)"
    return (
        f"{name}: the strain over time{by_slope} lies up to {largest:.3g} from the strain "
        f"that the stated rates impose, which it leaves at data row {first + 1}; check "
        "units and rates, of which each change starts a segment.",
    )


def _inside(curve: Curve, tolerance: float) -> tuple[FloatArray, list[str]]:
    """Strains with points a reading error outside the range moved onto its ends, and notices."""
    strain = np.clip(curve.strain, curve.lower, curve.upper)
    distance = np.abs(strain - curve.strain)
    worst = int(np.argmax(distance))
    if distance[worst] > tolerance:
        raise InputError(
            f"{curve.place}: data row {worst + 1}: found strain {curve.strain[worst]:g}, expected "
            f"{curve.range} (within {tolerance:.2g})."
        )
    if distance[worst] == 0:
        return strain, []
    return strain, [
        f"{curve.name}: {count_points(np.count_nonzero(distance))} moved by at most "
        f"{distance[worst]:.2g} in strain onto the ends of the range from {curve.range}."
    ]


def _order(
    curve: Curve, strain: FloatArray, tolerance: float
) -> tuple[npt.NDArray[np.intp], list[str]]:
    """Stable order of strains that do not truly run backwards, and notices."""
    backwards = np.maximum.accumulate(strain) - strain
    worst = int(np.argmax(backwards))
    if backwards[worst] > tolerance:
        raise InputError(
            f"{curve.place}: data row {worst + 1}: found strain {strain[worst]:g}, which runs "
            f"backwards by {backwards[worst]:.2g}, expected increasing strain "
            f"(within {tolerance:.2g}).{order_text(strain)}"
        )
    order = np.argsort(strain, kind="stable")
    if backwards[worst] == 0:
        return order, []
    return order, [
        f"{curve.name}: {count_points(np.count_nonzero(backwards))} out of order by at most "
        f"{backwards[worst]:.2g} in strain sorted."
    ]


def load_constant_rate(
    path: Path, tables: Mapping[str, Any] | None = None
) -> ConstantRateExperiment:
    """Read and check the file of a test at constant rate, or its tables, and its readings.

    Strains misplaced by a reading error are put right, points at zero strain are dropped, and a
    long curve is thinned, each with a notice. Where files hold time alone, it counts from the
    start, and strain follows from the rates.
    """
    file = read_toml(path, ConstantRateFile, tables)
    segments = tuple(RateSegment(s.start_strain, s.strain_rate_per_s) for s in file.segments)
    values, _, curves = all_of(
        lambda: shared_values(path, file),
        lambda: check_segments(path, file.segments),
        lambda: _read_curves(path, file, segments),
    )
    unit, uncertainty = None, None
    if file.data is not None:
        unit = file.data.strain_unit
        uncertainty = file.data.in_si("stress_uncertainty", "stress_unit", "stress", path)
    microstructure = measured_microstructure(path, file.microstructure, unit, file.final_strain)
    final_strain = _final_strain(path, file, segments, curves, microstructure)
    strain, stress, changes = join_curves(curves, final_strain)
    if file.compression == "negative":
        changes = [SIGNS_WERE_TURNED, *changes]
    test = ConstantRateExperiment(
        **values,
        segments=segments,
        strain=strain,
        stress=stress,
        final_strain=final_strain,
        stress_uncertainty=uncertainty,
        microstructure=microstructure,
        notices=tuple(dict.fromkeys([*file.notices, *changes, *remarks_on(strain, stress)])),
    )
    return test if file.data is None else _thinned(test, file.data.max_readings)


def _thinned(test: ConstantRateExperiment, most: int) -> ConstantRateExperiment:
    """Return a test with about so many readings, as those of loading histories are chosen."""
    kept = thinned(
        test.strain, test.reading_segment, test.stress, lambda number: test.bounds[[number]], most
    )
    notices = (*test.notices, *thinning_told(kept))
    return replace(test, strain=test.strain[kept], stress=test.stress[kept], notices=notices)


def _read_curves(
    path: Path, file: ConstantRateFile, segments: Sequence[RateSegment]
) -> list[Curve]:
    """Read the data files, in SI units but otherwise as they are."""
    check_data_keys(path, file)
    data = file.data
    if data is None:
        return []
    sign = sign_of(file.compression)
    end = np.inf if file.final_strain is None else file.final_strain
    bounds = [*(segment.start_strain for segment in segments), end]
    parts = [
        (
            data.model_copy(
                update={
                    "file": data.file if segment.file is None else segment.file,
                    "rows": {**data.rows, **(segment.rows or {})},
                }
            ),
            "[data]" if data.file is not None else f"[[segments]] number {k + 1}",
            (bounds[k], bounds[k + 1]),
        )
        for k, segment in enumerate(file.segments)
    ]
    if data.file is not None and file.segments[0].rows is None:
        parts = [(data, "[data]", (0.0, end))]
    return [_curve(path, part, segments, named_in, sign, *ends) for part, named_in, ends in parts]


def _curve(
    path: Path,
    data: DataTable,
    segments: Sequence[RateSegment],
    named_in: str,
    sign: int,
    lower: float,
    upper: float,
) -> Curve:
    """Read the points of one file, or of some of its rows."""
    source = data.source(path)
    read = [name for name in ("strain", "time") if getattr(data, f"{name}_column") is not None]
    columns = {f"{name}_column": (f"{name}_unit", name) for name in (*read, "stress")}
    found, notes = read_columns(
        path,
        data,
        columns,
        named_in=named_in,
        has_own_clock="strain" in read or named_in == "[data]" or len(segments) == 1,
    )
    stress, time = sign * found["stress_column"], found.get("time_column")
    if "strain_column" not in found:
        strain = _strain_at(found["time_column"], segments)
        return Curve(source, data.selection, strain, stress, lower, upper, notes)
    strain = sign * found["strain_column"]
    if np.mean(strain < 0) > 0.5:
        expected, other = ("positive", "negative")[::sign]
        raise InputError(
            f"{source}: column {data.strain_column!r}: found strains to {sign * np.min(strain):g} "
            f"(fraction), which are {other}, expected {expected} ones: if compression is {other} "
            f'in this file, write compression = "{other}" in {path}.'
        )
    if time is not None:
        start = _time_at(strain[:1], segments)
        imposed = _strain_at(time - time[0] + start, segments)
        notes += unlike_rates(source.name, time, strain, imposed)
    return Curve(source, data.selection, strain, stress, lower, upper, notes)


def _final_strain(
    path: Path,
    file: ConstantRateFile,
    segments: Sequence[RateSegment],
    curves: Sequence[Curve],
    microstructure: Sequence[MeasuredMicrostructure],
) -> float:
    """Return the end of the protocol: the key, or else the largest strain in the data."""
    last_start = segments[-1].start_strain
    last_segment = f"'start_strain' in [[segments]] number {len(segments)}"
    if file.final_strain is None:
        sections = [one.strain for one in microstructure if one.strain is not None]
        seen = [*sections, *(np.max(curve.strain) for curve in curves)]
        final = float(max(seen, default=0.0))
        if final <= last_start:
            raise InputError(
                f"{path}: key {last_segment} is {last_start:g}, but the data end at strain "
                f"{final:g}, expected data beyond it or the key 'final_strain'."
            )
        return final
    if file.final_strain <= last_start:
        raise InputError(
            f"{path}: key 'final_strain': found {file.final_strain:g}, expected more than "
            f"{last_start:g}, the {last_segment}."
        )
    return file.final_strain


KIND = Kind(ConstantRateFile, load_constant_rate)
