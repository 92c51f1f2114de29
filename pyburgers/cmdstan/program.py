"""A compiled Stan program, every way in which CmdStan runs it, and the log density of its data.

cmdstanpy writes and reads the files of CmdStan and installs it. Its `CmdStanModel` does not run the
programs, for five reasons. An interrupt leaves CmdStan running. The signal that ended a program is
not told. CmdStan's `gamma` cannot be set. Draws other than a chain are refused. A single evaluation
takes eight times as long.
"""

import logging
import time
from collections.abc import Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pandas as pd
from cmdstanpy import write_stan_json

from pyburgers.cmdstan.compilation import compile_program, recorded
from pyburgers.cmdstan.draw_files import Draws, read_draws, rows_of_draws
from pyburgers.common.csv_tables import csv_text
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import SamplingError
from pyburgers.common.messages import PATIENCE
from pyburgers.common.paths import given_path
from pyburgers.common.processes import Running, cores, side_by_side, start
from pyburgers.common.scratch import scratch_folder

logger = logging.getLogger(__name__)

COORDINATE = "coordinate"
"""The one parameter of a program with a density, an unbounded vector."""

ALL_DIGITS = 17
"""Enough to read the same number back."""

DATA, POSITION, OUTPUT, TRACE = "data.json", "position.json", "output.csv", "trace.csv"
"""Files of one run."""

DIFFERENCE = 0.05
"""Step of the central differences; coordinates are O(1)."""

LARGEST_STEP = 4.0
"""In posterior standard deviations, beyond which differences are taken again with smaller steps."""

SMALL_STEP = 0.25
"""Of those, in standard deviations as the differences before have them."""

N_REFINEMENTS = 4
"""Each is worth a factor of ten or more in the width of the narrowest direction."""

LEAST_CURVATURE = 0.15
"""Floor of the eigenvalues: flat directions are about as wide as a logistic prior, sd 1.8-2.6."""

N_ITERATIONS = 5000
"""Of a climb at most. It is given up when so many gradients would have taken less time.

Where the log density jumps, Stan's line search halves a step without end. None is given up within
`PATIENCE`."""

LEAST_RATIO = 1e-12
"""Floor of the eigenvalues over the largest, where digits do not hold the scales of all."""


class Unsolved(SamplingError):  # noqa: N818 - an outcome, at some points
    """A program stopped at some of the points that it was given, but not at all."""


class ModeNotFound(Exception):  # noqa: N818 - an outcome with a reason, not an error
    """The optimiser failed; the message says how."""


def load_program(source: str | Path) -> "Program":
    """Compile a Stan program, or take its executable from the cache.

    Files that the program includes are found beside it, then among the Stan files of the package.

    Parameters
    ----------
    source : path
        File of the program.

    Returns
    -------
    Program
        Its `executable` is a path for cmdstanpy. `evaluate(data)` returns the generated quantities
        of a program without parameters, by name.

    Raises
    ------
    ToolchainError
        If CmdStan or a compiler is missing, or the program does not compile.

    Examples
    --------
    >>> _ = Path("one.stan").write_text("generated quantities { real one = 1; }")
    >>> float(pyburgers.load_program(Path("one.stan")).evaluate({})["one"])
    1.0
    """
    return Program(compile_program(given_path(source)))


@dataclass(frozen=True)
class Program:
    """A compiled Stan program: when a method ends, however that comes, no process is left."""

    executable: Path

    @property
    def recipe(self) -> str:
        """Hash of the program, its compiler and its flags, wherever CmdStan lies."""
        return recorded(self.executable).recipe

    @property
    def has_cpp(self) -> bool:
        """Whether the functions that have bodies in C++ are compiled from these."""
        return recorded(self.executable).has_cpp

    def start(
        self,
        method: Sequence[str],
        *,
        data: Path,
        output: Path,
        seed: int,
        init: Path | float | None = None,
        chain: int = 1,
        digits: int | None = None,
        output_options: Sequence[str] = (),
    ) -> Running:
        """Start CmdStan with its arguments of a method, ``method=...`` first.

        It starts at the parameters in the JSON file `init`, or within that half width of zero. Its
        console goes beside `output`, with the ending ``.txt``. `seed` and `chain` decide its random
        numbers.
        """
        arguments = [
            *(str(self.executable), f"id={chain}", "random", f"seed={seed}"),
            *("data", f"file={data}", *([] if init is None else [f"init={init}"])),
            *("output", f"file={output}", *output_options),
            *([] if digits is None else [f"sig_figs={digits}"]),
        ]
        return start([*arguments, *method], output.with_suffix(".txt"))

    def evaluate(
        self,
        data: Mapping[str, object],
        position: Mapping[str, object] | None = None,
        *,
        seed: int = 1,
    ) -> dict[str, FloatArray]:
        """Return every variable of the program at a position of its parameters, if it has any."""
        with _inputs(data, position) as folder:
            method = ["method=sample", "num_samples=1", "algorithm=fixed_param"]
            failure = "The forward solution failed at these parameters"
            self.run(folder, method, seed=seed, failure=failure)
            return read_draws([folder / OUTPUT]).at(0)

    def generate(
        self,
        data: Mapping[str, object],
        files: Sequence[Path],
        *,
        seed: int,
        digits: int | None = None,
    ) -> Draws:
        """Compute generated quantities of the draws in files, a chain for each file.

        Files have seven columns ahead of the parameters.
        """
        with _inputs(data) as folder:
            outputs = [folder / f"generated_{k}.csv" for k in range(len(files))]
            everywhere: dict[str, Any] = {"data": folder / DATA, "seed": seed, "digits": digits}

            def starting() -> Iterator[Running]:
                for number, (file, output) in enumerate(zip(files, outputs, strict=True), start=1):
                    method = ["method=generate_quantities", f"fitted_params={file}"]
                    yield self.start(method, output=output, chain=number, **everywhere)

            with closing(side_by_side(starting(), at_once=cores())) as looks:
                for _, ended in looks:
                    for one in ended:
                        one.require_not_killed()
                        if one.failed:
                            why = one.console_tail()
                            raise SamplingError(f"Generated quantities failed: {why}")
            if [rows_of_draws(file) for file in outputs] != [rows_of_draws(file) for file in files]:
                raise Unsolved("The program has no solution at some of the draws.")
            return read_draws(outputs)

    def generate_at(
        self,
        data: Mapping[str, object],
        name: str,
        points: FloatArray,
        digits: int | None = None,
        seed: int = 1,
    ) -> tuple[npt.NDArray[np.bool_], Draws]:
        """Compute generated quantities at points, shape (n_points, n_coordinates), of one vector.

        Returns which points the program has solved, and the draws of those, as one chain in their
        order. If it has solved none, the draws have no variables.
        """
        names = [
            *(f"sampler{k}__" for k in range(7)),
            *(f"{name}.{k + 1}" for k in range(points.shape[1])),
        ]
        parts: list[Draws] = []
        solved, waiting = np.zeros(len(points), dtype=bool), [np.arange(len(points))]
        while waiting:
            some = waiting.pop()
            rows = pd.DataFrame(np.pad(points[some], ((0, 0), (7, 0))), columns=names)
            with scratch_folder() as folder:
                file = folder / "points.csv"
                text = csv_text(rows, float_format=f"%.{ALL_DIGITS}g")
                file.write_text(text, encoding="utf-8")
                try:
                    part = self.generate(data, [file], seed=seed + len(parts), digits=digits)
                except Unsolved:  # at which of them is not said: halves, until one is alone
                    waiting += np.array_split(some, 2)[::-1] if some.size > 1 else []
                else:
                    parts.append(part)
                    solved[some] = True
        if not parts:
            return solved, Draws({}, np.empty((1, 0, 0)))
        values = np.concatenate([part.values for part in parts], axis=1)
        return solved, Draws(parts[0].variables, values)

    def run(
        self,
        folder: Path,
        method: Sequence[str],
        *,
        seed: int,
        failure: str,
        tolerated: str = "",
        limit: float | None = None,
    ) -> None:
        """Run the program in a folder of `_inputs`; raise SamplingError if it fails.

        `limit`: seconds after which it is ended and has failed.
        """
        running = self.start(
            method,
            data=folder / DATA,
            init=folder / POSITION,
            output=folder / OUTPUT,
            seed=seed,
            digits=ALL_DIGITS,
            output_options=[f"diagnostic_file={folder / TRACE}"],
        )
        running.wait(limit)
        running.require_not_killed()
        if running.failed and not (tolerated and tolerated in running.printed()):
            raise SamplingError(f"{failure}: {running.console_tail()}")


@dataclass(frozen=True, eq=False)
class Ending:
    """Where a climb has ended: log density, place, (n_coordinates,), and all variables there."""

    log_density: float
    place: FloatArray
    variables: Mapping[str, FloatArray]


@dataclass(frozen=True)
class Density:
    """Log density of a program with its data, at points of its parameter `COORDINATE`.

    A place has the shape (n_coordinates,), points have (n_points, n_coordinates).
    """

    program: Program
    data: Mapping[str, Any]

    def with_data(self, changes: Mapping[str, object]) -> "Density":
        """Return the density with other entries of the data."""
        return replace(self, data={**self.data, **changes})

    def variables_at(self, place: FloatArray) -> dict[str, FloatArray]:
        """Return every variable at a place; raise SamplingError where there is no solution."""
        return self.program.evaluate(self.data, {COORDINATE: place.tolist()})

    def generated_at(self, points: FloatArray) -> tuple[npt.NDArray[np.bool_], Draws]:
        """Return which points are solved, and the variables there (`Program.generate_at`)."""
        return self.program.generate_at(self.data, COORDINATE, points, ALL_DIGITS)

    def at(self, points: FloatArray) -> FloatArray:
        """Return the log density, (n_points,), minus infinity where there is no solution."""
        solved, drawn = self.generated_at(points)
        found = np.full(len(points), -np.inf)
        if solved.any():
            found[solved] = drawn["log_density"][0]
        return np.where(np.isnan(found), -np.inf, found)

    def gradients(self, points: FloatArray) -> FloatArray:
        """Return gradients, (n_points, n_coordinates), to six digits."""
        # CmdStan records the gradient of one step of vanishing length. Its method log_prob, which
        # takes points as they are, came later than `MINIMUM_VERSION`.
        method = [
            *("method=sample", "num_samples=1", "num_warmup=0", "algorithm=hmc", "engine=nuts"),
            *("max_depth=1", "stepsize=1e-14", "adapt", "engaged=0"),
        ]
        found = []
        with _inputs(self.data) as folder:
            for point in points:
                write_stan_json(str(folder / POSITION), {COORDINATE: point})
                self.program.run(folder, method, seed=1, failure="There is no gradient here")
                trace = pd.read_csv(folder / TRACE, comment="#", encoding_errors="replace")
                row = trace.iloc[0].filter(regex="^g_")
                # Of the potential, which is minus the log density.
                found.append(-row.to_numpy(dtype=np.float64))
        return np.array(found)

    def curvature(self, centre: FloatArray, steps: FloatArray | None = None) -> FloatArray:
        """Return the symmetric Hessian of minus the log density, by differences of gradients.

        The columns of `steps`, (n_coordinates, n_coordinates), are the steps of the central
        differences; by default `DIFFERENCE` along each coordinate.
        """
        if steps is None:
            steps = DIFFERENCE * np.eye(centre.size)
        after, before = (self.gradients(centre + shift) for shift in (steps.T, -steps.T))
        hessian = -np.linalg.solve(2 * steps.T, after - before)
        symmetric: FloatArray = (hessian + hessian.T) / 2
        return symmetric

    def laplace(self, mode: FloatArray) -> FloatArray:
        """Return the covariance of the Laplace approximation at a mode, a square matrix.

        It is the inverse of the Hessian of minus the log density, whose eigenvalues are kept above
        `LEAST_CURVATURE`, and above `LEAST_RATIO` of the largest if its digits have no root else.
        """
        steps: FloatArray = DIFFERENCE * np.eye(mode.size)
        for _ in range(1 + N_REFINEMENTS):
            curvature, axes = np.linalg.eigh(self.curvature(mode, steps))
            curvature = np.maximum(curvature, LEAST_CURVATURE)
            covariance: FloatArray = (axes / curvature) @ axes.T
            try:
                widths = np.linalg.cholesky(covariance)
            except np.linalg.LinAlgError:
                covariance = (axes / np.maximum(curvature, LEAST_RATIO * curvature.max())) @ axes.T
                widths = np.linalg.cholesky(covariance)
            if np.linalg.norm(np.linalg.solve(widths, steps), axis=0).max() <= LARGEST_STEP:
                break
            steps = np.asarray(SMALL_STEP * widths, dtype=np.float64)
        return covariance

    def expected_rise(self, place: FloatArray, covariance: FloatArray) -> float:
        """Return the rise from a place to the mode of its quadratic approximation there."""
        (gradient,) = self.gradients(place[np.newaxis])
        return float(gradient @ covariance @ gradient) / 2

    def climb(self, start: FloatArray, *, seed: int, limit: float | None = None) -> Ending:
        """Climb from a place with L-BFGS, at most `limit` s; the end need not be a maximum."""
        with _inputs(self.data, {COORDINATE: start.tolist()}) as folder:
            self.program.run(
                folder,
                ["method=optimize", "algorithm=lbfgs", f"iter={N_ITERATIONS}"],
                seed=seed,
                failure="The optimiser failed",
                # It ends the climb where it is, often at the maximum.
                tolerated="Line search failed",
                limit=limit,
            )
            draws = read_draws([folder / OUTPUT])
            variables = draws.at(0)
            place = np.atleast_1d(variables[COORDINATE])
            return Ending(float(draws["lp__"][0, 0]), place, variables)

    def ends(self, starts: Sequence[FloatArray], *, seed: int) -> list[Ending]:
        """Climb from every start and return the ends, the best first; tell how far it has come."""
        found: list[Ending] = []
        began = time.monotonic()
        with suppress(SamplingError):
            self.gradients(np.array(starts[:1]))
        told = time.monotonic()
        limit = max(PATIENCE, N_ITERATIONS * (told - began))
        for number, place in enumerate(starts, start=1):
            # The optimiser may leave the region where the solver finds a solution.
            with suppress(SamplingError):
                found.append(self.climb(place, seed=seed, limit=limit))
            if time.monotonic() - told >= PATIENCE and number < len(starts):
                told = time.monotonic()
                logger.info(f"{number} of {len(starts)} climbs to the mode are done.")
        if not found:
            raise ModeNotFound(f"the optimiser failed from all {len(starts)} starts")
        return sorted(found, key=lambda end: end.log_density, reverse=True)


@contextmanager
def _inputs(
    data: Mapping[str, object], position: Mapping[str, object] | None = None
) -> Iterator[Path]:
    """Write data and position for as long as the block runs; give their folder."""
    with scratch_folder() as folder:
        for file, content in ((DATA, data), (POSITION, position or {})):
            write_stan_json(str(folder / file), content)
        yield folder
