"""Compare densities with a Stan that is newer than the CmdStan at hand.

    pip download --no-deps --only-binary=:all: --python-version 3.13 httpstan
    unzip -d newer httpstan-*.whl
    python benchmarks/newer_stan.py newer/httpstan

The package holds Stan's headers, its compiler and the libraries that both need, but no CmdStan, so
that only what a program computes can be compared, not how it is run. Each program is compiled there
once; log densities at scattered points are compared with those of the CmdStan in use, gradients
with the six digits that it prints, and times of gradients with its own. What is solved in time is
solved at a tolerance of 1e-12, because the solvers differ between the versions.
"""

import argparse
import resource
import subprocess
import tempfile
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from gradients import coordinates, leapfrogs
from tables import ROOT, markdown

from pyburgers.cmdstan.program import Density, load_program
from pyburgers.common.array_types import FloatArray
from pyburgers.common.atomic_files import write_json
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.likelihood import likelihoods
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions, StanData
from pyburgers.model.priors import default_priors

TESTS = {
    "attenuation": "ice/attenuation_twin.toml",
    "loading_history": "dunite/dunite_4580.toml",
    "forced_oscillation": "olivine/olivine_twin.toml",
}
"""A test for each program, in data/; the curve is taken as a loading history."""

POINTS, SPREAD, SEED = 6, 0.3, 3
"""Points, normal about the centres of the priors with this standard deviation in coordinates."""

TIMED = 100
"""Gradients at each point whose time is taken, at the tolerance of a fit."""

LIBRARIES = ("sundials_cvodes", "sundials_idas", "sundials_kinsol", "sundials_nvecserial", "tbb")


def main(arguments: Sequence[str] | None = None) -> None:
    """Compile, compare, and print a table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("package", type=Path, help="the unpacked folder httpstan")
    parser.add_argument("--program", choices=TESTS, action="append", help="default: all")
    options = parser.parse_args(arguments)
    package = options.package.resolve()
    names = options.program or TESTS
    print(markdown(pd.DataFrame([_row(name, _compiled(name, package)) for name in names])))


def _compiled(name: str, package: Path) -> Path:
    """Compile a program with the newer Stan, if that has not been done."""
    executable = package / f"{name}_density"
    if not executable.exists():
        translated = package / f"{name}.hpp"
        stan = ROOT / "stan"
        (package / "stanc").chmod(0o755)
        subprocess.run(
            [
                *(package / "stanc", f"--include-paths={stan}", f"--o={translated}"),
                *(f"--name={name}_model", stan / f"{name}.stan"),
            ],
            check=True,
        )
        include = package / "include"
        subprocess.run(
            [
                *("g++", "-std=c++17", "-O3", "-w", "-D_REENTRANT", "-DBOOST_DISABLE_ASSERTS"),
                *("-D_GLIBCXX_USE_CXX11_ABI=0", f"-I{include}", "-x", "c++", "-include"),
                *(include / "stan_sundials_printf_override.hpp", "-include", translated),
                *(ROOT / "benchmarks" / "newer_stan.hpp", "-x", "none", "-o", executable),
                *(f"-L{package / 'lib'}", f"-Wl,-rpath,{package / 'lib'}"),
                *(f"-l{library}" for library in LIBRARIES),
            ],
            check=True,
        )
    return executable


def _row(name: str, executable: Path) -> dict[str, str]:
    """Compare one program."""
    experiment = load_experiment(ROOT / "data" / TESTS[name])
    if experiment.protocol != name:
        experiment = likelihoods()[experiment.protocol].as_history(experiment)
    priors = default_priors(experiment.material, experiment.protocol)
    problem = problem_of([experiment], priors)
    program = load_program(likelihoods()[name].program)
    precise = program_data(problem, solver=SolverOptions(tolerance=1e-12, max_num_steps=1_000_000))
    rng = np.random.default_rng(SEED)
    points = rng.normal(0.0, SPREAD, (POINTS, precise["n_coordinates"]))
    solved, drawn = program.generate_at(precise, "coordinate", points, digits=17)
    points, density = points[solved], drawn["log_density"].ravel()
    slopes = Density(program, precise).gradients(points)
    newer, _ = _newer(executable, precise, points, 1)
    data = program_data(problem, solver=SolverOptions())
    once, often = (_newer(executable, data, points, n)[1] for n in (1, TIMED + 1))
    with tempfile.TemporaryDirectory() as folder:
        data_file = Path(folder) / "data.json"
        write_json(data_file, data)
        old_once, old_often = (
            leapfrogs(program, data_file, coordinates(points), n)[1] for n in (1, TIMED + 1)
        )
    of_gradient = np.abs(newer[:, 1:] - slopes) / np.abs(slopes).max(axis=1, keepdims=True)
    return {
        "program": name,
        "points": str(len(points)),
        "difference of the density": f"{np.max(np.abs(newer[:, 0] / density - 1)):.1e}",
        "of the gradient": f"{of_gradient.max():.1e}",
        "time of a gradient, newer over old": f"{(often - once) / (old_often - old_once):.2f}",
    }


def _newer(
    executable: Path, data: StanData, points: FloatArray, gradients: int
) -> tuple[FloatArray, float]:
    """Return log density and gradient at points, and the processor time (s) that they took."""
    with tempfile.TemporaryDirectory() as folder:
        data_file, points_file = Path(folder) / "data.json", Path(folder) / "points.txt"
        write_json(data_file, data)
        np.savetxt(points_file, points, fmt="%.17g")
        before = _seconds()
        said = subprocess.run(
            [executable, data_file, points_file, str(gradients)],
            capture_output=True,
            text=True,
            check=True,
        ).stdout
        return np.loadtxt(said.splitlines(), ndmin=2), _seconds() - before


def _seconds() -> float:
    return resource.getrusage(resource.RUSAGE_CHILDREN).ru_utime


if __name__ == "__main__":
    main()
