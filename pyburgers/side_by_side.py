"""Several fits at the same time, so that no core waits for the last chain of a fit."""

import io
import sys
import tempfile
from collections.abc import Callable, Mapping
from contextlib import redirect_stderr
from dataclasses import dataclass, replace
from pathlib import Path
from typing import TextIO

from pyburgers.experiment import Experiment
from pyburgers.experiment_files import load_experiment, save_experiment
from pyburgers.fitting import Fit, fit
from pyburgers.priors import PriorSet, load_priors, save_priors
from pyburgers.processes import completed, number_of_processes
from pyburgers.sampler_options import SamplerOptions
from pyburgers.toolchain import cores


@dataclass(frozen=True, eq=False)
class Problem:
    """What one fit is of.

    Attributes
    ----------
    experiment : Experiment
        A test with data.
    priors : PriorSet
        Priors of every parameter.
    options : SamplerOptions
        Chains, iterations, seed; how many chains run side by side is set here.
    """

    experiment: Experiment
    priors: PriorSet
    options: SamplerOptions


def fit_side_by_side(
    problems: Mapping[str, Problem],
    folder: Path,
    *,
    jobs: int | None = None,
    command: str,
    report: Callable[[str], None],
) -> dict[str, Fit]:
    """Fit several experiments, each in a process of its own; continue where a call stopped.

    Parameters
    ----------
    problems : mapping of str to Problem
        By name, begun in this order: those that take longest should come first.
    folder : Path
        Of the run directories, ``folder/NAME``.
    jobs : int, optional
        Fits at the same time; default one for each core. Cores that are left over run chains.
    command : str
        What regenerates the runs, for their manifests.
    report : callable
        Receives a sentence for each finished fit. What the fits themselves say goes to standard
        error, a line each with the name of the fit before it.

    Returns
    -------
    dict of str to Fit
        In the order of `problems`.

    Raises
    ------
    InputError
        If an input is wrong or a run directory holds something else.
    SamplingError
        If no chain of a fit finished, or the system killed a process.
    """
    processes = number_of_processes(jobs, len(problems))
    chains_each = max(1, cores() // processes)
    with tempfile.TemporaryDirectory(prefix="pyburgers-") as scratch:
        calls = {}
        for name, problem in problems.items():
            # What a problem holds cannot travel between processes, its files can.
            inputs = Path(scratch) / name
            inputs.mkdir()
            priors_file = inputs / "priors.toml"
            save_priors(problem.priors, priors_file)
            options = replace(problem.options, parallel_chains=chains_each)
            experiment_file = save_experiment(problem.experiment, inputs)
            calls[name] = (name, experiment_file, priors_file, folder / name, options, command)
        done = completed(_fit_files, calls, processes=processes, folder=folder)
        for n_done, (name, _) in enumerate(done, start=1):
            report(f"Fit {name} is done, {n_done} of {len(problems)}.")
    return {name: Fit.load(folder / name) for name in problems}


def _fit_files(
    name: str,
    experiment_file: Path,
    priors_file: Path,
    out: Path,
    options: SamplerOptions,
    command: str,
) -> None:
    """Fit what two files hold, in a process of its own."""
    with redirect_stderr(NamedLines(name, sys.stderr)) as lines:
        fit(
            load_experiment(experiment_file),
            load_priors(priors_file),
            out=out,
            options=options,
            command=command,
            report=lambda sentence: print(sentence, file=lines),
        )


class NamedLines(io.TextIOBase):
    """A text stream that passes on whole lines with a name before each.

    Parameters
    ----------
    name : str
        Who speaks.
    stream : file object
        Where the lines go.
    """

    def __init__(self, name: str, stream: TextIO) -> None:
        super().__init__()
        self._name = name
        self._stream = stream
        self._begun = ""

    def writable(self) -> bool:
        """Tell that the stream takes text."""
        return True

    def write(self, text: str) -> int:
        """Take a piece of text; what does not end a line waits for the rest."""
        *lines, self._begun = (self._begun + text).split("\n")
        for line in lines:
            # In one piece, so that lines of several processes do not mix.
            self._stream.write(f"{self._name}: {line}\n")
            self._stream.flush()
        return len(text)
