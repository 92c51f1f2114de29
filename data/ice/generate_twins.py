"""Write the synthetic curves of the ice samples PIL40, PIL72 and PIL105.

The measured curves are not public. These are solutions of the model plus Gaussian noise, at
parameters inside the priors for which the paper's printed statements hold. `search_twins.py` finds
the parameters, `docs/synthetic_ice.md` explains them. The solver is scipy's and the equations below
are the paper's six, so that the curves are an independent check of the Stan programs.

Run ``python data/ice/generate_twins.py`` to write the files anew, bit for bit.
"""

import argparse
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
from scipy.integrate import solve_ivp

FloatArray = npt.NDArray[np.float64]

GAS_CONSTANT = 8.314462618  # J/mol/K
TEMPERATURE = 260.0  # K, as in the paper's numerical solutions
INITIAL_GRAIN_SIZE = 230e-6  # m
BETA = -7.29e-4  # mol/J, the sign of Table 1 corrected
STRESS_NOISE = 0.1e6  # Pa
FINAL_STRAIN = 0.2
SEED = 1  # of the noise of all twins, chosen before any data were made with it


@dataclass(frozen=True)
class Twin:
    """Truth and sampling of one synthetic test; SI units.

    `candidate` is the number of the truth in the search for it; `log_interval` is the time (s)
    between logged readings, which are equally spaced in time; `sparse_peak` says whether most
    readings around the peak were lost.
    """

    name: str
    candidate: int
    strain_rate: float
    maxwell_modulus: float
    kelvin_modulus: float
    kelvin_viscosity: float
    stress_exponent: float
    grain_size_exponent: float
    activation_enthalpy: float
    steady_state_grain_size: float
    steady_state_fabric_factor: float
    critical_strain_grain_size: float
    critical_strain_fabric: float
    published: str
    log_interval: float
    sparse_peak: bool


TWINS = (
    Twin(
        name="PIL40",
        candidate=50_552,
        strain_rate=1.69e-4,
        maxwell_modulus=531e6,
        kelvin_modulus=5.50e9,
        kelvin_viscosity=4.25e11,
        stress_exponent=3.95,
        grain_size_exponent=0.486,
        activation_enthalpy=63.78e3,
        steady_state_grain_size=87.4e-6,
        steady_state_fabric_factor=0.666,
        critical_strain_grain_size=0.0307,
        critical_strain_fabric=0.178,
        published="-9.68 C, 8.03 MPa, 1.69e-4 1/s",
        log_interval=3.0,
        sparse_peak=True,
    ),
    Twin(
        name="PIL72",
        candidate=96_826,
        strain_rate=8.0e-5,
        maxwell_modulus=456e6,
        kelvin_modulus=7.96e9,
        kelvin_viscosity=4.45e11,
        stress_exponent=3.97,
        grain_size_exponent=0.263,
        activation_enthalpy=62.13e3,
        steady_state_grain_size=99.7e-6,
        steady_state_fabric_factor=0.619,
        critical_strain_grain_size=0.0628,
        critical_strain_fabric=0.235,
        published="-10.05 C, 6.32 MPa, 8.0e-5 1/s",
        log_interval=6.0,
        sparse_peak=False,
    ),
    Twin(
        name="PIL105",
        candidate=168_207,
        strain_rate=2.53e-5,
        maxwell_modulus=304e6,
        kelvin_modulus=6.57e9,
        kelvin_viscosity=4.32e11,
        stress_exponent=3.99,
        grain_size_exponent=0.448,
        activation_enthalpy=63.60e3,
        steady_state_grain_size=85.4e-6,
        steady_state_fabric_factor=0.672,
        critical_strain_grain_size=0.0698,
        critical_strain_fabric=0.142,
        published="-9.62 C, 4.49 MPa, 2.53e-5 1/s",
        log_interval=20.0,
        sparse_peak=False,
    ),
)


def stress_at(twin: Twin, strain: FloatArray) -> FloatArray:
    """Noise-free stress (Pa) of a twin.

    Parameters
    ----------
    twin : Twin
        Parameters and strain rate.
    strain : array, shape (n,)
        Increasing strains (fraction), positive.

    Returns
    -------
    array, shape (n,)
        From the paper's equations in the six states stress, Kelvin strain, elastic strain,
        dashpot strain, grain size and fabric factor, in time, from rest.
    """
    arrhenius = np.exp(twin.activation_enthalpy * (BETA - 1 / (GAS_CONSTANT * TEMPERATURE)))

    def rates(_time: float, state: FloatArray) -> FloatArray:
        stress, kelvin_strain, _, _, grain_size, fabric = state
        kelvin = (stress - twin.kelvin_modulus * kelvin_strain) / twin.kelvin_viscosity
        dashpot = (
            np.sign(stress)
            * (abs(stress) / fabric) ** twin.stress_exponent
            * grain_size**-twin.grain_size_exponent
            * arrhenius
        )
        elastic = twin.strain_rate - kelvin - dashpot
        grain_growth = (
            twin.strain_rate
            * (twin.steady_state_grain_size - grain_size)
            / twin.critical_strain_grain_size
        )
        fabric_growth = (
            twin.strain_rate
            * (twin.steady_state_fabric_factor - fabric)
            / twin.critical_strain_fabric
        )
        return np.array(
            [
                twin.maxwell_modulus * elastic,
                kelvin,
                elastic,
                dashpot,
                grain_growth,
                fabric_growth,
            ]
        )

    start = np.array([0.0, 0.0, 0.0, 0.0, INITIAL_GRAIN_SIZE, 1.0])
    times = strain / twin.strain_rate
    solution = solve_ivp(
        rates,
        (0.0, times[-1]),
        start,
        method="LSODA",
        t_eval=times,
        rtol=1e-10,
        atol=[1e-2, 1e-13, 1e-13, 1e-13, 1e-16, 1e-12],
    )
    if not solution.success:
        raise RuntimeError(f"{twin.name}: {solution.message}")
    stress: FloatArray = solution.y[0]
    return stress


def sampled_strain(twin: Twin) -> FloatArray:
    """Strains (fraction) of the readings that are kept, shape (n,).

    Every logged reading to 1 % strain, every third to 5 %, every tenth beyond; with `sparse_peak`
    one in twenty-five from 2 to 4.5 %.
    """
    reading = np.arange(1, int(FINAL_STRAIN / (twin.strain_rate * twin.log_interval)) + 1)
    strain = reading * twin.log_interval * twin.strain_rate
    stride = np.where(strain <= 0.01, 1, np.where(strain <= 0.05, 3, 10))
    if twin.sparse_peak:
        stride[(strain > 0.02) & (strain <= 0.045)] = 25
    kept: FloatArray = strain[reading % stride == 0]
    return kept


def csv_text(twin: Twin, rng: np.random.Generator) -> str:
    """Return the data file of one twin: time, strain and stress with noise."""
    strain = sampled_strain(twin)
    stress = stress_at(twin, strain) + STRESS_NOISE * rng.standard_normal(strain.size)
    rows = [
        f"{e / twin.strain_rate:.0f},{e:.8f},{s / 1e6:.4f}"
        for e, s in zip(strain, stress, strict=True)
    ]
    return "\n".join(["time_s,strain,stress_MPa", *rows]) + "\n"


def toml_text(twin: Twin) -> str:
    """Return the experiment file of one twin."""
    return f'''\
# Written by data/ice/generate_twins.py; change that script, not this file.
id = "{twin.name}"
material = "ice"
protocol = "constant_rate"
# The sample was at 263 K; the paper's numerical solutions use 260 K, and so does the twin.
temperature_K = {TEMPERATURE}
initial_grain_size_m = {INITIAL_GRAIN_SIZE}
final_strain = {FINAL_STRAIN}

[[segments]]
start_strain = 0.0
strain_rate_per_s = {twin.strain_rate}

[data]
file = "{twin.name}.csv"
separator = ","
header = true
strain_column = "strain"
strain_unit = "fraction"
stress_column = "stress_MPa"
stress_unit = "MPa"

[provenance]
kind = "synthetic"
source = "Solution of the nonlinear Burgers model plus Gaussian noise, by generate_twins.py"
licence = "BSD-3-Clause"
notes = "The measured curve of {twin.name} is not public. Rate and peak stress are those of one \
test in Table 1 of Qi and Goldsby (2021), doi 10.1029/2021JB021824 ({twin.published}); which of \
its tests is which sample is not known, except that PIL40 is the fastest of the three."

[metadata]
sample_temperature_K = 263
noise_seed = {SEED}

# The truth, in SI. beta carries the minus sign that Table 1 of the paper lacks.
[true_parameters]
maxwell_modulus = {twin.maxwell_modulus!r}
kelvin_modulus = {twin.kelvin_modulus!r}
kelvin_viscosity = {twin.kelvin_viscosity!r}
stress_exponent = {twin.stress_exponent!r}
grain_size_exponent = {twin.grain_size_exponent!r}
activation_enthalpy = {twin.activation_enthalpy!r}
beta = {BETA!r}
steady_state_grain_size = {twin.steady_state_grain_size!r}
steady_state_fabric_factor = {twin.steady_state_fabric_factor!r}
critical_strain_grain_size = {twin.critical_strain_grain_size!r}
critical_strain_fabric = {twin.critical_strain_fabric!r}
stress_noise = {STRESS_NOISE!r}
'''


def write_twins(folder: Path) -> list[Path]:
    """Write the two files of every twin into an existing folder and return them."""
    written = []
    for number, twin in enumerate(TWINS):
        rng = np.random.default_rng([SEED, number])
        for suffix, text in ((".toml", toml_text(twin)), (".csv", csv_text(twin, rng))):
            path = folder / f"{twin.name}{suffix}"
            path.write_text(text, encoding="utf-8", newline="\n")
            written.append(path)
    return written


if __name__ == "__main__":
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=Path(__file__).parent)
    for file in write_twins(parser.parse_args().out):
        print(file)
