"""Several fits at the same time, so that no core waits for the last chain of a fit."""

import logging
import sys
import tempfile
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path

from pyburgers.common.messages import messages_to
from pyburgers.common.processes import completed, cores, number_of_processes
from pyburgers.fitting.fit import Fit, fit
from pyburgers.model.priors import PriorSet, load_priors, save_priors
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.protocol import load_experiment, save_experiment
from pyburgers.sampling.options import SamplerOptions

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Task:
    """What one fit is of.

    Attributes
    ----------
    experiments : tuple of Experiment
        Tests with data; several are fitted together.
    priors : PriorSet
        Priors of every parameter.
    options : SamplerOptions
        Chains, iterations, seed; how many chains run side by side is set here.
    pool : mapping of str to str
        How parameters of several tests are pooled where it is not the default.
    """

    experiments: tuple[Experiment, ...]
    priors: PriorSet
    options: SamplerOptions
    pool: Mapping[str, str] = field(default_factory=dict)


def fit_side_by_side(
    tasks: Mapping[str, Task], folder: Path, *, jobs: int | None = None, command: str
) -> dict[str, Fit]:
    """Do several fits, each in a process of its own; continue where a call stopped.

    What the fits themselves say goes to standard error, a line each with the name of the fit
    before it.

    Parameters
    ----------
    tasks : mapping of str to Task
        By name, begun in this order: those that take longest should come first.
    folder : Path
        Of the run directories, ``folder/NAME``.
    jobs : int, optional
        Fits at the same time; default one for each core. Cores that are left over run chains.
    command : str
        What regenerates the runs, for their manifests.

    Returns
    -------
    dict of str to Fit
        In the order of `tasks`.

    Raises
    ------
    InputError
        If an input is wrong or a run directory holds something else.
    SamplingError
        If no chain of a fit finished, or the system killed a process.
    """
    processes = number_of_processes(jobs, len(tasks))
    chains_each = max(1, cores() // processes)
    with tempfile.TemporaryDirectory(prefix="pyburgers-") as scratch:
        calls = {}
        for name, task in tasks.items():
            # What a task holds cannot travel between processes, its files can.
            inputs = Path(scratch) / name
            inputs.mkdir()
            priors_file = inputs / "priors.toml"
            save_priors(task.priors, priors_file)
            options = replace(task.options, parallel_chains=chains_each)
            files = []
            for one in task.experiments:
                (inputs / one.id).mkdir()
                files.append(save_experiment(one, inputs / one.id))
            pool = dict(task.pool)
            calls[name] = (name, files, priors_file, pool, folder / name, options, command)
        done = completed(_fit_files, calls, processes=processes, folder=folder)
        for n_done, (name, _) in enumerate(done, start=1):
            logger.info(f"Fit {name} is done, {n_done} of {len(tasks)}.")
    return {name: Fit.load(folder / name) for name in tasks}


def _fit_files(
    name: str,
    experiment_files: Sequence[Path],
    priors_file: Path,
    pool: Mapping[str, str],
    out: Path,
    options: SamplerOptions,
    command: str,
) -> None:
    """Fit what two files hold, in a process of its own."""
    with messages_to(sys.stderr, name):
        fit(
            [load_experiment(file) for file in experiment_files],
            load_priors(priors_file),
            pool=pool,
            out=out,
            options=options,
            command=command,
        )
