"""A compiled Stan program, and every way in which CmdStan runs it.

cmdstanpy writes and reads the files of CmdStan and installs it. Its `CmdStanModel` does not run the
programs, for five reasons. An interrupt leaves CmdStan running. The signal that ended a program is
not told. CmdStan's `gamma` cannot be set. Draws other than a chain are refused. A single evaluation
takes eight times as long.
"""

import os
from collections.abc import Iterable, Iterator, Mapping, Sequence
from contextlib import closing, contextmanager, suppress
from dataclasses import dataclass
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd
from cmdstanpy import write_stan_json

from pyburgers.cmdstan.compilation import (
    compile_with,
    executable_path,
    recorded_recipe,
    shares_work,
)
from pyburgers.cmdstan.draw_files import Draws, read_draws, rows_of_draws
from pyburgers.cmdstan.installation import ensure_cmdstan
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import SamplingError
from pyburgers.common.processes import Running, cores, side_by_side, start
from pyburgers.common.scratch import scratch_folder

__all__ = [
    "ModeNotFound",
    "Program",
    "Unsolved",
    "compile_program",
    "executable_path",
    "load_program",
    "shares_work",
]

ALL_DIGITS = 17
"""Enough to read the same number back."""

DATA, POSITION, OUTPUT, TRACE = "data.json", "position.json", "output.csv", "trace.csv"
"""Files of one run."""


class Unsolved(SamplingError):  # noqa: N818 - an outcome, at some points
    """A program stopped at some of the points that it was given, but not at all."""


class ModeNotFound(Exception):  # noqa: N818 - an outcome with a reason, not an error
    """The optimiser failed; the message says how."""


def compile_program(program: Path, *, threads: bool = False) -> Path:
    """Return the executable of a Stan program; compile it unless it is in the cache.

    Only with `threads` can it run in several threads; without, it is a little faster. Raises
    ToolchainError if CmdStan cannot be had, the program is wrong or the compiler fails; the message
    ends with what stanc or the compiler said.
    """
    return compile_with(ensure_cmdstan(), program, threads=threads)


def load_program(source: Path, *, threads: int = 1) -> "Program":
    """Compile a Stan program, or take its executable from the cache.

    Files that the program includes are found beside it, then among the Stan files of the package.

    Parameters
    ----------
    source : Path
        File of the program.
    threads : int
        Threads that share the work of the program.

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
    return Program(compile_program(source, threads=threads > 1), threads)


@dataclass(frozen=True)
class Program:
    """A compiled Stan program, and the threads that share its work.

    It has more than one thread only if it is compiled for them. When one of its methods ends,
    however that comes, none of its processes is left.
    """

    executable: Path
    threads: int = 1

    @property
    def recipe(self) -> str:
        """Hash of the program, its compiler and its flags, wherever CmdStan lies."""
        return recorded_recipe(self.executable)

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
        return start(
            [
                *(str(self.executable), f"id={chain}", "random", f"seed={seed}"),
                *("data", f"file={data}", *([] if init is None else [f"init={init}"])),
                *("output", f"file={output}", *output_options),
                *([] if digits is None else [f"sig_figs={digits}"]),
                *method,
            ],
            output.with_suffix(".txt"),
            environment={**os.environ, "STAN_NUM_THREADS": str(self.threads)},
        )

    def evaluate(
        self,
        data: Mapping[str, object],
        position: Mapping[str, object] | None = None,
        *,
        seed: int = 1,
    ) -> dict[str, FloatArray]:
        """Return every variable of the program at a position of its parameters, if it has any.

        Raises SamplingError if the program stops with an error.
        """
        with _inputs(data, position) as folder:
            self._run(
                folder,
                ["method=sample", "num_samples=1", "algorithm=fixed_param"],
                seed=seed,
                failure="The forward solution failed at these parameters",
            )
            return read_draws([folder / OUTPUT]).at(0)

    def optimise(
        self, data: Mapping[str, object], position: Mapping[str, object], *, seed: int
    ) -> tuple[float, dict[str, FloatArray]]:
        """Climb from a position with L-BFGS; return log density and variables at the end.

        The end need not be a maximum. Raises SamplingError if the program stops with an error, as
        when the climb leaves the region with solutions.
        """
        with _inputs(data, position) as folder:
            method = ["method=optimize", "algorithm=lbfgs", "iter=5000"]
            # A line search that fails ends the climb where it is, often at the maximum.
            end = "Line search failed"
            self._run(folder, method, seed=seed, failure="The optimiser failed", tolerated=end)
            draws = read_draws([folder / OUTPUT])
            return float(draws["lp__"][0, 0]), draws.at(0)

    def ends(
        self, data: Mapping[str, object], starts: Iterable[Mapping[str, object]], *, seed: int
    ) -> list[tuple[float, dict[str, FloatArray]]]:
        """Climb from every start and return the ends as `optimise` does, the best first.

        Raises ModeNotFound if the optimiser fails from all starts.
        """
        found: list[tuple[float, dict[str, FloatArray]]] = []
        n_starts = 0
        for initial in starts:
            n_starts += 1
            # The optimiser may leave the region where the solver finds a solution.
            with suppress(SamplingError):
                found.append(self.optimise(data, initial, seed=seed))
        if not found:
            raise ModeNotFound(f"the optimiser failed from all {n_starts} starts")
        return sorted(found, key=lambda end: end[0], reverse=True)

    def gradients(
        self, data: Mapping[str, object], name: str, points: Sequence[FloatArray] | FloatArray
    ) -> FloatArray:
        """Return gradients of the log density, shape (n_points, n_coordinates), to six digits.

        The only parameter of the program is the unbounded vector `name`. Raises SamplingError if
        the log density is not finite at a point.
        """
        # CmdStan records the gradient of one step of vanishing length. Its method log_prob, which
        # takes points as they are, came later than `MINIMUM_VERSION`.
        method = [
            *("method=sample", "num_samples=1", "num_warmup=0", "algorithm=hmc", "engine=nuts"),
            *("max_depth=1", "stepsize=1e-14", "adapt", "engaged=0"),
        ]
        found = []
        with _inputs(data) as folder:
            for point in points:
                write_stan_json(str(folder / POSITION), {name: point})
                self._run(folder, method, seed=1, failure="There is no gradient here")
                # Of the potential, which is minus the log density.
                row = pd.read_csv(folder / TRACE, comment="#").iloc[0].filter(regex="^g_")
                found.append(-row.to_numpy(dtype=np.float64))
        return np.array(found)

    def generate(
        self,
        data: Mapping[str, object],
        files: Sequence[Path],
        *,
        seed: int,
        digits: int | None = None,
    ) -> Draws:
        """Compute generated quantities of the draws in files, a chain for each file.

        Files have seven columns ahead of the parameters. Raises Unsolved if the program stops at
        some of the draws, SamplingError if it stops with an error.
        """
        with _inputs(data) as folder:
            outputs = [folder / f"generated_{k}.csv" for k in range(len(files))]
            starting = (
                self.start(
                    ["method=generate_quantities", f"fitted_params={file}"],
                    data=folder / DATA,
                    output=output,
                    seed=seed,
                    chain=number,
                    digits=digits,
                )
                for number, (file, output) in enumerate(zip(files, outputs, strict=True), start=1)
            )
            with closing(side_by_side(starting, at_once=cores())) as looks:
                for _, ended in looks:
                    for one in ended:
                        one.require_not_killed()
                        if one.failed:
                            raise SamplingError(
                                f"Generated quantities failed: {one.console_tail()}"
                            )
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
                rows.to_csv(file, index=False, float_format=f"%.{ALL_DIGITS}g")
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

    def _run(
        self, folder: Path, method: Sequence[str], *, seed: int, failure: str, tolerated: str = ""
    ) -> None:
        """Run the program to its end in a folder of `_inputs`; raise what it came to otherwise."""
        running = self.start(
            method,
            data=folder / DATA,
            init=folder / POSITION,
            output=folder / OUTPUT,
            seed=seed,
            digits=ALL_DIGITS,
            output_options=[f"diagnostic_file={folder / TRACE}"],
        )
        running.wait()
        running.require_not_killed()
        if running.failed and not (tolerated and tolerated in running.printed()):
            raise SamplingError(f"{failure}: {running.console_tail()}")


@contextmanager
def _inputs(
    data: Mapping[str, object], position: Mapping[str, object] | None = None
) -> Iterator[Path]:
    """Write data and position for as long as the block runs; give their folder."""
    with scratch_folder() as folder:
        for file, content in ((DATA, data), (POSITION, position or {})):
            write_stan_json(str(folder / file), content)
        yield folder
