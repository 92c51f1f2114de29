"""What the laws of a test depend on beside its priors."""

from collections.abc import Mapping, Sequence
from typing import Protocol

from pyburgers.common.array_types import FloatArray


class Test(Protocol):
    """A test with its conditions and its points, of any kind."""

    @property
    def id(self) -> str:
        """Name."""

    @property
    def protocol(self) -> str:
        """Name of its kind."""

    @property
    def laws(self) -> Mapping[str, Sequence[str]]:
        """Laws that such tests can be fitted with, by part: any of a part that is not named."""

    @property
    def extension(self) -> str:
        """A stress or strain that surely pulls the sample, in words; empty for none."""

    @property
    def linear_hardening(self) -> bool:
        """Whether a backstress has its linear form in such tests."""

    @property
    def residual_correlation(self) -> str:
        """Parameter along which residuals may correlate: over strain or over time."""

    @property
    def temperature(self) -> float:
        """Kelvin."""

    @property
    def initial_grain_size(self) -> float:
        """Metres."""

    @property
    def position(self) -> FloatArray:
        """Where its points lie, shape (n_points,)."""

    @property
    def n_points(self) -> int:
        """Number of points."""

    @property
    def duration(self) -> float:
        """Time (s) between the first and the last point; 0 if points have no times."""

    @property
    def largest_stress(self) -> float:
        """Largest |σ| (Pa), where there are points."""
