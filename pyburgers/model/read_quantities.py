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
    `logarithm_of`: what the readings are logarithms of, if they are any.
    """

    noise: str
    negligible_noise: float
    logarithm_of: Quantity | None = None

    @property
    def shown(self) -> Quantity:
        """What tables and figures of predictions show of it."""
        return self.logarithm_of or self


STRESS = ReadQuantity(
    "stress", "stress_Pa", "Pa", "MPa", 1.0 / UNITS["stress"]["MPa"], "stress_noise", 1.0
)
STRAIN = ReadQuantity(
    "strain", "strain", "1", "%", 1.0 / UNITS["strain"]["percent"], "strain_noise", 1e-12
)
TAN_DELTA = Quantity("tan δ", "tan_delta", "1", "1", 1.0)
MODULUS = Quantity("modulus", "modulus_Pa", "Pa", "GPa", 1.0 / UNITS["stress"]["GPa"])
LOG_TAN_DELTA, LOG_MODULUS = (
    ReadQuantity("log_reading", "log_reading", "1", f"in ln {of.name}", 1.0, noise, 0.0, of)
    for of, noise in ((TAN_DELTA, "attenuation_scatter"), (MODULUS, "modulus_scatter"))
)

BY_NOISE = {one.noise: one for one in (STRESS, STRAIN, LOG_TAN_DELTA, LOG_MODULUS)}
"""Every quantity that is read, by the parameter that is its noise."""
