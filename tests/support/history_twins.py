"""Synthetic loading histories of ice, solved with scipy, with noise from a seed."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType

import history_oracle
import numpy as np

from pyburgers.common.array_types import BoolArray, FloatArray, IntArray
from pyburgers.kinds.experiment import Provenance
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stages import Stage, legs_of

TEMPERATURE, GRAIN_SIZE = 260.0, 230e-6

TRUTH: Mapping[str, float] = MappingProxyType(
    {
        "maxwell_modulus": 4.83e9,
        "kelvin_modulus": 0.8e9,
        "kelvin_viscosity": 1.2e11,
        "stress_exponent": 3.78,
        "grain_size_exponent": 0.55,
        "activation_enthalpy": 62.08e3,
        "beta": -7.29e-4,
        "steady_state_grain_size": 100e-6,
        "steady_state_fabric_factor": 0.6,
        "critical_strain_grain_size": 0.05,
        "critical_strain_fabric": 0.15,
        "stress_noise": 4e4,
        "strain_noise": 5e-4,
        "residual_correlation_time": 150.0,
        "residual_correlated_share": 0.6,
    }
)

SECOND: Mapping[str, float] = MappingProxyType(
    {
        "second_rate": 2e-5,
        "second_stress_exponent": 1.8,
        "second_grain_size_exponent": 1.4,
        "second_activation_enthalpy": 49e3,
        "mechanism_reference_stress": 2e6,
        "mechanism_reference_grain_size": 3e-4,
        "mechanism_reference_temperature": 265.0,
    }
)
"""A second mechanism of the dashpot."""

THIRD: Mapping[str, float] = MappingProxyType(
    {
        **SECOND,
        "third_rate": 1e-5,
        "third_stress_exponent": 2.4,
        "third_grain_size_exponent": 0.5,
        "third_activation_enthalpy": 55e3,
    }
)
"""The same, and a third one."""

BACKSTRESS: Mapping[str, float] = MappingProxyType(
    {
        "hardening_modulus": 4e8,
        "backstress_limit": 4e6,
        "recovery_rate": 2e-3,
        "recovery_exponent": 2.5,
        "recovery_activation_enthalpy": 60e3,
        "kelvin_reference_temperature": 265.0,
    }
)
"""A backstress of the dashpot."""

DISLOCATIONS: Mapping[str, float] = MappingProxyType(
    {
        **BACKSTRESS,
        "hardening_modulus": 2e9,
        "backstress_limit": 2e7,
        "recovery_exponent": 5.0,
        "initial_backstress": 8e5,
        "source_stress": 1e5,
        "boundary_recovery": 2.0,
        "reference_backstress": 3e6,
        "kelvin_reference_grain_size": 3e-4,
    }
)
"""The backstress of dislocations."""

PIEZOMETER: Mapping[str, float] = MappingProxyType(
    {
        "piezometer_reference_grain_size": 2e-3,
        "piezometer_exponent": 1.33,
        "piezometer_stress_floor": 1e6,
        "steady_state_grain_size": GRAIN_SIZE,  # that of the start: the piezometer is followed
    }
)

POWER_LAW_KELVIN: Mapping[str, float] = MappingProxyType(
    {
        "kelvin_stress_exponent": 3.0,
        "kelvin_activation_enthalpy": 60e3,
        "kelvin_reference_stress": 2e6,
        "kelvin_reference_temperature": 260.0,
    }
)

_STAGES: Mapping[str, Sequence[tuple[str, float, float]]] = MappingProxyType(
    {
        "creep": (("stress", 4000.0, 5e6),),
        "load and unload": (
            ("stress", 1500.0, 5e6),
            ("stress", 1000.0, 5e5),
            ("stress", 1500.0, 6e6),
        ),
        "relaxation": (("strain_rate", 600.0, 1e-4), ("hold_strain", 3000.0, 0.0)),
        "mixed": (
            ("strain_rate", 500.0, 1e-4),
            ("hold_strain", 500.0, 0.0),
            ("stress", 2500.0, 5e6),
        ),
    }
)
"""Control, duration (s) and value of the stages of each."""


def history_twin(
    name: str, n_readings: int, seed: int = 20261122, values: Mapping[str, float] = TRUTH
) -> HistoryExperiment:
    """One of the histories above, as many readings in each stage, dense at its start."""
    stages, start = [], 0.0
    for control, duration, value in _STAGES[name]:
        stages.append(Stage(control, start, start + duration, TEMPERATURE, value))  # type: ignore[arg-type]
        start += duration
    shape = np.union1d(np.geomspace(2e-3, 1.0, n_readings // 2), np.linspace(0.0, 1.0, n_readings))
    shape = shape[1:]
    times = [s.start_time + shape * (s.end_time - s.start_time) for s in stages]
    solution = history_oracle.history(values, GRAIN_SIZE, legs_of(stages), times)
    stage = np.repeat(np.arange(len(stages)), shape.size)
    is_strain = np.array([s.driven == "stress" for s in stages])[stage]
    if not is_strain.any():
        values = MappingProxyType({**values, "residual_correlation_time": 0.0})
    exact = np.where(is_strain, solution[history_oracle.STRAIN], solution[history_oracle.STRESS])
    time = np.concatenate(times)
    factor = np.linalg.cholesky(residual_covariance(values, time, stage, is_strain))
    rng = np.random.default_rng(seed)
    return HistoryExperiment(
        id=name.replace(" ", "_"),
        material="ice",
        temperature=TEMPERATURE,
        initial_grain_size=GRAIN_SIZE,
        provenance=Provenance("synthetic", "scipy"),
        metadata=MappingProxyType({}),
        notices=(),
        true_parameters=values,
        stages=tuple(stages),
        time=time,
        reading_stage=stage,
        reading=exact + factor @ rng.standard_normal(time.size),
        n_readings_in_file=time.size,
    )


def residual_covariance(
    values: Mapping[str, float],
    time: FloatArray,
    stage: IntArray,
    is_strain: BoolArray,
) -> FloatArray:
    """Covariance of the residuals of readings, which may correlate in time."""
    noise = np.where(is_strain, values.get("strain_noise", 1.0), values["stress_noise"])
    together = np.equal.outer(stage, stage)
    correlation_time = values.get("residual_correlation_time", 0.0)
    share = values.get("residual_correlated_share", 1.0) if correlation_time > 0 else 0.0
    since = np.abs(np.subtract.outer(time, time))
    correlation = share * np.exp(-since / (correlation_time or 1.0))
    covariance: FloatArray = np.outer(noise, noise) * (
        together * correlation + (1 - share) * np.eye(time.size)
    )
    return covariance
