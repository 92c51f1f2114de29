"""Find where trajectories of a finished fit go wrong.

    python benchmarks/leapfrogs.py runs/my_test               # at the step of its chains
    python benchmarks/leapfrogs.py runs/my_test --step 0.15   # at a longer one, with more of them

A divergence says that a trajectory met curvature which its steps do not follow, not where. From
draws of the run, in the mean metric of its chains, trajectories are followed, and the steps in
which the error of the energy changes by more than --told are shown with log density, its Jacobian
and parameters along them: what changes there in one stride is what the coordinates have lost.
"""

import argparse
import json
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
from tables import ROOT

from pyburgers.cmdstan.draw_files import adaptation_of, read_draws
from pyburgers.cmdstan.installation import ensure_cmdstan
from pyburgers.cmdstan.program import Program, load_program
from pyburgers.common.errors import SamplingError
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.stan_data import StanData
from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.sampling.run_directory import RunDirectory

FloatArray = npt.NDArray[np.float64]

SUNDIALS = ("nvecserial", "cvodes", "idas", "kinsol")


def main(arguments: Sequence[str] | None = None) -> None:
    """Follow trajectories and print what went wrong."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("run", type=Path, help="run directory of a fit of one test")
    parser.add_argument("--step", type=float, help="default: the mean of the chains'")
    parser.add_argument(
        "--steps", type=int, default=30, help="of a trajectory; default %(default)s"
    )
    parser.add_argument("--points", type=int, default=400, help="draws; default %(default)s")
    parser.add_argument("--told", type=float, default=4.0, help="default %(default)s")
    parser.add_argument("--shown", type=int, default=5, help="steps; default %(default)s")
    parser.add_argument("--seed", type=int, default=1, help="default %(default)s")
    options = parser.parse_args(arguments)
    fit, run = Fit.load(options.run), RunDirectory(options.run)
    adapted = [adaptation_of(file) for file in run.draws_files()]
    drawn = np.concatenate(list(read_draws(run.draws_files())["coordinate"]))
    every = max(1, len(drawn) // options.points)
    step = options.step or float(np.mean([one.step_size for one in adapted]))
    metric = np.mean([one.metric for one in adapted], axis=0)
    with tempfile.TemporaryDirectory() as folder:
        inputs = [Path(folder) / name for name in ("points", "factor")]
        np.savetxt(inputs[0], drawn[::every], fmt="%.17g")
        np.savetxt(inputs[1], np.linalg.cholesky(metric), fmt="%.17g")
        said = subprocess.run(
            [
                *(_compiled(fit, Path(folder)), run.stan_data_file, *inputs),
                *(str(one) for one in (step, options.steps, options.seed, options.told)),
            ],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
    found = np.loadtxt(said.splitlines(), ndmin=2)
    n_steps, wrong = int(found[:, 0].sum()), found[:, 1] > 0
    print(f"{wrong.sum()} of {n_steps} steps of {step:.3g} change the energy by {options.told:g}.")
    program = load_program(fit.problem.likelihood.program)
    data = json.loads(run.stan_data_file.read_text(encoding="utf-8"))
    for row in found[wrong][: options.shown]:
        shown = _along(program, data, fit.problem.free, *np.split(row[3:], 2))
        print(shown.to_string(float_format=lambda value: f"{value:.5g}"), end="\n\n")


def _compiled(fit: Fit, folder: Path) -> Path:
    """Compile the fit's program with a main that follows trajectories."""
    cmdstan, source = ensure_cmdstan(), fit.problem.likelihood.program
    math = cmdstan / "stan" / "lib" / "stan_math"
    translated, executable = folder / f"{source.stem}.hpp", folder / source.stem
    subprocess.run(
        [
            cmdstan / "bin" / "stanc",
            f"--include-paths={source.parent}",
            f"--o={translated}",
            source,
        ],
        check=True,
        stderr=subprocess.DEVNULL,
    )
    libraries = math / "lib"
    headers = (
        *(cmdstan / "src", cmdstan / "stan" / "src", *(cmdstan / "lib").glob("rapidjson_*"), math),
        *(found for kind in ("eigen_*", "boost_*") for found in libraries.glob(kind)),
        *(found for kind in ("tbb_*", "sundials_*") for found in libraries.glob(f"{kind}/include")),
    )
    (sundials,) = libraries.glob("sundials_*/lib")
    subprocess.run(
        [
            *("g++", "-std=c++1y", "-pthread", "-O3", "-w", "-D_REENTRANT"),
            *("-DBOOST_DISABLE_ASSERTS", *(f"-I{one}" for one in headers)),
            *("-x", "c++", "-include", translated, ROOT / "benchmarks" / "leapfrogs.hpp"),
            *("-x", "none", "-o", executable, f"-Wl,-rpath,{libraries / 'tbb'}"),
            *(sundials / f"libsundials_{name}.a" for name in SUNDIALS),
            libraries / "tbb" / "libtbb.so.2",
        ],
        check=True,
    )
    return executable


def _along(
    program: Program, data: StanData, free: Sequence[str], start: FloatArray, end: FloatArray
) -> pd.DataFrame:
    """Evaluate a program along a step, from before its start (0) to behind its end (1).

    Where there is no solution the column has no numbers.
    """
    names = [one.name for one in PROGRAM_PARAMETERS]
    rows: dict[str, dict[str, float]] = {}
    for part in np.linspace(-0.5, 1.5, 9):
        row = rows[f"{part:.2f}"] = {}
        position = {"coordinate": (start + part * (end - start)).tolist()}
        try:
            found = program.evaluate(data, position)
        except SamplingError:
            continue
        values = dict(zip(names, found["parameter"][0], strict=True))
        row["log density"] = float(found["log_density"])
        row["log Jacobian"] = float(found["log_jacobian"])
        row |= {name: float(values[name]) for name in free if name in values}
    return pd.DataFrame(rows)


if __name__ == "__main__":
    main()
