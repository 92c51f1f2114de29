"""Fit one or several tests, and what a finished fit says of each."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field, replace
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Self

import pandas as pd
import xarray as xr

from pyburgers.checks.prior_influence import Influence, prior_influence
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError, nearest, one_or_several, require_type
from pyburgers.common.messages import messages_where_watched
from pyburgers.common.paths import given_path
from pyburgers.fitting.new_test import Source
from pyburgers.fitting.plots import FitPlots
from pyburgers.fitting.prediction import Prediction, predict_test
from pyburgers.fitting.prior_draws import prior_groups, scores_beside
from pyburgers.fitting.problem_run import (
    put_aside_where_tolerance_matters,
    recorded_problem,
    run_chains,
    sample_until_good,
)
from pyburgers.fitting.sampled_fit import SampledFit, data_words, in_passing, write_tables
from pyburgers.kinds.conditions import Ranges, conditions_of, prior_doubts, tell_doubts
from pyburgers.kinds.experiment import A_TEST, Experiment, Provenance
from pyburgers.kinds.problem import Problem, one_test, problem_of
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.kinds.together import default_priors_for, pooling_for
from pyburgers.model.priors import FLOW_LAW, JOINT_PRIOR, SOME_PRIORS, PriorSet
from pyburgers.model.variants import ModelVariant
from pyburgers.posterior.build import build_posterior
from pyburgers.posterior.groups import load_posterior
from pyburgers.posterior.labelled_draws import draws_table, groups_of_tests, own_name, summary_table
from pyburgers.sampling.manifest import FitManifest
from pyburgers.sampling.options import SOME_OPTIONS, SamplerOptions
from pyburgers.sampling.run import draws_to_add
from pyburgers.sampling.run_directory import RunDirectory


@dataclass(frozen=True, eq=False, repr=False)
class Fit(SampledFit):
    """A finished fit of one test, or of several; `fit["ID"]` is the result for one of them.

    Attributes
    ----------
    directory, posterior, manifest
        As of every `SampledFit`; groups of the draws: `pyburgers.posterior.build.build_posterior`.
    problem : Problem
        Tests, priors, pooling.
    scores_beside : mapping of str to numpy.ndarray
        Of one test of a joint fit: scores (n, n_scores) of priors that it alone does not have.
    whole : Fit, optional
        Of one test of a joint fit: the joint fit.

    Examples
    --------
    >>> draws = fit.posterior["posterior"]["maxwell_modulus"]
    >>> draws.dims
    ('chain', 'draw')
    """

    problem: Problem
    scores_beside: Mapping[str, FloatArray] = field(default_factory=dict)
    whole: "Fit | None" = None

    @property
    def experiment(self) -> Experiment:
        """The one test of the fit.

        Raises
        ------
        InputError
            If it is a joint fit.
        """
        return self.problem.experiments[self._only_test()]

    @property
    def priors(self) -> PriorSet:
        """Priors of the test in SI, the noise scale resolved.

        Raises
        ------
        InputError
            If it is a joint fit.
        """
        return self.problem.priors[self._only_test()]

    @property
    def variant(self) -> ModelVariant:
        """Laws of the model's parts, which the priors decide, the same for all tests."""
        return self.problem.variant

    @property
    def is_joint(self) -> bool:
        """Whether several tests were fitted together."""
        return not self.problem.is_single

    @property
    def is_part(self) -> bool:
        """Whether this is the result of a joint fit for one test."""
        return len(self.manifest["experiments"]) > len(self.problem.experiments)

    @cached_property
    def fitted_conditions(self) -> tuple[Ranges, ...]:
        """Conditions that each fitted test passed, also of tests that this is no result for.

        Examples
        --------
        >>> sorted(fit.fitted_conditions[0])
        ['initial grain size', 'strain', 'strain rate', 'stress', 'temperature']
        """
        if self.whole is not None:
            return self.whole.fitted_conditions
        tests = self.tests().values()
        return tuple(conditions_of(one.experiment, one.posterior) for one in tests)

    @property
    def provenance(self) -> Provenance:
        """Origin of the data of the one test."""
        return self.experiment.provenance

    @property
    def part_name(self) -> str | None:
        """Name of the test if this is the result of a joint fit for one test, else None."""
        return self.problem.name if self.is_part else None

    def __getitem__(self, test: str) -> "Fit":
        """Return what the fit says about a test, as a fit of that test.

        Its tables, figures and predictions are those of fits of one test; draws of a shared
        parameter are the same in all tests.
        """
        tests = self.tests()
        if test not in tests:
            where = self.directory.path
            raise InputError(f"{where}: has no test {test!r}, {nearest(test, tests)}")
        return tests[test]

    def tests(self) -> "dict[str, Fit]":
        """Return the result for each test (see `__getitem__`).

        Examples
        --------
        >>> sorted(joint.tests())
        ['PIL40', 'other']
        """
        if not self.is_joint:
            return {self.problem.name: self}
        groups = groups_of_tests(self.posterior)
        parts = [*map(one_test, self.problem.experiments, self.problem.by_effect())]
        beside = scores_beside(self.problem, parts, groups)
        found = {}
        for alone in parts:
            one = replace(self, posterior=groups[alone.name], problem=alone, whole=self)
            found[alone.name] = replace(one, scores_beside=beside[alone.name])
        return found

    @cached_property
    def prior_doubts(self) -> tuple[str, ...]:
        """What is unlikely about the priors, of a joint fit about those of all tests.

        Examples
        --------
        >>> sentences = fit.prior_doubts
        """
        problem = (self.whole or self).problem
        return prior_doubts(problem.given_priors, problem.experiments)

    @property
    def read_off(self) -> frozenset[str]:
        """Priors that were read off the fitted data (`PriorSet.read_off`)."""
        data = [data_words(one.id, one.provenance) for one in self.problem.experiments]
        return self.problem.priors[0].read_off(data)

    def _influences_on(self, derived: Mapping[str, FloatArray]) -> dict[str, dict[str, Influence]]:
        """Influences by test and quantity."""
        fitted, found = self.manifest["experiments"], {}
        for name, test in self.tests().items():
            influences = prior_influence(
                test.posterior,
                test.priors,
                family=len(fitted) * len(test.priors.free),
                derived=derived,
                read_off=self.read_off,
                scores_beside=test.scores_beside,
            )
            found[name] = self._usable(influences)
        return found

    @cached_property
    def _decisions(self) -> dict[str, Influence]:
        """Shared parameters once, others and all priors by the test that owns them."""
        found: dict[str, Influence] = {}
        for e, of_test in enumerate(self.influences().values()):
            keys = {name: self._key(name, e) for one in of_test.values() for name in one.moves}
            for name, one in of_test.items():
                key = self._key(name, e)
                moves = {keys[prior]: move for prior, move in one.moves.items()}
                found.setdefault(key, replace(one, name=key, moves=moves))
        return found

    def _key(self, name: str, e: int) -> str:
        """Name of a quantity or prior of a test (from 0) among those of all tests."""
        pooled = FLOW_LAW[0] if name == JOINT_PRIOR else name
        own = self.is_joint and pooled not in self.problem.shared and "[" not in name
        return own_name(name, self.problem.owner(pooled, e)) if own else name

    def predict(
        self,
        experiment: Experiment,
        *,
        draws: int | None = None,
        separate_from: str | None = None,
        new_sample: bool = False,
        seed: int = 1,
    ) -> Prediction:
        """Predict another test from the draws (`pyburgers.fitting.prediction`).

        Parameters
        ----------
        experiment, draws, separate_from, new_sample, seed
            As for `pyburgers.fitting.prediction.predict_test`, which says what is raised.

        Examples
        --------
        >>> prediction = fit.predict(test)
        >>> score = pyburgers.score_table(prediction)
        """
        about = (self.fitted_conditions, self.cautions, self.which_draws)
        source = Source(self.problem, self.tests(), self.posterior, *about)
        return predict_test(source, experiment, draws, separate_from, seed, new_sample=new_sample)

    def prior_groups(self, draws: int, seed: int) -> dict[str, xr.Dataset]:
        """Draw from the priors of one test, and solve every draw for readings with noise.

        Examples
        --------
        >>> sorted(fit.prior_groups(20, seed=1))
        ['prior', 'prior_predictive']
        """
        if self.is_joint or draws == 0:
            return {}
        return prior_groups(self.experiment, self.priors, draws, seed)

    def report(self, path: str | Path, *, title: str | None = None) -> Path:
        """Write a page about the fit.

        Parameters
        ----------
        path : path
            A file that ends in ``.html``, with a folder of tables and figures beside it; or a
            folder.
        title : str, optional
            Heading of the page.

        Returns
        -------
        Path
            The page.

        Raises
        ------
        InputError
            If the folder cannot be written or holds something else.

        Examples
        --------
        >>> page = fit.report("page.html")
        """
        page: Path = import_module("pyburgers").report([self], path, title=title)
        return page

    @property
    def plot(self) -> FitPlots:
        """Figures of the fit of one test, drawn into axes of your own."""
        return FitPlots(self)

    def si_summary(self) -> pd.DataFrame:
        """Posterior table in SI units, of one test with the priors beside it.

        See `pyburgers.posterior.labelled_draws.draws_table` and `summary_table`.

        Examples
        --------
        >>> fit.si_summary().loc["maxwell_modulus", "unit"]
        'Pa'
        """
        if self.is_joint:
            return draws_table(self.posterior)
        return summary_table(self.posterior, self.priors)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a run directory.

        Parameters
        ----------
        path : path
            Run directory of `fit`.

        Returns
        -------
        Fit
            With the draws of the chains that have finished.

        Raises
        ------
        InputError
            If it is no run of one or several tests, has no finished chain, or a file was damaged or
            changed.

        Examples
        --------
        >>> fit.save("copy")
        >>> again = pyburgers.Fit.load("copy")
        """
        run = RunDirectory(given_path(path))
        found = run.read_manifest()
        if "kind" in found or ("experiments" not in found and run.finished_chains()):
            raise InputError(f"{path}: is not a fit of tests, expected a run of pyburgers fit.")
        run.require_a_chain()
        manifest = run.read_manifest(FitManifest)
        with run.unchanged_copy(manifest) as copy:
            problem = recorded_problem(copy, manifest)
        posterior = load_posterior(run, manifest)
        if posterior is None:
            posterior = build_posterior(run, problem, manifest)
        # A killed process did not note the chains that it had finished.
        return cls(run, posterior, {**manifest, "chains": run.chain_records()}, problem)

    def _only_test(self) -> int:
        if self.is_joint:
            name = self.problem.experiments[0].id
            raise InputError(
                f"{self.directory.path}: is a joint fit of {self.problem.name}, expected a fit of "
                f"one test, or one of its tests: --test {name}, or fit[{name!r}] in Python."
            )
        return 0


def fit(
    experiments: Experiment | Sequence[Experiment],
    priors: PriorSet | None = None,
    *,
    out: str | Path | None = None,
    pool: Mapping[str, str] | None = None,
    options: SamplerOptions | None = None,
    solver: SolverOptions | None = None,
    use_likelihood: bool = True,
    command: str = "pyburgers.fit(...)",
    more_draws: int | None = None,
    overwrite: bool = False,
) -> Fit:
    """Fit the nonlinear Burgers model to a test, or to several of one material.

    Parameters
    ----------
    experiments : Experiment or sequence of Experiment
        Tests with data (`pyburgers.load_experiment`, `pyburgers.ConstantRateTest` and others).
    priors : PriorSet, optional
        Priors of every parameter (`pyburgers.priors`), for all tests; they decide which variant of
        the model is fitted (`pyburgers.with_variant`). Default: those of the material.
    out : path, optional
        Run directory. An earlier run with the same inputs there is continued: only missing
        chains are run. Default: a temporary folder, which is removed with the fit (`Fit.save`
        keeps it). A pickled copy has no folder then.
    pool : mapping of str to str, optional
        How parameters of several tests are pooled, if not by default
        (`pyburgers.kinds.together.pooling_for`).
    options : SamplerOptions, optional
        Chains, iterations, seed, time. Chains continue until their draws are enough, or with
        shorter steps if a number depends on a few divergences (`docs/verdicts.md`).
    solver : SolverOptions, optional
        Tolerance of the ODE solver while sampling. All draws are solved again at the reference
        tolerance. If their Pareto k shows that the tolerance was too loose, all chains run again
        ten times tighter, at most twice.
    use_likelihood : bool
        False samples the prior predictive distribution with the same program.
    command : str
        Command that repeats the run, for the manifest.
    more_draws : int, optional
        Draws that are added to every chain of the run in `out`, after what it still lacks.
    overwrite : bool
        Whether a run of other inputs in `out` is removed; without it that is an error.

    Returns
    -------
    Fit
        Draws, table and checks. Chains that failed are named by the check "chains".

    Raises
    ------
    InputError
        If an input is wrong or `out` holds something else.
    SamplingError
        If no chain finished, or one could not be extended.

    Examples
    --------
    >>> options = pyburgers.SamplerOptions(chains=2, warmup=150, draws=100)
    >>> result = pyburgers.fit(test, priors, out="runs/mine", options=options)
    >>> table = result.summary()
    """
    tests = one_or_several("experiments", experiments, Experiment, A_TEST)
    if priors is None:
        priors = default_priors_for(tests)
    require_type("priors", priors, PriorSet, SOME_PRIORS)
    if more_draws is not None and out is None:
        raise InputError(
            f"more_draws: found {more_draws} without out, expected the folder of the run to which "
            "draws are added."
        )

    def fit_in(folder: Path) -> Fit:
        tell_doubts((priors, tests))
        return fit_problem(
            problem_of(tests, priors, pooling_for(tests, pool)),
            out=folder,
            options=options,
            solver=solver,
            use_likelihood=use_likelihood,
            command=command,
            more_draws=more_draws,
            overwrite=overwrite,
        )

    with messages_where_watched():
        return fit_in(given_path(out)) if out is not None else in_passing(fit_in)


def fit_problem(
    problem: Problem,
    *,
    out: str | Path,
    options: SamplerOptions | None = None,
    solver: SolverOptions | None = None,
    use_likelihood: bool = True,
    command: str,
    more_draws: int | None = None,
    overwrite: bool = False,
    remedy: str | None = None,
) -> Fit:
    """Fit the tests, priors and pooling of a problem; `fit` describes the options and errors.

    If a run of other inputs is in the folder, `remedy` says what to do, by default `way_out`.
    """
    run, settings = RunDirectory(given_path(out)), options or SamplerOptions()
    if more_draws is not None:
        more_draws, command = draws_to_add(run, more_draws, overwrite=overwrite)
    require_type("options", settings, SamplerOptions, SOME_OPTIONS)
    if not problem.free:
        raise InputError(
            f"{problem.priors[0].title!r}: found every parameter fixed, expected a prior of one, "
            "such as stress_noise."
        )

    def sample(more: int | None) -> Fit:
        while True:
            run_chains(
                problem,
                run,
                options=settings,
                solver=solver or problem.likelihood.solver,
                use_likelihood=use_likelihood,
                command=command,
                more_draws=more,
                overwrite=overwrite,
                remedy=remedy,
            )
            more = None  # chains that are run again get the same number
            result = Fit.load(run.path)
            if not put_aside_where_tolerance_matters(result):
                return result

    result = sample_until_good(sample, settings, more_draws)
    write_tables(result)
    return replace(result, manifest=run.read_manifest())
