"""A second mechanism of the dashpot: how priors tell its law, and their priors."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from pyburgers.common.errors import InputError
from pyburgers.model.laws import HARDENING_SWITCH, SECOND_MECHANISMS, SECOND_SWITCH
from pyburgers.model.parameters import (
    IN_SERIES,
    PARAMETER_BY_NAME,
    SECOND_REFERENCES,
    STANDARD_VALUES,
)
from pyburgers.model.prior_families import Prior, fixed_prior, is_fixed_at, is_standard

SOURCE = "Variant second_mechanism="
"""Beginning of the source of a number that a choice has put into priors."""


def second_mechanism(priors: Mapping[str, Prior]) -> str:
    """Tell the law from priors."""
    if is_standard(priors, SECOND_SWITCH):
        return "none"
    if not is_standard(priors, IN_SERIES):
        return "in_series"
    linear = is_fixed_at(priors["second_stress_exponent"], 1.0)
    return "diffusion" if linear else "power_law"


def check_mechanisms(priors: Mapping[str, Prior], where: str) -> None:
    """Raise InputError for a mechanism in series with one that flows by another stress."""
    if second_mechanism(priors) == "in_series" and not is_standard(priors, HARDENING_SWITCH):
        raise InputError(
            f"{where}: a backstress can turn the flow of the first mechanism against the stress, "
            "found second_mechanism=in_series, expected hardening=none or mechanisms side by side."
        )


def changes_of_mechanism(
    law: str, priors: Mapping[str, Prior], weak: Prior, conditions: Sequence[float]
) -> Sequence[Prior]:
    """Return the priors to exchange for another law.

    `conditions` are stress (Pa), grain size (m) and temperature (K) for which the rate is given.
    `weak` is its prior where priors do not give one. The median is then that of a dashpot as
    viscous as the Kelvin element in its prior mean. Numbers that another choice has put into the
    priors make way.
    """
    if law == second_mechanism(priors):
        return ()
    if law == "none":
        return [
            fixed_prior(PARAMETER_BY_NAME[name], STANDARD_VALUES[name], f"{SOURCE}{law}")
            for name in (SECOND_SWITCH, IN_SERIES)
        ]
    numbers = {
        **SECOND_MECHANISMS[law].held,
        "second_activation_enthalpy": float(priors["activation_enthalpy"].mean_sd()[0]),
        **dict(zip(SECOND_REFERENCES, conditions, strict=True)),
    }
    held = {
        name: value
        for name, value in numbers.items()
        if name not in priors or priors[name].source.startswith(SOURCE)
    }
    changed = [
        fixed_prior(PARAMETER_BY_NAME[name], value, f"{SOURCE}{law}")
        for name, value in {IN_SERIES: float(law == "in_series"), **held}.items()
    ]
    if is_standard(priors, SECOND_SWITCH) or priors[SECOND_SWITCH].source == weak.source:
        rate = conditions[0] / priors["kelvin_viscosity"].mean_sd()[0]
        changed.append(replace(weak, location=float(f"{rate:.0e}")))
    return changed
