"""What a prediction is about: draws of a fitted material, its state, and what a spectrum assumes.

Grain size and fabric relax towards a steady state with strain, over the critical strains
epsilon_c1 and epsilon_c2 (`stan/physics/microstructure.stan`). A spectrum in closed form takes them
as frozen, which fails in a draw where the strain of the hold, or of one cycle, is more than a share
of the smaller critical strain of what still evolves (`critical_strain`). A spectrum also takes an
elastic modulus, which may be that of the apparatus.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from numbers import Real
from types import MappingProxyType
from typing import Any

import numpy as np
import xarray as xr

from pyburgers.common.array_types import BoolArray, IntArray
from pyburgers.common.draws import FloatArray, evenly_spaced
from pyburgers.common.errors import InputError, require_type
from pyburgers.common.units import UNITS, number
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.prediction import MODULUS_OF_MACHINE
from pyburgers.fitting.sampled_fit import PRIOR_ALONE, SampledFit
from pyburgers.kinds.conditions import Ranges, environment_ranges, ranges_text
from pyburgers.kinds.kind import FittedTest
from pyburgers.model.closed_forms import with_maxwell_modulus
from pyburgers.model.display import LENGTH_FACTOR, LENGTH_UNIT
from pyburgers.model.environment import acting_environment, check_environment
from pyburgers.model.parameters import ENVIRONMENT, ENVIRONMENT_NUMBERS
from pyburgers.model.variants import variant_of
from pyburgers.predictions.stress_cycles import (
    EVOLUTION,
    OTHER_PARAMETERS,
    PARAMETER_NAMES,
    Regime,
    flow_rate,
)

MICROSTRUCTURES = ("initial", "steady_state")


@dataclass(frozen=True, eq=False)
class Material:
    """Draws (SI) of a material, shape (n_chains, n_draws), and its state under the stresses.

    Chain and draw are their numbers in the fit. Attributes are title, experiment, material,
    data_kind, microstructure, elastic_modulus, which is empty if it is that of the fit, and
    apparatus, which is "unseen" if the fitted test is one of the material alone.
    """

    parameters: Mapping[str, FloatArray]
    temperature: float
    grain_size: FloatArray
    fabric_factor: FloatArray
    chain: IntArray
    draw: IntArray
    attributes: Mapping[str, str]

    @property
    def state(self) -> dict[str, Any]:
        """Temperature, grain size and fabric factor, as arguments of the same names."""
        names = ("temperature", "grain_size", "fabric_factor")
        return {name: getattr(self, name) for name in names}

    def thinned(self, at_most: int) -> "Material":
        """Return the material with evenly spaced draws, shape (n,)."""
        return replace(
            self,
            parameters={
                name: evenly_spaced(one.ravel(), at_most) for name, one in self.parameters.items()
            },
            grain_size=evenly_spaced(self.grain_size.ravel(), at_most),
            fabric_factor=evenly_spaced(self.fabric_factor.ravel(), at_most),
        )

    def dashpot_rates(self, regimes: Sequence[Regime]) -> Ranges:
        """Return the range of median rates (1/s) of the dashpot at the highest stresses."""
        highest = [one.median_stress + one.amplitude for one in regimes]
        rates = flow_rate(
            self.parameters, np.reshape([min(highest), max(highest)], (2, 1, 1)), **self.state
        )
        least, most = np.median(rates, axis=(1, 2))
        return {"strain rate": (float(least), float(most))}


def fitted_material(
    fit: FittedTest,
    *,
    microstructure: str = "initial",
    temperature: float | None = None,
    grain_size: float | None = None,
    fabric_factor: float | None = None,
    elastic_modulus: float | None = None,
    elastic_modulus_sd: float = 0.0,
    environment: Mapping[str, float] = MappingProxyType({}),
    seed: int = 1,
) -> Material:
    """Return the material of a fit, by arguments of `pyburgers.predict_attenuation`."""
    if microstructure not in MICROSTRUCTURES:
        expected = " or ".join(map(repr, MICROSTRUCTURES))
        raise InputError(f"microstructure: found {microstructure!r}, expected {expected}.")
    for name, given in (
        ("temperature", temperature),
        ("grain_size", grain_size),
        ("fabric_factor", fabric_factor),
        ("elastic_modulus", elastic_modulus),
        ("elastic_modulus_sd", elastic_modulus_sd),
    ):
        if given is not None:
            require_type(name, given, Real, "one number")
    experiment = fit.experiment
    draws = fit.posterior["posterior"].to_dataset().transpose("chain", "draw", ...)
    parameters = {
        name: draws[name].to_numpy().astype(np.float64)
        for name in (*PARAMETER_NAMES, *OTHER_PARAMETERS)
        if name in draws and name not in experiment.without_effect
    }
    shape = parameters["maxwell_modulus"].shape
    check_environment(environment)
    for name, value in environment.items():
        parameters[name] = np.full(shape, value)
        if name not in acting_environment(parameters):
            number = ENVIRONMENT_NUMBERS[ENVIRONMENT.index(name)]
            raise InputError(
                f"environment: found {name}, on which no rate of the fit depends, expected none or "
                f"a fit with a prior of {number} or another one of its kind."
            )
    if elastic_modulus is not None:
        moduli = _modulus_draws(elastic_modulus, elastic_modulus_sd, shape, seed)
        parameters = with_maxwell_modulus(parameters, moduli)
    elif elastic_modulus_sd:
        raise InputError(
            f"elastic_modulus_sd: found {elastic_modulus_sd:g} Pa without elastic_modulus, "
            "expected both or none."
        )
    laws, tests = variant_of(fit.priors, experiment), [experiment]
    if isinstance(fit, Fit) and fit.whole is not None:
        # A table tells nothing of what evolves in the other tests.
        laws, tests = fit.whole.variant, [*fit.whole.problem.experiments]
    size, fabric = np.full(shape, experiment.initial_grain_size), np.ones(shape)
    if microstructure == "steady_state":
        unknown = [
            option
            for option, law, given, name in (
                ("--grain-size-um", laws.grain_size, grain_size, "steady_state_grain_size"),
                ("--fabric-factor", laws.fabric, fabric_factor, "steady_state_fabric_factor"),
            )
            if law == "evolving" and given is None and name not in parameters
        ]
        if unknown:
            raise InputError(
                f"microstructure: found 'steady_state', of which {experiment.id} tells nothing, "
                f"expected {' and '.join(unknown)}, or another test of the joint fit."
            )
        size = parameters.get("steady_state_grain_size", size)
        fabric = parameters.get("steady_state_fabric_factor", fabric)
    size = size if grain_size is None else np.full(shape, grain_size)
    fabric = fabric if fabric_factor is None else np.full(shape, fabric_factor)
    any_strain = np.ones(shape)
    # Constant in a fit of tables alone, because nothing is seen to evolve there.
    is_told = any("steady_state_grain_size" not in one.without_effect for one in tests)
    if laws.grain_size == "constant":
        parameters.pop("piezometer_reference_grain_size", None)
    if laws.grain_size == "constant" and is_told:
        parameters |= {"steady_state_grain_size": size, "critical_strain_grain_size": any_strain}
    if laws.fabric == "constant" and is_told:
        parameters |= {"steady_state_fabric_factor": fabric, "critical_strain_fabric": any_strain}
    at = experiment.temperature if temperature is None else temperature
    described = _microstructure_text(microstructure, grain_size, fabric_factor)
    modulus = _modulus_text(elastic_modulus, elastic_modulus_sd)
    conditions = [f"{at:g} K", described]
    there = {**experiment.environment, **environment}
    acting = {name: there[name] for name in acting_environment(parameters) if name in there}
    conditions += [ranges_text(environment_ranges(acting))] if acting else []
    conditions += [f"elastic modulus {modulus}"] if modulus else []
    origin = f"fitted to {experiment.provenance.kind} data"
    if isinstance(fit, SampledFit) and fit.draws_of == PRIOR_ALONE:
        origin = "drawn from priors"
    return Material(
        parameters=parameters,
        temperature=at,
        grain_size=size,
        fabric_factor=fabric,
        chain=draws["chain"].to_numpy(),
        draw=draws["draw"].to_numpy(),
        attributes={
            "title": f"{experiment.id} ({experiment.material}, {origin}): {', '.join(conditions)}",
            "experiment": experiment.id,
            "material": experiment.material,
            "data_kind": experiment.provenance.kind,
            "apparatus": "unseen" * ("apparatus_compliance" in experiment.without_effect),
            "microstructure": described,
            "elastic_modulus": modulus,
        },
    )


def _modulus_draws(
    mean: float, standard_deviation: float, shape: tuple[int, ...], seed: int
) -> FloatArray:
    """Draws of a log-normal elastic modulus, Pa."""
    if not (np.isfinite(mean) and mean > 0):
        raise InputError(f"elastic_modulus: found {mean:g} Pa, expected a positive modulus.")
    if not (np.isfinite(standard_deviation) and standard_deviation >= 0):
        raise InputError(
            f"elastic_modulus_sd: found {standard_deviation:g} Pa, expected 0 or a positive number."
        )
    variance = np.log1p((standard_deviation / mean) ** 2)
    normal = np.random.default_rng(seed).normal(size=shape)
    return np.asarray(mean * np.exp(np.sqrt(variance) * normal - 0.5 * variance))


def _modulus_text(mean: float | None, standard_deviation: float) -> str:
    """Say in words what elastic modulus was given; empty where none was."""
    if mean is None:
        return ""
    scatter = (
        f" ± {number(standard_deviation / UNITS['stress']['GPa'])}" if standard_deviation else ""
    )
    return f"{number(mean / UNITS['stress']['GPa'])}{scatter} GPa"


def _microstructure_text(
    microstructure: str, grain_size: float | None, fabric_factor: float | None
) -> str:
    """Say in words what was frozen."""
    said = []
    if grain_size is None or fabric_factor is None:
        said.append(f"{microstructure.replace('_', '-')} microstructure")
    if grain_size is not None:
        said.append(f"grain size {number(grain_size * LENGTH_FACTOR)} {LENGTH_UNIT}")
    if fabric_factor is not None:
        said.append(f"fabric factor {number(fabric_factor)}")
    return ", ".join(said)


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
    return np.asarray(np.where(change > 0, critical / np.maximum(1.0, change), np.inf))


def strain_fails(spectrum: xr.Dataset, strain: str) -> xr.DataArray:
    """Whether ``hold_strain`` or ``cycle_strain`` is too large by draw: 1 or 0, NaN if unknown."""
    critical = spectrum["critical_strain"]
    fails = spectrum[strain] > float(spectrum["critical_share"]) * critical
    return fails.astype(np.float64).where(critical.notnull())


def probability(of_draws: xr.DataArray) -> FloatArray:
    """Share of draws in which something is so, (n_regimes,) or (n_regimes, n_frequencies)."""
    draws = [name for name in of_draws.dims if name not in ("regime", "frequency")]
    return np.asarray(of_draws.mean(draws).transpose("regime", ...).to_numpy())


def likely_fails(spectrum: xr.Dataset) -> BoolArray:
    """Where frozen microstructure fails in most draws, shape (n_regimes, n_frequencies)."""
    return np.asarray(probability(spectrum["frozen_fails"]) >= LIKELY)


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
    if spectrum.attrs["apparatus"] == "unseen":
        return "The elastic modulus is E_M of the fit."
    return (
        f"{MODULUS_OF_MACHINE} Then tan δ at high frequency is too small; --elastic-modulus-Pa "
        "gives a modulus of the material instead."
    )
