"""What the laws of a test depend on beside its priors."""

from abc import ABC, abstractmethod
from collections.abc import Mapping, Sequence
from typing import ClassVar

from pyburgers.common.array_types import FloatArray
from pyburgers.model.laws import KELVIN_LAWS


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
