"""Tests under a history of imposed strain and stress: what was imposed, what was read."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np

from pyburgers.common.array_types import BoolArray, FloatArray, IntArray
from pyburgers.kinds.experiment import Experiment, Stated
from pyburgers.kinds.loading_history.stages import (
    OWN_KEYS,
    Leg,
    Stage,
    imposed_strains,
    imposed_stresses,
    legs_of,
)
from pyburgers.kinds.odd_readings import odd_readings
from pyburgers.model.display import time_unit
from pyburgers.model.read_quantities import STRAIN, STRESS
from pyburgers.model.residual_laws import draw_residuals

PULLING = 0.3
"""Reading in extension, over the largest one, that is more than an error."""

MAX_MISSED_SHARE = 0.05
"""Share of the largest strain up to which a strain of the apparatus need not be known."""

MAX_UNREAD_SHARE = 0.5
"""Share of a stage at either end of the readings from which on their times are doubted."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class HistoryExperiment(Experiment):
    """One test under a history of imposed strain and stress, in SI units.

    Attributes
    ----------
    stages : tuple of Stage
        One after the other without gaps; the first starts at 0 s, where the sample is at rest.
    time : array, shape (n_points,)
        Of the readings (s since the start), not decreasing.
    reading_stage : array of int, shape (n_points,)
        Stage of each reading, from 0.
    reading : array, shape (n_points,)
        True stress (Pa) where strain is imposed, true strain (fraction) where stress is imposed.
    stress_uncertainty, strain_uncertainty : float or None
        Standard deviation of a reading (Pa, fraction) where it is stated.
    apparatus_compliance : Stated or None
        Strain of the apparatus for a stress, in strain of the sample (1/Pa), that is part of
        measured and imposed strains; None for none.
    strain_offset : Stated or None
        Measured strain of the sample at rest; None for zero.
    n_readings_in_file : int
        Before records were thinned.

    Examples
    --------
    >>> test = pyburgers.load_experiment(data / "halite" / "halite_z3.toml")
    >>> len(test.stages)
    1
    """

    protocol: ClassVar[str] = "loading_history"
    of_points: ClassVar[tuple[str, ...]] = ("time", "reading_stage", "reading")
    laws: ClassVar[Mapping[str, Sequence[str]]] = {}
    residual_correlation: ClassVar[str] = "residual_correlation_time"
    small_strain: ClassVar[float] = 5e-5
    stages: tuple[Stage, ...]
    time: FloatArray
    reading_stage: IntArray
    reading: FloatArray
    stress_uncertainty: float | None = None
    strain_uncertainty: float | None = None
    apparatus_compliance: Stated | None = None
    strain_offset: Stated | None = None
    n_readings_in_file: int = 0

    @property
    def legs(self) -> tuple[Leg, ...]:
        """Parts over which what is imposed is linear in time, in the order of time."""
        return legs_of(self.stages)

    @property
    def end_time(self) -> float:
        """End of the test (s)."""
        return self.stages[-1].end_time

    @property
    def temperatures(self) -> FloatArray:
        """Temperatures of the stages."""
        return np.array([stage.temperature for stage in self.stages])

    @property
    def position(self) -> FloatArray:
        """Times of the readings."""
        return self.time

    @property
    def duration(self) -> float:
        """Time (s) between the first and the last reading."""
        return float(np.ptp(self.time)) if self.n_points else 0.0

    @property
    def span(self) -> tuple[float, float]:
        """Start and end of the test (s)."""
        return self.stages[0].start_time, self.end_time

    @property
    def response(self) -> FloatArray:
        """Readings: stress or strain, by stage."""
        return self.reading

    @property
    def response_is_strain(self) -> BoolArray:
        """Whether each reading is a strain, shape (n_points,)."""
        stress_driven = np.array([stage.driven == "stress" for stage in self.stages])
        return np.asarray(stress_driven[self.reading_stage])

    @property
    def quantity(self) -> IntArray:
        """0 of readings of the stress, 1 of those of the strain."""
        return self.response_is_strain.astype(np.int64)

    @property
    def noises(self) -> Mapping[str, float | None]:
        """Noises of what is read in its stages."""
        driven = {stage.driven for stage in self.stages}
        errors = {
            STRAIN.noise: ("stress", self.strain_uncertainty),
            STRESS.noise: ("strain", self.stress_uncertainty),
        }
        return {name: error for name, (imposed, error) in errors.items() if imposed in driven}

    @property
    def stated(self) -> Mapping[str, Stated]:
        """Compliance of the apparatus and zero of the strain, where the file states them."""
        stated = {name: getattr(self, name) for name in ("apparatus_compliance", "strain_offset")}
        return {name: one for name, one in stated.items() if one is not None}

    @property
    def imposed_stresses(self) -> FloatArray:
        """Stresses (Pa) at the ends of all legs that impose one; empty for none."""
        return imposed_stresses(self.legs)

    @property
    def extension(self) -> str:
        """Imposed stress, or imposed strain before any, that pulls the sample; or such readings."""
        stresses = [*self.imposed_stresses, *_pulling(self.reading[~self.response_is_strain])]
        if stresses and (least := min(stresses)) < 0:
            return f"{least / 1e6:g} MPa"
        legs = itertools.takewhile(lambda leg: leg.driven == "strain", self.legs)
        strains = _pulling(imposed_strains(list(legs)))
        return f"an imposed strain of {strains.min():g}" if strains.size else ""

    @property
    def largest_stress(self) -> float:
        """Largest |σ| (Pa), imposed or measured; only of an experiment with data."""
        stresses = [*self.imposed_stresses, *self.reading[~self.response_is_strain]]
        return float(np.abs(stresses).max())

    @property
    def doubts(self) -> tuple[str, ...]:
        """Say where signs, times, compliance or path strains do not go with what was read."""
        if not self.n_points:
            return ()
        return (
            *self._doubts_about_signs(),
            *self._doubts_about_times(),
            *self._doubts_about_compliance(),
            *self._doubts_about_path_strains(),
            *odd_readings(self._strains_read, "strain"),
            *odd_readings(self.reading[~self.response_is_strain] / 1e6, "stress (MPa)"),
        )

    def _doubts_about_signs(self) -> Iterator[str]:
        """Say where imposed stresses and most strains that are read have opposite signs."""
        imposed, strain = self.imposed_stresses, self._strains_read
        if not imposed.any() or not strain.size:
            return
        there, here, usual = "extension", "compression", np.median(strain)
        if imposed.min() >= 0 > usual:
            there, here = here, there
        elif not imposed.max() <= 0 < usual:
            return
        yield (
            f"imposed stresses are {there} while strains are {here}; check their signs "
            '(compression is positive unless compression = "negative") and the zero of the strain.'
        )

    def _doubts_about_times(self) -> Iterator[str]:
        """Say where half of a stage passes ahead of its first reading or behind the last one."""
        first, last = (int(self.reading_stage[k]) for k in (0, -1))
        unread = (
            (first, self.time[0] - self.stages[first].start_time, "before the first"),
            (last, self.stages[last].end_time - self.time[-1], "after the last"),
        )
        unit, seconds = time_unit(self.end_time)
        for k, passed, where in unread:
            duration = self.stages[k].end_time - self.stages[k].start_time
            if passed > MAX_UNREAD_SHARE * duration:
                yield (
                    f"stage {k + 1} lasts {duration / seconds:.4g} {unit}, of which "
                    f"{passed / seconds:.4g} {unit} are {where} reading; check units and start "
                    "of the times."
                )

    def _doubts_about_compliance(self) -> Iterator[str]:
        """Say where compliance times stress is not what the apparatus takes up."""
        if self.apparatus_compliance is None:
            return
        strains = np.array([0.0, *self._strains_read, *imposed_strains(self.legs)])
        farthest = float(strains[np.argmax(np.abs(strains))])
        known, stress = abs(farthest), f"{self.largest_stress / 1e6:.3g} MPa"
        taken_up = self.apparatus_compliance.value * self.largest_stress
        # A force over the first area acts on another one, and on another length.
        missed = taken_up * abs(float(np.expm1(2 * farthest)))
        if taken_up > known:
            yield (
                f"the compliance of the apparatus makes a strain of {taken_up:.3g} of a stress of "
                f"{stress}, but no strain that is read or imposed exceeds {known:.3g}; check its "
                "unit."
            )
        elif missed > (self.strain_uncertainty or MAX_MISSED_SHARE * known):
            yield (
                f"at a strain of {farthest:.3g} the strain of the apparatus under {stress} is off "
                f"by up to {missed:.2g}, as length and area are not the first ones; correct the "
                "strains for the apparatus yourself, and leave out [apparatus]."
            )

    @property
    def _strains_read(self) -> FloatArray:
        """Strains among the readings, from their stated zero."""
        zero = 0.0 if self.strain_offset is None else self.strain_offset.value
        return np.asarray(self.reading[self.response_is_strain] - zero)

    def _doubts_about_path_strains(self) -> Iterator[str]:
        """Say where microstructure was measured beyond all strain that is imposed and read."""
        is_strain = self.response_is_strain
        driven = {n for n, stage in enumerate(self.stages) if stage.driven == "stress"}
        if not driven <= set(self.reading_stage[is_strain].tolist()):
            return
        # Noise of the readings only adds to it.
        read = float(np.abs(np.diff(self.reading[is_strain], prepend=0.0)).sum())
        imposed = sum(abs(leg.end_value) for leg in self.legs if leg.driven == "strain")
        beyond = [one.strain for one in self.microstructure if (one.strain or 0) > read + imposed]
        if beyond:
            yield (
                f"the microstructure was measured at a path strain of {beyond[0]:g}, but imposed "
                f"strains and readings add up to {read + imposed:.3g}; check its unit."
            )

    @property
    def largest_strain_read(self) -> float | None:
        """Largest |ε| of the readings, None where none is a strain."""
        strains = np.abs(self.reading[self.response_is_strain])
        return float(strains.max()) if strains.size else None

    @property
    def title(self) -> str:
        """Sample, material, temperatures, number of stages and kind of data."""
        n_stages = len(self.stages)
        return (
            f"{self.id}: {self.material}, {self.temperature_text}, "
            f"{n_stages} {'stage' if n_stages == 1 else 'stages'}, {self.provenance.kind} data"
        )

    def to_be_solved(self) -> Self:
        """Return the test with its readings, which set the scales of the solution."""
        return replace(self, microstructure=())

    def reading_places(self) -> tuple[FloatArray, IntArray]:
        """Return times of a solution that hold every reading, and the place of each among them."""
        # A reading at the start of a stage stands behind the jump there: its time comes twice.
        start = np.array([stage.start_time for stage in self.stages])
        is_behind = (self.reading_stage > 0) & (self.time == start[self.reading_stage])
        return np.repeat(self.time, 1 + is_behind), np.cumsum(1 + is_behind) - 1

    def with_noise(
        self, response: FloatArray, values: Mapping[str, float], rng: np.random.Generator
    ) -> Self:
        """Put readings with residuals, which may correlate in time, in the place of others."""
        sizes = np.array([values["stress_noise"], values.get("strain_noise", 0.0)])
        residuals = draw_residuals(self, sizes[self.quantity], self.reading_stage, values, rng)
        return replace(self, reading=response + residuals)

    def own_tables(self) -> dict[str, Any]:
        """Return stages, apparatus and readings."""
        compliance, offset = self.apparatus_compliance, self.strain_offset
        is_force = any(stage.is_force for stage in self.stages)
        return {
            "stages": [_stage_table(stage) for stage in self.stages],
            "stress_measure": "engineering" if is_force else None,
            "apparatus": compliance
            and {"compliance_per_Pa": compliance.value, "compliance_sd_per_Pa": compliance.sd},
            "strain_offset": offset
            and {"value": offset.value, "sd": offset.sd, "unit": "fraction"},
            "data": self._data_table() if self.n_points else None,
        }

    def _data_table(self) -> dict[str, Any]:
        """Return the table [data] with its columns."""
        is_strain = self.response_is_strain
        columns: dict[str, FloatArray] = {
            "time_s": self.time,
            "stage": (self.reading_stage + 1).astype(np.float64),
        }
        table: dict[str, Any] = {
            "file": columns,
            "missing": [],
            "time_column": "time_s",
            "time_unit": "s",
            "stage_column": "stage",
            "max_readings": max(self.n_points, 10),
            "readings_in_file": self.n_readings_in_file,
        }
        for quantity, unit, own, error in (
            ("stress", "Pa", ~is_strain, self.stress_uncertainty),
            ("strain", "fraction", is_strain, self.strain_uncertainty),
        ):
            if own.any() or error is not None:
                columns[quantity] = np.where(own, self.reading, np.nan)
                table |= {f"{quantity}_column": quantity, f"{quantity}_unit": unit}
                table[f"{quantity}_uncertainty"] = error
        return table


def _pulling(values: FloatArray) -> FloatArray:
    """Return the values in extension that are no error of a zero or of a reading."""
    return np.asarray(values[values < -PULLING * np.abs(values).max(initial=0.0)])


def _stage_table(stage: Stage) -> dict[str, Any]:
    """One of [[stages]], in SI."""
    table: dict[str, Any] = {
        "control": stage.control,
        "start_time": stage.start_time,
        "end_time": stage.end_time,
        "temperature_K": stage.temperature,
    }
    if stage.knots:
        table["knots"] = [list(knot) for knot in stage.knots]
    else:
        table |= zip(OWN_KEYS[stage.control], (stage.value, stage.start_stress), strict=False)
    return table


NEARLY_CONSTANT = 0.02
"""How far a stress may lie from its mean, as a share of it: flow with an exponent of 4 is then
within 8 % of that under the mean, about as well as minimum rates of two tests agree."""


LEAST_DURATION = 0.05
"""Share of a stage from which on a nearly constant stress is a load, whatever lies beside it."""


STEEPEST = 10.0
"""How many times faster than `NEARLY_CONSTANT` allows over a whole part its stress may change in
the first and the last leg. Faster ones begin the loading or unloading beside it, whose elastic
strain is no creep."""


@dataclass(frozen=True)
class CreepInterval:
    """Part of a stage, from 0, in which a nearly constant compressive stress stands; s, mean Pa."""

    stage: int
    start_time: float
    end_time: float
    stress: float

    @property
    def duration(self) -> float:
        """Seconds."""
        return self.end_time - self.start_time


def creep_intervals(experiment: HistoryExperiment) -> tuple[CreepInterval, ...]:
    """Return the creep of a test, in the order of time: whole stages, or their longest parts."""
    found = []
    for number, stage in enumerate(experiment.stages):
        legs = [leg for leg in experiment.legs if leg.stage == number]
        least = LEAST_DURATION * (stage.end_time - stage.start_time)
        if stage.driven == "stress":
            parts = [
                one for one in _steady_parts(legs) if one.duration >= least or _rests(one, legs)
            ]
            found += _longest(parts)
    return tuple(found)


def _rests(part: CreepInterval, legs: Sequence[Leg]) -> bool:
    """Whether a short part is a load: its stress changes much slower than in the legs beside it."""
    inside = [
        abs(leg.rate)
        for leg in legs
        if part.start_time <= leg.start_time and leg.end_time <= part.end_time
    ]
    beside = [leg for leg in legs if part.start_time == leg.end_time]
    beside += [leg for leg in legs if part.end_time == leg.start_time]
    shortest = min(leg.end_time - leg.start_time for leg in beside)
    is_level = STEEPEST * max(inside) <= min(abs(leg.rate) for leg in beside)
    return is_level and shortest <= part.duration


def _steady_parts(legs: Sequence[Leg]) -> list[CreepInterval]:
    """Return every sequence of legs of a stage with a nearly constant stress."""
    found = []
    for first in range(len(legs)):
        least, largest, impulse = np.inf, -np.inf, 0.0
        for leg in legs[first:]:
            ends = leg.start_value, leg.end_value
            least, largest = min(least, *ends), max(largest, *ends)
            impulse += 0.5 * sum(ends) * (leg.end_time - leg.start_time)
            start = legs[first].start_time
            duration = leg.end_time - start
            stress = impulse / duration
            steepest = max(abs(legs[first].rate), abs(leg.rate))
            is_ramp = steepest * duration > STEEPEST * 2 * NEARLY_CONSTANT * stress
            if least <= 0 or largest - least > 2 * NEARLY_CONSTANT * largest:
                break
            if not is_ramp and max(largest - stress, stress - least) <= NEARLY_CONSTANT * stress:
                found.append(CreepInterval(leg.stage, start, leg.end_time, stress))
    return found


def _longest(parts: Sequence[CreepInterval]) -> list[CreepInterval]:
    """Return the longest parts that do not overlap, in the order of time."""
    kept: list[CreepInterval] = []
    for part in sorted(parts, key=lambda one: -one.duration):
        if all(part.end_time <= o.start_time or o.end_time <= part.start_time for o in kept):
            kept.append(part)
    return sorted(kept, key=lambda one: one.start_time)
