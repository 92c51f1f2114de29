"""Composite flow laws in plain NumPy, from pre-exponential factors, as papers print them."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np

from pyburgers.common.array_types import FloatArray

GAS_CONSTANT = 8.314462618


@dataclass(frozen=True)
class PowerLaw:
    """A d^-p S^n exp(-Q/(R T)) in units of a paper: factors turn Pa and m into them."""

    factor: float
    n: float
    p: float
    q: float
    stress_unit: float = 1e6
    length_unit: float = 1.0

    def rate(
        self, stress: FloatArray, grain_size: FloatArray, temperature: FloatArray
    ) -> FloatArray:
        """Strain rate (1/s) at Pa, m and K."""
        found: FloatArray = (
            self.factor
            * (stress / self.stress_unit) ** self.n
            * (grain_size / self.length_unit) ** -self.p
            * np.exp(-self.q / (GAS_CONSTANT * temperature))
        )
        return found


GOLDSBY_KOHLSTEDT_2001 = {
    "dislocation": PowerLaw(4.0e5, 4.0, 0.0, 60e3),
    "sliding": PowerLaw(3.9e-3, 1.8, 1.4, 49e3),
    "basal_slip": PowerLaw(5.5e7, 2.4, 0.0, 60e3),
}
"""Below 255 K, MPa and m; Table 5, as the ice sheet model PISM has it (GoldsbyKohlstedt.cc)."""

GOLDSBY_KOHLSTEDT_2001_WARM = {
    "dislocation": PowerLaw(6.0e28, 4.0, 0.0, 180e3),
    "sliding": PowerLaw(3.0e26, 1.8, 1.4, 192e3),
    "basal_slip": PowerLaw(5.5e7, 2.4, 0.0, 60e3),
}
"""The same above 258 K."""

HIRTH_KOHLSTEDT_2003 = {
    "diffusion": PowerLaw(1.5e9, 1.0, 3.0, 375e3, 1e6, 1e-6),
    "dislocation": PowerLaw(1.1e5, 3.5, 0.0, 530e3, 1e6, 1e-6),
    "sliding": PowerLaw(6500.0, 3.5, 2.0, 400e3, 1e6, 1e-6),
}
"""Dry olivine below 1523 K without pressure, MPa and um; from Table 1, as GeoParams.jl and the
Very Broadband Rheology calculator have it."""


def composite_rate(
    laws: Mapping[str, PowerLaw],
    in_series: Sequence[tuple[str, str]],
    stress: FloatArray,
    grain_size: FloatArray,
    temperature: FloatArray,
) -> FloatArray:
    """Sum of rates (1/s), where pairs in series act as the slower one, 1/(1/a + 1/b)."""
    rates = {name: law.rate(stress, grain_size, temperature) for name, law in laws.items()}
    for first, second in in_series:
        a, b = rates.pop(first), rates.pop(second)
        rates[f"{first} {second}"] = a * b / (a + b)
    return np.asarray(sum(rates.values()))
