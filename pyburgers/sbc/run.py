"""Simulation-based calibration over processes: many data sets, each a small file, resumable.

The folder of a calibration holds ``manifest.json``, ``inputs/`` (template and priors) and
``simulations/simulation_SEED.json``, one for each data set, written when its fit is done; the same
command continues with those that are missing.
"""

import json
import logging
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from functools import cached_property
from pathlib import Path

from pyburgers.cmdstan.program import load_program
from pyburgers.common.atomic_files import sha256_of_json, write_json
from pyburgers.common.errors import InputError
from pyburgers.common.processes import completed, number_of_processes
from pyburgers.common.toml_files import read_text
from pyburgers.model.priors import PriorSet, load_priors, save_priors
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.problem import Problem, problem_of
from pyburgers.protocols.program_data import program_data
from pyburgers.protocols.protocol import load_experiment, save_experiment
from pyburgers.protocols.stan_data import SolverOptions
from pyburgers.sampling.charts import check_coordinates
from pyburgers.sampling.options import INDECISIVE, SamplerOptions
from pyburgers.sampling.run import files_in, origin_record
from pyburgers.sampling.run_directory import RunDirectory
from pyburgers.sbc.data_sets import Replication, check_template, replicate
from pyburgers.sbc.rank_uniformity import RankBands, RankVerdict, judge_ranks, rank_bands

logger = logging.getLogger(__name__)

CALIBRATION_KIND = "pyburgers sbc"
"""What the manifest of a calibration says."""

SHORT_RUN = SamplerOptions(chains=2, warmup=300, draws=400, parallel_chains=1)
"""Default of each fit: long enough for `N_RANKED` nearly independent draws."""

N_RANKED = 99

SIMULATIONS = "simulations"
"""Folder of the data sets."""


@dataclass(frozen=True)
class CalibrationPlan:
    """What a calibration does.

    Attributes
    ----------
    simulations : int
        Data sets. A larger number continues a calibration of fewer.
    seed : int
        Seed of the first data set; the others follow on, by 1.
    n_ranked : int
        Draws of each fit among which the truth is ranked.
    sampler : SamplerOptions
        Of each fit; its seed is that of the data set.
    """

    simulations: int = 200
    seed: int = 1
    n_ranked: int = N_RANKED
    sampler: SamplerOptions = SHORT_RUN

    def __post_init__(self) -> None:
        """Check the values.

        Raises
        ------
        InputError
            If one is out of range.
        """
        draws = self.sampler.chains * self.sampler.draws
        for name, value, least, most in (
            ("simulations", self.simulations, 1, 10**6),
            ("seed", self.seed, 0, 2**31 - 1 - self.simulations),
            ("ranked_draws", self.n_ranked, 3, draws),
        ):
            if not least <= value <= most:
                raise InputError(f"{name} is {value}, expected a number from {least} to {most}.")

    @property
    def seeds(self) -> range:
        """Seed of each data set."""
        return range(self.seed, self.seed + self.simulations)


@dataclass(frozen=True, eq=False)
class Calibration:
    """A finished calibration.

    Attributes
    ----------
    template : Experiment
        Protocol and points of the data sets.
    priors : PriorSet
        What the truths were drawn from.
    plan : CalibrationPlan
        Data sets, seeds, sampler.
    replications : tuple of Replication
        One for each data set, by seed.
    """

    template: Experiment
    priors: PriorSet
    plan: CalibrationPlan
    replications: tuple[Replication, ...]

    @cached_property
    def ranked(self) -> tuple[Replication, ...]:
        """Data sets with a fit."""
        return tuple(one for one in self.replications if one.failure is None)

    @cached_property
    def ranks(self) -> dict[str, list[int]]:
        """Ranks of each quantity over the data sets with a fit."""
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
        """Whether there are ranks, and no quantity is found not to be calibrated."""
        found = {verdict.verdict for verdict in self.verdicts.values()}
        return bool(found) and "not calibrated" not in found


def calibrate(
    template: Experiment,
    priors: PriorSet,
    *,
    out: Path,
    plan: CalibrationPlan,
    jobs: int | None = None,
    command: str = "pyburgers.calibrate(...)",
) -> Calibration:
    """Simulate data sets from the prior, fit each, and rank the truths; continue where one stopped.

    Parameters
    ----------
    template : Experiment
        Protocol and points; its stresses serve to resolve a relative noise prior.
    priors : PriorSet
        What truths are drawn from and fits use.
    out : Path
        Folder of the calibration. An earlier one with the same inputs there is continued.
    plan : CalibrationPlan
        Data sets, seeds, sampler.
    jobs : int, optional
        Processes; default one for each core. Each runs one chain at a time.
    command : str
        What regenerates the calibration, for the manifest.

    Raises
    ------
    InputError
        If an input is wrong or `out` holds something else.
    SamplingError
        If the priors have no solvable draws, or a process was killed.
    """
    check_template(template)
    problem = problem_of([template], priors)
    check_coordinates(problem, plan.sampler.coordinates)
    jobs = number_of_processes(jobs, plan.simulations)
    sampler = plan.sampler.suited_to(problem.protocol)
    plan = replace(plan, sampler=replace(sampler, parallel_chains=1))
    (priors,) = problem.priors
    if not priors.free:
        raise InputError(f"{priors.title}: all parameters are fixed, expected a free one to rank.")
    identity = _fingerprint(problem, plan, load_program(problem.protocol.program).key)
    run = RunDirectory(out)
    with run.claimed(identity, ("inputs", SIMULATIONS)):
        save_experiment(template, run.inputs)
        save_priors(priors, run.priors_file)
        run.update_manifest(_record(run, template, priors, plan, command))
        missing = [seed for seed in plan.seeds if not simulation_file(run, seed).is_file()]
        n_found = plan.simulations - len(missing)
        if n_found:
            logger.info(f"{n_found} of {plan.simulations} data sets are there already.")
        _run_missing(run, missing, plan, jobs)
        run.update_manifest({"status": "complete"})
    return Calibration(
        template, priors, plan, tuple(_read_replication(run, seed) for seed in plan.seeds)
    )


def simulation_file(run: RunDirectory, seed: int) -> Path:
    """Return where the outcome of one data set is."""
    return run.path / SIMULATIONS / f"simulation_{seed:06d}.json"


def _fingerprint(problem: Problem, plan: CalibrationPlan, program_key: str) -> str:
    """Hash of everything that decides the outcome of a data set, save which one it is."""
    sampler = {
        key: value
        for key, value in asdict(plan.sampler).items()
        if key not in INDECISIVE - {"chains"} and key != "seed"
    }
    return sha256_of_json(
        {
            "kind": CALIBRATION_KIND,
            "data": program_data(problem, solver=SolverOptions()),
            "seed": plan.seed,
            "n_ranked": plan.n_ranked,
            "sampler": sampler,
            "program": program_key,
        }
    )


def _record(
    run: RunDirectory,
    template: Experiment,
    priors: PriorSet,
    plan: CalibrationPlan,
    command: str,
) -> dict[str, object]:
    """Note what will run: command, settings, versions, hashes of the inputs."""
    return {
        "kind": CALIBRATION_KIND,
        "template": template.id,
        "priors": priors.title,
        **origin_record(run, command, files_in(run.inputs)),
        "plan": asdict(plan),
        "solver": asdict(SolverOptions()),
    }


def _run_missing(run: RunDirectory, seeds: Sequence[int], plan: CalibrationPlan, jobs: int) -> None:
    """Do data sets in processes of their own; stop handing them out when one fails."""
    if not seeds:
        return
    done = completed(
        _replicate_into,
        {seed: (run.path, seed, plan) for seed in seeds},
        processes=jobs,
        folder=run.path,
    )
    try:
        for n_done, (seed, outcome) in enumerate(done, start=1):
            logger.info(f"Data set {seed}: {outcome}, {n_done} of {len(seeds)}.")
    except BaseException:
        run.update_manifest({"status": "interrupted"})
        raise


def _replicate_into(path: Path, seed: int, plan: CalibrationPlan) -> str:
    """Do one data set, in a process of its own, and write its file; return the outcome in a word.

    The process reads the inputs itself: what the parent holds cannot be handed over.
    """
    run = RunDirectory(path)
    scratch = run.new_scratch()
    replication = replicate(
        load_experiment(run.inputs / "experiment.toml"),
        load_priors(run.priors_file),
        scratch,
        seed=seed,
        options=plan.sampler,
        n_thinned=plan.n_ranked,
    )
    write_json(simulation_file(run, seed), asdict(replication))
    shutil.rmtree(scratch)
    return "no fit" if replication.failure is not None else "ranked"


def _read_replication(run: RunDirectory, seed: int) -> Replication:
    content = json.loads(read_text(simulation_file(run, seed)))
    return Replication(**{**content, "failed_checks": tuple(content["failed_checks"])})
