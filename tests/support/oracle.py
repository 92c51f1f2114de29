"""The model written out again, for tests only: scipy's solver, the paper's equations, SI units."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

from pyburgers.common.array_types import FloatArray

GAS_CONSTANT = 8.314462618  # J/mol/K


def rate_factor(parameters: Mapping[str, float], temperature: float) -> float:
    """exp[Q_M (beta - 1/(R T))]."""
    exponent = parameters["activation_enthalpy"] * (
        parameters["beta"] - 1 / (GAS_CONSTANT * temperature)
    )
    return float(np.exp(exponent))


def dashpot_rate(
    parameters: Mapping[str, float],
    temperature: float,
    stress: npt.ArrayLike,
    grain_size: npt.ArrayLike,
    fabric: npt.ArrayLike,
) -> FloatArray:
    """Eq. 1 of the paper (1/s), odd in stress; Garofalo's law, or that of a threshold stress."""
    stress, grain_size, fabric = map(np.asarray, (stress, grain_size, fabric))
    threshold = parameters.get("threshold_stress", 0.0)
    magnitude = np.maximum(np.abs(stress) - threshold, 0.0) / fabric
    breakdown = parameters.get("breakdown_stress", 0.0)
    if breakdown > 0.0:
        magnitude = breakdown * np.sinh(magnitude / breakdown)
    rate: FloatArray = (
        np.sign(stress)
        * magnitude ** parameters["stress_exponent"]
        * grain_size ** -parameters["grain_size_exponent"]
        * rate_factor(parameters, temperature)
    )
    return rate


def all_rates(
    parameters: Mapping[str, float],
    temperature: float,
    stress: npt.ArrayLike,
    backstress: npt.ArrayLike,
    grain_size: npt.ArrayLike,
    fabric: npt.ArrayLike,
) -> tuple[FloatArray, FloatArray]:
    """Rates (1/s) of the dashpot with all its mechanisms, and of the first of them."""
    stress, backstress, grain_size = map(np.asarray, (stress, backstress, grain_size))
    flow_stress = stress - backstress - source_stress(parameters, grain_size)
    first = dashpot_rate(parameters, temperature, flow_stress, grain_size, fabric)
    if (reference := parameters.get("reference_backstress", 0.0)) > 0.0:
        first = (backstress / reference) ** 2 * first
    if parameters.get("second_rate", 0.0) == 0.0:
        return first, first
    slower = 1 / temperature - 1 / parameters["mechanism_reference_temperature"]
    second, third = (
        parameters.get(f"{which}_rate", 0.0)
        * np.sign(stress)
        * np.abs(stress / parameters["mechanism_reference_stress"])
        ** parameters.get(f"{which}_stress_exponent", 1.0)
        * (parameters["mechanism_reference_grain_size"] / grain_size)
        ** parameters.get(f"{which}_grain_size_exponent", 0.0)
        * np.exp(-parameters.get(f"{which}_activation_enthalpy", 0.0) / GAS_CONSTANT * slower)
        for which in ("second", "third")
    )
    if parameters.get("third_in_series", 0.0) == 1.0:
        second, third = _in_series(second, third), np.zeros_like(third)
    if parameters.get("second_in_series", 0.0) == 1.0:
        return _in_series(first, second) + third, first
    return first + second + third, first


def _in_series(one: FloatArray, other: FloatArray) -> FloatArray:
    total = np.asarray(one + other)
    return np.divide(one * other, total, out=np.zeros(total.shape), where=total != 0)


def kelvin_rate(
    parameters: Mapping[str, float], temperature: float, stress: float, kelvin_strain: float
) -> float:
    """Rate (1/s) of a Kelvin element, linear or A_K sgn(q) |q|^n_K exp(-Q_K/(R T))."""
    driving = stress - parameters["kelvin_modulus"] * kelvin_strain
    exponent = parameters.get("kelvin_stress_exponent", 1.0)
    enthalpy = parameters.get("kelvin_activation_enthalpy", 0.0)
    if exponent == 1.0 and enthalpy == 0.0:
        return driving / parameters["kelvin_viscosity"]
    # The rate is q/viscosity at the reference driving stress and temperature.
    reference_stress = parameters.get("kelvin_reference_stress", 1e6)
    reference_temperature = parameters.get("kelvin_reference_temperature", temperature)
    factor = (
        reference_stress ** (1 - exponent)
        / parameters["kelvin_viscosity"]
        * np.exp(enthalpy / (GAS_CONSTANT * reference_temperature))
    )
    rate = (
        factor
        * np.sign(driving)
        * np.abs(driving) ** exponent
        * np.exp(-enthalpy / (GAS_CONSTANT * temperature))
    )
    return float(rate)


def source_stress(parameters: Mapping[str, float], grain_size: npt.ArrayLike) -> FloatArray:
    """Stress (Pa) that sources of dislocations take."""
    if parameters.get("reference_backstress", 0.0) == 0.0:
        return np.zeros(())
    finer = parameters["kelvin_reference_grain_size"] / np.asarray(grain_size)
    return np.asarray(parameters["source_stress"] * finer)


def backstress_rate(
    parameters: Mapping[str, float],
    temperature: float,
    backstress: float,
    dashpot_rate: float,
    grain_size: float,
) -> float:
    """Storage by flow less dynamic recovery and static recovery (Pa/s)."""
    modulus = parameters.get("hardening_modulus", 0.0)
    if modulus == 0.0:
        return 0.0
    slower = 1 / temperature - 1 / parameters["kelvin_reference_temperature"]
    activated = np.exp(-parameters["recovery_activation_enthalpy"] / GAS_CONSTANT * slower)
    share = backstress / parameters["backstress_limit"]
    static = parameters["recovery_rate"] * activated * backstress
    if (reference := parameters.get("reference_backstress", 0.0)) > 0.0:
        sources = float(source_stress(parameters, grain_size))
        ratio = backstress / reference
        along = backstress * ratio ** (parameters["recovery_exponent"] - 1)
        boundaries = parameters["boundary_recovery"] * sources * ratio**3
        stored = dashpot_rate * (1 + sources / backstress) - abs(dashpot_rate) * share
        return float(
            modulus * stored - parameters["recovery_rate"] * activated * (along + boundaries)
        )
    return float(
        modulus * (dashpot_rate - abs(dashpot_rate) * share)
        - static * abs(share) ** (parameters["recovery_exponent"] - 1)
    )


def wanted_grain_size(parameters: Mapping[str, float], stress: float) -> float:
    """Grain size (m) that grains evolve to: d_ss, or that of a piezometer."""
    at_one_megapascal = parameters.get("piezometer_reference_grain_size", 0.0)
    if at_one_megapascal == 0.0:
        return parameters["steady_state_grain_size"]
    return piezometer(stress) * at_one_megapascal / 0.015


def piezometer(stress: float) -> float:
    """Grain size (m) of Eq. 5, the stress floored as sqrt(stress^2 + (1 MPa)^2)."""
    return float(0.015 * (np.hypot(stress, 1e6) / 1e6) ** -1.33)


@dataclass(frozen=True)
class OscillatingStrain:
    """Imposed strain: amplitudes of sin(k w t) and cos(k w t), k = 1, 2, ... and a background.

    The strain rate of the background (1/s) has coefficients of powers of the time since
    `record_start` (s), the constant first. Before the record it keeps the rate it has there.
    """

    period: float
    sine: Sequence[float]
    cosine: Sequence[float]
    background: Sequence[float]
    record_start: float

    def rate(self, time: float) -> float:
        """Strain rate, 1/s."""
        omega = 2 * np.pi / self.period
        since = max(time - self.record_start, 0.0)
        rate = sum(b * since**k for k, b in enumerate(self.background))
        for k, (s, c) in enumerate(zip(self.sine, self.cosine, strict=True), start=1):
            rate += k * omega * (s * np.cos(k * omega * time) - c * np.sin(k * omega * time))
        return float(rate)

    def zero_ahead(self, cycles: int) -> float:
        """Time (s) of the fundamental's upward zero `cycles` before the last ahead of the record.

        The strain is A sin(w t + phase); it passes upwards where the angle is a multiple of 2 pi.
        """
        phase = np.arctan2(self.cosine[0], self.sine[0])
        turns = np.floor(self.record_start / self.period + phase / (2 * np.pi)) - cycles
        return float((turns - phase / (2 * np.pi)) * self.period)


def oscillation(
    parameters: Mapping[str, float],
    temperature: float,
    initial_grain_size: float,
    imposed: OscillatingStrain,
    *,
    start: float,
    start_stress: float,
    time: FloatArray,
) -> FloatArray:
    """Solve Eqs. 1, 2 and 5 with F = 1: stress (Pa), Kelvin strain, grain size (m), shape (3, n).

    The spin-up begins at `start` (s), where the Kelvin element has settled under `start_stress`;
    grains keep their size until the record starts. Times (s) after that increase.
    """

    def rates(at: float, state: FloatArray, growing: bool) -> FloatArray:
        stress, kelvin_strain, grain_size = state
        strain_rate = imposed.rate(at)
        kelvin = kelvin_rate(parameters, temperature, stress, kelvin_strain)
        dashpot, _ = all_rates(parameters, temperature, stress, 0.0, grain_size, 1.0)
        growth = (piezometer(stress) - grain_size) / parameters["critical_strain_grain_size"]
        return np.array(
            [
                parameters["maxwell_modulus"] * (strain_rate - kelvin - float(dashpot)),
                kelvin,
                abs(strain_rate) * growth if growing else 0.0,
            ]
        )

    state = np.array(
        [start_stress, start_stress / parameters["kelvin_modulus"], initial_grain_size]
    )
    for growing, span, wanted in (
        (False, (start, imposed.record_start), np.array([imposed.record_start])),
        (True, (imposed.record_start, float(time[-1])), time),
    ):
        solution = solve_ivp(
            rates,
            span,
            state,
            method="LSODA",
            t_eval=wanted,
            rtol=1e-10,
            atol=[1.0, 1e-13, 1e-15],
            max_step=imposed.period / 50,
            args=(growing,),
        )
        assert solution.success, solution.message
        state = solution.y[:, -1]
    states: FloatArray = solution.y
    return states
