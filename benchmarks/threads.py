"""What threads within a chain buy: eight tests of one material, fitted together.

    python benchmarks/threads.py             # about five minutes on two cores without other work
    python benchmarks/threads.py --threads 4

A short fit sets up coordinates and gives draws. There, gradients are timed in turn: of the program
without threads, and of that with threads in one and in several. Times of the clock, since threads
are there to shorten them, and of the processors.
"""

import argparse
import tempfile
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
from gradients import leapfrogs, ms_per_gradient
from tables import ICE, markdown

from pyburgers.cmdstan.draw_files import read_draws
from pyburgers.cmdstan.program import load_program
from pyburgers.fitting.fit import fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD
from pyburgers.kinds.forward import simulate_data
from pyburgers.model.priors import default_priors
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory

FloatArray = npt.NDArray[np.float64]

TWINS = ("PIL40", "PIL72", "PIL105")
N_TESTS = 8
MATERIAL = (
    *("maxwell_modulus", "kelvin_modulus", "kelvin_viscosity", "stress_exponent"),
    *("grain_size_exponent", "activation_enthalpy", "beta"),
)
"""What all tests have of the first twin."""

SHORT_FIT = SamplerOptions(chains=1, warmup=20, draws=8, max_treedepth=5, seed=1)
POINTS, TIMED, ROUNDS = 4, 60, 5
"""Draws at which gradients are timed, how many at each, and how often in turn."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit, measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, default=2)
    threads = parser.parse_args(arguments).threads
    programs = {
        "without threads": load_program(LIKELIHOOD.program),
        "with threads, in one": replace(load_program(LIKELIHOOD.program, threads=2), threads=1),
        f"with threads, in {threads}": load_program(LIKELIHOOD.program, threads=threads),
    }
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        fit(_tests(), default_priors("ice"), out=out, options=SHORT_FIT)
        run = RunDirectory(out)
        draws = read_draws([run.draws_file(1)])["coordinate"][0]
        points = draws[:: max(1, len(draws) // POINTS)][:POINTS]
        density = {
            name: leapfrogs(program, run.stan_data_file, points, 1)[1]
            for name, program in programs.items()
        }
        taken: dict[str, list[FloatArray]] = {name: [] for name in programs}
        for _ in range(ROUNDS):
            for name, program in programs.items():
                taken[name].append(ms_per_gradient(program, run.stan_data_file, points, TIMED))
    rows = {name: np.median(times, axis=0) for name, times in taken.items()}
    first = next(iter(rows))
    away = {name: np.abs(found / density[first] - 1).max() for name, found in density.items()}
    table = [
        {
            "program": name,
            "a gradient, clock (ms)": f"{clock:.2f}",
            "processors (ms)": f"{processors:.2f}",
            "times as fast": f"{rows[first][0] / clock:.2f}",
            "difference of the log density": f"{away[name]:.0e}",
        }
        for name, (clock, processors) in rows.items()
    ]
    print(markdown(pd.DataFrame(table)))


def _tests() -> list[ConstantRateExperiment]:
    """Make tests of the material of the first twin, with the microstructures of all twins."""
    twins = [load_constant_rate(ICE / f"{name}.toml") for name in TWINS]
    truths = [dict(twin.true_parameters or {}) for twin in twins]
    common = {name: truths[0][name] for name in MATERIAL}
    made = []
    for k in range(N_TESTS):
        twin, truth = twins[k % len(twins)], truths[k % len(twins)]
        rng = np.random.default_rng([20261122, k])
        test = simulate_data(twin, {**truth, **common}, rng, source="one material")
        made.append(replace(test, id=f"test_{k + 1}"))
    return made


if __name__ == "__main__":
    main()
