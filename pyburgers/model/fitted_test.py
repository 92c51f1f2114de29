"""What the laws of a test depend on beside its priors."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Mapping, Sequence
from typing import ClassVar

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.model.laws import KELVIN_LAWS
from pyburgers.model.parameters import GIVEN_TOGETHER


class Test(ABC):
    """A test with its conditions and its points, of any kind.

    `pyburgers.kinds.experiment.Experiment` says what its attributes are.
    """

    protocol: ClassVar[str]
    laws: ClassVar[Mapping[str, Sequence[str]]] = {
        "kelvin": tuple(law.name for law in KELVIN_LAWS.values() if not law.times),
        "hardening": ("none",),
    }
    linear_hardening: ClassVar[bool] = False
    residual_correlation: ClassVar[str] = "residual_correlation_strain"
    id: str
    temperature: float
    initial_grain_size: float

    @property
    @abstractmethod
    def position(self) -> FloatArray:
        """Positions of the readings on the clock of the protocol (SI), shape (n_points,)."""

    @property
    @abstractmethod
    def n_points(self) -> int:
        """Number of data points; zero for an experiment that can only be simulated."""

    @property
    def duration(self) -> float:
        """Time (s) between the first and the last reading; 0 if readings have no times."""
        return 0.0

    @property
    @abstractmethod
    def largest_stress(self) -> float:
        """Largest |σ| (Pa) in the test; only of an experiment with data."""

    @property
    def extension(self) -> str:
        """A stress or strain that surely pulls the sample, in words; empty for none."""
        return ""


def set_up_stress(test: Test, own: Iterable[str]) -> float:
    """Return the stress (Pa) at which a law is set up whose own parameters are not given."""
    if test.n_points == 0:
        names = dict.fromkeys(one for name in own for one in (name, *GIVEN_TOGETHER.get(name, ())))
        raise InputError(
            f"{test.id}: a new law is set up at the largest stress of the data, and there "
            f"are none; give values of the law's own parameters: {', '.join(names)}."
        )
    return test.largest_stress
