"""Count how often the verdicts say no, of correct models and of known misfits.

Data are simulated at draws from the prior of ice, spoilt in one way each, and fitted with the
standard model. ``fit`` makes run directories, ``judge`` counts verdicts::

    python benchmarks/verdict_power.py fit OUT --kinds curve creep --seeds 1 2 3
    python benchmarks/verdict_power.py judge OUT --draws 400 1000

``fit`` with more draws adds them to the chains that are there; ``judge`` leaves out fits that have
fewer draws than it counts.
"""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import replace
from functools import partial
from itertools import pairwise, product
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd

import pyburgers
from pyburgers.checks.fit_checks import CheckedDraws, CheckKind, Outcome, run_checks
from pyburgers.checks.verdicts import CHECKS, verdicts
from pyburgers.common.array_types import FloatArray

TEMPERATURE, RATE, STRESS, DURATION = 263.0, 1e-4, 4e6, 8000.0
"""Kelvin, 1/s, Pa, s; of the curve up to a strain of 0.2, and of the creep test."""

SOURCE = "Simulated by benchmarks/verdict_power.py"

STRAINS = np.linspace(0.002, 0.2, 100)
TIMES = np.geomspace(8.0, DURATION, 100)
STRESS_NOISE, STRAIN_NOISE = 0.01, 0.005
"""Of the largest reading."""

STRESS_RANGE, STRAIN_RANGE = (2e6, 15e6), (5e-3, 0.15)
"""Largest readings (Pa, and strain) that a draw from the prior has to have."""

TEMPERATURE_DRIFT, LOAD_DRIFT, STEPS = 5.0, 0.03, 20
"""Kelvin and share by the end of a test, in so many steps."""

AR1 = 0.9
"""Correlation of errors of neighbouring readings."""

SINE = 2.7
"""Noise standard deviations of a sine of two periods."""

CHAINS, FIRST_DRAWS = 2, 500
"""Draws of each chain before any are added."""

MISFITS: tuple[str, ...] = (
    "correct", "two_elements", "n_K_3", "load_drift_3_percent", "temperature_drift_5_K", "AR1",
    "displaced", "sine", "andrade",
)  # fmt: skip

LAWS: Mapping[str, Mapping[str, float]] = MappingProxyType(
    {
        "two_elements": {"peak_strength": 1.0, "peak_time_decades": 1.3, "peak_width": 0.0},
        "n_K_3": {"kelvin_stress_exponent": 3.0, "kelvin_reference_stress": 1e6},
        "andrade": {"andrade_exponent": 1.0 / 3.0},
    }
)
"""Parameters (SI) of the Kelvin part of the truth."""

SAMPLE: Mapping[str, Any] = MappingProxyType(
    {"material": "ice", "temperature_K": TEMPERATURE, "grain_size_um": 230.0}
)


def imposed(kind: str, misfit: str) -> pyburgers.HistoryExperiment:
    """Return the loading that the sample sees, without readings."""
    drift = TEMPERATURE_DRIFT if misfit == "temperature_drift_5_K" else 0.0
    end = STRAINS[-1] / RATE if kind == "curve" else DURATION
    edges = np.linspace(0.0, end, STEPS + 1 if drift else 2).tolist()
    control: dict[str, Any] = {"control": "stress", "stress": STRESS}
    if kind == "curve":
        control = {"control": "strain_rate", "strain_rate_per_s": RATE}
    elif misfit == "load_drift_3_percent":
        rate = LOAD_DRIFT * STRESS / end
        control = {"control": "stress_rate", "start_stress": STRESS, "stress_rate": rate}
    stages = [
        {
            **control,
            "start_time": start,
            "end_time": stop,
            "temperature_K": TEMPERATURE + drift * (k + 0.5) / (len(edges) - 1),
        }
        for k, (start, stop) in enumerate(pairwise(edges))
    ]
    return pyburgers.LoadingHistory(stages=stages, time_unit="s", stress_unit="Pa", **SAMPLE)


def noise(misfit: str, n: int, rng: np.random.Generator) -> FloatArray:
    """Errors of readings of standard deviation 1, shape (n,)."""
    white = rng.standard_normal(n)
    if misfit == "sine":
        return white + SINE * np.sin(4.0 * np.pi * np.arange(n) / n + rng.uniform(0, 2 * np.pi))
    if misfit != "AR1":
        return white
    found = np.empty(n)
    found[0] = white[0]
    for k in range(1, n):
        found[k] = AR1 * found[k - 1] + np.sqrt(1.0 - AR1**2) * white[k]
    return found


def simulated(kind: str, misfit: str, seed: int) -> pyburgers.Experiment:
    """Return data simulated at a draw from the prior, with what a user would say of them."""
    rng = np.random.default_rng([seed, MISFITS.index(misfit), kind == "creep"])
    driven = imposed(kind, misfit)
    times = STRAINS / RATE if kind == "curve" else TIMES
    low, high = STRESS_RANGE if kind == "curve" else STRAIN_RANGE
    priors = pyburgers.priors("ice").resolved(1e6)
    while True:
        values = {**priors.sample(rng), **LAWS.get(misfit, {})}
        try:
            solution = pyburgers.simulate(driven, values, at=times)
        except pyburgers.SamplingError:
            continue
        read = solution["stress_Pa" if kind == "curve" else "strain"].to_numpy()
        if low <= np.abs(read).max() <= high:
            break
    size = (STRESS_NOISE if kind == "curve" else STRAIN_NOISE) * np.abs(read).max()
    if kind == "curve" and misfit == "load_drift_3_percent":
        read = read * (1.0 + LOAD_DRIFT * STRAINS / STRAINS[-1])
    if misfit == "displaced":  # the zero of the reading was lost
        read = read + 10.0 * size
    read = read + size * noise(misfit, read.size, rng)
    about = {**SAMPLE, "name": f"{kind}_{misfit}_{seed}", "kind": "synthetic", "source": SOURCE}
    if kind == "curve":
        return pyburgers.ConstantRateTest(
            strain=STRAINS,
            strain_unit="fraction",
            stress=read,
            stress_unit="Pa",
            strain_rate=RATE,
            **about,
        )
    return pyburgers.CreepTest(
        time=TIMES,
        time_unit="s",
        strain=read,
        strain_unit="fraction",
        stress=STRESS,
        stress_unit="Pa",
        **about,
    )


def fit_all(
    out: Path, kinds: Sequence[str], misfits: Sequence[str], seeds: Sequence[int], draws: int
) -> None:
    """Give each test so many draws a chain; one that cannot be sampled is named and left out."""
    for seed, kind, misfit in product(seeds, kinds, misfits):
        test = simulated(kind, misfit, seed)
        fit = partial(
            pyburgers.fit,
            test,
            pyburgers.priors("ice"),
            options=pyburgers.SamplerOptions(
                chains=CHAINS, draws=FIRST_DRAWS, warmup=400, seed=seed
            ),
            out=out / test.id / "run",
        )
        try:
            lacking = draws - fit().checked_draws.posterior["posterior"].sizes["draw"]
            if lacking > 0:
                fit(more_draws=lacking)
        except pyburgers.SamplingError as error:
            print(f"{test.id}: {error}")


def thinned(fit: pyburgers.Fit, count: int) -> CheckedDraws:
    """Return so many draws of a fit, evenly spaced, as checks look at them."""
    whole = fit.checked_draws
    sizes = whole.posterior["posterior"].sizes
    kept = np.linspace(0, sizes["draw"] - 1, count // sizes["chain"]).astype(int)
    return replace(whole, posterior=whole.posterior.isel(draw=kept, missing_dims="ignore"))


def judge(out: Path, counts: Sequence[int]) -> pd.DataFrame:
    """Return verdicts of every run, with so many draws of each, evenly thinned.

    The column failed has the names of the checks that said no.
    """
    rows = []
    for folder in sorted(
        path.parent for path in out.glob("*/run") if (path / "posterior.nc").exists()
    ):
        kind, rest = folder.name.split("_", 1)
        misfit, seed = rest.rsplit("_", 1)
        fit = pyburgers.Fit.load(folder / "run")
        have = fit.checked_draws.posterior["posterior"].sizes
        for count in (one for one in counts if one <= have["chain"] * have["draw"]):
            results = run_checks(thinned(fit, count), CHECKS)
            said = verdicts(results)
            rows.append(
                {
                    "kind": kind,
                    "misfit": misfit,
                    "seed": int(seed),
                    "draws": count,
                    "sampled": said[CheckKind.SAMPLING].outcome.value,
                    "describes": said[CheckKind.DESCRIPTION].outcome.value,
                    "failed": ", ".join(
                        one.name
                        for one in results
                        if one.check.kind is CheckKind.DESCRIPTION and one.outcome is Outcome.NO
                    ),
                }
            )
    return pd.DataFrame(rows)


def main() -> None:
    """Read the command line."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("action", choices=("fit", "judge"))
    parser.add_argument("out", type=Path)
    parser.add_argument(
        "--kinds", nargs="+", choices=("curve", "creep"), default=["curve", "creep"]
    )
    parser.add_argument("--misfits", nargs="+", choices=MISFITS, default=list(MISFITS))
    parser.add_argument("--seeds", nargs="+", type=int, default=[1])
    parser.add_argument("--draws", nargs="+", type=int, default=[400, 1000])
    given = parser.parse_args()
    if given.action == "fit":
        fit_all(given.out, given.kinds, given.misfits, given.seeds, max(given.draws) // CHAINS)
        return
    found = judge(given.out, given.draws)
    print(found.to_string())
    for verdict in ("sampled", "describes"):
        counted = found.groupby(["kind", "misfit", "draws"])[verdict].value_counts().unstack()
        print(f"\n{verdict}\n{counted.fillna(0).astype(int).to_string()}")


if __name__ == "__main__":
    main()
