"""Imagined oscillations: strain cycles that are imposed, without a record of them."""

from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.forced_oscillation.harmonics import N_HARMONICS, HarmonicFit
from pyburgers.kinds.forced_oscillation.preparation import (
    OscillationRecord,
    PreparedOscillation,
)

LABORATORY_STRESS = 1e7
"""Stress (Pa) at which the flow rate is told, where none was measured."""

NO_RECORD = OscillationRecord(*[np.empty(0)] * 6)
"""Of a test that can only be simulated."""


@dataclass(frozen=True)
class ImposedCycles:
    """Cycles of the strain: amplitude x sin(2 pi t / period) + mean rate x t, from t = 0.

    `period`: seconds.
    `strain_amplitude`: fraction.
    `cycles`: how many there are.
    `mean_strain_rate`: rate (1/s) of the strain beside the cycles.
    `start_stress`: stress (Pa) at which the model starts, ahead of the cycles.
    """

    period: float
    strain_amplitude: float
    cycles: float
    mean_strain_rate: float = 0.0
    start_stress: float = 0.0

    def prepared(self) -> PreparedOscillation:
        """Return what drives the model, known exactly; there is nothing to compare it with."""
        half = 0.5 * self.cycles * self.period
        rise = self.mean_strain_rate * half
        return PreparedOscillation(
            period=self.period,
            strain_fit=self._exact((rise, rise), self.strain_amplitude, half),
            stress_fit=self._exact((self.start_stress,), LABORATORY_STRESS, half),
            background="kept",
            start_stress=self.start_stress,
            start=0.0,
            time=np.empty(0),
            stress=np.empty(0),
            uncertainty=np.empty(0),
            strain_sine=_first(self.strain_amplitude),
            strain_cosine=_first(0.0),
            background_rate=np.array([self.mean_strain_rate]),
            strain_error=np.empty((0, 2 * N_HARMONICS + 1)),
            t_middle=half,
            t_half=half,
            notices=(),
        )

    def _exact(self, trend: tuple[float, ...], amplitude: float, half: float) -> HarmonicFit:
        """Return a series without errors: Legendre coefficients of its trend, and a sine."""
        coefficients = np.concatenate([trend, _first(amplitude), _first(0.0)])
        return HarmonicFit(
            period=self.period,
            n_harmonics=N_HARMONICS,
            degree=len(trend) - 1,
            t_middle=half,
            t_half=half,
            coefficients=coefficients,
            covariance=np.zeros((coefficients.size, coefficients.size)),
            residual_sd=0.0,
            chi_square=0.0,
            n_points=0,
        )


def _first(amplitude: float) -> npt.NDArray[np.float64]:
    """Amplitudes of the harmonics where only the fundamental has one."""
    return np.array([amplitude, *[0.0] * (N_HARMONICS - 1)])
