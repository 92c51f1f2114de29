"""Tests at piecewise constant strain rate: the imposed rates and the measured curve."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.common.units import count_points, rounded_to
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.limits import unlikely_strain_rate
from pyburgers.kinds.loading_history.driver import MAX_READINGS
from pyburgers.kinds.odd_readings import odd_readings, opposed_stresses, repeated
from pyburgers.model.parameters import PARAMETERS
from pyburgers.model.peak_test import PeakTest
from pyburgers.model.read_quantities import STRESS
from pyburgers.model.residual_laws import draw_residuals

LEAST_STRAIN = 1e-12
"""Strain from which on there is a solution: the solver cannot stop at rest."""


MIN_READ_SHARE = 0.05
"""A unit may be wrong where readings end before this share of the final strain."""


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

    Examples
    --------
    >>> test = pyburgers.load_experiment(data / "ice" / "PIL40.toml")
    >>> type(test).__name__, test.temperature
    ('ConstantRateExperiment', 260.0)
    """

    protocol: ClassVar[str] = "constant_rate"
    laws: ClassVar[Mapping[str, Sequence[str]]] = {}
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
    def duration(self) -> float:
        """Time (s) between the first and the last reading."""
        return float(np.ptp(self.time_at(self.strain))) if self.n_points else 0.0

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
        found = unlikely_strain_rate(max(segment.strain_rate for segment in self.segments))
        if self.n_points and self.strain[-1] < MIN_READ_SHARE * self.final_strain:
            found.append(
                f"readings end at a strain of {self.strain[-1]:g}, a small part of the final "
                f"{self.final_strain:g}; check the unit of the strains."
            )
        return (*found, *odd_readings(self.stress / 1e6, "stress (MPa)"))

    @property
    def bounds(self) -> FloatArray:
        """Strains at which segments start, and the final one, shape (n_segments + 1,)."""
        return np.array([*(one.start_strain for one in self.segments), self.final_strain])

    @property
    def largest_strain(self) -> float | None:
        """Final strain."""
        return self.final_strain

    def to_be_solved(self) -> Self:
        """Return the test without its points."""
        return replace(self, strain=np.empty(0), stress=np.empty(0), microstructure=())

    def known_columns(self, at: FloatArray) -> Mapping[str, FloatArray]:
        """Return the times of strains."""
        return {"time_s": self.time_at(at)}

    def with_noise(
        self, response: FloatArray, values: Mapping[str, float], rng: np.random.Generator
    ) -> Self:
        """Put stresses with residuals, which may correlate along strain, in the place of others."""
        noise = np.full(self.n_points, values["stress_noise"])
        residuals = draw_residuals(self, noise, self.reading_segment, values, rng)
        return replace(self, stress=response + residuals)

    def own_tables(self) -> dict[str, Any]:
        """Return segments and readings."""
        data: dict[str, Any] = {
            "file": {"strain": self.strain, "stress_Pa": self.stress},
            "missing": [],
            "strain_column": "strain",
            "strain_unit": "fraction",
            "stress_column": "stress_Pa",
            "stress_unit": "Pa",
            "stress_uncertainty": self.stress_uncertainty,
            "max_readings": self.n_points if self.n_points > MAX_READINGS else None,
        }
        return {
            "final_strain": self.final_strain,
            "segments": [
                {"start_strain": s.start_strain, "strain_rate_per_s": s.strain_rate}
                for s in self.segments
            ],
            "data": data if self.n_points else None,
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
        steps = self.bounds[1:-1]
        after_another = np.diff(self.strain, prepend=-1.0) == 0
        at_step = np.isin(self.strain, steps)
        ends_before = np.searchsorted(steps, self.strain, side="left")
        return np.asarray(ends_before + (at_step & after_another))

    def time_at(self, strain: FloatArray) -> FloatArray:
        """Return the times (s since the start) at which strains (n,), not negative, are reached."""
        return _time_at(strain, self.segments)


STEP_ROUNDING = 1e-12
"""Relative distance from a rate step below which a strain counts as the step: no solver starts into
so short a segment."""


def rate_text(rate: float) -> str:
    """Strain rate (1/s) as matplotlib text."""
    mantissa, exponent = f"{rate:.2e}".split("e")
    return rf"${mantissa}\times10^{{{int(exponent)}}}$ s$^{{-1}}$"


def _steps(segments: Sequence[RateSegment]) -> tuple[FloatArray, FloatArray, FloatArray]:
    """Strains and times (s) at which segments start, and their rates (1/s), each (n_segments,)."""
    starts, rates = np.transpose([(one.start_strain, one.strain_rate) for one in segments])
    return starts, np.concatenate([[0.0], np.cumsum(np.diff(starts) / rates[:-1])]), rates


def _time_at(strain: FloatArray, segments: Sequence[RateSegment]) -> FloatArray:
    """Return the times (s since the start) at which strains are reached."""
    starts, times, rates = _steps(segments)
    for step in starts[1:]:
        strain = np.where(np.isclose(strain, step, rtol=STEP_ROUNDING, atol=0.0), step, strain)
    segment = np.clip(np.searchsorted(starts, strain, side="right") - 1, 0, None)
    return np.asarray(times[segment] + (strain - starts[segment]) / rates[segment])


def _strain_at(time: FloatArray, segments: Sequence[RateSegment]) -> FloatArray:
    """Strain reached at times (s since the start); the first rate holds for times before it."""
    starts, times, rates = _steps(segments)
    segment = np.clip(np.searchsorted(times, time, side="right") - 1, 0, None)
    return np.asarray(starts[segment] + (time - times[segment]) * rates[segment])


LATE_STRAIN = 0.01
"""Strain of a first reading beyond which strain may not count from the start of loading."""


def remarks_on(strain: FloatArray, stress: FloatArray) -> list[str]:
    """Say what a reader should know about a curve, each (n_points,); no sentence names a file."""
    if strain.size == 0:
        return []
    remarks = repeated(strain, stress, "strain")
    if strain.size < len(PARAMETERS):
        remarks.append(
            f"{count_points(strain.size)} for the {len(PARAMETERS)} parameters of the model: what "
            "the data do not fix is left to the priors."
        )
    if strain[0] > LATE_STRAIN:
        remarks.append(
            f"The first reading is at a strain of {rounded_to(100 * strain[0])} %: the model "
            "starts at rest at zero strain, so check that strain counts from the start of loading."
        )
    remarks += opposed_stresses(stress, compressed=True)
    if strain[-1] > 1:
        remarks.append(
            f"The largest strain is {strain[-1]:g} as a fraction: check that it is not in percent."
        )
    return remarks
