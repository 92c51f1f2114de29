"""Tables of attenuation and modulus as tests."""

from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, ClassVar, Self

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.common.errors import InputError
from pyburgers.common.units import span_text
from pyburgers.kinds.attenuation.table import (
    ATTENUATION,
    MODULUS,
    NO_READINGS,
    CycleConditions,
    Elasticity,
    Readings,
    spectra_of,
)
from pyburgers.kinds.experiment import Experiment
from pyburgers.model.laws import HARDENING_LAWS, laws_in_closed_form
from pyburgers.model.parameters import RESIDUAL_CORRELATION
from pyburgers.model.read_quantities import LOG_MODULUS, LOG_TAN_DELTA

UNSTATED_STRESS = 1e6
"""Axial stress (Pa) at which the flow rate of a linear dashpot is sampled where none is stated."""

LEAST_BULK_MODULUS = 1e9
"""Bulk modulus (Pa) of a solid below which its unit may be wrong."""

SURE_ERRORS = 3.0
"""Stated errors below zero at which a tan(delta) is not negative by chance."""

LARGEST_TAN_DELTA = 3.0
"""tan(delta) beyond which its unit may be wrong."""


@dataclass(frozen=True, eq=False, kw_only=True, repr=False)
class AttenuationExperiment(Experiment):
    """One specimen's table of attenuation and modulus in SI units.

    `temperature` is that of the sampled flow rate; rows have temperatures of their own.

    Attributes
    ----------
    conditions : CycleConditions
        Of every row.
    readings : Readings
        Readings of each row.
    elasticity : Elasticity
        Whether cycles are axial or of shear, and what relates the two.

    Examples
    --------
    >>> table = pyburgers.load_experiment(data / "ice" / "attenuation_twin.toml")
    >>> type(table).__name__, table.n_points
    ('AttenuationExperiment', 72)
    """

    protocol: ClassVar[str] = "attenuation"
    points_together: ClassVar[str] = "a row of the table gives attenuation and modulus together"
    may_be_uncertain: ClassVar[frozenset[str]] = frozenset()
    laws: ClassVar[Mapping[str, Sequence[str]]] = {
        **laws_in_closed_form(),
        "hardening": (*HARDENING_LAWS,),
        "grain_size": ("constant",),
        "fabric": ("constant",),
        "residuals": ("independent",),
    }
    without_effect: ClassVar[frozenset[str]] = frozenset(
        {
            "steady_state_grain_size",
            "steady_state_fabric_factor",
            "critical_strain_grain_size",
            "critical_strain_fabric",
            "stress_noise",
            "strain_noise",
            "strain_offset",
            "apparatus_compliance",
            "initial_backstress",
            *RESIDUAL_CORRELATION,
        }
    )
    linear_hardening: ClassVar[bool] = True
    parts_name: ClassVar[str] = "temperatures"
    conditions: CycleConditions
    readings: Readings
    elasticity: Elasticity

    @property
    def temperatures(self) -> FloatArray:
        """Temperatures of the rows."""
        return self.conditions.temperature

    @property
    def parts(self) -> Mapping[str, int]:
        """Readings at each temperature, the hottest first."""
        quantities = 2 if self.readings.modulus.size else 1
        # Temperatures that differ by less than a name shows are one part.
        hottest_first = self._names[np.argsort(-self.conditions.temperature)]
        return {str(name): quantities * n for name, n in Counter(hottest_first).items()}

    def without_part(self, name: str) -> Self:
        """Return the table without a temperature, which it must have, beside others."""
        if name not in self.parts:
            return super().without_part(name)
        if len(self.parts) == 1:
            raise InputError(f"{self.id}: has no other temperature than {name}, expected several.")
        return self._rows(np.flatnonzero(self._names != name))

    def only_part(self, name: str) -> Self:
        """Return what the table has of a temperature, one of `parts`."""
        return self._rows(np.flatnonzero(self._names == name))

    @property
    def _names(self) -> npt.NDArray[np.str_]:
        """Temperature of each row, as `parts` names it."""
        return np.array([f"{own:g}K" for own in self.conditions.temperature])

    def _rows(self, kept: IntArray) -> Self:
        conditions, readings = self.conditions.ordered(kept), self.readings.ordered(kept)
        return replace(self, conditions=conditions, readings=readings)

    @property
    def position(self) -> FloatArray:
        """Places of the readings: spectra of attenuation, then of modulus."""
        place, n_attenuations = self.conditions.place, self.readings.tan_delta.size
        of_moduli = place[: self.readings.modulus.size] + self.conditions.n_spectra
        return np.concatenate([place[:n_attenuations], of_moduli])

    @property
    def span(self) -> tuple[float, float]:
        """Start of the first spectrum of attenuation, and the end of the last one of moduli."""
        return 0.0, float(np.nextafter(2 * self.conditions.n_spectra, 0))

    @property
    def response(self) -> FloatArray:
        """ln(tan delta), or ln of its limit, then ln(modulus / Pa)."""
        recorded = np.maximum(self.readings.tan_delta, self.readings.limit)
        return np.asarray(np.log(np.concatenate([recorded, self.readings.modulus])))

    @property
    def response_limit(self) -> FloatArray:
        """Logarithms of the limits of tan(delta); moduli have none."""
        no_limit = np.zeros(self.readings.modulus.size)
        with np.errstate(divide="ignore"):
            return np.asarray(np.log(np.concatenate([self.readings.limit, no_limit])))

    @property
    def quantity(self) -> IntArray:
        """0 of readings of attenuation, 1 of those of the modulus."""
        sizes = [self.readings.tan_delta.size, self.readings.modulus.size]
        return np.repeat([ATTENUATION, MODULUS], sizes)

    @property
    def noises(self) -> Mapping[str, float | None]:
        """Scatters, which may be none where all errors are stated."""
        errors = {
            LOG_TAN_DELTA.noise: self.readings.tan_delta_error,
            LOG_MODULUS.noise: self.readings.modulus_error,
        }
        return {name: 0.0 if np.all(error > 0) else None for name, error in errors.items()}

    def to_be_solved(self) -> Self:
        """Return the table without what was read."""
        return replace(self, readings=NO_READINGS)

    def known_columns(self, at: FloatArray) -> Mapping[str, FloatArray]:
        """Return which reading, period and temperature belong to places."""
        _, _, quantity = self.conditions.at(at)
        is_modulus = (quantity == MODULUS).astype(np.float64)
        return {"is_modulus": is_modulus, **self.conditions_at(at)}

    def conditions_at(self, at: FloatArray) -> Mapping[str, FloatArray]:
        """Return periods and temperatures of places."""
        period, spectrum, _ = self.conditions.at(at)
        temperature = self.conditions.temperature[self.conditions.first_rows[spectrum]]
        return {"period_s": period, "temperature_K": temperature}

    def with_noise(
        self, response: FloatArray, values: Mapping[str, float], rng: np.random.Generator
    ) -> Self:
        """Put readings with scatter and stated errors in the place of others."""
        readings = self.readings
        n = readings.tan_delta.size
        tan_delta, modulus = np.exp(response[:n]), np.exp(response[n:])
        # As in stan/kinds/attenuation_response.stan.
        tan_delta = np.hypot(tan_delta, readings.tan_delta_error)
        relative_error = readings.modulus_error / readings.modulus
        spreads = (
            np.hypot(values.get("attenuation_scatter", 0.0), readings.tan_delta_error / tan_delta),
            np.hypot(values.get("modulus_scatter", 0.0), relative_error),
        )
        tan_delta, modulus = (
            one * np.exp(spread * rng.standard_normal(one.size))
            for one, spread in zip((tan_delta, modulus), spreads, strict=True)
        )
        errors = relative_error * modulus
        noisy = replace(readings, tan_delta=tan_delta, modulus=modulus, modulus_error=errors)
        return replace(self, readings=noisy)

    def solution_table(self, solution: pd.DataFrame) -> pd.DataFrame:
        """Return tan delta and modulus at the rows of the table."""
        conditions = self.conditions
        reading = np.exp(solution.set_index("place")["log_reading"])
        return pd.DataFrame(
            {
                "period_s": conditions.period,
                "temperature_K": conditions.temperature,
                "median_stress_Pa": conditions.median_stress,
                "amplitude_Pa": conditions.amplitude,
                "tan_delta": reading[conditions.place].to_numpy(),
                "modulus_Pa": reading[conditions.place + conditions.n_spectra].to_numpy(),
            }
        )

    @property
    def stated_errors(self) -> FloatArray:
        """Stated errors of the logarithms of readings, 0 where there are none, (n_points,)."""
        readings = self.readings
        return np.concatenate(
            [
                readings.tan_delta_error / np.maximum(readings.tan_delta, readings.limit),
                readings.modulus_error / readings.modulus,
            ]
        )

    @property
    def amplitude_is_stated(self) -> bool:
        """Whether the amplitude of the stress is known."""
        return bool(np.all(self.conditions.amplitude > 0))

    @property
    def largest_stress(self) -> float:
        """Largest axial equivalent of a stress (Pa) in a cycle."""
        if not self.amplitude_is_stated:
            return UNSTATED_STRESS
        stress = self.conditions.median_stress + self.conditions.amplitude
        return float(stress.max() * self.elasticity.stress_factor)

    @property
    def poisson_ratio_in_shear(self) -> float | None:
        """Poisson's ratio of readings in shear, NaN if a bulk modulus stands for it; else None."""
        if self.elasticity.deformation == "axial":
            return None
        return np.nan if self.elasticity.poisson_ratio is None else self.elasticity.poisson_ratio

    @property
    def doubts(self) -> tuple[str, ...]:
        """Say where tan(delta) and the elastic constants are those of no solid."""
        found, readings = [], self.readings
        largest = float(readings.tan_delta.max(initial=0.0))
        if largest > LARGEST_TAN_DELTA:
            found.append(
                f"a tan delta of {largest:g} is unlikely; check the form and the unit of the "
                "column."
            )
        sure = np.maximum(readings.limit, SURE_ERRORS * readings.tan_delta_error)
        if n_negative := int(np.sum(readings.tan_delta < -sure)):
            found.append(
                f"{n_negative} of {sure.size} attenuations are negative beyond their error, down "
                f"to {readings.tan_delta.min():.3g}, and count as upper limits; check the sign of "
                "the phase."
            )
        bulk, shear = self.elasticity.bulk_modulus, float(readings.modulus.max(initial=0.0))
        if bulk is not None and bulk < LEAST_BULK_MODULUS:
            found.append(f"a bulk modulus of {bulk:g} Pa is unlikely; 130 GPa is 130e9.")
        elif bulk is not None and 3 * bulk < 2 * shear:
            ratio = (3 * bulk - 2 * shear) / (6 * bulk + 2 * shear)
            found.append(
                f"with a bulk modulus of {bulk:g} Pa and a shear modulus of {shear:g} Pa Poisson's "
                f"ratio is {ratio:.2g}, expected one above 0; check both."
            )
        return tuple(found)

    @property
    def title(self) -> str:
        """Sample, material and kind of data; below them temperatures and periods."""
        return (
            f"{self.id}: {self.material}, {self.provenance.kind} data\n"
            f"{self.temperature_text}, periods {range_text(self.conditions.period)} s, "
            f"{self.elasticity.deformation} cycles"
        )

    def own_tables(self) -> dict[str, Any]:
        """Return what the cycles are, and rows with readings; without any, the spectra."""
        conditions, readings = self.conditions, self.readings
        attenuation = {
            "deformation": self.elasticity.deformation,
            "poisson_ratio": self.elasticity.poisson_ratio,
            "bulk_modulus_Pa": self.elasticity.bulk_modulus,
        }
        if readings.tan_delta.size == 0:
            return {"attenuation": attenuation, "spectra": spectra_of(conditions)}
        columns = {
            "period": ("period_s", conditions.period),
            "temperature": ("temperature_K", conditions.temperature),
            "median_stress": ("median_stress_Pa", conditions.median_stress),
            "attenuation": ("tan_delta", readings.tan_delta),
            "attenuation_uncertainty": ("tan_delta_uncertainty", readings.tan_delta_error),
            "limit": ("limit", readings.limit),
        }
        units = {"period_unit": "s", "temperature_unit": "K", "stress_unit": "Pa"}
        if self.amplitude_is_stated:
            columns["amplitude"] = ("amplitude_Pa", conditions.amplitude)
        if readings.modulus.size:
            columns["modulus"] = ("modulus_Pa", readings.modulus)
            columns["modulus_uncertainty"] = ("uncertainty_Pa", readings.modulus_error)
            units["modulus_unit"] = "Pa"
        data = {
            "file": dict(columns.values()),
            "missing": [],
            **{f"{key}_column": name for key, (name, _) in columns.items()},
            **units,
            "attenuation_form": "tan_delta",
        }
        return {"attenuation": attenuation, "data": data}


def range_text(numbers: FloatArray, digits: int = 6) -> str:
    """Return the least and the largest number, or the only one that so many digits tell."""
    return span_text((numbers.min(), numbers.max()), digits)
