"""Which mechanism of a composite flow law leads where, with the probability that the draws give."""

from collections.abc import Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import xarray as xr

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.array_types import BoolArray, FloatArray, IntArray
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


def solved_draws(posterior: xr.DataTree) -> IntArray:
    """Return which draws `solve_under` solves, counted through all chains, from 0."""
    sizes = posterior["posterior"].sizes
    return evenly_spaced(np.arange(sizes["chain"] * sizes["draw"]), DRAWS)


def solve_under(
    law: RateLaw,
    posterior: xr.DataTree,
    used: RateTable,
    environment: Mapping[str, npt.ArrayLike],
    *,
    temperature: FloatArray,
    stress: FloatArray,
    grain_size: FloatArray,
    keeps_draws: bool,
) -> Mapping[str, FloatArray]:
    """Run `stan/mechanism_map.stan` for conditions (K, Pa, m), each (n,).

    Of an environment (SI) that is not given the mean of the tests is taken.
    """
    conditions = {"temperature": temperature, "grain_size": grain_size, "stress": stress}
    for name, values in conditions.items():
        if values.ndim != 1 or not values.size:
            raise InputError(
                f"{name}: found an array of shape {values.shape}, expected a number or some in a "
                "list."
            )
        if not (np.isfinite(values) & (values > 0)).all():
            raise InputError(f"{name}: found {values.min():g}, expected numbers above 0.")
    there = environment_of(law, **_environment_at(used, stress.shape, environment))
    drawn = all_draws(posterior["predictions"].to_dataset()["law"])[solved_draws(posterior)]
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
            **{name: values.tolist() for name, values in conditions.items()},
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


def within_factor(values: FloatArray, of_tests: FloatArray) -> BoolArray:
    """Whether values (n,) lie within `NEAR_FACTOR` of those of tests (k,), shape (n, k)."""
    distance = np.abs(np.log(values[:, np.newaxis] / of_tests))
    return np.asarray(distance <= np.log(NEAR_FACTOR))
