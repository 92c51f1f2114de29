"""Write the synthetic twin of a forced oscillation record of olivine in a D-DIA press.

The measured record is not public. The twin is a solution of the model at parameters inside the
priors of the paper's Table 2, with a bias stress, a drifting background strain rate and Gaussian
noise in both channels, sampled as X-ray diffraction (stress) and radiography (strain) do. The
solver is scipy's and the equations below are the paper's, written out again: that makes the twin
an independent check of the Stan programs.

The sample is at its bias and cycled for a while ahead of the record, so that no start-up transient
is in it; its grains, of the stated size, change from the start of the record on.

Run ``python data/olivine/generate_record.py`` to write the files anew, bit for bit.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

FloatArray = npt.NDArray[np.float64]

GAS_CONSTANT = 8.314462618  # J/mol/K
NAME = "olivine_twin"
# The first seed whose noise has, in both channels, a mean and a standard deviation within one
# standard error of the nominal ones.
SEED = 3
SPIN_UP_CYCLES = 40


@dataclass(frozen=True)
class Truth:
    """Parameters and conditions of the twin; SI units.

    `bias` is the stress at which the sample is loaded, its Kelvin element relaxed, when cycling
    starts. `background_start` and `background_end` are the background strain rates at the start
    and at the end of the record, between which it changes linearly; before the record it keeps
    the first. `strain_phase` is that of the imposed sinusoid at time zero. Steady-state
    grain size, steady-state fabric factor and critical strain of fabric are not in the equations
    of this test; they are what `data/priors/olivine.toml` fixes.
    """

    temperature: float = 1423.0
    initial_grain_size: float = 10e-6
    bias: float = 108e6
    period: float = 300.0
    strain_amplitude: float = 2e-3
    strain_phase: float = 0.7
    background_start: float = 0.9e-6
    background_end: float = 1.1e-6
    duration: float = 1860.0
    strain_interval: float = 9.0
    stress_interval: float = 25.0
    strain_noise: float = 2e-5
    stress_noise: float = 4e6
    maxwell_modulus: float = 203e9
    kelvin_modulus: float = 25e9
    kelvin_viscosity: float = 600e9
    stress_exponent: float = 3.2
    grain_size_exponent: float = 0.8
    # The dashpot carries the mean background rate at about the bias.
    activation_enthalpy: float = 467e3
    beta: float = -9.2e-5
    critical_strain_grain_size: float = 0.3
    steady_state_grain_size: float = 32.8e-6
    steady_state_fabric_factor: float = 1.0
    critical_strain_fabric: float = 1.0
    # Eq. 5 of the paper; below the least stress grains would be asked to grow without limit.
    piezometer_reference_grain_size: float = 0.015
    piezometer_exponent: float = 1.33
    piezometer_stress_floor: float = 1e6


TRUTH = Truth()


def strain_at(truth: Truth, time: FloatArray) -> FloatArray:
    """Total strain (fraction) at times (s) of the record, shape (n,); zero trend at time zero."""
    slope = (truth.background_end - truth.background_start) / truth.duration
    angle = 2 * np.pi * time / truth.period + truth.strain_phase
    strain: FloatArray = (
        truth.background_start * time
        + 0.5 * slope * time**2
        + truth.strain_amplitude * np.sin(angle)
    )
    return strain


def strain_rate_at(truth: Truth, time: float) -> float:
    """Total strain rate (1/s) at a time (s), before the record too."""
    slope = (truth.background_end - truth.background_start) / truth.duration
    frequency = 2 * np.pi / truth.period
    return float(
        truth.background_start
        + slope * max(time, 0.0)
        + truth.strain_amplitude * frequency * np.cos(frequency * time + truth.strain_phase)
    )


def states_at(truth: Truth, times: FloatArray) -> FloatArray:
    """Solve the three equations from the bias at rest, `SPIN_UP_CYCLES` ahead of the record.

    Grains change from the start of the record on.

    Parameters
    ----------
    truth : Truth
        Parameters and history.
    times : array, shape (n,)
        Increasing times (s), zero being the start of the record.

    Returns
    -------
    array, shape (3, n)
        Stress (Pa), Kelvin strain and grain size (m), from Eqs. 1, 2 and 5 with F = 1.
    """
    arrhenius = np.exp(
        truth.activation_enthalpy * (truth.beta - 1 / (GAS_CONSTANT * truth.temperature))
    )

    def rates(time: float, state: FloatArray) -> FloatArray:
        stress, kelvin_strain, grain_size = state
        strain_rate = strain_rate_at(truth, time)
        kelvin = (stress - truth.kelvin_modulus * kelvin_strain) / truth.kelvin_viscosity
        dashpot = (
            np.sign(stress)
            * abs(stress) ** truth.stress_exponent
            * grain_size**-truth.grain_size_exponent
            * arrhenius
        )
        floored = max(abs(stress), truth.piezometer_stress_floor)
        preferred = (
            truth.piezometer_reference_grain_size * (floored / 1e6) ** -truth.piezometer_exponent
        )
        growth = abs(strain_rate) * (preferred - grain_size) / truth.critical_strain_grain_size
        if time < 0:
            growth = 0.0
        elastic = strain_rate - kelvin - dashpot
        return np.array([truth.maxwell_modulus * elastic, kelvin, growth])

    solution = solve_ivp(
        rates,
        (-SPIN_UP_CYCLES * truth.period, max(times[-1], 1.0)),
        np.array([truth.bias, truth.bias / truth.kelvin_modulus, truth.initial_grain_size]),
        method="LSODA",
        t_eval=times,
        rtol=1e-10,
        atol=[1e-1, 1e-13, 1e-16],
    )
    if not solution.success:
        raise RuntimeError(solution.message)
    states: FloatArray = solution.y
    return states


def clock(start: float, end: float, interval: float, rng: np.random.Generator) -> FloatArray:
    """Return times (s) of slightly irregular readings, to the tenth of a second, from `start`."""
    times = np.arange(start, end, interval)
    times[1:] += 0.1 * interval * rng.uniform(-1.0, 1.0, times.size - 1)
    rounded: FloatArray = np.round(times, 1)
    return rounded


def strain_csv(truth: Truth, rng: np.random.Generator) -> str:
    """Return the file of the radiographs: time, strain with noise, its standard deviation."""
    time = clock(0.0, truth.duration, truth.strain_interval, rng)
    strain = strain_at(truth, time) + truth.strain_noise * rng.standard_normal(time.size)
    rows = [f"{t:.1f},{e:.7f},{truth.strain_noise:.7f}" for t, e in zip(time, strain, strict=True)]
    return "\n".join(["time_s,strain,uncertainty", *rows]) + "\n"


def stress_csv(truth: Truth, rng: np.random.Generator) -> str:
    """Return the file of the diffraction patterns: time, stress with noise, its deviation.

    Standard deviations vary by up to 20 % from reading to reading; their root mean square is
    `stress_noise`.
    """
    time = clock(6.0, truth.duration - 30.0, truth.stress_interval, rng)
    share = 1.0 + 0.2 * rng.uniform(-1.0, 1.0, time.size)
    deviation = np.round(truth.stress_noise * share / np.sqrt(np.mean(share**2)), -4)
    stress = states_at(truth, time)[0] + deviation * rng.standard_normal(time.size)
    columns = zip(time, stress / 1e6, deviation / 1e6, strict=True)
    rows = [f"{t:.1f},{s:.3f},{d:.2f}" for t, s, d in columns]
    return "\n".join(["time_s,stress_MPa,uncertainty_MPa", *rows]) + "\n"


def toml_text(truth: Truth) -> str:
    """Return the experiment file."""
    return f'''\
# Written by data/olivine/generate_record.py; change that script, not this file.
id = "{NAME}"
material = "olivine"
protocol = "forced_oscillation"
temperature_K = {truth.temperature!r}
# At the first strain reading, where the record starts.
initial_grain_size_m = {truth.initial_grain_size!r}

[oscillation]
period_s = {truth.period!r}
background = "kept"
spin_up_cycles = 2

[data]
separator = ","
header = true
strain_file = "{NAME}_strain.csv"
strain_time_column = "time_s"
strain_time_unit = "s"
strain_column = "strain"
strain_unit = "fraction"
strain_uncertainty_column = "uncertainty"
stress_file = "{NAME}_stress.csv"
stress_time_column = "time_s"
stress_time_unit = "s"
stress_column = "stress_MPa"
stress_unit = "MPa"
stress_uncertainty_column = "uncertainty_MPa"

[provenance]
kind = "synthetic"
source = "Solution of the nonlinear Burgers model plus Gaussian noise, by generate_record.py"
licence = "BSD-3-Clause"
notes = "The measured record is not public. Period and temperature are the paper's; bias, drift, \
noise and sampling are made up to resemble a test in a D-DIA press with stress from X-ray \
diffraction and strain from radiography."

[metadata]
noise_seed = {SEED}

# The truth, in SI. Steady-state grain size, steady-state fabric factor and critical strain of
# fabric are not in the equations of this test: they are what data/priors/olivine.toml fixes.
# stress_noise is the root mean square of the standard deviations.
[true_parameters]
maxwell_modulus = {truth.maxwell_modulus!r}
kelvin_modulus = {truth.kelvin_modulus!r}
kelvin_viscosity = {truth.kelvin_viscosity!r}
stress_exponent = {truth.stress_exponent!r}
grain_size_exponent = {truth.grain_size_exponent!r}
activation_enthalpy = {truth.activation_enthalpy!r}
beta = {truth.beta!r}
steady_state_grain_size = {truth.steady_state_grain_size!r}
steady_state_fabric_factor = {truth.steady_state_fabric_factor!r}
critical_strain_grain_size = {truth.critical_strain_grain_size!r}
critical_strain_fabric = {truth.critical_strain_fabric!r}
stress_noise = {truth.stress_noise!r}
piezometer_reference_grain_size = {truth.piezometer_reference_grain_size!r}
piezometer_exponent = {truth.piezometer_exponent!r}
piezometer_stress_floor = {truth.piezometer_stress_floor!r}
'''


def write_record(folder: Path) -> list[Path]:
    """Write the three files into an existing folder and return them."""
    rng = np.random.default_rng(SEED)
    texts = {
        f"{NAME}.toml": toml_text(TRUTH),
        f"{NAME}_strain.csv": strain_csv(TRUTH, rng),
        f"{NAME}_stress.csv": stress_csv(TRUTH, rng),
    }
    written = []
    for name, text in texts.items():
        path = folder / name
        path.write_text(text, encoding="utf-8", newline="\n")
        written.append(path)
    return written


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    for file in write_record(parser.parse_args().out):
        print(file)
