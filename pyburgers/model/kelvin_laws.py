"""Laws of the Kelvin part (`pyburgers.model.laws`): how priors tell them, and their priors.

A law is on where its switch is not left at its standard value.
"""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from types import MappingProxyType

from pyburgers.common.errors import InputError
from pyburgers.model.laws import KELVIN_LAWS
from pyburgers.model.parameters import PARAMETER_BY_NAME, STANDARD_VALUES
from pyburgers.model.prior_families import Prior, fixed_prior, is_fixed_at

_SWITCHES: Mapping[str, str] = MappingProxyType(
    {
        "kelvin_stress_exponent": "power_law",
        "relaxation_time_decades": "extended",
        "peak_strength": "extended_peak",
        "andrade_exponent": "andrade",
    }
)
"""Parameters whose standard value takes a law out."""

_STRENGTH = "peak_strength"
_SECOND_ELEMENT = (
    "Not in the paper: a second element of a thirtieth of the elastic compliance up to thrice it"
)

_WIDTH = "peak_width"
"""Without one the peak is a second element."""

_COMPLIANCE = "kelvin_modulus"
"""Of Andrade creep, a convention: after the time eta_K/E_K it has reached stress/E_K."""


def kelvin_law(priors: Mapping[str, Prior], where: str) -> str:
    """Tell the law of the Kelvin part from priors by parameter; `where` is for messages.

    Raises InputError if parameters of laws are free that do not go together.
    """
    on = [law for switch, law in _SWITCHES.items() if not _is_standard(priors, switch)]
    if on == ["extended", "extended_peak"]:
        return "extended_peak"
    if on == ["extended_peak"] and _is_standard(priors, _WIDTH):
        return "two_elements"
    if len(on) > 1 or on == ["extended_peak"]:
        names = [name for name, law in _SWITCHES.items() if law in on]
        raise InputError(
            f"{where}: found effects of {' and '.join(names)} in the priors, expected one law of "
            "the Kelvin part (a peak only on top of a band of relaxation times)."
        )
    return on[0] if on else "linear"


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
    the priors are those of Andrade creep, whose modulus is a convention.
    """
    found = kelvin_law(priors, where)
    if law == found:
        return ()
    if found == "andrade" and priors[_COMPLIANCE].is_fixed:
        raise InputError(
            f"{where}: kelvin={law} needs a prior of {_COMPLIANCE}, which is fixed where the "
            "Kelvin part is Andrade creep, expected the priors of the material."
        )
    wanted, present = KELVIN_LAWS[law].parameters, KELVIN_LAWS[found].parameters
    switches = (*_SWITCHES, _WIDTH)
    effective = dict.fromkeys((*switches, *present))
    taken_out = [name for name in effective if name in priors and name not in wanted]
    put_in = [
        name
        for name in wanted
        if name not in priors
        or (_is_standard(priors, name) and (name in switches or name not in present))
    ]
    values = {name: STANDARD_VALUES[name] for name in taken_out}
    if law == "two_elements":
        values[_WIDTH] = STANDARD_VALUES[_WIDTH]  # a strength asks for one
        second = replace(freed[_STRENGTH], location=0.3, scale=1.5, source=_SECOND_ELEMENT)
        freed = {**freed, _STRENGTH: second}
    if law != "linear":
        values |= {name: value for name, value in references.items() if name not in priors}
    if law == "andrade" and not priors[_COMPLIANCE].is_fixed:
        values[_COMPLIANCE] = float(f"{priors[_COMPLIANCE].mean_sd()[0]:.0e}")
    source = f"Variant kelvin={law}"
    fixed = (fixed_prior(PARAMETER_BY_NAME[name], values[name], source) for name in values)
    return [*fixed, *(freed[name] for name in put_in)]


def _is_standard(priors: Mapping[str, Prior], name: str) -> bool:
    return name not in priors or is_fixed_at(priors[name], STANDARD_VALUES[name])
