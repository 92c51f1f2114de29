"""Laws of the hardening of the dashpot: how priors tell them, and their priors."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from pyburgers.common.errors import InputError
from pyburgers.model.laws import HARDENING_LAWS, HARDENING_SWITCH
from pyburgers.model.parameters import PARAMETER_BY_NAME, STANDARD_VALUES
from pyburgers.model.prior_families import Prior, fixed_prior, is_fixed_at, is_standard

BACKSTRESS_SHARE = 0.5
"""Prior median of the limit of the backstress, over the largest measured stress."""

RECOVERIES = 10.0
"""Prior median of the recovery rate, over the inverse of the time of the readings."""

NOT_LINEAR = ("backstress_limit", "recovery_exponent")
"""Parameters that leave the linear form about zero stress alone at their standard values."""


def hardening_law(priors: Mapping[str, Prior]) -> str:
    """Tell the law from priors."""
    return "none" if is_standard(priors, HARDENING_SWITCH) else "backstress"


def medians_of_hardening(
    priors: Mapping[str, Prior], largest_stress: float, duration: float
) -> Mapping[str, float]:
    """Return medians (SI) of weak priors for a test. A stress or duration (s) of 0 says nothing.

    The modulus has the prior mean of the Kelvin modulus.
    """
    medians = {HARDENING_SWITCH: priors["kelvin_modulus"].mean_sd()[0]}
    if largest_stress > 0:
        medians["backstress_limit"] = BACKSTRESS_SHARE * largest_stress
    if duration > 0:
        medians["recovery_rate"] = RECOVERIES / duration
    return medians


def held_by_hardening(
    priors: Mapping[str, Prior], temperature: float, *, is_linear: bool
) -> Mapping[str, float]:
    """Return values (SI) at which parameters are fixed where the priors do not say them.

    Recovery has the enthalpy of the flow law, and its rate is that at the temperature (K). The
    linear form has recovery in proportion to the backstress, and no limit.
    """
    linear = {name: STANDARD_VALUES[name] for name in NOT_LINEAR} if is_linear else {}
    return {
        "recovery_activation_enthalpy": float(priors["activation_enthalpy"].mean_sd()[0]),
        "kelvin_reference_temperature": temperature,
        **linear,
    }


def check_linear_hardening(priors: Mapping[str, Prior], protocol: str, where: str) -> None:
    """Raise InputError for a backstress that has no linear form about zero stress."""
    if hardening_law(priors) == "none":
        return
    for name in ("stress_exponent", "recovery_exponent"):
        if not is_fixed_at(priors[name], 1.0):
            raise InputError(
                f"{where}: hardening=backstress is linear in tests of the protocol {protocol}, and "
                "about zero stress a power law neither flows nor recovers, expected "
                f"{name} fixed at 1 (variant maxwell=linear)."
            )


def changes_of_hardening(
    law: str,
    priors: Mapping[str, Prior],
    freed: Mapping[str, Prior],
    medians: Mapping[str, float],
    held: Mapping[str, float],
) -> Sequence[Prior]:
    """Return the priors to exchange for another law.

    `freed` are weak priors, of which some get `medians` (SI), to one digit. Others are `held`.
    """
    present = hardening_law(priors)
    source = f"Variant hardening={law}"
    if law == present:
        return ()
    parameters = HARDENING_LAWS["backstress"].parameters
    fixed = dict(held)
    free: list[Prior] = []
    if law == "none":
        fixed = {name: STANDARD_VALUES[name] for name in parameters}
    for name in parameters:
        if name not in fixed and is_standard(priors, name):
            location = medians.get(name)
            weak = freed[name]
            free.append(
                weak if location is None else replace(weak, location=float(f"{location:.0e}"))
            )
    put = [
        fixed_prior(PARAMETER_BY_NAME[name], value, source)
        for name, value in fixed.items()
        if law == "none" or name not in priors or name in NOT_LINEAR
    ]
    return [*free, *put]
