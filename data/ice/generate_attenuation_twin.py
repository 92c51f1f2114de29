"""Write a synthetic table of attenuation of ice, and a curve at constant rate of the same ice.

The table, under cycles about a median stress, has the columns of a table such as that of McCarthy
and Cooper (2016), Earth and Planetary Science Letters 443, 185-194, which is not part of the
project: whoever has it can put it in the place of this one. Its numbers are the closed form of the
model, integrated by scipy and written out here again, with scatter. The curve is the solution of
the paper's equations with noise; it has flow law and Kelvin part of the table, a microstructure of
its own, and the elastic modulus of specimen and apparatus together. Nothing was measured.

Run ``python data/ice/generate_attenuation_twin.py`` to write the files anew, bit for bit.
"""

import argparse
from collections.abc import Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.integrate import quad, solve_ivp

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
CURVE_NAME = "curve_beside_attenuation_twin"
CURVE_SEED = 6
CURVE_TRUTH: Mapping[str, float] = {
    **TRUTH,
    "maxwell_modulus": 0.6e9,
    "steady_state_grain_size": 90e-6,
    "steady_state_fabric_factor": 0.65,
    "critical_strain_grain_size": 0.04,
    "critical_strain_fabric": 0.17,
    "stress_noise": 0.1e6,
}
CURVE_GRAIN_SIZE = 230e-6
CURVE_TEMPERATURE = 263.15
STRAIN_RATE = 1e-4
CURVE_STRAINS = np.concatenate([np.linspace(0.0005, 0.02, 40), np.linspace(0.0225, 0.2, 72)])

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


def curve_stress() -> npt.NDArray[np.float64]:
    """Return the stress (Pa) of the curve at its strains, without noise.

    From rest: the paper's equations in stress, Kelvin strain, grain size and fabric factor.
    """
    truth = CURVE_TRUTH
    arrhenius = np.exp(
        truth["activation_enthalpy"] * (truth["beta"] - 1 / (GAS_CONSTANT * CURVE_TEMPERATURE))
    )

    def rates(_time: float, state: npt.NDArray[np.float64]) -> npt.NDArray[np.float64]:
        stress, kelvin_strain, grain_size, fabric = state
        kelvin = (stress - truth["kelvin_modulus"] * kelvin_strain) / truth["kelvin_viscosity"]
        dashpot = (
            np.sign(stress)
            * (abs(stress) / fabric) ** truth["stress_exponent"]
            * grain_size ** -truth["grain_size_exponent"]
            * arrhenius
        )
        grains = (truth["steady_state_grain_size"] - grain_size) / truth[
            "critical_strain_grain_size"
        ]
        fabrics = (truth["steady_state_fabric_factor"] - fabric) / truth["critical_strain_fabric"]
        return np.array(
            [
                truth["maxwell_modulus"] * (STRAIN_RATE - kelvin - dashpot),
                kelvin,
                STRAIN_RATE * grains,
                STRAIN_RATE * fabrics,
            ]
        )

    times = CURVE_STRAINS / STRAIN_RATE
    solution = solve_ivp(
        rates,
        (0.0, times[-1]),
        np.array([0.0, 0.0, CURVE_GRAIN_SIZE, 1.0]),
        method="LSODA",
        t_eval=times,
        rtol=1e-10,
        atol=[1e-2, 1e-13, 1e-16, 1e-12],
    )
    return np.asarray(solution.y[0])


def curve_text() -> str:
    """Return the curve with its noise."""
    rng = np.random.default_rng(CURVE_SEED)
    stress = curve_stress()
    stress += CURVE_TRUTH["stress_noise"] * rng.standard_normal(stress.size)
    lines = [
        "# SYNTHETIC: written by generate_attenuation_twin.py; nothing here was measured.",
        "strain,stress_MPa",
    ]
    lines += [f"{e:.6g},{s / 1e6:.5f}" for e, s in zip(CURVE_STRAINS, stress, strict=True)]
    return "\n".join(lines) + "\n"


def main() -> None:
    """Write table and curve."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--folder", type=Path, default=Path(__file__).parent)
    folder = parser.parse_args().folder
    (folder / f"{NAME}.csv").write_text(table_text(), encoding="utf-8")
    (folder / f"{CURVE_NAME}.csv").write_text(curve_text(), encoding="utf-8")


if __name__ == "__main__":
    main()
