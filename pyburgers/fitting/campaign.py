"""Many fits, each in its own folder by one process on any machine; campaigns of a plan.

A campaign has a fit of every combination of tests, laws, priors and seeds. Its folder holds
``runs/NAME/``, the run directory of each fit, ``status.csv`` and ``report/``. The status of a fit
is read from its run directory alone. So any number of processes, on any machines, can work on the
same campaign.
"""

import logging
import os
import sys
from collections import Counter
from collections.abc import Callable, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import pandas as pd
from pydantic import Field

from pyburgers.checks.fit_checks import CheckKind
from pyburgers.common.errors import InputError, PyburgersError, one_or_several, require_type
from pyburgers.common.messages import messages_to
from pyburgers.common.paths import given_path
from pyburgers.common.processes import cores
from pyburgers.common.scratch import scratch_folder
from pyburgers.common.tasks import ALL_HERE, Workers, run_tasks
from pyburgers.common.toml_files import NAME, Table, read_json, read_toml
from pyburgers.fitting.fit import Fit, fit_problem
from pyburgers.fitting.problem_run import problem_record, recorded_problem, settled_options
from pyburgers.fitting.run_inputs import input_texts, write_inputs
from pyburgers.kinds.conditions import tell_doubts
from pyburgers.kinds.experiment import A_TEST, Experiment
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.problem import Problem, of_one_program, problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import REFERENCE_SOLVER, SolverOptions
from pyburgers.kinds.together import pooling_for, priors_for
from pyburgers.model.priors import SOME_PRIORS, PriorSet
from pyburgers.model.variants import with_variant
from pyburgers.sampling.manifest import COMPLETE, FitManifest
from pyburgers.sampling.options import SOME_OPTIONS, SamplerOptions, options_table, recorded_options
from pyburgers.sampling.run import fingerprint
from pyburgers.sampling.run_directory import RunDirectory

logger = logging.getLogger(__name__)


@dataclass(frozen=True, eq=False)
class Task:
    """One fit of several.

    Attributes
    ----------
    problem : Problem
        Tests, priors, pooling.
    options : SamplerOptions
        Chains, iterations, seed. On this machine, how many chains run side by side is set by how
        many fits do.
    solver : SolverOptions or None
        None takes that of the protocol.
    remark : str
        Text behind the command in the run's manifest.

    Examples
    --------
    >>> task = pyburgers.task_of([test], priors, options)
    >>> task.options.chains
    2
    """

    problem: Problem
    options: SamplerOptions
    solver: SolverOptions | None = None
    remark: str = ""


def task_of(
    experiments: Experiment | Sequence[Experiment],
    priors: PriorSet,
    options: SamplerOptions,
    pool: Mapping[str, str] | None = None,
) -> Task:
    """Return the task of a fit of one test, or of several together.

    Parameters
    ----------
    experiments, priors, options, pool
        As for `pyburgers.fit`.

    Returns
    -------
    Task
        For `fit_side_by_side`.

    Raises
    ------
    InputError
        If an input is wrong.

    Examples
    --------
    >>> task = pyburgers.task_of(test, priors, options)
    """
    tests = one_or_several("experiments", experiments, Experiment, A_TEST)
    require_type("priors", priors, PriorSet, SOME_PRIORS)
    require_type("options", options, SamplerOptions, SOME_OPTIONS)
    tell_doubts((priors, tests))
    return Task(problem_of(tests, priors, pooling_for(tests, pool)), options)


def run_fits(
    tasks: Mapping[Path, Task],
    *,
    workers: Workers = ALL_HERE,
    command: str,
    keep_going: bool = False,
    after: Callable[[Path], None] = lambda _: None,
) -> dict[Path, PyburgersError]:
    """Do several fits, each in a process of its own; continue where a call stopped.

    The fits begin in the order of their run directories in `tasks`, so those that take longest
    should come first. Cores of this machine that are left over run chains. Messages of a fit go to
    standard error of its process, each line with the name of the fit before it. When a fit is done,
    `after` receives its run directory. If `keep_going`, fits that cannot be done are returned with
    their errors, and the others go on.
    """
    mine = workers.mine(tasks)
    if not mine:
        return {}
    above = os.path.commonpath([out.absolute().parent for out in mine])
    calls, processes = {}, workers.processes(len(mine))
    for number, (out, task) in enumerate(mine.items(), start=1):
        name = out.absolute().relative_to(above).as_posix()
        if workers.executor is None:
            # The last fit begins when another has ended, and soon has all cores to itself.
            beside = 1 if number == len(mine) > processes else processes
            chains = max(1, cores() // beside)
            task = replace(task, options=replace(task.options, parallel_chains=chains))
        # Elsewhere the working directory may be another one.
        calls[out] = (name, task, out.absolute(), command, keep_going)
    failed = {}
    with run_tasks(_do, calls, workers=workers, out=Path(above)) as done:
        for n_done, (out, error) in enumerate(done, start=1):
            how = "is done" if error is None else f"could not be done ({error})"
            logger.info(f"Fit {calls[out][0]} {how}, {n_done} of {len(mine)}.")
            if error is None:
                after(out)
            else:
                failed[out] = error
    return failed


def fit_side_by_side(
    tasks: Mapping[str, Task],
    folder: str | Path,
    *,
    workers: Workers = ALL_HERE,
    command: str,
    after: Callable[[str, Fit], None] = lambda _name, _fit: None,
) -> dict[str, Fit]:
    """Do several fits, each in a process of its own; continue where a call stopped.

    Parameters
    ----------
    tasks : mapping of str to Task
        Fits by name. They begin in this order, so those that take longest should come first.
    folder : path
        Folder of the run directories, each with the name of its fit.
    workers : Workers
        Processes or executor, and the part of the fits that this call does.
    command : str
        Command that repeats the fits, for their manifests.
    after : callable
        Receives the name of a fit and the fit when it is done.

    Returns
    -------
    dict of str to Fit
        Fits of this part, in their order.

    Raises
    ------
    InputError
        If an input is wrong or a run directory holds something else.
    SamplingError
        If no chain of a fit finished.
    SystemFailureError
        If the system killed a process.

    Examples
    --------
    >>> tasks = {"mine": pyburgers.task_of([test], priors, options)}
    >>> fits = pyburgers.fit_side_by_side(tasks, Path("runs"), command="python my_script.py")
    """
    names = {given_path(folder) / name: name for name in tasks}
    found: dict[str, Fit] = {}

    def keep(out: Path) -> None:
        name = names[out]
        found[name] = Fit.load(out)
        after(name, found[name])

    in_folders = {out: tasks[name] for out, name in names.items()}
    run_fits(in_folders, workers=workers, command=command, after=keep)
    return {name: found[name] for name in workers.mine(tasks)}


def _do(name: str, task: Task, out: Path, command: str, keep_going: bool) -> PyburgersError | None:
    """Do a fit, in a process of its own; its folder holds all that comes of it."""
    with messages_to(sys.stderr, name):
        try:
            fit_problem(
                task.problem,
                out=out,
                options=task.options,
                solver=task.solver,
                command=f"{command} {task.remark}".rstrip(),
                remedy="remove the folder, or choose another --out",
            )
        except PyburgersError as error:
            if not keep_going:
                raise
            return error
    return None


SHIPPED = "default"
"""Stands in a plan for the priors that come with the package."""

NOT_BEGUN, DAMAGED, OF_OTHERS = "not begun", "damaged", "of other inputs"
"""Status of runs that have no manifest, cannot be read, or are of other inputs than the plan's."""

LONGEST_NAME = 200
"""Letters of the name of a run, which is that of a folder."""

Name = Annotated[str, Field(pattern=NAME)]


if TYPE_CHECKING:
    SamplerTable = Table
else:
    SamplerTable = options_table(settled=False, without={"seed", "parallel_chains"})


class _PlanFile(Table):
    id: Name = Field(description="a name of letters, digits, '_', '.' and '-'")
    tests: dict[Name, Annotated[list[str], Field(min_length=1)]] = Field(
        min_length=1,
        description="a table that gives each test, or several to be fitted together, a name and a "
        "list of files",
    )
    variants: dict[Name, dict[str, str]] = Field(
        {"standard": {}},
        min_length=1,
        description="a table of tables: each variant by its name, with a law by part",
    )
    priors: dict[Name, str] = Field(
        {SHIPPED: SHIPPED}, min_length=1, description="a table of prior files by name"
    )
    pool: dict[str, str] = Field({}, description="how joint fits pool parameters")
    seeds: list[int] = Field([1], min_length=1, description="a list of whole numbers")
    sampler: SamplerTable = Field(SamplerTable(), description="settings of the sampler")


@dataclass(frozen=True)
class Combination:
    """Test, laws, priors and seed of one fit, by the names in the plan."""

    test: str
    variant: str
    priors: str
    seed: int

    @property
    def name(self) -> str:
        """Name of the run."""
        return f"{self.test}-{self.variant}-{self.priors}-seed{self.seed}"


@dataclass(frozen=True, eq=False)
class Campaign:
    """Every fit of a plan by its combination, tests outermost and seeds innermost."""

    id: str
    tasks: Mapping[Combination, Task]


def load_campaign(path: Path) -> Campaign:
    """Read a plan and everything that it names; nothing is fitted."""
    plan = read_toml(path, _PlanFile)
    settings = plan.sampler.model_dump(exclude_unset=True)
    tasks = {}
    for test, files in plan.tests.items():
        experiments = of_one_program([load_experiment(path.parent / file) for file in files])
        pool = plan.pool if len(experiments) > 1 else None
        for variant, laws in plan.variants.items():
            for name, file in plan.priors.items():
                source = None if file == SHIPPED else path.parent / file
                given = priors_for(experiments, source, laws)
                for seed in plan.seeds:
                    one = Combination(test, variant, name, seed)
                    try:
                        priors = with_variant(given, experiments[0], laws)
                        options = SamplerOptions(seed=seed, **settings)
                        pooling = pooling_for(experiments, pool)
                        tasks[one] = Task(problem_of(experiments, priors, pooling), options)
                    except InputError as error:
                        raise InputError(f"{path}: {one.name}: {error}") from error
    _check_names(path, [one.name for one in tasks])
    problems = (task.problem for task in tasks.values())
    tell_doubts(*((problem.given_priors, problem.experiments) for problem in problems))
    return Campaign(plan.id, tasks)


def _check_names(path: Path, names: list[str]) -> None:
    """Check that the names of runs can be those of different folders."""
    (most_common, number) = Counter(names).most_common(1)[0]
    if number > 1:
        raise InputError(
            f"{path}: {number} fits would have the name {most_common}, expected other names."
        )
    if len(longest := max(names, key=len)) > LONGEST_NAME:
        raise InputError(
            f"{path}: the name {longest} of a fit has {len(longest)} letters, expected at most "
            f"{LONGEST_NAME}: shorten the names in the plan."
        )


def run_campaign(
    campaign: Campaign, out: Path, *, workers: Workers = ALL_HERE, command: str
) -> dict[str, PyburgersError]:
    """Do the fits of a campaign, or a part of them; return why some failed, by names of runs."""
    tasks = {run_folder(out, one): task for one, task in campaign.tasks.items()}
    failed = run_fits(tasks, workers=workers, command=command, keep_going=True)
    return {folder.name: error for folder, error in failed.items()}


def status_table(campaign: Campaign, out: Path) -> pd.DataFrame:
    """Return how far each fit of a campaign is, by the name of its run, from its run directory.

    Verdicts (yes, no, cannot tell) are empty before a fit is complete. `chains` counts the finished
    chains of `of_chains`, none of a run of other inputs; `chain_seconds` is their wall time (s).
    """
    rows = {
        one.name: _status(run_folder(out, one), one, task) for one, task in campaign.tasks.items()
    }
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("run")


def _status(folder: Path, one: Combination, task: Task) -> dict[str, Any]:
    """Return the row of a fit."""
    run = RunDirectory(folder)
    status, chains, found = NOT_BEGUN, dict[str, Any](), dict[str, Any]()
    try:
        if run.manifest_file.is_file():
            manifest = run.read_manifest()
            status = manifest.get("status", NOT_BEGUN)
            if "experiments" in manifest and not _is_run_of(run, task.problem, task.options):
                status = OF_OTHERS
        if status != OF_OTHERS:
            chains = run.chain_records()
        if status == COMPLETE and run.checks_file.is_file():
            found = read_json(run.checks_file).get("verdicts", {})
    except (InputError, OSError) as error:
        logger.info(f"{one.name} is damaged: {error}")
        status = DAMAGED
    outcomes = {kind: found.get(kind.name.lower(), {}).get("outcome", "") for kind in CheckKind}
    return {
        **asdict(one),
        "status": status,
        "chains": len(chains),
        "of_chains": max([task.options.chains, *map(int, chains)]),
        "sampled_well": outcomes[CheckKind.SAMPLING],
        "describes_data": outcomes[CheckKind.DESCRIPTION],
        "chain_seconds": round(sum(record["wall_seconds"] for record in chains.values()), 1),
    }


def _is_run_of(run: RunDirectory, problem: Problem, options: SamplerOptions) -> bool:
    """Tell whether a run has the inputs of a fit, whatever compiler and solver it has."""
    settled = asdict(settled_options(problem, options))
    wanted = {**problem_record(problem), "sampler": settled, "use_likelihood": True}
    with scratch_folder() as folder:
        copy = RunDirectory(folder)
        write_inputs(copy, input_texts(problem.experiments, problem.given_priors))
        return _hash_of_inputs(copy, wanted) == _hash_of_inputs(run, run.read_manifest(FitManifest))


def _hash_of_inputs(run: RunDirectory, record: Mapping[str, Any]) -> str:
    """Return the `fingerprint` of a run, but for its program and solver."""
    problem, use_likelihood = recorded_problem(run, record), record["use_likelihood"]
    data = program_data(problem, solver=REFERENCE_SOLVER, use_likelihood=use_likelihood)
    return fingerprint(data, recorded_options(record["sampler"]), "")


def shown_status_table(table: pd.DataFrame) -> pd.DataFrame:
    """Return a table of `status_table` as text, for the terminal and the page."""
    chains = table["chains"].astype(str) + " of " + table["of_chains"].astype(str)
    columns = {
        "run": table.index,
        "status": table["status"],
        "chains": chains,
        "sampled well?": table["sampled_well"],
        "describes the data?": table["describes_data"],
        "chains took (s)": table["chain_seconds"].map("{:.0f}".format),
    }
    return pd.DataFrame(columns)


def run_folder(out: Path, one: Combination) -> Path:
    """Return the run directory of a fit."""
    return out / "runs" / one.name
