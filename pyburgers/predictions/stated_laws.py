"""Laws of a fit: expressions in the names of its parameters, and creep laws for flow codes.

Exports state the expressions. Flow codes take one state of the material and second invariants, SI.
Axial compression by σ at a rate ε̇ has the second invariants τ = √(s:s/2) = σ/√3 and
ε̇_II = √(ε̇:ε̇/2) = (√3/2) ε̇. Hence ε̇ = A σ^n d^-p exp(-Q/(R T)) is
ε̇_II = [3^((n+1)/2)/2] A τ^n d^-p exp(-Q/(R T)).
"""

import re
from collections.abc import Mapping, Sequence
from dataclasses import astuple, dataclass, replace
from numbers import Real

import numpy as np

from pyburgers.common.array_types import FloatArray
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError, require_type
from pyburgers.common.units import UNITS, number
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import SampledFit
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.laws import Mechanism, RateLaw
from pyburgers.kinds.attenuation.table import Elasticity
from pyburgers.kinds.experiment import Experiment
from pyburgers.model.display import LENGTH_FACTOR, LENGTH_UNIT
from pyburgers.model.environment import environment_law
from pyburgers.model.laws import (
    DASHPOT_LAWS,
    HARDENING_LAWS,
    KELVIN_LAWS,
    MECHANISMS,
    further_rate,
    rate_of_mechanisms,
)
from pyburgers.model.parameters import STANDARD_VALUES
from pyburgers.model.prior_families import Prior, is_fixed_at
from pyburgers.model.priors import FLOW_LAW, PriorSet
from pyburgers.model.variants import ModelVariant, variant_of
from pyburgers.posterior.labelled_draws import own_name
from pyburgers.predictions.material import Material, fitted_material
from pyburgers.predictions.stress_cycles import A_REGIME, Regime, check_state, flow_rate

LOGARITHM = "ln_"
"""What names of logarithms of quantities begin with, in SI units."""

POWER_LAW = DASHPOT_LAWS["power_law"].flow_law


def is_logarithm(name: str) -> bool:
    """Whether a name is that of the logarithm of a quantity."""
    return name.startswith(LOGARITHM)


def undeformed(grain_size: str) -> dict[str, str]:
    """Return grain size and fabric factor of the material before a test."""
    return {"grain_size": grain_size, "fabric_factor": "1"}


def laws_of(
    prior_set: PriorSet, experiment: Experiment, material: ModelVariant | None = None
) -> dict[str, object]:
    """Return expressions of the laws of a fit, and of its microstructure and how that evolves.

    `material`: its laws in a joint fit. What evolves there but not in the test has no steady state.
    """
    priors, variant = prior_set.priors, variant_of(prior_set, experiment)
    start = f"{experiment.initial_grain_size:.10g}"
    grain_size = {
        "constant": start,
        "evolving": "steady_state_grain_size",
        "piezometric": "piezometer_reference_grain_size"
        "*(sqrt(stress^2 + piezometer_stress_floor^2)/1e6)^-piezometer_exponent",
    }[variant.grain_size]
    flow_law = DASHPOT_LAWS[variant.maxwell].flow_law + environment_law(priors)
    hardening = HARDENING_LAWS[variant.hardening]
    hardening_law, mechanisms = hardening.expression + environment_law(priors, "recovery_"), {}
    if hardening.parameters:
        flow_law = re.sub(r"\bstress\b", hardening.driving, flow_law) + hardening.density
    if variant.second_mechanism != "none":
        mechanisms = {
            "first_mechanism": flow_law.removeprefix("strain_rate = "),
            **{
                f"{which}_mechanism": further_rate(which) + environment_law(priors, f"{which}_")
                for which in MECHANISMS
                if variant.record()[f"{which}_mechanism"] != "none"
            },
        }
        rate = rate_of_mechanisms(variant.second_mechanism, variant.third_mechanism)
        flow_law = f"strain_rate = {rate}"
        hardening_law = hardening_law.replace("strain_rate", "first_mechanism")
    is_told = material is None or all(
        getattr(material, part) == getattr(variant, part) for part in ("grain_size", "fabric")
    )
    fabric = "1" if variant.fabric == "constant" else "steady_state_fabric_factor"
    evolving = {
        "steady": {"grain_size": grain_size, "fabric_factor": fabric},
        "change_per_path_strain": {
            "grain_size": "0"
            if variant.grain_size == "constant"
            else f"({grain_size} - grain_size)/critical_strain_grain_size",
            "fabric_factor": "0"
            if variant.fabric == "constant"
            else f"({fabric} - fabric_factor)/critical_strain_fabric",
        },
    }
    return {
        "flow_law": flow_law,
        **({"mechanisms": mechanisms} if mechanisms else {}),
        **({"hardening_law": hardening_law} if hardening.parameters else {}),
        "elastic_law": _elastic_law(priors, experiment),
        "kelvin_law": _kelvin_law(variant.kelvin, priors),
        "microstructure": {"undeformed": undeformed(start), **(evolving if is_told else {})},
    }


def _has(priors: Mapping[str, Prior], name: str) -> bool:
    return name in priors and not is_fixed_at(priors[name], STANDARD_VALUES[name])


def _elastic_law(priors: Mapping[str, Prior], experiment: Experiment) -> str:
    law, warmer = "elastic_strain = stress/maxwell_modulus", "modulus_temperature_coefficient"
    if warmer in experiment.without_effect or not _has(priors, warmer):
        return law
    return (
        f"{law}/(1 + modulus_temperature_coefficient*(temperature - modulus_reference_temperature))"
    )


def _kelvin_law(law: str, priors: Mapping[str, Prior]) -> str:
    slowing = ""
    if _has(priors, "kelvin_activation_enthalpy"):
        slowing += (
            "*exp(kelvin_activation_enthalpy/R*(1/temperature - 1/kelvin_reference_temperature))"
        )
    if _has(priors, "kelvin_grain_size_exponent"):
        slowing += "*(initial_grain_size/kelvin_reference_grain_size)^kelvin_grain_size_exponent"
    if faster := environment_law(priors, "kelvin_"):
        slowing += f"/({faster.removeprefix('*')})"
    return KELVIN_LAWS[law].expression.format(slower=slowing)


def composite_law(law: RateLaw) -> dict[str, object]:
    """Return the expression of a composite law, and that of each of its mechanisms."""
    processes: dict[int, list[str]] = {}
    for one in law.mechanisms:
        processes.setdefault(one.process, []).append(one.name)
    parts = (
        steps[0] if len(steps) == 1 else f"1/({' + '.join(f'1/{step}' for step in steps)})"
        for steps in processes.values()
    )
    return {
        "flow_law": f"strain_rate = {' + '.join(parts)}",
        "mechanisms": {one.name: _mechanism_law(law, one) for one in law.mechanisms},
    }


def _mechanism_law(law: RateLaw, one: Mechanism) -> str:
    """Return the expression of the rate of a mechanism, SI."""
    at, q = law.reference, "activation_enthalpy"
    first = 1 / at.temperature
    stress, grain_size = f"(stress/{at.stress:.10g})", f"(grain_size/{at.grain_size:.10g})"
    rate = f"exp({LOGARITHM}mechanism_rate)"
    if one.has_beta:
        first, stress, grain_size, rate = 0.0, "stress", "grain_size", f"exp(beta*{q})"
    warmer = ""
    if one.premelting_temperature:
        warmer = (
            f" + (premelting_enthalpy - {q})*min(1/temperature - "
            f"{1 / one.premelting_temperature:.10g}, 0)"
        )
    text = (
        f"{rate}*{stress}^stress_exponent*{grain_size}^-grain_size_exponent"
        f"*exp(-({q}*(1/temperature - {first:.10g}){warmer})/R)"
    )
    for name in one.parameters:
        text = text.replace(name, own_name(name, one.name))
    return text + environment_law(law.priors.priors, of=f"[{one.name}]")


RATE_INVARIANT = float(np.sqrt(3)) / 2
"""Second invariant of the rate of axial compression, over that rate."""

STRESS_FACTOR = Elasticity("shear").stress_factor
"""Stress of axial compression over its second invariant."""

LARGEST_EXPONENT = 700.0
"""Largest |ln A| of a prefactor that all codes can hold as a double number."""

MPA, YEAR = UNITS["stress"]["MPa"], 365.25 * UNITS["time"]["h"] * 24
"""Units of ice-sheet codes in SI units; the year is the Julian one."""


@dataclass(frozen=True)
class Stated:
    """Choices beside the fit, in SI units; `pyburgers.export` describes them."""

    microstructure: str | None = None
    grain_size: float | None = None
    fabric_factor: float | None = None
    temperatures: Sequence[float] = ()
    frequencies: Sequence[float] = ()
    regime: Regime | None = None
    poisson_ratio: float | None = None
    elastic_modulus: float | None = None

    def __post_init__(self) -> None:
        """Refuse numbers out of range."""
        for name in ("grain_size", "fabric_factor", "poisson_ratio", "elastic_modulus"):
            value = getattr(self, name)
            if value is not None:
                require_type(name, value, Real, "a number")
        if self.regime is not None:
            require_type("regime", self.regime, Regime, A_REGIME)
        none: Sequence[float] = ()
        check_state(
            self.temperatures,
            none if self.grain_size is None else self.grain_size,
            none if self.fabric_factor is None else self.fabric_factor,
        )
        if self.poisson_ratio is not None and not -1 < self.poisson_ratio < 0.5:
            raise InputError(
                f"poisson_ratio: found {self.poisson_ratio:g}, expected a number from -1 to 0.5."
            )


@dataclass(frozen=True)
class CreepLaw:
    """Power law ε̇ = exp(log_factor) σ^n d^-p exp(-Q/(R T)) in axial compression, d (m) and F."""

    log_factor: float
    stress_exponent: float
    grain_size_exponent: float
    activation_energy: float
    grain_size: float
    fabric_factor: float

    @property
    def prefactor(self) -> float:
        """A of second invariants, Pa^-n m^p s^-1; raises `InputError` if no double number is it."""
        log_prefactor = (
            self.log_factor + self.stress_exponent * np.log(STRESS_FACTOR) + np.log(RATE_INVARIANT)
        )
        if abs(log_prefactor) > LARGEST_EXPONENT:
            raise InputError(
                f"prefactor: found exp({log_prefactor:.4g}), expected at most "
                f"exp(±{LARGEST_EXPONENT:g}), which a double number holds; use --format json."
            )
        return float(np.exp(log_prefactor))

    def at_its_grain_size(self) -> "CreepLaw":
        """Return the same law with the effect of its grain size in the prefactor, p = 0."""
        factor = self.log_factor - self.grain_size_exponent * np.log(self.grain_size)
        return replace(self, log_factor=float(factor), grain_size_exponent=0.0)


@dataclass(frozen=True, eq=False)
class CreepLaws:
    """Creep laws of all draws: fields of `CreepLaw` (n_draws,), and in words their state."""

    columns: Mapping[str, FloatArray]
    state: str

    @property
    def mean(self) -> CreepLaw:
        """The law whose ln(rate) is everywhere the posterior mean of ln(rate)."""
        means = {name: float(one.mean()) for name, one in self.columns.items()}
        for state, exponent in (
            ("grain_size", "grain_size_exponent"),
            ("fabric_factor", "stress_exponent"),
        ):
            found, exponents = self.columns[state], self.columns[exponent]
            weights = exponents if exponents.sum() else np.ones(exponents.size)
            means[state] = float(
                np.exp(np.average(np.log(found), weights=weights)) if np.ptp(found) else found[0]
            )
        return CreepLaw(**means)

    def draw(self, k: int) -> CreepLaw:
        """Return the law of a draw, counted from 0 along all chains."""
        return CreepLaw(**{name: float(one[k]) for name, one in self.columns.items()})


def rate_factors(laws: Sequence[CreepLaw], temperatures: Sequence[float]) -> FloatArray:
    """Return A exp(-Q/(R T)) d^-p of second invariants (MPa^-n a^-1), (n_laws, n_temperatures)."""
    rows = np.array([*map(astuple, laws)])
    log_factor, exponent, grain_size_exponent, energy, size, _ = rows.T
    parameters = {
        "stress_exponent": exponent,
        "grain_size_exponent": grain_size_exponent,
        "activation_enthalpy": energy,
        "beta": log_factor / energy,
    }
    rates = [
        flow_rate(parameters, STRESS_FACTOR * MPA, temperature=one, grain_size=size)
        for one in temperatures
    ]
    return np.asarray(np.stack(rates, axis=-1) * RATE_INVARIANT * YEAR)


def creep_laws(fit: SampledFit, stated: Stated, code: str) -> CreepLaws:
    """Return the creep laws of all draws in a stated state, if the dashpot is a power law."""
    if isinstance(fit, RateFit):
        if not fit.law.is_power_law:
            raise InputError(
                f"{code}: cannot express {fit.law.priors.title!r}, expected a power law; use "
                "--format json."
            )
        draws = fit.power_law()
        if stated.microstructure == "steady_state":
            raise InputError(
                f"{code}: found the microstructure 'steady_state', of which {fit.data.id} tells "
                "nothing, expected 'initial' or none."
            )
        has_grains = bool(draws["grain_size_exponent"].any())
        if stated.grain_size is None and has_grains:
            raise InputError(
                f"{code}: found no grain size of undeformed material, expected --grain-size-um "
                "because the law of a table holds for that."
            )
        fabric = np.full_like(draws["beta"], stated.fabric_factor or 1.0)
        size = stated.grain_size or 1e-3  # without effect unless stated
        grain_size = np.full_like(draws["beta"], size)
        least = " at their least rates" if fit.law.enhancements else ""
        whose = f"of the tests{least}" if fit.softening is None else "undeformed"
        state = whose
        if has_grains:
            state += f", grain size {number(size * LENGTH_FACTOR)} {LENGTH_UNIT}"
    else:
        assert isinstance(fit, Fit)
        if fit.variant.hardening != "none":
            raise InputError(
                f"{code}: cannot express the backstress of the fit, which changes with time, "
                "expected a dashpot without one; fit with --variant hardening=none, or use "
                "--format json."
            )
        if fit.variant.second_mechanism != "none":
            raise InputError(
                f"{code}: cannot express several mechanisms of the dashpot, expected a power "
                "law; fit with one mechanism, or use --format json."
            )
        if DASHPOT_LAWS[fit.variant.maxwell].own_stress:
            raise InputError(
                f"{code}: cannot express the dashpot {fit.variant.maxwell!r} of the fit, expected "
                "a power law; fit with --variant maxwell=power_law, or use --format json."
            )
        if environment_law(fit.priors.priors):
            raise InputError(
                f"{code}: cannot express a flow law that depends on pressure, water or melt, "
                "expected one that does not; use --format json."
            )
        found = fit.posterior["posterior"].to_dataset()
        draws = {name: all_draws(found[name]) for name in FLOW_LAW}
        has_grains = bool(draws["grain_size_exponent"].any())
        material = stated_material(fit, stated, code, has_grains=has_grains)
        grain_size, fabric = material.grain_size.ravel(), material.fabric_factor.ravel()
        state = material.attributes["microstructure"]
    columns = {
        "log_factor": draws["beta"] * draws["activation_enthalpy"]
        - draws["stress_exponent"] * np.log(fabric),
        "stress_exponent": draws["stress_exponent"],
        "grain_size_exponent": draws["grain_size_exponent"],
        "activation_energy": draws["activation_enthalpy"],
        "grain_size": grain_size,
        "fabric_factor": fabric,
    }
    return CreepLaws(columns, state)


def stated_material(fit: Fit, stated: Stated, code: str, *, has_grains: bool = True) -> Material:
    """Return the material in its state, which has to be stated if its microstructure evolves.

    `has_grains`: whether the grain size matters.
    """
    variant, chosen = (fit.whole or fit).variant, stated.microstructure
    open_grains = has_grains and variant.grain_size != "constant" and stated.grain_size is None
    open_fabric = variant.fabric != "constant" and stated.fabric_factor is None
    if chosen is None and (open_grains or open_fabric):
        evolving = " and ".join(["grain size"] * open_grains + ["fabric"] * open_fabric)
        raise InputError(
            f"{code}: cannot express the evolving {evolving} of the fit, expected one state: "
            "--microstructure initial or steady-state, or --grain-size-um and --fabric-factor."
        )
    if chosen == "steady_state" and open_grains and variant.grain_size == "piezometric":
        raise InputError(
            f"{code}: cannot express a grain size that follows the stress (piezometer), expected "
            "--grain-size-um for the steady state."
        )
    return fitted_material(
        fit,
        microstructure=chosen or "initial",
        temperature=stated.temperatures[0] if stated.temperatures else None,
        grain_size=stated.grain_size,
        fabric_factor=stated.fabric_factor,
        elastic_modulus=stated.elastic_modulus,
    )
