"""Write a synthetic table of attenuation and modulus of ice under cycles about a median stress.

It has the columns of a table such as that of McCarthy and Cooper (2016), Earth and Planetary
Science Letters 443, 185-194, which is not part of the project: whoever has it can put it in the
place of this one. Numbers are the closed form of the model, integrated by scipy and written out
here again, with scatter: nothing in it was measured.

Run ``python data/ice/generate_attenuation_twin.py`` to write the file anew, bit for bit.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np
from scipy.integrate import quad

GAS_CONSTANT = 8.314462618  # J/mol/K
NAME = "attenuation_twin"
SEED = 5
GRAIN_SIZE = 0.5e-3
TRUTH: Mapping[str, float] = {
    "maxwell_modulus": 9.2e9,
    "kelvin_modulus": 3.5e9,
    "kelvin_viscosity": 120e9,
    "stress_exponent": 3.78,
    "grain_size_exponent": 0.55,
    "activation_enthalpy": 62080.0,
    "beta": -7.29e-4,
    "steady_state_grain_size": 1e-4,
    "steady_state_fabric_factor": 1.0,
    "critical_strain_grain_size": 1.0,
    "critical_strain_fabric": 1.0,
    "stress_noise": 1e6,
    "kelvin_activation_enthalpy": 50e3,
    "kelvin_reference_temperature": 263.15,
    "modulus_temperature_coefficient": -1.5e-3,
    "modulus_reference_temperature": 257.15,
    "attenuation_scatter": 0.04,
    "modulus_scatter": 0.01,
}
TEMPERATURES = (263.15, 253.15)
REGIMES = ((1.0, 0.17), (2.0, 0.9))
"""Median stress and amplitude, MPa."""

FREQUENCIES = tuple(round(float(f), 6) for f in np.geomspace(1e-4, 1.0, 9))
TAN_DELTA_ERROR = 0.004
LIMIT = 0.015
"""tan(delta) below which the apparatus would not tell."""


def fluidity(temperature: float, median: float, amplitude: float) -> float:
    """Return what the dashpot's loss compliance is 1/omega times, 1/(Pa s); stresses in Pa."""
    factor = GRAIN_SIZE ** -TRUTH["grain_size_exponent"] * np.exp(
        TRUTH["activation_enthalpy"] * (TRUTH["beta"] - 1 / (GAS_CONSTANT * temperature))
    )

    def integrand(x: float) -> float:
        stress = median + amplitude * np.sin(x)
        return float(factor * np.sign(stress) * abs(stress) ** TRUTH["stress_exponent"] * np.sin(x))

    return float(quad(integrand, 0, 2 * np.pi, epsrel=1e-11)[0]) / (np.pi * amplitude)


def compliance(
    frequency: float, temperature: float, median: float, amplitude: float
) -> tuple[float, float]:
    """Return storage and loss compliance (1/Pa); stresses in Pa, frequency in Hz."""
    omega = 2 * np.pi * frequency
    modulus = TRUTH["maxwell_modulus"] * (
        1
        + TRUTH["modulus_temperature_coefficient"]
        * (temperature - TRUTH["modulus_reference_temperature"])
    )
    viscosity = TRUTH["kelvin_viscosity"] * np.exp(
        TRUTH["kelvin_activation_enthalpy"]
        / GAS_CONSTANT
        * (1 / temperature - 1 / TRUTH["kelvin_reference_temperature"])
    )
    kelvin = 1 / complex(TRUTH["kelvin_modulus"], omega * viscosity)
    loss = -kelvin.imag + fluidity(temperature, median, amplitude) / omega
    return 1 / modulus + kelvin.real, loss


def table_text() -> str:
    """Return the table with its scatter."""
    rng = np.random.default_rng(SEED)
    lines = [
        "# SYNTHETIC: written by generate_attenuation_twin.py; nothing here was measured.",
        "temperature_K,median_stress_MPa,amplitude_MPa,frequency_Hz,tan_delta,tan_delta_sd,"
        "youngs_modulus_GPa",
    ]
    for temperature in TEMPERATURES:
        for median, amplitude in REGIMES:
            for frequency in FREQUENCIES:
                storage, loss = compliance(frequency, temperature, 1e6 * median, 1e6 * amplitude)
                tan_delta = loss / storage
                spread = np.hypot(TRUTH["attenuation_scatter"], TAN_DELTA_ERROR / tan_delta)
                read = max(tan_delta * np.exp(spread * rng.standard_normal()), LIMIT)
                modulus = 1 / np.hypot(storage, loss)
                modulus *= np.exp(TRUTH["modulus_scatter"] * rng.standard_normal())
                cells = (temperature, median, amplitude, frequency)
                lines.append(
                    ",".join(
                        f"{cell:g}" if cell is not temperature else f"{cell}" for cell in cells
                    )
                    + f",{read:.6g},{TAN_DELTA_ERROR},{modulus / 1e9:.6g}"
                )
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path(__file__).parent)
    folder = parser.parse_args().folder
    (folder / f"{NAME}.csv").write_text(table_text(), encoding="utf-8")


if __name__ == "__main__":
    main()
