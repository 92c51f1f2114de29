"""What is read of a test, and the noise of such readings: the one table of noises."""

from dataclasses import dataclass

from pyburgers.common.units import UNITS


@dataclass(frozen=True)
class Quantity:
    """A quantity along which, or of which, tests of a protocol are.

    `name`: name of its dimension or variable in draws.
    `column`: its column in tables of solutions and points.
    `si_unit`, `display_unit`: of stored values, and of figures and tables.
    `display_factor`: from the one to the other.
    """

    name: str
    column: str
    si_unit: str
    display_unit: str
    display_factor: float

    @property
    def label(self) -> str:
        """Name and display unit."""
        return f"{self.name} ({self.display_unit})"


@dataclass(frozen=True)
class ReadQuantity(Quantity):
    """A quantity that is read.

    `noise`: parameter that is the size of the noise of its readings.
    `negligible_noise`: size (SI) that stands for none, as some programs need one.
    """

    noise: str
    negligible_noise: float


STRESS = ReadQuantity(
    "stress", "stress_Pa", "Pa", "MPa", 1.0 / UNITS["stress"]["MPa"], "stress_noise", 1.0
)
STRAIN = ReadQuantity(
    "strain", "strain", "1", "%", 1.0 / UNITS["strain"]["percent"], "strain_noise", 1e-12
)
LOG_TAN_DELTA, LOG_MODULUS = (
    ReadQuantity("log_reading", "log_reading", "1", f"in ln {name}", 1.0, noise, 0.0)
    for name, noise in (("tan δ", "attenuation_scatter"), ("modulus", "modulus_scatter"))
)

BY_NOISE = {one.noise: one for one in (STRESS, STRAIN, LOG_TAN_DELTA, LOG_MODULUS)}
"""Every quantity that is read, by the parameter that is its noise."""
