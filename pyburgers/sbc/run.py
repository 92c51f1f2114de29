"""Simulation-based calibration over processes: many data sets, each a small file, resumable.

The folder of a calibration holds ``manifest.json``, ``inputs/`` (templates and priors) and
``simulations/simulation_SEED.json``. The file of a data set is written when its fit is done; the
same command continues with those that are missing. Several calls may do a part of them each. Their
number is fixed with the first: nobody can stop, or go on, because of how the ranks look.
"""

import logging
import math
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

from pydantic import Field

from pyburgers.cmdstan.program import load_program
from pyburgers.common.atomic_files import sha256_of_json, write_json
from pyburgers.common.errors import InputError, SystemFailureError
from pyburgers.common.locks import process_lock
from pyburgers.common.tasks import ALL_HERE, Workers, run_tasks
from pyburgers.common.toml_files import Table, read_json_table
from pyburgers.common.units import UNITS
from pyburgers.fitting.problem_run import problem_record, recorded_problem, settled_options
from pyburgers.fitting.run_inputs import input_texts, write_inputs
from pyburgers.kinds.conditions import tell_doubts
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.kinds.together import pooling_for
from pyburgers.model.priors import PriorSet
from pyburgers.sampling.manifest import COMPLETE, PoolingRecord, RecordedHashes, SamplerRecord
from pyburgers.sampling.options import INDECISIVE, recorded_options
from pyburgers.sampling.run import decisive, files_in, made_now_by, origin_record
from pyburgers.sampling.run_directory import RunDirectory
from pyburgers.sbc.data_sets import DataSetPlan, check_template, replicate
from pyburgers.sbc.rank_uniformity import RankBands, RankVerdict, judge_ranks, rank_bands
from pyburgers.sbc.replication import (
    SIMULATIONS,
    Replication,
    replications,
    scratch_of,
    simulation_file,
    take_from_table,
)

logger = logging.getLogger(__name__)

CALIBRATION_KIND = "pyburgers sbc"
"""The kind of run in the manifest of a calibration."""

SYSTEM_ATTEMPTS = 3
"""Tries of a data set whose chains the system ends, after which the calibration stops."""


@dataclass(frozen=True)
class CalibrationPlan(DataSetPlan):
    """The data sets of a calibration; their number is fixed with the first one, of this seed."""

    simulations: int = 200
    seed: int = 1

    def __post_init__(self) -> None:
        """Refuse values out of range."""
        draws = self.sampler.chains * self.sampler.draws
        for name, value, least, most in (
            ("simulations", self.simulations, 1, 10**6),
            ("seed", self.seed, 0, 2**31 - 1 - self.simulations),
            ("ranked_draws", self.n_ranked, 3, draws),
            ("refits", self.refits, 0, 5),
        ):
            if not least <= value <= most:
                raise InputError(f"{name} is {value}, expected a number from {least} to {most}.")
        for name, limits, factor, unit in (
            ("stress_range", self.stress_range, UNITS["stress"]["MPa"], "MPa"),
            ("strain_range", self.strain_range, UNITS["strain"]["percent"], "%"),
        ):
            low, high = limits or (0.0, math.inf)
            if not 0 <= low < high:
                raise InputError(
                    f"{name} is {low / factor:g} to {high / factor:g} {unit}, expected two "
                    "numbers, not negative, of which the second is larger."
                )

    @property
    def seeds(self) -> range:
        """Seed of each data set."""
        return range(self.seed, self.seed + self.simulations)


class _PlanTable(Table):
    """A settled `CalibrationPlan` in a manifest."""

    simulations: int
    seed: int
    n_ranked: int
    sampler: SamplerRecord
    refits: int
    stress_range: list[float] | None = Field(min_length=2, max_length=2)
    strain_range: list[float] | None = Field(default=None, min_length=2, max_length=2)


class _CalibrationManifest(RecordedHashes):
    experiments: list[str] = Field(min_length=1, description="names of the templates")
    pooling: PoolingRecord
    plan: _PlanTable
    command: str


@dataclass(frozen=True, eq=False)
class Calibration:
    """A calibration, as far as it has come, with templates, priors of truths, and the command."""

    template: Problem
    plan: CalibrationPlan
    replications: tuple[Replication, ...]
    command: str

    @cached_property
    def ranked(self) -> tuple[Replication, ...]:
        """Data sets with a fit that has converged."""
        return tuple(one for one in self.replications if one.ranks)

    @cached_property
    def ranks(self) -> dict[str, list[int]]:
        """Ranks of each quantity over the data sets that are ranked."""
        names = self.ranked[0].ranks if self.ranked else ()
        return {name: [one.ranks[name] for one in self.ranked] for name in names}

    @cached_property
    def bands(self) -> RankBands:
        """Bands for the distributions of the ranks."""
        return rank_bands(len(self.ranked), self.plan.n_ranked, max(1, len(self.ranks)))

    @cached_property
    def verdicts(self) -> Mapping[str, RankVerdict]:
        """Verdict on each quantity."""
        return judge_ranks(self.ranks, self.bands)

    @property
    def passed(self) -> bool:
        """Whether data sets are enough to tell, and no quantity is found not to be calibrated."""
        found = {verdict.verdict for verdict in self.verdicts.values()}
        return bool(found) and found <= {"calibrated", "within chance"}


def calibrate(
    templates: Experiment | Sequence[Experiment],
    priors: PriorSet,
    *,
    out: Path,
    plan: CalibrationPlan,
    pool: Mapping[str, str] | None = None,
    workers: Workers = ALL_HERE,
    command: str = "pyburgers.sbc.run.calibrate(...)",
) -> Calibration:
    """Simulate data sets from the prior, fit each, and rank the truths; continue where one stopped.

    Stresses of the templates serve to resolve a relative noise prior. If the plan has more
    repetitions than before, only these are added.
    """
    tests = [templates] if isinstance(templates, Experiment) else list(templates)
    problem = problem_of(tests, priors, pooling_for(tests, pool))
    check_template(problem, plan.strain_range)
    tell_doubts((priors, tests))
    sampler = replace(settled_options(problem, plan.sampler), parallel_chains=1)
    plan = replace(plan, sampler=sampler)
    identity = _fingerprint(problem, plan, load_program(problem.likelihood.program).recipe)
    run = RunDirectory(out)
    _refuse_fewer_repetitions(run, plan)
    folders = ("inputs", SIMULATIONS)
    if workers.part is None:
        with run.claimed(identity, folders):
            _write_inputs(run, problem, plan, command)
            take_from_table(run, plan.seeds, plan.n_ranked)
            _run_missing(run, plan, workers)
            run.update_manifest({"status": COMPLETE})
    else:
        with run.claimed(identity, folders, shared=True):
            _write_inputs(run, problem, plan, command)
            take_from_table(run, plan.seeds, plan.n_ranked)
        _run_missing(run, plan, workers)
    return Calibration(problem, plan, replications(run, plan.seeds, plan.n_ranked), command)


def _refuse_fewer_repetitions(run: RunDirectory, plan: CalibrationPlan) -> None:
    """Raise where an earlier calibration in the folder has repeated fits more often."""
    if not run.manifest_file.is_file() or "plan" not in run.read_manifest():
        return
    earlier = run.read_manifest(_CalibrationManifest)["plan"]["refits"]
    if plan.refits < earlier:
        raise InputError(
            f"{run.path}: was calibrated with {earlier} repetitions of fits that had not "
            f"converged, expected no fewer, found {plan.refits}."
        )


def _write_inputs(run: RunDirectory, problem: Problem, plan: CalibrationPlan, command: str) -> None:
    """Save, in a claimed folder, what data sets are made of, and what will run."""
    if "plan" not in run.read_manifest():  # else others may be reading the same inputs
        write_inputs(run, input_texts(problem.experiments, problem.priors[0]))
    run.update_manifest(_record(run, problem, plan, command))


def load_calibration(folder: Path) -> Calibration:
    """Return a calibration as far as it has come."""
    run = RunDirectory(folder)
    if run.read_manifest().get("kind") != CALIBRATION_KIND:
        raise InputError(f"{folder}: holds no calibration, expected a folder of pyburgers sbc.")
    manifest = run.read_manifest(_CalibrationManifest)
    with run.unchanged_copy(manifest) as copy:
        template = recorded_problem(copy, manifest)
    content = manifest["plan"]
    given = {name: content.get(name) for name in ("stress_range", "strain_range")}
    ranges = {name: tuple(limits) for name, limits in given.items() if limits is not None}
    sampler = recorded_options(content["sampler"])
    plan = CalibrationPlan(**{**content, "sampler": sampler, **ranges})
    return Calibration(
        template,
        plan,
        replications(run, plan.seeds, plan.n_ranked),
        manifest["command"],
    )


def _fingerprint(problem: Problem, plan: CalibrationPlan, recipe: str) -> str:
    """Hash of everything that decides the outcome of a data set, save which one it is."""
    sampler = {
        key: value
        for key, value in asdict(plan.sampler).items()
        if key not in INDECISIVE - {"chains"} and key != "seed"
    }
    return sha256_of_json(
        {
            "kind": CALIBRATION_KIND,
            "data": decisive(program_data(problem, solver=SolverOptions())),
            "seed": plan.seed,
            "simulations": plan.simulations,
            # Repetitions can be added: the first ones stay what they were.
            "data_set": {
                "n_ranked": plan.n_ranked,
                "refits": 0,
                "first": 0,
                "stress_range": plan.stress_range,
                "strain_range": plan.strain_range,
            },
            "sampler": sampler,
            "program": recipe,
        }
    )


def _record(
    run: RunDirectory, problem: Problem, plan: CalibrationPlan, command: str
) -> dict[str, object]:
    """Note what will run: command, settings, versions, hashes of the inputs."""
    return {
        "kind": CALIBRATION_KIND,
        **problem_record(problem),
        "priors": problem.priors[0].title,
        **origin_record(run, made_now_by(command), files_in(run.inputs)),
        "plan": asdict(plan),
        "solver": asdict(SolverOptions()),
    }


def _run_missing(run: RunDirectory, plan: CalibrationPlan, workers: Workers) -> None:
    """Do the data sets of a part that are missing; stop handing them out when one fails."""
    mine = workers.mine({seed: simulation_file(run, seed) for seed in plan.seeds})
    missing = [
        seed
        for seed, file in mine.items()
        if scratch_of(file).exists() or not _is_done(file, plan.refits)
    ]
    if len(missing) < len(mine):
        n_found = len(mine) - len(missing)
        logger.info(f"{n_found} of {len(mine)} data sets are there already.")
    if not missing:
        return
    # Elsewhere the working directory may be another one.
    calls = {seed: (run.path.absolute(), seed, plan) for seed in missing}
    try:
        with run_tasks(_replicate_into, calls, workers=workers, out=run.path) as done:
            for n_done, (seed, outcome) in enumerate(done, start=1):
                logger.info(f"Data set {seed}: {outcome}, {n_done} of {len(missing)}.")
    except BaseException:
        run.update_manifest({"status": "interrupted"})
        raise


def _replicate_into(path: Path, seed: int, plan: CalibrationPlan) -> str:
    """Do a data set in a process, again if the system ends chains; return how it went."""
    run = RunDirectory(path)
    file = simulation_file(run, seed)
    scratch = scratch_of(file)
    scratch.mkdir(exist_ok=True)
    taken = f"{path}: another process is doing data set {seed}"
    remedy = "wait for it, or let each do another --part"
    with process_lock(scratch / ".lock", taken, remedy, patience=0):
        if not _is_done(file, plan.refits):
            before = read_json_table(file, Replication) if file.is_file() else None
            done = _replicate(run, scratch / "fits", seed, plan, before)
            write_json(file, done.model_dump())
        replication = read_json_table(file, Replication)
        shutil.rmtree(scratch)
    if replication.failure is not None:
        return "no fit"
    return "ranked" if replication.ranks else "not converged"


def _is_done(file: Path, refits: int) -> bool:
    """Tell whether a data set has its outcome, after so many longer fits if they are needed."""
    return file.is_file() and read_json_table(file, Replication).is_done(refits)


def _replicate(
    run: RunDirectory, out: Path, seed: int, plan: CalibrationPlan, before: Replication | None
) -> Replication:
    """Do one data set in a folder of its own, where fits of an earlier attempt go on."""
    template = recorded_problem(run, run.read_manifest())
    tries_left = SYSTEM_ATTEMPTS
    while True:
        tries_left -= 1
        try:
            return replicate(template, out, seed=seed, plan=plan, before=before)
        except SystemFailureError:
            if not tries_left:
                raise
