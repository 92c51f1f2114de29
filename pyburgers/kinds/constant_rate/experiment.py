"""Tests at piecewise constant strain rate: the imposed rates, the measured curve, their files."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any, ClassVar

import numpy as np
import numpy.typing as npt

from pyburgers.common.columns import read_columns
from pyburgers.common.errors import InputError, all_of
from pyburgers.common.toml_files import read_toml
from pyburgers.kinds.constant_rate.curves import (
    Curve,
    join_curves,
    remarks_on,
    unlike_rates,
)
from pyburgers.kinds.constant_rate.file_tables import (
    ConstantRateFile,
    DataTable,
    check_data_keys,
    check_segments,
)
from pyburgers.kinds.experiment import Experiment, FloatArray, MeasuredMicrostructure
from pyburgers.kinds.experiment_file import (
    SIGNS_WERE_TURNED,
    measured_microstructure,
    microstructure_tables,
    shared_values,
    sign_of,
)
from pyburgers.kinds.likelihood import strains_of
from pyburgers.kinds.limits import far_reading
from pyburgers.model.peak_test import PeakTest
from pyburgers.model.read_quantities import STRESS

IntArray = npt.NDArray[np.int64]

LEAST_STRAIN = 1e-12
"""Strain from which on there is a solution: the solver cannot stop at rest."""

MAX_LIKELY_STRAIN_RATE, MIN_READ_SHARE = 1.0, 0.05
"""A unit may be wrong beyond this strain rate (1/s), and where readings end before this share of
the final strain."""


@dataclass(frozen=True)
class RateSegment:
    """Part of a test at one imposed strain rate.

    `start_strain`: strain (fraction) from which the rate holds, until the next segment or the end.
    `strain_rate`: imposed axial strain rate (1/s), positive.
    """

    start_strain: float
    strain_rate: float


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class ConstantRateExperiment(Experiment):
    """One test at piecewise constant strain rate in SI units.

    Attributes
    ----------
    segments : tuple of RateSegment
        The first starts at zero strain; start strains increase.
    strain : array, shape (n_points,)
        Axial strain (fraction, positive, non-decreasing) of the stresses. Strains may repeat.
    stress : array, shape (n_points,)
        Differential stress (Pa, compression positive) that the model is compared with.
    final_strain : float
        Strain at which the protocol ends, not below that of the last datum.
    stress_uncertainty : float or None
        Stated standard deviation of a reading (Pa), for checks of the residuals.
    """

    protocol: ClassVar[str] = "constant_rate"
    of_points: ClassVar[tuple[str, ...]] = ("strain", "stress")
    segments: tuple[RateSegment, ...]
    strain: FloatArray
    stress: FloatArray
    final_strain: float
    stress_uncertainty: float | None = None

    @property
    def position(self) -> FloatArray:
        """Strains of the stresses."""
        return self.strain

    @property
    def span(self) -> tuple[float, float]:
        """A strain next to rest, and the final one."""
        return LEAST_STRAIN, self.final_strain

    @property
    def response(self) -> FloatArray:
        """Stresses."""
        return self.stress

    @property
    def largest_stress(self) -> float:
        """Largest measured |σ| (Pa); only of an experiment with data."""
        return float(np.max(np.abs(self.stress)))

    @property
    def title(self) -> str:
        """Sample, material, first rate and kind of data."""
        rate = rate_text(self.segments[0].strain_rate)
        return (
            f"{self.id}: {self.material}, {self.temperature:g} K, "
            f"{'first ' if len(self.segments) > 1 else ''}{rate}, {self.provenance.kind} data"
        )

    @property
    def doubts(self) -> tuple[str, ...]:
        """Return doubts about rates that no press has and about missing readings at the end."""
        found = []
        fastest = max(segment.strain_rate for segment in self.segments)
        if fastest > MAX_LIKELY_STRAIN_RATE:
            found.append(f"a strain rate of {fastest:g} 1/s is unlikely; check its unit.")
        if self.n_points and self.strain[-1] < MIN_READ_SHARE * self.final_strain:
            found.append(
                f"readings end at a strain of {self.strain[-1]:g}, a small part of the final "
                f"{self.final_strain:g}; check the unit of the strains."
            )
        return (*found, *far_reading(self.stress / 1e6, "stress (MPa)"))

    @property
    def largest_strain(self) -> float | None:
        """Final strain."""
        return self.final_strain

    def own_tables(self) -> dict[str, Any]:
        """Return segments, readings and microstructure."""
        data: dict[str, Any] = {
            "file": {"strain": self.strain, "stress_Pa": self.stress},
            "missing": [],
            "strain_column": "strain",
            "strain_unit": "fraction",
            "stress_column": "stress_Pa",
            "stress_unit": "Pa",
            "stress_uncertainty": self.stress_uncertainty,
        }
        return {
            "final_strain": self.final_strain,
            "segments": [
                {"start_strain": s.start_strain, "strain_rate_per_s": s.strain_rate}
                for s in self.segments
            ],
            "data": data if self.n_points else None,
            "microstructure": microstructure_tables(self.microstructure) or None,
        }

    @property
    def noises(self) -> Mapping[str, float | None]:
        """Noise of the stress."""
        return {STRESS.noise: self.stress_uncertainty}

    @property
    def peak(self) -> PeakTest | None:
        """Largest stress at the first rate."""
        first = self.reading_segment == 0
        if not first.any():
            return None
        return PeakTest(
            strain_rate=self.segments[0].strain_rate,
            stress=float(self.stress[first].max()),
            temperature=self.temperature,
            grain_size=self.initial_grain_size,
        )

    @property
    def reading_segment(self) -> IntArray:
        """Segment of each observed point, from 0, shape (n_points,).

        If several points lie at the strain of a rate step, the first ends the segment before. The
        others are in the segment that begins there.
        """
        steps = [segment.start_strain for segment in self.segments[1:]]
        after_another = np.diff(self.strain, prepend=-1.0) == 0
        at_step = np.isin(self.strain, steps)
        return np.asarray(self.segment_of(self.strain) + (at_step & after_another))

    def segment_of(self, strain: FloatArray) -> IntArray:
        """Return the segment of strains, from 0; that of a rate step is the one that ends there."""
        steps = [segment.start_strain for segment in self.segments[1:]]
        return np.searchsorted(steps, strain, side="left")

    def time_at(self, strain: FloatArray) -> FloatArray:
        """Return the times (s since the start) at which strains are reached.

        Parameters
        ----------
        strain : array, shape (n,)
            Axial strain (fraction), not negative.
        """
        return _time_at(strain, self.segments)


def strain_grid(experiment: ConstantRateExperiment, shape: FloatArray) -> FloatArray:
    """Strains spread in the same way over every rate segment.

    `shape` (n_shape,): positions in a segment, increasing, more than 0 to 1. The result (n_shape *
    n_segments,): increasing; the strains of rate steps are among them exactly, since rounding that
    put one just behind a step would give the solver a segment too short to start in.
    """
    starts = np.array([segment.start_strain for segment in experiment.segments])
    ends = np.append(starts[1:], experiment.final_strain)
    grid = starts[:, np.newaxis] + (ends - starts)[:, np.newaxis] * shape
    grid[:, -1] = ends
    strain: FloatArray = grid.ravel()
    return strain


def rate_text(rate: float) -> str:
    """Strain rate (1/s) as matplotlib text."""
    mantissa, exponent = f"{rate:.2e}".split("e")
    return rf"${mantissa}\times10^{{{int(exponent)}}}$ s$^{{-1}}$"


def load_constant_rate(
    path: Path, tables: Mapping[str, Any] | None = None
) -> ConstantRateExperiment:
    """Read and check the file of a test at constant rate, or its tables, and its readings.

    Strains that are out of order or outside their segment by a reading error (see
    `pyburgers.kinds.constant_rate.curves`) are put right with a notice. Points at zero strain
    are dropped with one: the model starts at rest, with no stress whatever the parameters. Where
    data files hold time alone, it counts from the start, and strain follows from the imposed rates.
    Times beside strains are compared with the rates, and a notice says where they differ. Raise
    InputError if a file, key, unit or number is not what it has to be.
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
    return ConstantRateExperiment(
        **values,
        segments=segments,
        strain=strain,
        stress=stress,
        final_strain=final_strain,
        stress_uncertainty=uncertainty,
        microstructure=microstructure,
        notices=tuple(dict.fromkeys([*file.notices, *changes, *remarks_on(strain, stress)])),
    )


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
    curves = []
    for part, named_in, ends in parts:
        strain, stress, notes = _read_points(
            path, part, segments, named_in, sign, is_whole=data.file is not None
        )
        curves.append(Curve(part.source(path), part.selection, strain, stress, *ends, notes))
    return curves


def _read_points(
    path: Path,
    data: DataTable,
    segments: Sequence[RateSegment],
    named_in: str,
    sign: int,
    *,
    is_whole: bool,
) -> tuple[FloatArray, FloatArray, tuple[str, ...]]:
    """Strain (fraction) and stress (Pa) of one file, each of shape (n_rows,), and notes."""
    source = data.source(path)
    read = [name for name in ("strain", "time") if getattr(data, f"{name}_column") is not None]
    names = (*read, "stress")
    columns = {f"{name}_column": (f"{name}_unit", name) for name in names}
    values, notes = read_columns(
        path,
        data,
        columns,
        named_in=named_in,
        has_own_clock="strain" in read or is_whole or len(segments) == 1,
    )
    found = dict(zip(names, values, strict=True))
    stress, time = sign * found["stress"], found.get("time")
    if "strain" not in found:
        return _strain_at(found["time"], segments), stress, notes
    strain = sign * found["strain"]
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
    return strain, stress, notes


def _steps(segments: Sequence[RateSegment]) -> tuple[FloatArray, FloatArray]:
    """Start strains and rates (1/s) of the segments, each of shape (n_segments,)."""
    return (
        np.array([segment.start_strain for segment in segments]),
        np.array([segment.strain_rate for segment in segments]),
    )


def _step_times(starts: FloatArray, rates: FloatArray) -> FloatArray:
    """Return the times (s) at which the segments start."""
    return np.concatenate([[0.0], np.cumsum(np.diff(starts) / rates[:-1])])


def _time_at(strain: FloatArray, segments: Sequence[RateSegment]) -> FloatArray:
    """Return the times (s since the start) at which strains are reached."""
    starts, rates = _steps(segments)
    segment = np.clip(np.searchsorted(starts, strain, side="right") - 1, 0, None)
    times: FloatArray = _step_times(starts, rates)[segment]
    return times + (strain - starts[segment]) / rates[segment]


def _strain_at(time: FloatArray, segments: Sequence[RateSegment]) -> FloatArray:
    """Strain reached at times (s since the start); the first rate holds for times before it."""
    starts, rates = _steps(segments)
    times = _step_times(starts, rates)
    segment = np.clip(np.searchsorted(times, time, side="right") - 1, 0, None)
    strain: FloatArray = starts[segment] + (time - times[segment]) * rates[segment]
    return strain


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
        seen = [*strains_of(microstructure[-1:]), *(np.max(curve.strain) for curve in curves)]
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
