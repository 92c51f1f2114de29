"""Variants of the model by name: which law each of its parts follows.

A variant is a matter of priors: each choice frees a parameter or fixes it at a value that takes a
part of the model out. The Stan programs read from the same priors which equations to solve, so
priors and equations cannot contradict each other, and what a run used can be told from its priors.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import partial
from typing import Literal

import numpy as np

from pyburgers.common.errors import InputError, nearest, require_type
from pyburgers.model.fitted_test import Test, set_up_stress
from pyburgers.model.hardening import (
    changes_of_hardening,
    check_dislocations,
    check_linear_hardening,
    hardening_law,
)
from pyburgers.model.laws import (
    DASHPOT_LAWS,
    DASHPOT_STRESSES,
    HARDENING_LAWS,
    KELVIN_LAWS,
    MECHANISMS,
)
from pyburgers.model.laws_in_priors import (
    beta_of_linear,
    changes_of_kelvin,
    changes_of_mechanism,
    check_mechanisms,
    dashpot_law,
    kelvin_law,
    mechanism,
)
from pyburgers.model.parameters import (
    PIEZOMETER,
)
from pyburgers.model.prior_families import (
    Prior,
    fixed_by_variant,
    is_fixed_at,
    priors_of_freed_parameters,
)
from pyburgers.model.priors import PriorSet
from pyburgers.model.residual_laws import ResidualsLaw, changes_of_residuals, residuals_law

NO_EVOLUTION = 1e9
"""Critical strain at which the microstructure of an oscillating test stays as it is."""

WITHOUT_EFFECT = 1.0
"""Critical strain where the microstructure is in its steady state from the start."""


@dataclass(frozen=True)
class ModelVariant:
    """Laws of the parts of the model; the defaults are those of the paper at constant rate.

    Attributes
    ----------
    kelvin : str
        Kelvin part: a name of `pyburgers.model.laws.KELVIN_LAWS`.
    maxwell : str
        Dashpot of the Maxwell element: a name of `pyburgers.model.laws.DASHPOT_LAWS`.
    grain_size : {"evolving", "constant", "piezometric"}
        Evolving towards a steady-state size, constant, or evolving towards the size of the
        material's piezometer, as in oscillating tests.
    fabric : {"evolving", "constant"}
        Crystal fabric; oscillating tests have a constant one.
    residuals : {"independent", "autocorrelated", "discrepancy"}
        From point to point; along strain or time; or the sum of reading errors and a smooth
        discrepancy of the law.
    hardening : {"none", "backstress", "dislocations"}
        Whether the dashpot of the Maxwell element flows by the stress less a backstress, and
        whether that is the one of dislocations.
    second_mechanism : {"none", "diffusion", "power_law", "in_series"}
        Whether the dashpot has a second mechanism, beside the first one or in series with it.
    third_mechanism : {"none", "diffusion", "power_law", "in_series"}
        Whether it has a third one, beside both or in series with the second.

    Examples
    --------
    >>> pyburgers.ModelVariant(kelvin="extended").short_text
    'kelvin=extended'
    """

    kelvin: str = "linear"
    maxwell: str = "power_law"
    grain_size: Literal["evolving", "constant", "piezometric"] = "evolving"
    fabric: Literal["evolving", "constant"] = "evolving"
    residuals: ResidualsLaw = "independent"
    hardening: str = "none"
    second_mechanism: str = "none"
    third_mechanism: str = "none"

    def record(self) -> dict[str, str]:
        """Return the choices by name, as manifests hold them.

        Examples
        --------
        >>> pyburgers.ModelVariant().record()["maxwell"]
        'power_law'
        """
        return asdict(self)

    @property
    def text(self) -> str:
        """Every choice in words but for those of nothing."""
        words = {"kelvin": "Kelvin part", "maxwell": "Maxwell dashpot"}
        return ", ".join(
            f"{words.get(part, part)} {choice}".replace("_", " ")
            for part, choice in self.record().items()
            if choice != "none"
        )

    @property
    def short_text(self) -> str:
        """Differences from the paper's model at constant rate, as options of the command line."""
        standard = ModelVariant().record()
        different = [
            f"{part}={choice}" for part, choice in self.record().items() if choice != standard[part]
        ]
        return " ".join(different) or "standard"

    @property
    def residuals_correlate(self) -> bool:
        """Whether residuals correlate between neighbouring readings."""
        return self.residuals != "independent"


CHOICES: Mapping[str, tuple[str, ...]] = {
    "kelvin": (*KELVIN_LAWS,),
    "maxwell": (*DASHPOT_LAWS,),
    "grain_size": ("evolving", "constant", "piezometric"),
    "fabric": ("evolving", "constant"),
    "residuals": ("independent", "autocorrelated", "discrepancy"),
    "hardening": (*HARDENING_LAWS,),
    **{f"{which}_mechanism": (*laws,) for which, laws in MECHANISMS.items()},
}
"""Names of the parts and of the laws that each may follow."""


def parse_choices(options: Sequence[str]) -> dict[str, str]:
    """Return law by part of choices of ``--variant``, such as ``kelvin=power_law``.

    Raises InputError if an option is no choice, names an unknown part or law, or repeats a part.
    """
    choices: dict[str, str] = {}
    for option in options:
        part, equals, choice = option.partition("=")
        if not equals:
            raise InputError(f"--variant {option}: expected PART=LAW, such as kelvin=power_law.")
        if part in choices:
            raise InputError(f"--variant {option}: found a second choice for {part}, expected one.")
        choices[part] = choice
    _check_names(choices, "--variant")
    return choices


def with_variant(priors: PriorSet, experiment: Test, choices: Mapping[str, str]) -> PriorSet:
    """Return priors of the model with the chosen laws.

    Parameters
    ----------
    priors : PriorSet
        Priors of the material. Laws that are not chosen stay as in these priors.
    experiment : Test
        The test with data that is to be fitted.
    choices : mapping of str to str
        Law by part, see `ModelVariant`.

    Raises
    ------
    InputError
        If an argument is of another type, a name is unknown, or priors or experiment do not
        allow a choice.

    Examples
    --------
    >>> changed = pyburgers.with_variant(pyburgers.priors("ice"), test, {"maxwell": "linear"})
    >>> pyburgers.variant_of(changed, test).maxwell
    'linear'
    """
    require_type("priors", priors, PriorSet, "priors, as of pyburgers.priors")
    require_type("experiment", experiment, Test, "a test, as of pyburgers.load_experiment")
    require_type("choices", choices, Mapping, 'a law by part, such as {"kelvin": "power_law"}')
    _check_names(choices, "variant")
    _check_kind(choices, experiment)
    changed = priors
    for part, choice in choices.items():
        exchanged = _CHANGES[part](changed, experiment, choice)
        changed = changed.exchanging(*exchanged) if exchanged else changed
    found = variant_of(changed, experiment).record()
    for part, choice in choices.items():
        if found[part] != choice:
            raise InputError(
                f"{experiment.id}: {part}={choice} does not go with tests of the protocol "
                f"{experiment.protocol} and these priors ({part} is {found[part]} in them), "
                f"expected {part}={found[part]} or other priors."
            )
    check_variant(changed, experiment)
    return changed


def variant_of(priors: PriorSet, experiment: Test) -> ModelVariant:
    """Return the laws that the priors give a fit of an experiment.

    Examples
    --------
    >>> pyburgers.variant_of(pyburgers.priors("ice"), test).short_text
    'standard'
    """
    has_fabric = _allows(experiment, "fabric", "evolving")
    constant_fabric = not has_fabric or is_fixed_at(priors["steady_state_fabric_factor"], 1.0)
    return ModelVariant(
        maxwell=dashpot_law(priors.priors, experiment.id),
        grain_size=_grain_size_law(priors, experiment),
        fabric="constant" if constant_fabric else "evolving",
        residuals=residuals_law(priors.priors, experiment.residual_correlation),
        kelvin=kelvin_law(priors.priors, experiment.id),
        hardening=hardening_law(priors.priors),
        second_mechanism=mechanism("second", priors.priors),
        third_mechanism=mechanism("third", priors.priors),
    )


def check_variant(priors: PriorSet, experiment: Test) -> None:
    """Raise InputError for priors of a variant that the experiment cannot be fitted with."""
    check_laws(priors, experiment)
    if not _allows(experiment, "kelvin", "extended") and not is_fixed_at(
        priors["kelvin_grain_size_exponent"], 0.0
    ):
        raise InputError(
            f"{experiment.id}: kelvin_grain_size_exponent has no effect in tests of the protocol "
            f"{experiment.protocol}, expected it fixed at 0."
        )
    residuals = variant_of(priors, experiment).residuals
    if residuals == "independent":
        has_one = not is_fixed_at(priors["discrepancy"], 0.0)
        if has_one and _allows(experiment, "residuals", "discrepancy"):
            raise InputError(
                f"{experiment.id}: a discrepancy of the law is smooth, found "
                f"{experiment.residual_correlation} fixed at 0, expected a prior of it."
            )
        return
    if not _allows(experiment, "residuals", residuals):
        raise InputError(
            f"{experiment.id}: residuals={residuals} is for tests of the protocols whose strain "
            f"only increases, found {experiment.protocol}, where strain goes back and forth."
        )
    same = np.flatnonzero(np.diff(experiment.position) == 0)
    all_correlate = is_fixed_at(priors["residual_correlated_share"], 1.0)
    if residuals == "autocorrelated" and same.size > 0 and all_correlate:
        raise InputError(
            f"{experiment.id}: residuals that all correlate (residual_correlated_share fixed at 1) "
            f"need points at different strains, found two at {experiment.position[same[0]]:g}, "
            "expected a share that is free or below 1."
        )


def check_laws(priors: PriorSet, experiment: Test) -> None:
    """Raise InputError for laws that tests of the kind do not take, or without their piezometer."""
    variant = variant_of(priors, experiment)
    if variant.grain_size == "piezometric" and not _has_piezometer(priors):
        raise InputError(
            f"{experiment.id}: the grain size of tests of the protocol {experiment.protocol} "
            f"follows a piezometer, found none in the priors {priors.title!r}, expected "
            f"{', '.join(PIEZOMETER[:-1])} and {PIEZOMETER[-1]} in them, or the variant "
            "grain_size=constant."
        )
    _check_kind(variant.record(), experiment)
    if experiment.linear_hardening:
        check_linear_hardening(priors.priors, experiment.protocol, experiment.id)
    check_dislocations(priors.priors, experiment)
    check_mechanisms(priors.priors, experiment.id)


def _check_kind(choices: Mapping[str, str], experiment: Test) -> None:
    """Raise InputError for laws by part that tests of the kind do not take."""
    for part in ("kelvin", "maxwell", "hardening", "second_mechanism", "third_mechanism"):
        if part in choices and not _allows(experiment, part, choices[part]):
            raise InputError(
                f"{experiment.id}: {part}={choices[part]} is not for tests of the protocol "
                f"{experiment.protocol}, expected {' or '.join(experiment.laws[part])}; tests that "
                "are given as loading histories take more laws (docs/variants.md)."
            )


def _allows(experiment: Test, part: str, law: str) -> bool:
    """Whether tests of the kind can be fitted with a law."""
    return law in experiment.laws.get(part, (law,))


def _check_names(choices: Mapping[str, str], where: str) -> None:
    for part, choice in choices.items():
        if part not in CHOICES:
            raise InputError(f"{where}: unknown part {part!r}, {nearest(part, CHOICES)}")
        if choice not in CHOICES[part]:
            raise InputError(
                f"{where}: unknown law {choice!r} of {part}, {nearest(choice, CHOICES[part])}"
            )


def _grain_size_law(
    priors: PriorSet, experiment: Test
) -> Literal["evolving", "constant", "piezometric"]:
    """Tell the law of the grain size.

    Tests of some kinds know a constant one alone. Where it may evolve towards a size of its own, it
    does unless that is the size at the start.
    """
    if not _allows(experiment, "grain_size", "piezometric"):
        return "constant"
    if not _allows(experiment, "grain_size", "evolving"):
        frozen = is_fixed_at(priors["critical_strain_grain_size"], NO_EVOLUTION)
        return "constant" if frozen else "piezometric"
    if not is_fixed_at(priors["steady_state_grain_size"], experiment.initial_grain_size):
        return "evolving"
    return "piezometric" if _has_piezometer(priors) else "constant"


def _has_piezometer(priors: PriorSet) -> bool:
    return not is_fixed_at(priors["piezometer_reference_grain_size"], 0.0)


def _changes_of_maxwell(priors: PriorSet, experiment: Test, choice: str) -> Sequence[Prior]:
    """Fix n, or free the law's own stress; with n = 1 beta means another A: its prior moves along.

    The flow rate at the largest measured stress keeps the prior that it has with the power law,
    to first order in the spread of n. The median of the own stress is a share of that stress.
    """
    changed = []
    for name, law in DASHPOT_STRESSES.items():
        if law.name == choice and is_fixed_at(priors[name], 0.0):
            median = float(f"{law.stress_share * set_up_stress(experiment, [name]):.0e}")
            changed.append(replace(priors_of_freed_parameters()[name], location=median))
        elif law.name != choice and not is_fixed_at(priors[name], 0.0):
            changed.append(fixed_by_variant(name, 0.0, f"maxwell={choice}"))
    exponent, beta = priors["stress_exponent"], priors["beta"]
    if choice != "linear" or is_fixed_at(exponent, 1.0):
        return changed
    if priors.flow_law is not None:
        raise InputError(
            f"{experiment.id}: maxwell=linear fixes the stress exponent, found it in the joint "
            f"prior of the flow law of {priors.title!r}, expected a prior of each parameter."
        )
    if beta.family not in ("normal", "fixed") or np.isfinite([beta.lower, beta.upper]).any():
        raise InputError(
            f"{experiment.id}: maxwell=linear moves the prior of beta to another stress exponent, "
            f"expected a normal one without bounds or a fixed value, found {beta.family!r}; write "
            "a prior file with stress_exponent fixed at 1 instead."
        )
    enthalpy = priors["activation_enthalpy"].location
    largest = set_up_stress(experiment, ["stress_exponent = 1"])
    moved = beta_of_linear(beta, exponent, np.log(largest) / enthalpy)
    return [*changed, fixed_by_variant("stress_exponent", 1.0, "maxwell=linear"), moved]


def _changes_of_grain_size(priors: PriorSet, experiment: Test, choice: str) -> Sequence[Prior]:
    source = f"grain_size={choice}"
    if not _allows(experiment, "grain_size", "evolving"):
        frozen = fixed_by_variant("critical_strain_grain_size", NO_EVOLUTION, source)
        return [frozen] if choice == "constant" else []
    if choice == "evolving":
        return []
    start = fixed_by_variant("steady_state_grain_size", experiment.initial_grain_size, source)
    if choice == "piezometric":
        if not _has_piezometer(priors):
            raise InputError(
                f"{experiment.id}: {source} needs a piezometer, found none in the priors "
                f"{priors.title!r}, expected {', '.join(PIEZOMETER[:-1])} and {PIEZOMETER[-1]} in "
                "them."
            )
        return [start]  # which has no effect then
    none = fixed_by_variant("piezometer_reference_grain_size", 0.0, source)
    return [
        start,
        fixed_by_variant("critical_strain_grain_size", WITHOUT_EFFECT, source),
        *((none,) if _has_piezometer(priors) else ()),
    ]


def _changes_of_fabric(_priors: PriorSet, experiment: Test, choice: str) -> Sequence[Prior]:
    if choice != "constant" or not _allows(experiment, "fabric", "evolving"):
        return []
    return [
        fixed_by_variant("steady_state_fabric_factor", 1.0, "fabric=constant"),
        fixed_by_variant("critical_strain_fabric", WITHOUT_EFFECT, "fabric=constant"),
    ]


_CHANGES: Mapping[str, Callable[[PriorSet, Test, str], Sequence[Prior]]] = {
    "kelvin": changes_of_kelvin,
    "maxwell": _changes_of_maxwell,
    "grain_size": _changes_of_grain_size,
    "fabric": _changes_of_fabric,
    "residuals": changes_of_residuals,
    "hardening": changes_of_hardening,
    **{f"{which}_mechanism": partial(changes_of_mechanism, which) for which in MECHANISMS},
}
"""Priors that each choice exchanges."""
