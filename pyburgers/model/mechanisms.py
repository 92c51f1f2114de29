"""Further mechanisms of the dashpot: how priors tell their laws, and their priors."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from pyburgers.common.errors import InputError
from pyburgers.model.laws import HARDENING_SWITCH, MECHANISMS
from pyburgers.model.parameters import (
    FURTHER_MECHANISMS,
    MECHANISM_REFERENCES,
    PARAMETER_BY_NAME,
    STANDARD_VALUES,
)
from pyburgers.model.prior_families import Prior, fixed_prior, is_fixed_at, is_standard

SOURCE = "Variant {}_mechanism="
"""Beginning of the source of a number that a choice has put into priors."""


def mechanism(which: str, priors: Mapping[str, Prior]) -> str:
    """Tell the law of the second or third mechanism from priors."""
    rate, exponent, *_, in_series = FURTHER_MECHANISMS[which]
    if is_standard(priors, rate):
        return "none"
    if not is_standard(priors, in_series):
        return "in_series"
    return "diffusion" if is_fixed_at(priors[exponent], 1.0) else "power_law"


def check_mechanisms(priors: Mapping[str, Prior], where: str) -> None:
    """Raise InputError for mechanisms that no dashpot has together."""
    second, third = (mechanism(which, priors) for which in FURTHER_MECHANISMS)
    if second == "in_series" and not is_standard(priors, HARDENING_SWITCH):
        raise InputError(
            f"{where}: a backstress can turn the flow of the first mechanism against the stress, "
            "found second_mechanism=in_series, expected hardening=none or mechanisms side by side."
        )
    if second == "none" != third:
        raise InputError(
            f"{where}: found third_mechanism={third} without a second mechanism, expected it as "
            f"the second one (second_mechanism={third}) or a second one too."
        )


def changes_of_mechanism(
    which: str,
    law: str,
    priors: Mapping[str, Prior],
    weak: Prior,
    conditions: Sequence[float],
) -> Sequence[Prior]:
    """Return the priors to exchange for another law of the second or third mechanism.

    `conditions` are stress (Pa), grain size (m) and temperature (K) for which the rate is given;
    those of the second mechanism stay for the third. `weak` is the prior of the rate where priors
    do not give one. The median is then that of a dashpot as viscous as the Kelvin element in its
    prior mean. Numbers that another choice has put into the priors make way.
    """
    if law == mechanism(which, priors):
        return ()
    rate, *_, enthalpy, in_series = FURTHER_MECHANISMS[which]
    source = SOURCE.format(which)
    if law == "none":
        return [
            fixed_prior(PARAMETER_BY_NAME[name], STANDARD_VALUES[name], f"{source}{law}")
            for name in (rate, in_series)
        ]
    numbers = {
        **MECHANISMS[which][law].held,
        enthalpy: float(priors["activation_enthalpy"].mean_sd()[0]),
        **dict(zip(MECHANISM_REFERENCES, conditions, strict=True)),
    }
    held = {
        name: value
        for name, value in numbers.items()
        if name not in priors or priors[name].source.startswith(source)
    }
    changed = [
        fixed_prior(PARAMETER_BY_NAME[name], value, f"{source}{law}")
        for name, value in {in_series: float(MECHANISMS[which][law].in_series), **held}.items()
    ]
    if is_standard(priors, rate) or priors[rate].source == weak.source:
        given_at = MECHANISM_REFERENCES[0]
        stress = held[given_at] if given_at in held else priors[given_at].location
        median = stress / priors["kelvin_viscosity"].mean_sd()[0]
        changed.append(replace(weak, location=float(f"{median:.0e}")))
    return changed
