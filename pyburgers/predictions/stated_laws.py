"""Laws of a fit as expressions in the names of its parameters, which exports state."""

import re
from collections.abc import Mapping

from pyburgers.flow_law_tables.laws import Mechanism, RateLaw
from pyburgers.kinds.experiment import Experiment
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
from pyburgers.model.priors import PriorSet
from pyburgers.model.variants import ModelVariant, variant_of
from pyburgers.posterior.labelled_draws import own_name

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
    """Return expressions of the laws of a fit, and initial and steady microstructure, by name.

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
    return {
        "flow_law": flow_law,
        **({"mechanisms": mechanisms} if mechanisms else {}),
        **({"hardening_law": hardening_law} if hardening.parameters else {}),
        "elastic_law": _elastic_law(priors, experiment),
        "kelvin_law": _kelvin_law(variant.kelvin, priors),
        "microstructure": {
            "undeformed": undeformed(start),
            **({"steady": {"grain_size": grain_size, "fabric_factor": fabric}} if is_told else {}),
        },
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
