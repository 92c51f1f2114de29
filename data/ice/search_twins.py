"""Search for truths of the synthetic twins for which the paper's printed statements hold.

For each twin, candidates are drawn from Table 1's priors. The activation enthalpy of a candidate is
not drawn but solved for, so that the stress peaks at the published value; beta stays at the middle
of its prior, because only its product with the enthalpy counts. The truth is the candidate, of
those that meet every requirement, nearest to their mean. `docs/synthetic_ice.md` says what the
requirements are, what they ask for analytically, and what the search found.

Run ``PYTHONPATH=reports python data/ice/search_twins.py`` to repeat the search, some minutes;
`generate_twins.py` holds what it found.
"""

import argparse
import sys
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from maor.attenuation import falling_stretch, lowest_slope

from pyburgers.cmdstan.program import load_program
from pyburgers.common.messages import messages_to
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.model.priors import default_priors
from pyburgers.predictions.attenuation import DEFAULT_FREQUENCIES, attenuation_spectrum

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]

PROGRAM = Path(__file__).with_suffix(".stan")
SEED = 17  # of the candidates, chosen before the first run
CANDIDATES = 400_000  # for each sample
TEMPERATURE = 260.0  # K
INITIAL_GRAIN_SIZE = 230e-6  # m
BETA = -7.29e-4  # mol/J

PEAK_STRAIN = (0.025, 0.035)  # "near 3 %"
LARGEST_FINAL_SHARE = 0.8  # of the peak stress, at 20 % strain: "weakening"
STEEPEST_FINAL_SLOPE = -1.0  # d ln(stress)/d strain there, 1 % for each % of strain: "steady"
ENTHALPY = (59e3, 71e3)  # J/mol, three standard deviations of Table 1's prior
LOW_SLOPE = -0.5  # d ln(tan delta)/d ln(f) at 1e-4 Hz below which the background rules
STRETCH = (0.5e-3, 2e-3)  # Hz, "near 1e-3 Hz": the falling stretch comes into this range
MUCH_LARGER = 2.0  # the step from 2 to 4 MPa over that from 1 to 2 MPa

STRAIN = np.concatenate([np.arange(1, 121) * 5e-4, [0.08, 0.10, 0.15, 0.19, 0.20]])
CHUNK = 4000  # candidates in one run of the program
ROUNDS = 5  # of the fixed-point iteration for the reference stress
SEARCHED = (
    "maxwell_modulus",
    "kelvin_modulus",
    "kelvin_viscosity",
    "stress_exponent",
    "grain_size_exponent",
    "steady_state_grain_size",
    "steady_state_fabric_factor",
    "critical_strain_grain_size",
    "critical_strain_fabric",
)
STANDARD = {
    parameter.name: parameter.standard if parameter.standard is not None else 1.0
    for parameter in PROGRAM_PARAMETERS
}


@dataclass(frozen=True)
class Sample:
    """What is published of the test behind a twin, and what the paper finds for the sample.

    Attributes
    ----------
    name : str
        Of the sample.
    strain_rate, peak_stress : float
        1/s and Pa.
    found : mapping of str to (float, float)
        Ranges for what the paper says of single parameters.
    """

    name: str
    strain_rate: float
    peak_stress: float
    found: Mapping[str, tuple[float, float]]


SAMPLES = (
    Sample(
        "PIL40",
        1.69e-4,
        8.03e6,
        # "n is about 4", "epsilon_c1 is about 0.03"
        {"stress_exponent": (3.95, 4.05), "critical_strain_grain_size": (0.0275, 0.0325)},
    ),
    Sample("PIL72", 8.0e-5, 6.32e6, {}),
    Sample("PIL105", 2.53e-5, 4.49e6, {}),
)


def candidates(sample: Sample, number: int, rng: np.random.Generator) -> pd.DataFrame:
    """Draw candidates from Table 1's priors, within what the paper found for the sample."""
    priors = default_priors("ice")
    columns = {}
    for name in SEARCHED:
        distribution = priors[name].distribution()
        low, high = distribution.cdf(sample.found.get(name, distribution.support()))
        columns[name] = distribution.ppf(rng.uniform(low, high, number))
    return pd.DataFrame(columns)


def enthalpy(sample: Sample, table: pd.DataFrame, log_reference: FloatArray) -> FloatArray:
    """Activation enthalpy (J/mol) at which ln of the reference stress (Pa) is as given."""
    log_rate = (
        np.log(sample.strain_rate)
        + table["grain_size_exponent"].to_numpy() * np.log(INITIAL_GRAIN_SIZE)
        - table["stress_exponent"].to_numpy() * log_reference
    )
    found: FloatArray = log_rate / (BETA - 1 / (GAS_CONSTANT * TEMPERATURE))
    return found


def solve(sample: Sample, table: pd.DataFrame, tolerance: float = 1e-6) -> pd.DataFrame:
    """Peak and end of the stress-strain curve of every candidate, through Stan."""
    program = load_program(PROGRAM)
    parts = []
    for start in range(0, len(table), CHUNK):
        part = table.iloc[start : start + CHUNK].assign(beta=BETA)
        parameter = [
            part[name] if name in part else np.full(len(part), standard)
            for name, standard in STANDARD.items()
        ]
        values = program.evaluate(
            {
                "n_candidates": len(part),
                "parameter": np.column_stack(parameter).tolist(),
                "n_strains": STRAIN.size,
                "strain": STRAIN.tolist(),
                "strain_rate": sample.strain_rate,
                "initial_grain_size": INITIAL_GRAIN_SIZE,
                "temperature": TEMPERATURE,
                "tolerance": tolerance,
            }
        )
        names = ("peak_stress", "peak_strain", "final_stress", "final_slope")
        parts.append(pd.DataFrame({name: values[name] for name in names}, index=part.index))
    return pd.concat(parts)


def with_published_peak(sample: Sample, table: pd.DataFrame) -> pd.DataFrame:
    """Add the enthalpy that puts the peak where it is published, and the curve's properties."""
    log_reference = np.full(len(table), np.log(1.1 * sample.peak_stress))
    solved, curve = table, pd.DataFrame()
    for _ in range(ROUNDS):
        solved = table.assign(activation_enthalpy=enthalpy(sample, table, log_reference))
        curve = solve(sample, solved)
        # The peak follows the reference stress almost in proportion.
        log_reference = log_reference + np.log(sample.peak_stress / curve["peak_stress"].to_numpy())
    return solved.join(curve)


def may_have_one_falling_stretch(sample: Sample, table: pd.DataFrame) -> BoolArray:
    """Whether the peak of attenuation can vanish at 1.5 MPa (see docs/synthetic_ice.md).

    The dashpot flows fastest where the reference stress is lowest, and it cannot be below the peak
    stress: candidates whose peak survives even then need not be solved.
    """
    lowest = np.full(len(table), np.log(sample.peak_stress))
    fastest = table.assign(activation_enthalpy=enthalpy(sample, table, lowest))
    found: BoolArray = ~spectra(fastest, [1e-3])["debye_peak"].to_numpy()[:, 1]
    return found


def spectra(table: pd.DataFrame, frequencies: Sequence[float] = DEFAULT_FREQUENCIES) -> xr.Dataset:
    """Attenuation of the initial microstructure in the paper's regimes."""
    values = {name: table[name].to_numpy() for name in (*SEARCHED, "activation_enthalpy")}
    return attenuation_spectrum(
        {**values, "beta": np.full(len(table), BETA)},
        frequencies,
        temperature=TEMPERATURE,
        grain_size=INITIAL_GRAIN_SIZE,
    )


def requirements(sample: Sample, solved: pd.DataFrame) -> dict[str, BoolArray]:
    """Tell candidate by candidate which of the paper's statements hold.

    Attenuation is that of the initial microstructure, as in the study's statements.
    """
    spectrum = spectra(solved)
    peaks = spectrum["debye_peak"].to_numpy()
    low, high = falling_stretch(spectrum)
    tan_delta = spectrum["tan_delta"].to_numpy()
    steps = np.diff(tan_delta[:, [0, 2, 3]], axis=1)
    share = solved["final_stress"] / solved["peak_stress"]
    return {
        "enthalpy within the prior": solved["activation_enthalpy"].between(*ENTHALPY).to_numpy(),
        "peak stress as published": (
            (solved["peak_stress"] / sample.peak_stress - 1).abs() < 1e-3
        ).to_numpy(),
        "peak near 3 %": solved["peak_strain"].between(*PEAK_STRAIN).to_numpy(),
        "weakens to a steady stress": (
            (share < LARGEST_FINAL_SHARE) & (solved["final_slope"] > STEEPEST_FINAL_SLOPE)
        ).to_numpy(),
        "one falling stretch, at 1 MPa": peaks[:, 0] & ~peaks[:, 1:].any(axis=1),
        "it is near 1e-3 Hz": (low <= STRETCH[1]) & (high >= STRETCH[0]),
        "background below it": lowest_slope(spectrum)[:, 0] < LOW_SLOPE,
        "much larger step from 2 to 4 MPa": np.all(steps[:, 1] > MUCH_LARGER * steps[:, 0], axis=1),
    }


def typical(found: pd.DataFrame) -> pd.Series:
    """Return the candidate nearest to the mean of all, in units of their standard deviations."""
    names = [*SEARCHED, "activation_enthalpy"]
    scaled = (found[names] - found[names].mean()) / found[names].std()
    return found.iloc[int((scaled**2).sum(axis=1).to_numpy().argmin())]


def truth_of(sample: Sample, candidate: pd.Series) -> pd.Series:
    """Return a candidate to three digits, its enthalpy solved again and given to 10 J/mol."""
    rounded = {name: float(f"{candidate[name]:.3g}") for name in SEARCHED}
    (solved,) = with_published_peak(sample, pd.DataFrame([rounded])).to_dict("records")
    rounded["activation_enthalpy"] = round(solved["activation_enthalpy"], -1)
    return pd.Series(rounded, name=candidate.name)


def search(
    sample: Sample, number: int, rng: np.random.Generator
) -> tuple[pd.DataFrame, pd.DataFrame]:
    """Search one sample.

    Parameters
    ----------
    sample : Sample
        Published conditions.
    number : int
        Candidates to draw.
    rng : Generator
        Gives the candidates.

    Returns
    -------
    found : DataFrame
        Candidates that meet every requirement (SI).
    counts : DataFrame
        Columns requirement, alone, together: how many candidates meet one requirement, and that
        one with all before it. Those that fail the first are not solved.
    """
    drawn = candidates(sample, number, rng)
    possible = drawn[may_have_one_falling_stretch(sample, drawn)]
    solved = with_published_peak(sample, possible)
    together = np.ones(len(solved), dtype=bool)
    rows = [("the peak of attenuation can vanish at 1.5 MPa", len(possible), len(possible))]
    for name, met in requirements(sample, solved).items():
        together &= met
        rows.append((name, int(met.sum()), int(together.sum())))
    return solved[together], pd.DataFrame(rows, columns=["requirement", "alone", "together"])


def main() -> None:
    """Search all samples and print counts and truths."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--candidates", type=int, default=CANDIDATES, help="for each sample")
    parser.add_argument("--seed", type=int, default=SEED)
    parser.add_argument("--out", type=Path, help="folder for tables of what was found")
    options = parser.parse_args()
    with messages_to(sys.stderr):
        for place, sample in enumerate(SAMPLES):
            rng = np.random.default_rng([options.seed, place])
            found, counts = search(sample, options.candidates, rng)
            print(f"\n{sample.name}: {len(found)} of {options.candidates} candidates")
            print(counts.to_string(index=False))
            if options.out is not None:
                options.out.mkdir(parents=True, exist_ok=True)
                found.to_csv(options.out / f"{sample.name}.csv", index_label="candidate")
            if len(found):
                print(found.describe(percentiles=[0.05, 0.5, 0.95]).T.to_string())
                nearest = truth_of(sample, typical(found))
                print(
                    f"nearest to the mean, candidate {nearest.name}:", nearest.to_string(), sep="\n"
                )


if __name__ == "__main__":
    main()
