"""Laws of the Kelvin part, the dashpot and its further mechanisms: how priors tell them.

The functions also return the priors to exchange for another law (`pyburgers.model.laws`).
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np

from pyburgers.common.errors import InputError
from pyburgers.model.fitted_test import Test, set_up_stress
from pyburgers.model.laws import (
    DASHPOT_STRESSES,
    HARDENING_SWITCH,
    KELVIN_LAWS,
    KELVIN_SWITCHES,
    MECHANISMS,
)
from pyburgers.model.parameters import (
    FURTHER_MECHANISMS,
    MECHANISM_REFERENCES,
    STANDARD_VALUES,
)
from pyburgers.model.prior_families import (
    Prior,
    SomePriors,
    fixed_by_variant,
    is_fixed_at,
    is_standard,
    priors_of_freed_parameters,
)

REFERENCE_STRESS_SHARE = 0.25
"""Driving stress for which the viscosity of a power-law Kelvin dashpot is given, over the largest
measured stress: of the order of what drives the element while it creeps."""


def kelvin_law(priors: Mapping[str, Prior], where: str) -> str:
    """Tell the law of the Kelvin part from priors by parameter; `where` is for messages.

    Raises InputError if parameters of laws are free that do not go together.
    """
    on = [name for name in KELVIN_SWITCHES if not is_standard(priors, name)]
    for law in KELVIN_LAWS.values():
        if {*law.switches} == {*on} and all(is_standard(priors, name) for name in law.without):
            return law.name
    raise InputError(
        f"{where}: found effects of {' and '.join(on)} in the priors, expected one law of the "
        "Kelvin part (a peak only on top of a band of relaxation times)."
    )


def changes_of_kelvin(given: SomePriors, test: Test, law: str) -> Sequence[Prior]:
    """Return the priors to exchange for another law of the Kelvin part.

    Modulus and viscosity are given for conditions of the test where the priors do not say others.
    Raises InputError if the priors fix a parameter by a convention of their law, and the other law
    does not.
    """
    priors, freed = given.priors, priors_of_freed_parameters()
    found = kelvin_law(priors, test.id)
    if law == found:
        return ()
    wanted, present = KELVIN_LAWS[law], KELVIN_LAWS[found]
    references = {"kelvin_reference_temperature": test.temperature}
    if wanted.own_stress:
        stress = REFERENCE_STRESS_SHARE * set_up_stress(test, wanted.parameters)
        references["kelvin_reference_stress"] = float(f"{stress:.0e}")
    else:
        references["kelvin_reference_grain_size"] = test.initial_grain_size
    for name in present.conventions:
        if priors[name].is_fixed:
            raise InputError(
                f"{test.id}: kelvin={law} needs a prior of {name}, which is fixed with the law "
                f"{found} of the Kelvin part, expected the priors of the material."
            )
    switches = {*KELVIN_SWITCHES, *(name for one in KELVIN_LAWS.values() for name in one.without)}
    values = {
        name: STANDARD_VALUES[name]
        for name in sorted({*switches, *present.parameters})
        if name in priors and name not in wanted.parameters
    }
    values |= {name: STANDARD_VALUES[name] for name in wanted.without}
    if law != "linear":
        values |= {name: value for name, value in references.items() if name not in priors}
    for name in wanted.conventions:
        if not priors[name].is_fixed:
            values[name] = float(f"{priors[name].mean_sd()[0]:.0e}")
    fixed = (fixed_by_variant(name, value, f"kelvin={law}") for name, value in values.items())
    put_in = [
        replace(freed[name], **wanted.weak_priors.get(name, {}))
        for name in wanted.parameters
        if name not in priors
        or (is_standard(priors, name) and (name in switches or name not in present.parameters))
    ]
    return [*fixed, *put_in]


def dashpot_law(priors: Mapping[str, Prior], where: str) -> str:
    """Tell the law of the dashpot from priors by parameter; `where` is for messages.

    Raises InputError if there is more than one stress of a law's own.
    """
    on = [name for name in DASHPOT_STRESSES if not is_standard(priors, name)]
    if len(on) > 1:
        raise InputError(
            f"{where}: found effects of {' and '.join(on)} in the priors, expected one law of the "
            "dashpot."
        )
    if on:
        return DASHPOT_STRESSES[on[0]].name
    return "linear" if is_fixed_at(priors["stress_exponent"], 1.0) else "power_law"


def beta_of_linear(beta: Prior, exponent: Prior, per_exponent: float) -> Prior:
    """Return the prior of beta moved to n = 1, where a rate moves it by so much for each n."""
    mean, spread = exponent.mean_sd()
    return replace(
        beta,
        location=float(beta.location + (mean - 1) * per_exponent),
        scale=0.0 if beta.is_fixed else float(np.hypot(beta.scale, spread * per_exponent)),
        source=f"Variant maxwell=linear: moved to n = 1 at the largest stress; {beta.source}",
    )


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


def changes_of_mechanism(which: str, given: SomePriors, test: Test, law: str) -> Sequence[Prior]:
    """Return the priors to exchange for another law of the second or third mechanism.

    The rate is given at the largest stress, to one digit, before the test; the conditions of the
    second mechanism stay for the third. If priors do not give a rate, its median is that of a
    dashpot as viscous as the Kelvin element in its prior mean. Numbers that another choice has put
    into the priors make way.
    """
    priors, choice = given.priors, f"{which}_mechanism={law}"
    if law == mechanism(which, priors):
        return ()
    rate, *_, enthalpy, in_series = FURTHER_MECHANISMS[which]
    if law == "none":
        return [fixed_by_variant(name, STANDARD_VALUES[name], choice) for name in (rate, in_series)]
    own = (rate, in_series) if MECHANISMS[which][law].in_series else (rate,)
    stress_of_test = float(f"{set_up_stress(test, own):.0e}")
    conditions = (stress_of_test, test.initial_grain_size, test.temperature)
    numbers = {
        **MECHANISMS[which][law].held,
        enthalpy: float(priors["activation_enthalpy"].mean_sd()[0]),
        **dict(zip(MECHANISM_REFERENCES, conditions, strict=True)),
    }
    held = {
        name: value
        for name, value in numbers.items()
        if name not in priors or priors[name].source.startswith(f"Variant {which}_mechanism=")
    }
    changed = [
        fixed_by_variant(name, value, choice)
        for name, value in {in_series: float(MECHANISMS[which][law].in_series), **held}.items()
    ]
    weak = priors_of_freed_parameters()[rate]
    if is_standard(priors, rate) or priors[rate].source == weak.source:
        given_at = MECHANISM_REFERENCES[0]
        stress = held[given_at] if given_at in held else priors[given_at].location
        median = stress / priors["kelvin_viscosity"].mean_sd()[0]
        changed.append(replace(weak, location=float(f"{median:.0e}")))
    return changed
