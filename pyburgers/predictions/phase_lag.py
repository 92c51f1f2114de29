"""Phase lag between two oscillating time series, and with it the attenuation tan delta."""

import math
from dataclasses import dataclass
from typing import Any

import numpy as np
import numpy.typing as npt

from pyburgers.common.errors import InputError
from pyburgers.protocols.forced_oscillation.harmonics import (
    N_HARMONICS,
    HarmonicFit,
    choose_degree,
    fit_harmonics,
)

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class PhaseLag:
    """Lag of the strain behind the stress at the fundamental.

    Attributes
    ----------
    radians, standard_error : float
        Phase of the stress minus that of the strain (rad), in (-pi, pi]; positive where strain
        lags stress, as in a dissipating material.
    tan_delta, tan_delta_standard_error : float
        Attenuation 1/Q, the tangent of the lag, and its standard error to first order.
    strain_amplitude, strain_amplitude_standard_error : float
        Of the fundamental, in the unit of the strain.
    stress_amplitude, stress_amplitude_standard_error : float
        Of the fundamental, in the unit of the stress.
    """

    radians: float
    standard_error: float
    tan_delta: float
    tan_delta_standard_error: float
    strain_amplitude: float
    strain_amplitude_standard_error: float
    stress_amplitude: float
    stress_amplitude_standard_error: float


def phase_lag(
    strain_time: FloatArray,
    strain: FloatArray,
    stress_time: FloatArray,
    stress: FloatArray,
    *,
    period: float,
    strain_uncertainty: FloatArray | None = None,
    stress_uncertainty: FloatArray | None = None,
    degree: int | None = None,
    n_harmonics: int = N_HARMONICS,
) -> PhaseLag:
    """Measure by how much strain lags stress.

    Each series is fitted with harmonics and a polynomial trend of its own
    (`pyburgers.protocols.forced_oscillation.harmonics`); the lag is the difference of the
    fundamental phases (cf. Maor,
    arXiv:2407.03533). Without harmonics a nonlinear record of few cycles is biased.

    Parameters
    ----------
    strain_time, strain : array, shape (n_strain,)
        Increasing times (s) and strains.
    stress_time, stress : array, shape (n_stress,)
        Increasing times (s) on a clock with the same origin, and stresses.
    period : float
        Period of the fundamental (s).
    strain_uncertainty, stress_uncertainty : array, optional
        Standard deviations of the readings; by default the scatter about the fit is taken.
    degree : int, optional
        Degree of both trends; by default chosen for each series
        (`pyburgers.protocols.forced_oscillation.harmonics.choose_degree`).
    n_harmonics : int
        Harmonics, the fundamental included.

    Raises
    ------
    InputError
        If the readings do not suffice for the fits.
    """

    def fit(
        name: str, time: FloatArray, value: FloatArray, uncertainty: FloatArray | None
    ) -> HarmonicFit:
        given: dict[str, Any] = {
            "period": period,
            "n_harmonics": n_harmonics,
            "uncertainty": uncertainty,
        }
        try:
            chosen = choose_degree(time, value, **given) if degree is None else degree
            return fit_harmonics(time, value, degree=chosen, **given)
        except InputError as error:
            raise InputError(f"{name}: {error}") from None

    of_strain = fit("strain", strain_time, strain, strain_uncertainty)
    of_stress = fit("stress", stress_time, stress, stress_uncertainty)
    strain_phase, strain_error = of_strain.phase()
    stress_phase, stress_error = of_stress.phase()
    # The remainder lies in [-pi, pi]: the one end stands for the other.
    radians = math.remainder(stress_phase - strain_phase, 2.0 * math.pi)
    radians = math.pi if radians == -math.pi else radians
    error = math.hypot(strain_error, stress_error)
    tan_delta = math.tan(radians)
    return PhaseLag(
        radians,
        error,
        tan_delta,
        (1.0 + tan_delta**2) * error,
        *of_strain.amplitude(),
        *of_stress.amplitude(),
    )
