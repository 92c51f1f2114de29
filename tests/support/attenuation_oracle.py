"""Attenuation and modulus by numerical integration of the equations as docs/model.md has them."""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
import numpy.typing as npt
from scipy.integrate import quad

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment

GAS_CONSTANT = 8.314462618


def fluidity_of_stress(
    median: float, amplitude: float, exponent: float, breakdown: float = 0.0
) -> float:
    """Return the integral 1/(pi sigma_0) of g(sigma) sin x over a period, g without its factor."""

    def strength(x: float) -> float:
        stress = median + amplitude * np.sin(x)
        equivalent = breakdown * np.sinh(stress / breakdown) if breakdown > 0 else stress
        return float(np.sign(equivalent) * abs(equivalent) ** exponent * np.sin(x))

    kinks = [-np.arcsin(median / amplitude)] if median < amplitude else []
    edges = [-np.pi / 2, *kinks, np.pi / 2]
    peak = abs(strength(np.pi / 2))
    parts = [
        quad(lambda x: strength(x) / peak, low, high, epsabs=1e-13, epsrel=1e-12, limit=400)[0]
        for low, high in pairwise(edges)
    ]
    return 2 * peak * sum(parts) / (np.pi * amplitude)


def log_readings(
    experiment: AttenuationExperiment,
    values: Mapping[str, float],
    period: FloatArray,
    row: npt.NDArray[np.int64],
) -> FloatArray:
    """Return ln(tan delta) and ln(modulus) in the conditions of rows at any periods, (2, n)."""
    conditions, elasticity = experiment.conditions, experiment.elasticity
    temperature = conditions.temperature[row]
    to_axial = 1.0 if elasticity.deformation == "axial" else np.sqrt(3)
    of_stress = {}
    for k in set(row.tolist()):
        median, amplitude = conditions.median_stress[k], conditions.amplitude[k]
        of_stress[k] = (
            fluidity_of_stress(
                to_axial * median,
                to_axial * amplitude,
                values["stress_exponent"],
                values.get("breakdown_stress", 0.0),
            )
            if amplitude > 0
            else 1.0
        )
    factor = (
        np.exp(values["activation_enthalpy"] * (values["beta"] - 1 / (GAS_CONSTANT * temperature)))
        * experiment.initial_grain_size ** -values["grain_size_exponent"]
    )
    fluidity = factor * np.array([of_stress[k] for k in row.tolist()])
    elastic = values["maxwell_modulus"] * (
        1
        + values["modulus_temperature_coefficient"]
        * (temperature - values["modulus_reference_temperature"])
    )
    viscosity = values["kelvin_viscosity"] * np.exp(
        values["kelvin_activation_enthalpy"]
        / GAS_CONSTANT
        * (1 / temperature - 1 / values["kelvin_reference_temperature"])
    )
    omega = 2 * np.pi / period
    creep = 1 / (values["kelvin_modulus"] + 1j * omega * viscosity) + fluidity / (1j * omega)
    if elasticity.deformation == "axial":
        compliance = 1 / elastic + creep
    elif elasticity.bulk_modulus is not None:
        compliance = 3 / elastic - 1 / (3 * elasticity.bulk_modulus) + 3 * creep
    else:
        assert elasticity.poisson_ratio is not None
        compliance = 2 * (1 + elasticity.poisson_ratio) / elastic + 3 * creep
    return np.log([-compliance.imag / compliance.real, 1 / np.abs(compliance)])
