"""What can be combined: each law of the model, each kind of test, each material.

Every combination is tried on the priors that come with the package, as `pyburgers fit --variant`
would; nothing is listed by hand.
"""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np

from pyburgers.common.errors import InputError
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.kind import kinds
from pyburgers.kinds.likelihood import NAMES
from pyburgers.model.fitted_test import Test
from pyburgers.model.priors import default_priors, shipped_prior_files
from pyburgers.model.variants import CHOICES, variant_of, with_variant

STANDARD, POSSIBLE, REFUSED = "standard", "yes", "no"
FROZEN = "with constant grain size"
THIRD = "with a second mechanism"
FROZEN_THIRD = f"{FROZEN} and {THIRD.removeprefix('with ')}"

CONSTANT_GRAINS = {"grain_size": "constant"}
"""What a material without a piezometer needs where the grain size would follow one."""

SECOND = {"second_mechanism": "power_law"}
"""What a third mechanism needs."""

TOGETHER_WITH: Mapping[str, Mapping[str, str]] = {
    POSSIBLE: {},
    FROZEN: CONSTANT_GRAINS,
    THIRD: SECOND,
    FROZEN_THIRD: {**CONSTANT_GRAINS, **SECOND},
}
"""Laws of other parts that each law is tried with, by the outcome where they are enough."""


class AnyTest(Test):
    """A test of a kind, as far as laws depend on it."""

    id = "test"
    temperature = 1000.0
    initial_grain_size = 1e-4
    largest_stress = 1e7
    duration = 0.02
    position = np.array([0.01, 0.02, 0.03])
    n_points = 3


@dataclass(frozen=True)
class Combination:
    """A law with a kind of test and a material.

    Attributes
    ----------
    material, protocol, part, law : str
        What is combined.
    outcome : str
        `STANDARD`, what a fit takes when nothing is said, `REFUSED`, or one of `TOGETHER_WITH`.
    reason : str
        Of a refusal, the sentence that a user sees.
    """

    material: str
    protocol: str
    part: str
    law: str
    outcome: str
    reason: str = ""


def materials() -> tuple[str, ...]:
    """Return the materials that have priors."""
    return tuple(sorted(shipped_prior_files()))


def combinations() -> list[Combination]:
    """Try every law with every kind of test and every material."""
    return [
        _tried(material, _any_test(protocol), part, law)
        for protocol in NAMES
        for part, laws in CHOICES.items()
        for law in laws
        for material in materials()
    ]


def _any_test(protocol: str) -> Test:
    kinds()  # imports the modules of all kinds
    kind = next(kind for kind in Experiment.__subclasses__() if kind.protocol == protocol)

    class OfKind(AnyTest):
        protocol = kind.protocol
        laws = kind.laws
        linear_hardening = kind.linear_hardening
        residual_correlation = kind.residual_correlation

    return OfKind()


def _tried(material: str, test: Test, part: str, law: str) -> Combination:
    priors = default_priors(material, test.protocol)
    here = (material, test.protocol, part, law)
    refusals = []
    for outcome, others in TOGETHER_WITH.items():
        try:
            with_variant(priors, test, {**others, part: law})
        except InputError as error:
            refusals.append(str(error))
            continue
        standard = outcome == POSSIBLE and variant_of(priors, test).record()[part] == law
        return Combination(*here, STANDARD if standard else outcome)
    return Combination(*here, REFUSED, refusals[0])
