"""Peaks of tests at constant strain rate, as tables of rates have them."""

from dataclasses import dataclass

import numpy as np

SAME_RATE, SAME_STRESS, SAME_GRAIN_SIZE, SAME_TEMPERATURE = 0.01, 0.05, 0.05, 5.0
"""Differences up to which two records may be of one test: of logarithms, and in kelvin. A peak
is read off noisy stresses, and the temperature of a sample is not that of the machine."""


@dataclass(frozen=True)
class PeakTest:
    """The peak of a test at constant strain rate.

    It has the imposed rate (1/s), the stress at the peak (Pa), the temperature (K), and the grain
    size at the start (m).
    """

    strain_rate: float
    stress: float
    temperature: float
    grain_size: float

    def may_be(self, other: "PeakTest") -> bool:
        """Whether two records may be of one test, given how they are rounded and reported."""
        ratios = [
            (self.strain_rate / other.strain_rate, SAME_RATE),
            (self.stress / other.stress, SAME_STRESS),
            (self.grain_size / other.grain_size, SAME_GRAIN_SIZE),
        ]
        return abs(self.temperature - other.temperature) <= SAME_TEMPERATURE and all(
            abs(np.log(ratio)) <= same for ratio, same in ratios
        )

    def __str__(self) -> str:
        """Return the conditions in words."""
        return (
            f"{self.strain_rate:.3g} 1/s, {self.stress / 1e6:.3g} MPa, {self.temperature:.4g} K "
            f"and {self.grain_size * 1e3:.3g} mm"
        )
