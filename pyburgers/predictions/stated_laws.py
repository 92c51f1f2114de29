"""Laws of a fit as expressions for exports, and the microstructures that each law holds for.

The expressions use the names of the exported parameters and the variables of `VARIABLES`. Tests
evaluate the expressions and compare the values with those of the Stan functions.
"""

from collections.abc import Mapping
from types import MappingProxyType

from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.laws import DASHPOT_LAWS, KELVIN_LAWS
from pyburgers.model.parameters import STANDARD_VALUES
from pyburgers.model.prior_families import Prior, is_fixed_at
from pyburgers.model.priors import PriorSet
from pyburgers.model.variants import Test, variant_of

VARIABLES: Mapping[str, str] = MappingProxyType(
    {
        "stress": "Pa",
        "temperature": "K",
        "grain_size": "m",
        "initial_grain_size": "m",
        "fabric_factor": "1",
        "kelvin_strain": "1",
        "time": "s",
        "R": f"{GAS_CONSTANT:.10g} J/(mol K)",
    }
)
"""Units of the variables, and the gas constant; stress and strain are positive in compression."""

POWER_LAW = DASHPOT_LAWS["power_law"].flow_law


def undeformed(grain_size: str) -> dict[str, str]:
    """Return grain size and fabric factor of the material before a test."""
    return {"grain_size": grain_size, "fabric_factor": "1"}


def laws_of(prior_set: PriorSet, experiment: Test) -> dict[str, object]:
    """Return the laws of a fit of a test by name, and the microstructures that they hold for.

    Flow, elastic and Kelvin law are expressions; ``microstructure`` gives grain size and fabric
    factor before the test and in the steady state.
    """
    priors, variant = prior_set.priors, variant_of(prior_set, experiment)
    start = f"{experiment.initial_grain_size:.10g}"
    grain_size = {
        "constant": start,
        "evolving": "steady_state_grain_size",
        "piezometric": "piezometer_reference_grain_size"
        "*(sqrt(stress^2 + piezometer_stress_floor^2)/1e6)^-piezometer_exponent",
    }[variant.grain_size]
    fabric = "1" if variant.fabric == "constant" else "steady_state_fabric_factor"
    return {
        "flow_law": DASHPOT_LAWS[variant.maxwell].flow_law,
        "elastic_law": _elastic_law(priors),
        "kelvin_law": _kelvin_law(variant.kelvin, priors),
        "microstructure": {
            "undeformed": undeformed(start),
            "steady": {"grain_size": grain_size, "fabric_factor": fabric},
        },
    }


def _has(priors: Mapping[str, Prior], name: str) -> bool:
    return name in priors and not is_fixed_at(priors[name], STANDARD_VALUES[name])


def _elastic_law(priors: Mapping[str, Prior]) -> str:
    law = "elastic_strain = stress/maxwell_modulus"
    if not _has(priors, "modulus_temperature_coefficient"):
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
    return KELVIN_LAWS[law].expression.format(slower=slowing)
