"""What a spectrum assumes, and where that fails: frozen microstructure, an elastic modulus.

Grain size and fabric relax towards a steady state with strain, over the critical strains
epsilon_c1 and epsilon_c2 (`stan/physics/microstructure.stan`). A spectrum in closed form takes them
as frozen, which fails in a draw where the strain of the hold, or of one cycle, is more than a share
of the smaller critical strain of what still evolves (`critical_strain`).
"""

from collections.abc import Mapping

import numpy as np
import xarray as xr

from pyburgers.common.array_types import BoolArray
from pyburgers.common.draws import FloatArray
from pyburgers.common.units import UNITS, number
from pyburgers.predictions.stress_cycles import EVOLUTION

CRITICAL_SHARE = 0.1
"""Default share of the critical strain: it brings grain size or fabric a tenth of their way, which
makes a dashpot with n = 4 that will halve its strength faster by a fifth."""

HARMLESS_EXPONENT = 4.0
"""Stress exponent up to which `CRITICAL_SHARE` does little."""

LIKELY = 0.5
"""Share of draws from which on a part of a curve is marked."""


def critical_strain(
    parameters: Mapping[str, FloatArray],
    grain_size: FloatArray,
    fabric_factor: FloatArray,
    final_grain_size: FloatArray,
    steepness: FloatArray,
) -> FloatArray:
    """Return the smaller critical strain of what evolves: infinite if nothing, NaN if unknown.

    A size that will change several times reaches its share in as many times less strain, and so
    does a fabric on which the rate depends more steeply than in the power law of `CRITICAL_SHARE`.
    Grain size (m) and fabric have the shape of the draws, `final_grain_size`, `steepness` (of
    `stan/stress_cycles.stan`) and the result a last axis of regimes.
    """
    if any(name not in parameters for name in EVOLUTION):
        return np.full(final_grain_size.shape, np.nan)
    of_grains, of_fabric, _, final_fabric = (
        parameters[name][..., np.newaxis] for name in EVOLUTION
    )
    smaller: FloatArray = np.minimum(
        _relative(of_grains, grain_size[..., np.newaxis], final_grain_size),
        _relative(of_fabric, fabric_factor[..., np.newaxis], final_fabric)
        / np.maximum(1.0, steepness / HARMLESS_EXPONENT),
    )
    return smaller


def _relative(critical: FloatArray, start: FloatArray, final: FloatArray) -> FloatArray:
    """Critical strain over the relative change that is to come, where that is more than one."""
    change = np.abs(final / start - 1.0)
    values: FloatArray = np.where(change > 0, critical / np.maximum(1.0, change), np.inf)
    return values


def strain_fails(spectrum: xr.Dataset, strain: str) -> xr.DataArray:
    """Whether ``hold_strain`` or ``cycle_strain`` is too large, draw by draw.

    1 where it is more than the share of the critical strain, else 0; NaN if unknown.
    """
    critical = spectrum["critical_strain"]
    fails = spectrum[strain] > float(spectrum["critical_share"]) * critical
    return fails.astype(np.float64).where(critical.notnull())


def probability(of_draws: xr.DataArray) -> FloatArray:
    """Share of draws in which something is so, (n_regimes,) or (n_regimes, n_frequencies)."""
    draws = [name for name in of_draws.dims if name not in ("regime", "frequency")]
    values: FloatArray = of_draws.mean(draws).transpose("regime", ...).to_numpy()
    return values


def likely_fails(spectrum: xr.Dataset) -> BoolArray:
    """Where frozen microstructure fails in most draws, shape (n_regimes, n_frequencies)."""
    marked: BoolArray = probability(spectrum["frozen_fails"]) >= LIKELY
    return marked


def frozen_limit_texts(spectrum: xr.Dataset) -> list[str]:
    """Say by regime in which share of draws the hold fails, and up to which cycles most do."""
    ordered = spectrum.sortby("frequency")
    frequency = ordered["frequency"].to_numpy()
    by_hold = probability(strain_fails(ordered, "hold_strain"))
    by_cycle = probability(strain_fails(ordered, "cycle_strain"))
    texts = []
    for share, of_cycles in zip(by_hold, by_cycle, strict=True):
        if np.isnan(share):
            texts.append("cannot tell")
            continue
        n_failing = int((of_cycles >= LIKELY).sum())
        cycles = "in all cycles"
        if n_failing == 0 and of_cycles[0] > 0:
            cycles = f"in cycles of {frequency[0]:.2g} Hz in {100 * of_cycles[0]:.0f} %"
        elif n_failing == 0:
            cycles = f"in no cycle down to {frequency[0]:.2g} Hz"
        elif n_failing < frequency.size:
            cycles = f"in cycles up to {frequency[n_failing - 1]:.2g} Hz"
        hold = f"in the hold in {100 * share:.0f} % of draws"
        first, second = (hold, cycles) if share >= LIKELY or n_failing == 0 else (cycles, hold)
        holds = "holds; " if share < LIKELY and n_failing == 0 else ""
        texts.append(f"{holds}fails {first}, {second}")
    return texts


def frozen_sentence(spectrum: xr.Dataset) -> str:
    """Say what is assumed of the microstructure, and by how much the stresses strain it."""
    share = float(spectrum["critical_share"])
    hours = float(spectrum["hold_time"]) / UNITS["time"]["h"]
    start = (
        "The closed form takes the microstructure as frozen. That fails in a draw where the strain "
        f"of the hold at the median stress ({number(hours)} h) or of one cycle is more than "
        f"{number(100 * share)} % of the smaller critical strain of what still evolves"
    )
    critical = spectrum["critical_strain"].to_numpy()
    if np.isnan(critical).all():
        return (
            f"{start}; the parameters do not say how it evolves, so where it does cannot be told."
        )
    if np.isinf(critical).all():
        return f"{start}; here nothing evolves any more."
    strain = spectrum["hold_strain"]
    held = strain.median([name for name in strain.dims if name != "regime"]).to_numpy()
    strains = ", ".join(
        f"{100 * value:.2g} % at {label}"
        for label, value in zip(spectrum["regime"].to_numpy(), held, strict=True)
    )
    return (
        f"{start} (median {float(np.median(critical)):.2g}). The hold strains by "
        f"{strains} (medians). A solution in time with evolving microstructure says by how much "
        "curves are off."
    )


def pale_sentence(spectrum: xr.Dataset) -> str:
    """Say at which stresses frozen microstructure fails in most draws, where curves are pale."""
    if np.isnan(spectrum["critical_strain"].to_numpy()).all():
        return "The microstructure is taken as frozen; whether it is cannot be told."
    pale = [
        f"{label}{'' if fails.all() else ' (slow cycles)'}"
        for label, fails in zip(spectrum["regime"].to_numpy(), likely_fails(spectrum), strict=True)
        if fails.any()
    ]
    if not pale:
        return "The microstructure is taken as frozen, which holds in most draws at these stresses."
    return (
        "The microstructure is taken as frozen, which fails in most draws at "
        f"{', '.join(pale)}: those curves are pale."
    )


def elastic_modulus_sentence(spectrum: xr.Dataset) -> str:
    """Say where the elastic modulus of a predicted spectrum comes from."""
    given = spectrum.attrs["elastic_modulus"]
    if given:
        return f"The elastic modulus is given: {given}."
    of_the_fit = "The elastic modulus is E_M of the fit."
    if spectrum.attrs["apparatus"] == "unseen":
        return of_the_fit
    return (
        f"{of_the_fit} If strain was read off the machine, as in most "
        "tests at constant rate, E_M is mostly the stiffness of the apparatus. Then tan δ at high "
        "frequency is too small; --elastic-modulus-Pa gives a modulus of the material instead."
    )
