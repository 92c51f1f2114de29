"""Which mechanism of a composite flow law leads where, with the probability that the draws give."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import xarray as xr

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.array_types import BoolArray, FloatArray
from pyburgers.common.draws import all_draws, evenly_spaced
from pyburgers.common.errors import InputError
from pyburgers.flow_law_tables.laws import RateLaw
from pyburgers.flow_law_tables.program_data import environment_of
from pyburgers.flow_law_tables.tables import RateTable
from pyburgers.model.environment import check_environment
from pyburgers.model.parameters import ENVIRONMENT

DRAWS = 400
"""Draws of the law at most that a map counts."""

NEAR_KELVIN, NEAR_FACTOR = 10.0, 3.0
"""A test within so many kelvins and within this factor of stress and grain size supports a map."""


@dataclass(frozen=True)
class NaturalConditions:
    """A range of temperature (K), stress (axial equivalent, Pa) and grain size (m) in nature."""

    name: str
    temperature: tuple[float, float]
    stress: tuple[float, float]
    grain_size: tuple[float, float]
    source: str


NATURAL_CONDITIONS: Mapping[str, tuple[NaturalConditions, ...]] = MappingProxyType(
    {
        "ice": (
            NaturalConditions(
                "shear margins of ice streams",
                (258.0, 273.0),
                (0.06e6 * 3**0.5, 0.20e6 * 3**0.5),
                (1e-3, 1e-2),
                "shear stress: Frontiers in Earth Science 9, 702761 (2021); temperature and grain "
                "size are choices of this project",
            ),
            NaturalConditions(
                "ice shell of Europa",
                (170.0, 273.0),
                (1e4, 1e5),
                (1e-4, 1e-1),
                "temperature and grain size: Ruiz (2010); stress below about 1 bar: Showman and "
                "Han (2004), Journal of Geophysical Research 109, E01010",
            ),
        ),
    }
)
"""Conditions to which laws of a material are carried, as examples."""


@dataclass(frozen=True, eq=False)
class MechanismMap:
    """Leading mechanisms over temperature and stress, or over grain size and stress.

    Attributes
    ----------
    temperature : array, shape (n,) or (1,)
        K.
    grain_size : array, shape (1,) or (n,)
        m.
    stress : array, shape (m,)
        Axial equivalent, Pa.
    mechanisms : tuple of str
        Names.
    probability : array, shape (m, n, n_mechanisms)
        Share of the draws in which the mechanism leads: its process is the fastest, and in its
        process no step is slower.
    log_rate, log_rate_sd : array, shape (m, n)
        Mean and standard deviation of ln(strain rate s).
    is_supported : array of bool, shape (m, n)
        Whether a fitted test lies within 10 K and within a factor of 3 of stress and grain size.

    Examples
    --------
    >>> found = creep.mechanism_map()
    >>> found.probability.sum(axis=-1).round(9).min()
    np.float64(1.0)
    """

    temperature: FloatArray
    grain_size: FloatArray
    stress: FloatArray
    mechanisms: tuple[str, ...]
    probability: FloatArray
    log_rate: FloatArray
    log_rate_sd: FloatArray
    is_supported: BoolArray

    @property
    def over_grain_size(self) -> bool:
        """Whether the map is over grain size in place of temperature."""
        return self.grain_size.size > 1


def mechanism_map(
    law: RateLaw,
    posterior: xr.DataTree,
    used: RateTable,
    *,
    temperature: FloatArray | float | None = None,
    stress: FloatArray | None = None,
    grain_size: FloatArray | float | None = None,
    environment: Mapping[str, npt.ArrayLike] = MappingProxyType({}),
) -> MechanismMap:
    """Count in which draws of `posterior` each mechanism leads (`RateFit.mechanism_map`)."""
    if temperature is None:
        low, high = used.temperature.min() - 30.0, used.temperature.max()
        temperature = np.linspace(low, high, 45) if np.ndim(grain_size or 0) == 0 else high
    if stress is None:
        stress = np.geomspace(used.stress.min() / 100.0, used.stress.max(), 45)
    if grain_size is None:
        mean = used.mean_conditions.grain_size
        grain_size = law.reference.grain_size if np.isnan(mean) else mean
    warmth, size, load = (
        np.atleast_1d(np.asarray(one, dtype=np.float64))
        for one in (temperature, grain_size, stress)
    )
    if warmth.size > 1 and size.size > 1:
        raise InputError("temperature and grain_size: found arrays of both, expected one number.")
    shape = (load.size, max(warmth.size, size.size))
    every_load = np.broadcast_to(load[:, np.newaxis], shape).ravel()
    every_warmth, every_size = (np.broadcast_to(one, shape).ravel() for one in (warmth, size))
    found = _evaluated(
        law,
        posterior,
        every_load,
        every_size,
        every_warmth,
        _environment_at(used, every_load.shape, environment),
        keeps_draws=False,
    )
    near = (
        (np.abs(every_warmth[:, np.newaxis] - used.temperature) <= NEAR_KELVIN)
        & _within_factor(every_load, used.stress)
        & (_within_factor(every_size, used.grain_size) | np.isnan(used.grain_size))
    )
    return MechanismMap(
        temperature=warmth,
        grain_size=size,
        stress=load,
        mechanisms=tuple(one.name for one in law.mechanisms),
        probability=found["probability"].reshape(*shape, -1),
        log_rate=found["mean_log_rate"].reshape(shape),
        log_rate_sd=found["sd_log_rate"].reshape(shape),
        is_supported=near.any(axis=1).reshape(shape),
    )


def local_power_law(
    law: RateLaw,
    posterior: xr.DataTree,
    used: RateTable,
    temperature: FloatArray,
    stress: FloatArray,
    grain_size: FloatArray,
    *,
    environment: Mapping[str, npt.ArrayLike],
) -> xr.Dataset:
    """Solve a law for each draw under conditions (K, Pa, m), each (n,), see `RateFit.rates_at`."""
    there = _environment_at(used, stress.shape, environment)
    found = _evaluated(law, posterior, stress, grain_size, temperature, there, keeps_draws=True)
    at = {"temperature": temperature, "stress": stress, "grain_size": grain_size}
    return xr.Dataset(
        {
            "log_strain_rate": (("draw", "condition"), found["log_rate"]),
            "stress_exponent": (("draw", "condition"), found["stress_exponent"]),
        },
        {name: ("condition", values) for name, values in at.items()},
    )


def _evaluated(
    law: RateLaw,
    posterior: xr.DataTree,
    stress: FloatArray,
    grain_size: FloatArray,
    temperature: FloatArray,
    environment: Mapping[str, FloatArray],
    *,
    keeps_draws: bool,
) -> Mapping[str, FloatArray]:
    """Run `stan/mechanism_map.stan` for conditions (Pa, m, K), each (n,)."""
    for name, values in (
        ("temperature", temperature),
        ("grain_size", grain_size),
        ("stress", stress),
    ):
        if values.ndim != 1 or not values.size:
            raise InputError(
                f"{name}: found an array of shape {values.shape}, expected a number or some in a "
                "list."
            )
        if not (np.isfinite(values) & (values > 0)).all():
            raise InputError(f"{name}: found {values.min():g}, expected numbers above 0.")
    there = environment_of(law, **environment)
    drawn = evenly_spaced(all_draws(posterior["predictions"].to_dataset()["law"]), DRAWS)
    return load_program(stan_directory() / "mechanism_map.stan").evaluate(
        {
            "n_draws": len(drawn),
            "n_mechanisms": drawn.shape[1],
            "law": drawn.tolist(),
            "process": [one.process for one in law.mechanisms],
            "premelting_temperature": [one.premelting_temperature for one in law.mechanisms],
            "reference_stress": law.reference.stress,
            "reference_grain_size": law.reference.grain_size,
            "reference_temperature": law.reference.temperature,
            "n_conditions": stress.size,
            "stress": stress.tolist(),
            "grain_size": grain_size.tolist(),
            "temperature": temperature.tolist(),
            "n_environment": there.shape[1],
            "environment": there.tolist(),
            "keeps_draws": int(keeps_draws),
        }
    )


def _environment_at(
    used: RateTable, shape: tuple[int, ...], given: Mapping[str, npt.ArrayLike]
) -> dict[str, FloatArray]:
    """Return each of `ENVIRONMENT` (SI) as an array of a shape: as given, or the tests' mean."""
    check_environment(given)
    found = {}
    for name in ENVIRONMENT:
        known = getattr(used, name)
        known = known[np.isfinite(known)]
        mean = known.mean() if known.size else np.nan
        found[name] = np.broadcast_to(np.asarray(given.get(name, mean), dtype=np.float64), shape)
    return found


def _within_factor(values: FloatArray, of_tests: FloatArray) -> BoolArray:
    """Whether values (n,) lie within `NEAR_FACTOR` of those of tests (k,), shape (n, k)."""
    distance = np.abs(np.log(values[:, np.newaxis] / of_tests))
    return np.asarray(distance <= np.log(NEAR_FACTOR))
