"""What can be combined: each law of the model, each kind of test, each material.

Every combination is tried on the priors that come with the package, as `pyburgers fit --variant`
would; nothing is listed by hand.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pyburgers.common.errors import InputError
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.kind import kinds
from pyburgers.kinds.likelihood import NAMES
from pyburgers.model.priors import default_priors, shipped_prior_files
from pyburgers.model.variants import CHOICES, variant_of, with_variant

STANDARD, POSSIBLE, REFUSED = "standard", "yes", "no"
FROZEN = "with constant grain size"

CONSTANT_GRAINS = {"grain_size": "constant"}
"""What a material without a piezometer needs where the grain size would follow one."""


@dataclass(frozen=True)
class AnyTest:
    """A test of a kind, as far as laws depend on it."""

    id: str
    protocol: str
    laws: Mapping[str, Sequence[str]]
    linear_hardening: bool
    residual_correlation: str
    temperature: float
    initial_grain_size: float
    largest_stress: float
    duration: float = 0.02
    extension: str = ""

    @property
    def position(self) -> npt.NDArray[np.float64]:
        """Three places on its clock."""
        return np.array([0.01, 0.02, 0.03])

    @property
    def n_points(self) -> int:
        """Number of points."""
        return self.position.size


@dataclass(frozen=True)
class Combination:
    """A law with a kind of test and a material.

    Attributes
    ----------
    material, protocol, part, law : str
        What is combined.
    outcome : str
        `STANDARD`, what a fit takes when nothing is said, `POSSIBLE`, `FROZEN`, possible together
        with `CONSTANT_GRAINS`, or `REFUSED`.
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


def _any_test(protocol: str) -> AnyTest:
    kinds()  # imports the modules of all kinds
    kind = next(kind for kind in Experiment.__subclasses__() if kind.protocol == protocol)
    return AnyTest(
        id="test",
        protocol=protocol,
        laws=kind.laws,
        linear_hardening=kind.linear_hardening,
        residual_correlation=kind.residual_correlation,
        temperature=1000.0,
        initial_grain_size=1e-4,
        largest_stress=1e7,
    )


def _tried(material: str, test: AnyTest, part: str, law: str) -> Combination:
    priors = default_priors(material, test.protocol)
    here = (material, test.protocol, part, law)
    refusals = []
    for outcome, others in ((POSSIBLE, {}), (FROZEN, CONSTANT_GRAINS)):
        try:
            with_variant(priors, test, {**others, part: law})
        except InputError as error:
            refusals.append(str(error))
            continue
        standard = outcome == POSSIBLE and variant_of(priors, test).record()[part] == law
        return Combination(*here, STANDARD if standard else outcome)
    return Combination(*here, REFUSED, refusals[0])
