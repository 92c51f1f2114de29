"""Laws of the hardening of the dashpot: how priors tell them, and their priors."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.model.fitted_test import Test, set_up_stress
from pyburgers.model.laws import DISLOCATIONS_SWITCH, HARDENING_LAWS, HARDENING_SWITCH
from pyburgers.model.parameters import STANDARD_VALUES
from pyburgers.model.prior_families import (
    Prior,
    SomePriors,
    fixed_by_variant,
    is_fixed_at,
    is_standard,
    priors_of_freed_parameters,
)

BACKSTRESS_SHARE = 0.5
"""Prior median of the limit of the backstress, over the largest measured stress."""

RECOVERIES = 10.0
"""Prior median of the recovery rate, over the inverse of the time of the readings."""

NOT_LINEAR = ("backstress_limit", "recovery_exponent")
"""Parameters that leave the linear form about zero stress alone at their standard values."""

LIMIT_OF_DISLOCATIONS, FIRST_DISLOCATIONS = 5.0, 0.1
"""Prior medians of limit and start of the backstress of dislocations, as BACKSTRESS_SHARE."""

DISLOCATION_RECOVERY = 5.0
"""Exponent of recovery along pipes."""

SOURCE_LENGTH = 4e-10
"""Length (m) that Young's modulus over the grain size takes for a stress of sources.

It is 2 G b: the shear modulus G is 0.4 of Young's, the Burgers vector b half a nanometre.
"""

PULLED = 0.01
"""Stress in extension, over the largest in compression, that is more than an error of a solver."""

OF_BACKSTRESS = frozenset(
    {DISLOCATIONS_SWITCH, *(name for law in HARDENING_LAWS.values() for name in law.parameters)}
)
"""Parameters that laws of the hardening free, and the one that tells them apart."""


def hardening_law(priors: Mapping[str, Prior]) -> str:
    """Tell the law from priors."""
    if is_standard(priors, HARDENING_SWITCH):
        return "none"
    return "backstress" if is_standard(priors, DISLOCATIONS_SWITCH) else "dislocations"


def check_dislocations(priors: Mapping[str, Prior], test: Test) -> None:
    """Raise InputError for dislocations that store no backstress, are none at first, or are pulled.

    Dislocations that stress of one sign has stored say nothing of one of the other sign.
    """
    if is_standard(priors, DISLOCATIONS_SWITCH):
        return
    if test.extension:
        raise InputError(
            f"{test.id}: hardening=dislocations takes stresses of one sign, found "
            f"{test.extension}, expected none in extension, or hardening=backstress."
        )
    for name in (HARDENING_SWITCH, "initial_backstress"):
        if is_standard(priors, name):
            raise InputError(
                f"{test.id}: found {name} fixed at 0 beside a {DISLOCATIONS_SWITCH}, which is for "
                f"hardening=dislocations, expected a positive {name}, or no {DISLOCATIONS_SWITCH}."
            )


def extension_sentences(reference_backstress: npt.ArrayLike, stress: FloatArray) -> list[str]:
    """Say where a solution (Pa) leaves the stresses that dislocations of that reference take."""
    least = float(stress.min(initial=0.0))
    if not np.any(reference_backstress) or least >= -PULLED * stress.max(initial=0.0):
        return []
    return [
        f"The stress falls to {least / 1e6:.4g} MPa, in extension, which hardening=dislocations "
        "does not describe: what is solved from there on means nothing."
    ]


def check_median_stress(priors: Mapping[str, Prior], median: FloatArray, where: str) -> None:
    """Raise InputError for median stresses (Pa) about which a law has no linear form."""
    law = hardening_law(priors)
    if law == "backstress" and np.any(median != 0):
        raise InputError(
            f"{where}: hardening=backstress takes cycles about zero stress, found a median stress, "
            "expected none or the variant hardening=none."
        )
    if law == "dislocations" and np.any(median <= 0):
        raise InputError(
            f"{where}: hardening=dislocations takes small cycles about steady flow, found no "
            "median stress, expected one above 0 in every row, or the variant hardening=none."
        )


def check_linear_hardening(priors: Mapping[str, Prior], protocol: str, where: str) -> None:
    """Raise InputError for a backstress that has no linear form about zero stress."""
    if hardening_law(priors) != "backstress":
        return
    for name in ("stress_exponent", "recovery_exponent"):
        if not is_fixed_at(priors[name], 1.0):
            raise InputError(
                f"{where}: hardening=backstress is linear in tests of the protocol {protocol}, and "
                "about zero stress a power law neither flows nor recovers, expected "
                f"{name} fixed at 1 (variant maxwell=linear)."
            )


def changes_of_hardening(given: SomePriors, test: Test, law: str) -> Sequence[Prior]:
    """Return the priors to exchange for a law; tests of a kind that names it take its linear form.

    Medians of weak priors are those for the test, to one digit.
    """
    priors, found = given.priors, hardening_law(given.priors)
    if law == found:
        return ()
    without: list[Prior] = []
    if found != "none":
        without = [
            fixed_by_variant(name, STANDARD_VALUES[name], "hardening=none")
            for name in OF_BACKSTRESS
        ]
        priors = {**priors, **{one.parameter: one for one in without}}
    if law == "none":
        return without
    stress, freed = 0.0, priors_of_freed_parameters()
    if law == "dislocations" or not test.linear_hardening:
        switch = (DISLOCATIONS_SWITCH,) if law == "dislocations" else ()
        stress = set_up_stress(test, (*HARDENING_LAWS[law].parameters, *switch))
    fixed, medians = _held(law, priors, test, stress), _medians(law, priors, test, stress)
    free: list[Prior] = []
    for name in HARDENING_LAWS[law].parameters:
        if name not in fixed and is_standard(priors, name):
            location = medians.get(name)
            weak = freed[name]
            free.append(
                weak if location is None else replace(weak, location=float(f"{location:.0e}"))
            )
    put = [
        fixed_by_variant(name, value, f"hardening={law}")
        for name, value in fixed.items()
        if name not in priors or name in OF_BACKSTRESS
    ]
    return [*without, *free, *put]


def _medians(
    law: str, priors: Mapping[str, Prior], test: Test, stress: float
) -> Mapping[str, float]:
    """Medians (SI) of weak priors; the modulus has the prior mean of the Kelvin modulus."""
    sources = SOURCE_LENGTH * priors["maxwell_modulus"].mean_sd()[0] / test.initial_grain_size
    medians = {
        HARDENING_SWITCH: priors["kelvin_modulus"].mean_sd()[0],
        "source_stress": sources,
    }
    if stress > 0:
        share = LIMIT_OF_DISLOCATIONS if law == "dislocations" else BACKSTRESS_SHARE
        medians["backstress_limit"] = share * stress
        medians["initial_backstress"] = FIRST_DISLOCATIONS * stress
    if test.duration > 0:
        medians["recovery_rate"] = RECOVERIES / test.duration
    return medians


def _held(law: str, priors: Mapping[str, Prior], test: Test, stress: float) -> Mapping[str, float]:
    """Values (SI) at which parameters are fixed where the priors do not say them.

    Recovery has the enthalpy of the flow law. The linear form has recovery in proportion to the
    backstress, and no limit. Rates of dislocations are those at the largest stress, to one digit.
    """
    held = {
        "recovery_activation_enthalpy": float(priors["activation_enthalpy"].mean_sd()[0]),
        "kelvin_reference_temperature": test.temperature,
    }
    if test.linear_hardening and law == "backstress":
        held |= {name: STANDARD_VALUES[name] for name in NOT_LINEAR}
    if law == "dislocations":
        held |= {
            DISLOCATIONS_SWITCH: float(f"{stress:.0e}"),
            "kelvin_reference_grain_size": test.initial_grain_size,
            "recovery_exponent": DISLOCATION_RECOVERY,
        }
        if test.linear_hardening:  # of a steady state, which knows no start
            held["initial_backstress"] = held[DISLOCATIONS_SWITCH]
    return held
