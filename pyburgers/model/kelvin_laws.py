"""Laws of the Kelvin part (`pyburgers.model.laws`): how priors tell them, and their priors."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from pyburgers.common.errors import InputError
from pyburgers.model.laws import KELVIN_LAWS, KELVIN_SWITCHES
from pyburgers.model.parameters import PARAMETER_BY_NAME, STANDARD_VALUES
from pyburgers.model.prior_families import Prior, fixed_prior, is_standard


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


def changes_for(
    law: str,
    priors: Mapping[str, Prior],
    freed: Mapping[str, Prior],
    references: Mapping[str, float],
    where: str,
) -> Sequence[Prior]:
    """Return the priors to exchange for another law of the Kelvin part.

    `priors` are the material's, `freed` weak priors of what laws free, and `references` (SI) that
    for which modulus and viscosity are given where the priors do not say it. Raises InputError if
    the priors fix a parameter by a convention of their law, and the other law does not.
    """
    found = kelvin_law(priors, where)
    if law == found:
        return ()
    wanted, present = KELVIN_LAWS[law], KELVIN_LAWS[found]
    for name in present.conventions:
        if priors[name].is_fixed:
            raise InputError(
                f"{where}: kelvin={law} needs a prior of {name}, which is fixed with the law "
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
    fixed = (
        fixed_prior(PARAMETER_BY_NAME[name], value, f"Variant kelvin={law}")
        for name, value in values.items()
    )
    put_in = [
        replace(freed[name], **wanted.weak_priors.get(name, {}))
        for name in wanted.parameters
        if name not in priors
        or (is_standard(priors, name) and (name in switches or name not in present.parameters))
    ]
    return [*fixed, *put_in]
