"""What threads within a chain buy: eight tests of one material, fitted together.

    python benchmarks/threads.py             # about five minutes on two cores without other work
    python benchmarks/threads.py --threads 4

A short fit sets up coordinates and gives draws. There, gradients are timed in turn: of the program
without threads, and of that with threads in one and in several. Times of the clock, since threads
are there to shorten them, and of the processors.
"""

import argparse
import os
import tempfile
import time
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
from sampling import ICE, markdown

from pyburgers.cmdstan.draw_files import read_draws
from pyburgers.cmdstan.program import Program, load_program
from pyburgers.common.atomic_files import write_json
from pyburgers.fitting.fit import fit_jointly
from pyburgers.model.priors import default_priors
from pyburgers.protocols.constant_rate.experiment import (
    ConstantRateExperiment,
    load_constant_rate,
)
from pyburgers.protocols.constant_rate.protocol import PROTOCOL
from pyburgers.protocols.forward import simulate_data
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

STEP = 1e-14
"""Of leapfrogs that stay where they are."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit, measure, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--threads", type=int, default=2)
    threads = parser.parse_args(arguments).threads
    programs = {
        "without threads": load_program(PROTOCOL.program),
        "with threads, in one": replace(load_program(PROTOCOL.program, threads=2), threads=1),
        f"with threads, in {threads}": load_program(PROTOCOL.program, threads=threads),
    }
    with tempfile.TemporaryDirectory() as folder:
        out = Path(folder) / "run"
        fit_jointly(_tests(), default_priors("ice"), out=out, options=SHORT_FIT)
        run = RunDirectory(out)
        draws = read_draws([run.draws_file(1)])["coordinate"][0]
        points = draws[:: max(1, len(draws) // POINTS)][:POINTS]
        taken: dict[str, list[FloatArray]] = {name: [] for name in programs}
        density: dict[str, FloatArray] = {}
        for _ in range(ROUNDS):
            for name, program in programs.items():
                once, density[name] = _leapfrogs(program, run.stan_data_file, points, 1)
                often, _ = _leapfrogs(program, run.stan_data_file, points, 1 + TIMED)
                taken[name].append(1e3 * (often - once) / (TIMED * len(points)))
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


def _leapfrogs(
    program: Program, data: Path, points: FloatArray, number: int
) -> tuple[FloatArray, FloatArray]:
    """Return seconds of the clock and of the processors for leapfrogs at points, and densities."""
    density = []
    clock, before = time.monotonic(), os.times()
    with tempfile.TemporaryDirectory() as folder:
        init, output = Path(folder) / "init.json", Path(folder) / "output.csv"
        for point in points:
            write_json(init, {"coordinate": point.tolist()})
            running = program.start(
                [
                    *("method=sample", "num_samples=1", "num_warmup=0", "adapt", "engaged=0"),
                    *("algorithm=hmc", "engine=static", f"int_time={number * STEP}"),
                    f"stepsize={STEP}",
                ],
                data=data,
                init=init,
                output=output,
                seed=1,
                digits=17,
            )
            running.wait()
            density.append(read_draws([output])["lp__"][0, 0])
    after = os.times()
    used = after.children_user - before.children_user
    return np.array([time.monotonic() - clock, used]), np.array(density)


if __name__ == "__main__":
    main()
