"""Fit several tests together, and read such fits."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import pandas as pd
import xarray as xr

from pyburgers.common.atomic_files import write_atomically, write_json
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit, is_joint
from pyburgers.fitting.sampled_fit import SampledFit, sample_until_solved, write_tables
from pyburgers.model.pooling import pooling_from, pooling_of
from pyburgers.model.priors import PriorSet, load_priors, save_priors
from pyburgers.model.variants import ModelVariant, variant_of
from pyburgers.posterior.joint_labelled_draws import TESTS, build_joint_posterior
from pyburgers.posterior.labelled_draws import draws_table, load_posterior
from pyburgers.protocols.constant_rate.experiment import load_constant_rate
from pyburgers.protocols.constant_rate.protocol import CONSTANT_RATE
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.stan_data import SolverOptions
from pyburgers.sampling.charts import check_coordinates
from pyburgers.sampling.joint_charts import choose_joint_geometry, draw_joint_start
from pyburgers.sampling.joint_stan_data import joint_data
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.problem import JointProblem, joint_problem
from pyburgers.sampling.run import SamplingTask, keep_experiment, run_task
from pyburgers.sampling.run_directory import RunDirectory
from pyburgers.sampling.run_record import priors_record


@dataclass(frozen=True, eq=False)
class JointFit(SampledFit):
    """A finished joint fit.

    Attributes
    ----------
    directory, posterior, manifest
        As of every `SampledFit`, over all tests; groups of the draws:
        `pyburgers.posterior.joint_labelled_draws.build_joint_posterior`.
    problem : JointProblem
        Tests, priors, pooling.
    """

    problem: JointProblem

    @property
    def variant(self) -> ModelVariant:
        """Laws of the model's parts, told from the priors, as those of all tests."""
        return variant_of(self.problem.priors[0], self.problem.experiments[0])

    def summary(self) -> pd.DataFrame:
        """Table of every sampled quantity in SI units (`pyburgers.common.draws_table`)."""
        return draws_table(self.posterior)

    def tests(self) -> dict[str, Fit]:
        """Return what the joint fit says about each test, as a fit of that test.

        Their tables, figures and predictions are those of fits of one test; draws of a shared
        parameter are the same in all.
        """
        found = {}
        for experiment, priors in zip(self.problem.experiments, self.problem.priors, strict=True):
            posterior = self.posterior[f"{TESTS}/{experiment.id}"]
            assert isinstance(posterior, xr.DataTree)  # a group, as build_joint_posterior has it
            found[experiment.id] = Fit(self.directory, posterior, self.manifest, experiment, priors)
        return found

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a run directory.

        Raises
        ------
        InputError
            If it is not a joint fit or has no finished chain.
        """
        run = RunDirectory(Path(path))
        manifest = run.read_manifest()
        if not is_joint(manifest):
            raise InputError(f"{path}: is not a joint fit, expected a run of several tests.")
        run.require_a_chain()
        problem = joint_problem(
            [load_constant_rate(_experiment_file(run, name)) for name in manifest["experiments"]],
            load_priors(run.priors_file),
            pooling_from(manifest["pooling"]),
        )
        posterior = load_posterior(run)
        if posterior is None:
            posterior = build_joint_posterior(run, problem)
        return cls(run, posterior, {**manifest, "chains": run.chain_records()}, problem)


def fit_jointly(
    experiments: Sequence[Experiment],
    priors: PriorSet,
    *,
    out: str | Path,
    pool: Mapping[str, str] | None = None,
    options: SamplerOptions | None = None,
    solver: SolverOptions | None = None,
    use_likelihood: bool = True,
    command: str = "pyburgers.fit_jointly(...)",
) -> JointFit:
    """Fit the nonlinear Burgers model to several tests of one material at constant rate.

    Parameters
    ----------
    experiments : sequence of Experiment
        At least two tests with data.
    priors : PriorSet
        Priors of every parameter, for all tests.
    out : path
        Run directory. An earlier run with the same inputs there is continued.
    pool : mapping of str to str, optional
        How parameters are pooled where it is not the default
        (`pyburgers.model.pooling.pooling_of`).
    options, solver, use_likelihood, command
        As for `pyburgers.fit`.

    Raises
    ------
    InputError
        If an input is wrong or `out` holds something else.
    SamplingError
        If no chain finished.
    """
    if len(experiments) < 2:
        raise InputError(f"joint fit: found {len(experiments)} test, expected at least two.")
    return fit_joint_problem(
        joint_problem(experiments, priors, pooling_of(pool)),
        out=out,
        options=options,
        solver=solver,
        use_likelihood=use_likelihood,
        command=command,
    )


def fit_joint_problem(
    problem: JointProblem,
    *,
    out: str | Path,
    options: SamplerOptions | None = None,
    solver: SolverOptions | None = None,
    use_likelihood: bool = True,
    command: str,
) -> JointFit:
    """Fit tests, be it a single one, with the priors and the pooling of a joint fit.

    Parameters
    ----------
    problem : JointProblem
        Tests, priors, pooling.
    out, options, solver, use_likelihood, command
        As for `fit_jointly`, which says what is raised.
    """
    options = (options or SamplerOptions()).suited_to(problem.experiments[0])
    solver = solver or SolverOptions()
    check_coordinates(problem.experiments[0], options.coordinates)
    task = _task(problem, options, solver, use_likelihood)
    run = RunDirectory(Path(out))

    def sample() -> JointFit:
        run_task(task, run.path, solver=solver, command=command)
        return JointFit.load(run.path)

    result = sample_until_solved(sample, run)
    write_tables(result)
    return replace(result, manifest=run.read_manifest())


def _task(
    problem: JointProblem, options: SamplerOptions, solver: SolverOptions, use_likelihood: bool
) -> SamplingTask:
    """Settle what is sampled."""
    data = joint_data(problem, solver=solver, use_likelihood=use_likelihood)
    priors = problem.given_priors
    return SamplingTask(
        name=problem.name,
        data_kind=problem.data_kind,
        program=CONSTANT_RATE.program,
        data=data,
        options=options,
        write_inputs=lambda run: _write_inputs(run, problem),
        choose_geometry=lambda model: choose_joint_geometry(
            model, data, problem, wanted=options.coordinates, seed=options.seed, solver=solver
        ),
        draw_start=lambda chain: draw_joint_start(problem, seed=options.seed, chain=chain),
        manifest={
            "experiments": [experiment.id for experiment in problem.experiments],
            "pooling": problem.pooling.record(),
            **priors_record(priors, problem.experiments[0]),
        },
    )


def _experiment_file(run: RunDirectory, name: str) -> Path:
    """Copy of one test."""
    return run.inputs / TESTS / name / "experiment.toml"


def _write_inputs(run: RunDirectory, problem: JointProblem) -> None:
    """Save tests, priors and pooling."""
    for experiment in problem.experiments:
        keep_experiment(run, experiment, _experiment_file(run, experiment.id))
    # Not resolved: that is done for each test by itself.
    write_atomically(run.priors_file, lambda path: save_priors(problem.given_priors, path))
    write_json(run.inputs / "pooling.json", problem.pooling.record())
