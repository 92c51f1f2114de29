"""Time a gradient with the fast solver and with `ode_bdf`.

    python benchmarks/solvers.py           # some minutes

A short fit of each test sets up its coordinates and gives draws. At these, gradients of all tests
are timed with both solvers in turn. Writes a table.
"""

import argparse
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from pathlib import Path

import pandas as pd
from first_go import data_set
from gradients import Position, coordinates, ms_per_gradient
from tables import ICE, RESULTS, ROOT, markdown

from pyburgers import SamplerOptions, load_experiment
from pyburgers.cmdstan.draw_files import read_draws
from pyburgers.cmdstan.program import Program, load_program
from pyburgers.common.atomic_files import write_json
from pyburgers.fitting.fit import fit_problem
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.stan_data import SOLVERS
from pyburgers.model.priors import default_priors
from pyburgers.sampling.run_directory import RunDirectory

FILES: Mapping[str, Path] = {
    "PIL40, one rate": ICE / "PIL40.toml",
    "dunite 4581, three rates": ROOT / "data" / "dunite" / "dunite_4581.toml",
    "creep of salt under a force": ROOT / "data" / "halite" / "halite_z3.toml",
}
SIMULATED: Mapping[str, str] = {
    "creep of ice": "creep",
    "relaxation of ice": "relaxation",
    "load and unload of ice": "load_unload",
    "three stages of ice": "three_stages",
    "oscillation of olivine, background kept": "oscillation_kept",
    "the same, background removed": "oscillation_removed",
}
"""Kinds of `first_go`, whose first data sets are taken."""

SHORT_FIT = SamplerOptions(chains=1, warmup=60, draws=16, max_treedepth=6, seed=1)
POINTS, TIMED, ROUNDS = 8, 100, 7
"""Draws at which gradients are timed, how many at each, and how often in turn."""

PAGE = """# Gradients with both solvers

Written by `benchmarks/solvers.py`; do not edit. Milliseconds of one core for a whole gradient: the
median of {rounds} rounds, least and largest in brackets. A round times {timed} gradients at each of
{points} draws of a short fit. Ratios of rounds are less uncertain than times: tests and solvers
take turns. Salt and dunite are measured, ice is synthetic.

{table}
"""


@dataclass(frozen=True)
class Timed:
    """A fitted test: readings, program, data for each solver, and draws."""

    readings: int
    program: Program
    data: Mapping[str, Path]
    positions: Sequence[Position]


def main() -> None:
    """Fit, measure, and write the table."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, default=RESULTS)
    out: Path = parser.parse_args().out
    out.mkdir(parents=True, exist_ok=True)
    problems = {name: _problem(file) for name, file in FILES.items()}
    problems |= {name: data_set(kind, 0) for name, kind in SIMULATED.items()}
    with tempfile.TemporaryDirectory() as folder:
        timed = {name: _fitted(one, Path(folder) / name) for name, one in problems.items()}
        rounds = [
            {
                (name, solver): ms_per_gradient(one.program, data, one.positions, TIMED)[1]
                for name, one in timed.items()
                for solver, data in one.data.items()
            }
            for _ in range(ROUNDS)
        ]
    table = markdown(_table(pd.DataFrame(rounds), timed))
    print(table)
    page = PAGE.format(rounds=ROUNDS, timed=TIMED, points=POINTS, table=table)
    (out / "solvers.md").write_text(page, encoding="utf-8")


def _problem(file: Path) -> Problem:
    """Return the default fit of a file."""
    test = load_experiment(file)
    return problem_of([test], default_priors(test.material, test.protocol))


def _fitted(problem: Problem, out: Path) -> Timed:
    """Fit a test for a short while."""
    fit_problem(problem, out=out, options=SHORT_FIT, command="benchmarks/solvers.py")
    run = RunDirectory(out)
    draws = read_draws([run.draws_file(1)])["coordinate"][0]
    points = draws[:: max(1, len(draws) // POINTS)][:POINTS]
    data = {solver: out / f"{solver}.json" for solver in SOLVERS}
    for number, file in enumerate(data.values()):
        write_json(file, {**run.read_stan_data(), "solver": number})
    (test,) = problem.experiments
    program = load_program(likelihood_of(test).program)
    return Timed(test.n_points, program, data, coordinates(points))


def _table(taken: pd.DataFrame, timed: Mapping[str, Timed]) -> pd.DataFrame:
    """Return times of a gradient (ms) and ratios: median and range of the rounds."""

    def spread(values: "pd.Series[float]") -> str:
        return f"{values.median():.2g} ({values.min():.2g} to {values.max():.2g})"

    rows = []
    for name, one in timed.items():
        slow, fast = (taken[name, solver] for solver in SOLVERS)
        rows.append(
            {
                "test": name,
                "readings": str(one.readings),
                "`--solver bdf` (ms)": spread(slow),
                "fast (ms)": spread(fast),
                "times as fast": spread(slow / fast),
            }
        )
    return pd.DataFrame(rows)


if __name__ == "__main__":
    main()
