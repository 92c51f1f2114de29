"""What is fitted: tests of one material, their priors, and how they are pooled."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np

from pyburgers.common.errors import InputError
from pyburgers.kinds.experiment import CONDITION_KEYS, ENVIRONMENT_KEYS, Experiment, Stated
from pyburgers.kinds.likelihood import Likelihood, likelihood_of, likelihoods
from pyburgers.kinds.stan_data import Layout, PlainCoordinates, layout_of
from pyburgers.model.environment import acting_environment
from pyburgers.model.parameters import CONDITIONS, PARAMETER_BY_NAME, RESIDUAL_CORRELATION
from pyburgers.model.pooling import SEPARATE, Pooling
from pyburgers.model.prior_families import Prior, fixed_prior, is_fixed_at, normal_prior
from pyburgers.model.priors import FLOW_LAW, PriorSet
from pyburgers.model.residual_laws import reading_error_priors
from pyburgers.model.variants import WITHOUT_EFFECT, ModelVariant, check_variant, variant_of

HISTORIES, TABLES = "loading_history", "attenuation"
"""Protocols that one program takes together."""


@dataclass(frozen=True)
class Problem:
    """One or several tests to be fitted; made by `problem_of`, which checks it.

    `experiments`: at least one, with data, of different names.
    `given_priors`, `priors`: for all tests, not resolved; and resolved, of each test.
    `pooling`: how the tests hang together; it counts for a test that is left alone, too.
    """

    experiments: tuple[Experiment, ...]
    given_priors: PriorSet
    priors: tuple[PriorSet, ...]
    pooling: Pooling

    @property
    def name(self) -> str:
        """Names of the tests, joined."""
        return "+".join(experiment.id for experiment in self.experiments)

    @property
    def data_kind(self) -> str:
        """Kinds of the tests' provenance, joined."""
        return "+".join(sorted({experiment.provenance.kind for experiment in self.experiments}))

    @property
    def likelihood(self) -> Likelihood[Any]:
        """Likelihood whose program takes all tests."""
        return common_likelihood(self.experiments)

    @property
    def variant(self) -> ModelVariant:
        """Laws of the model's parts, which the priors decide, the same for all tests."""
        return variant_of(self.priors[0], self.experiments[0])

    @property
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that are inferred in every test."""
        return self.priors[0].free

    @property
    def partial(self) -> tuple[str, ...]:
        """Names of the partially pooled ones among them."""
        return self.pooling.of_kind("partial", self.free)

    @property
    def shared(self) -> tuple[str, ...]:
        """Names of those among them that have one value in all tests."""
        return tuple(name for name in self.free if self.kind(name) == "shared")

    def kind(self, name: str) -> str:
        """Return how a parameter is pooled: the kind, or by apparatus where only some share it."""
        sources = self._apparatus.get(name)
        if sources is None:
            return self.pooling.kinds[name]
        return {1: "shared", len(sources): "separate"}.get(len(set(sources)), "by apparatus")

    def owner(self, name: str, test: int) -> str:
        """Return the joined names of the tests that have the value of a test (from 0)."""
        sources = self._sources.get(name, range(len(self.experiments)))
        return "+".join(
            experiment.id
            for e, (experiment, source) in enumerate(zip(self.experiments, sources, strict=True))
            if source == sources[test] and self.has_effect(name, e)
        )

    def has_effect(self, name: str, test: int) -> bool:
        """Return whether a test (from 0) feels a parameter; if not it carries another's value."""
        sources = self._carried.get(name)
        return sources is None or sources[test] == test

    @property
    def _apparatus(self) -> dict[str, list[int]]:
        """Errors of conditions, with the first test that was made with the same apparatus."""
        uncertain = [experiment.uncertain for experiment in self.experiments]
        made_with = [{one.parameter: one.apparatus for one in own} for own in uncertain]
        found = {}
        for name in made_with[0]:
            names = [own.get(name) for own in made_with]
            found[name] = [e if own is None else names.index(own) for e, own in enumerate(names)]
        return found

    @cached_property
    def _carried(self) -> dict[str, list[int]]:
        """Parameters without effect in some tests, with the test whose value each carries."""
        found = {}
        for name in self.free:
            feels = [name not in experiment.without_effect for experiment in self.experiments]
            if any(feels) and not all(feels) and self.kind(name) != "shared":
                found[name] = [e if own else feels.index(True) for e, own in enumerate(feels)]
        return found

    @property
    def _sources(self) -> dict[str, list[int]]:
        """Test whose value each test has, of parameters that the pooling alone does not say."""
        return {**self._apparatus, **self._carried}

    @cached_property
    def layout(self) -> Layout:
        """Which coordinate stands for what."""
        n_errors = [experiment.n_driving_errors for experiment in self.experiments]
        return layout_of(self.free, len(n_errors), self.pooling, n_errors, self._sources)

    @property
    def is_single(self) -> bool:
        """Whether it is one test whose parameters are nobody else's."""
        return len(self.experiments) == 1 and not self.partial

    @property
    def coordinates(self) -> tuple[PlainCoordinates, ...]:
        """Plain coordinates of each test by itself; all stand for the same parameters."""
        return tuple(map(plain_coordinates, self.experiments, self.priors))

    def alone(self) -> "tuple[Problem, ...]":
        """Return each test by itself, with its resolved priors."""
        return tuple(map(one_test, self.experiments, self.priors))

    def by_effect(self) -> tuple[PriorSet, ...]:
        """Return the priors of each test, those of parameters without effect in it as known."""
        return tuple(
            own.exchanging(
                *(
                    fixed_prior(PARAMETER_BY_NAME[name], own[name].mean_sd()[0], "no effect")
                    for name in self._carried
                    if not self.has_effect(name, e)
                )
            )
            for e, own in enumerate(self.priors)
        )

    @property
    def parts(self) -> dict[str, int]:
        """What can be left out, with its number of readings: a test, or a part of a single one."""
        if len(self.experiments) > 1:
            return {experiment.id: experiment.n_points for experiment in self.experiments}
        return dict(self.experiments[0].parts)

    @property
    def parts_name(self) -> str:
        """What the parts are, in the plural."""
        return "tests" if len(self.experiments) > 1 else self.experiments[0].parts_name

    def without(self, part: str) -> "Problem":
        """Take out a test, or a part of a single one, and keep the prior densities of the rest.

        Priors that follow the largest stress of all tests, and residuals that correlate, stay as
        they are.
        """
        if len(self.experiments) == 1:
            kept = [self.experiments[0].without_part(part)]
            return problem_of(kept, self.priors[0], self.pooling)
        shared = [name for name in self.shared if name not in CONDITIONS]
        priors = _with_shared(self.given_priors, self.priors[0], shared)
        others = [k for k, experiment in enumerate(self.experiments) if experiment.id != part]
        grains = [n for n in ("steady_state_grain_size",) if n not in self.free]
        priors = _with_shared(priors, self.priors[others[0]], grains)
        left = problem_of([self.experiments[k] for k in others], priors, self.pooling)
        lost = [
            name
            for name in RESIDUAL_CORRELATION
            if name in self.free
            and name not in left.free
            and any(name not in experiment.without_effect for experiment in left.experiments)
        ]
        if not lost:
            return left
        # One that each test has by its own duration comes back with what else correlates.
        alike = [n for n in lost if len({self.priors[k][n].location for k in others}) == 1]
        return problem_of(
            left.experiments, _with_shared(priors, self.priors[others[0]], alike), self.pooling
        )


def one_test(experiment: Experiment, priors: PriorSet) -> Problem:
    """Return a test by itself with its resolved priors; nothing is checked, it may lack data."""
    return Problem((experiment,), priors, (priors,), SEPARATE)


def problem_of(
    experiments: Sequence[Experiment], priors: PriorSet, pooling: Pooling = SEPARATE
) -> Problem:
    """Check tests, priors and pooling, and resolve the priors for each test.

    Tests of several protocols are taken as one program takes them. A prior that is a share of the
    largest stress takes that of the test, or of all if the parameter is shared.
    """
    for experiment in experiments:
        _check_not_in_prior(experiment, priors)
    experiments = of_one_program(experiments)
    # Some file systems take names that differ in case alone for one.
    names = [experiment.id.casefold() for experiment in experiments]
    for experiment, name in zip(experiments, names, strict=True):
        if names.count(name) > 1:
            raise InputError(
                f"{experiment.id}: stands {names.count(name)} times among the tests of a joint "
                "fit, expected different ones."
            )
    for experiment in experiments:
        _check_test(experiment, experiments[0], priors)
    largest = [experiment.largest_stress for experiment in experiments]
    _check_conditions(experiments)
    _check_environment(experiments, priors)
    by_kind = common_likelihood(experiments).own_priors(experiments, priors)
    of_tests = tuple(
        _with_own_grains(own, experiments[0], experiment).exchanging(
            *condition_priors(experiment), *reading_error_priors(own.priors, experiment.noises)
        )
        for experiment, own in zip(experiments, by_kind, strict=True)
    )
    _check_same_free(experiments, of_tests)
    shared = pooling.of_kind("shared", of_tests[0].free)
    common = of_tests[0].resolved(max(largest))
    resolved = tuple(
        _with_shared(own.resolved(stress), common, shared)
        for own, stress in zip(of_tests, largest, strict=True)
    )
    problem = Problem(tuple(experiments), priors, resolved, pooling)
    _check_pooling(problem)
    return problem


def _with_own_grains(own: PriorSet, first: Experiment, experiment: Experiment) -> PriorSet:
    """Let grains stay at, or start from, each test's size where variants fix it in the first."""
    if "steady_state_grain_size" not in own.priors:
        return own
    size, critical_strain = own["steady_state_grain_size"], own["critical_strain_grain_size"]
    law = variant_of(own, first).grain_size
    stays = law == "constant" and is_fixed_at(critical_strain, WITHOUT_EFFECT)
    if not is_fixed_at(size, first.initial_grain_size) or not (stays or law == "piezometric"):
        return own
    quantity = PARAMETER_BY_NAME[size.parameter]
    return own.exchanging(fixed_prior(quantity, experiment.initial_grain_size, size.source))


def of_one_program(experiments: Sequence[Experiment]) -> tuple[Experiment, ...]:
    """Return tests as one program takes them: tables behind histories, which know curves."""
    if len({experiment.protocol for experiment in experiments}) == 1:
        return tuple(experiments)
    taken = [likelihood_of(experiment).as_history(experiment) for experiment in experiments]
    return tuple(sorted(taken, key=lambda one: one.protocol == TABLES))


def common_likelihood(experiments: Sequence[Experiment]) -> Likelihood[Any]:
    """Return the likelihood whose program takes some tests (`of_one_program`)."""
    names = {experiment.protocol for experiment in experiments}
    return likelihoods()[names.pop() if len(names) == 1 else HISTORIES]


def plain_quantity(prior: Prior) -> tuple[float, float, float, float]:
    """Return origin, size, lower and upper bound (SI) of the plain coordinate of a parameter."""
    if prior.family == "lognormal":
        # Its scale is that of the logarithm; the median sets the size.
        return 0.0, prior.location, prior.lower, prior.upper
    return prior.location, prior.scale, prior.lower, prior.upper


def replaced_by_flow(priors: PriorSet, names: Sequence[str]) -> str | None:
    """Return the first free parameter without two bounds, which would cut a flow law's point."""
    for name in names:
        prior = priors[name]
        if not prior.is_fixed and np.isinf([prior.lower, prior.upper]).any():
            return name
    return None


def plain_coordinates(experiment: Experiment, priors: PriorSet) -> PlainCoordinates:
    """Choose origin and size of every free parameter and what the reference quantity replaces."""
    likelihood = likelihood_of(experiment)
    at = (*likelihood.reference_origin(experiment), -np.inf, np.inf)
    # Where bounds of Q_M would cut the point of the flow law, it replaces beta.
    replaced = replaced_by_flow(priors, ("activation_enthalpy", "beta"))
    names = tuple(likelihood.reference.name if one == replaced else one for one in priors.free)
    rows = [at if one == replaced else plain_quantity(priors[one]) for one in priors.free]
    numbers = np.array(rows, dtype=np.float64).reshape(len(rows), 4)
    return PlainCoordinates(names, tuple(priors.free), *numbers.T)


def _check_test(experiment: Experiment, first: Experiment, priors: PriorSet) -> None:
    """Check that a test can be fitted, together with a first one."""
    if experiment.n_points == 0:
        raise InputError(f"{experiment.id}: the experiment has no data, expected a [data] table.")
    if experiment.material != first.material:
        raise InputError(
            f"{experiment.id}: is of the material {experiment.material}, expected "
            f"{first.material} like {first.id}, because a joint fit is of one material."
        )
    check_variant(priors, experiment)
    likelihood_of(experiment).check_priors(experiment, priors)


def _check_conditions(experiments: Sequence[Experiment]) -> None:
    """Refuse conditions that a test lacks, and two errors of one apparatus."""
    for name, (sd_key, apparatus_key) in CONDITION_KEYS.items():
        stated = {
            test.id: one for test in experiments for one in test.uncertain if one.parameter == name
        }
        missing = [test.id for test in experiments if test.id not in stated]
        if stated and missing:
            raise InputError(
                f"{missing[0]}: key {sd_key!r} is missing, expected it because {min(stated)} of "
                "the same joint fit has it; a condition that is well known has a small one."
            )
        for test, one in stated.items():
            for other, again in stated.items():
                same = one.apparatus is not None and one.apparatus == again.apparatus
                if same and one.sd != again.sd:
                    raise InputError(
                        f"{test}: key {sd_key!r} is {one.sd:g}, in {other} it is {again.sd:g}, "
                        f"expected one number for the {apparatus_key} {one.apparatus!r}."
                    )


def _check_environment(experiments: Sequence[Experiment], priors: PriorSet) -> None:
    """Ask all tests for what one of them states, if rates depend on it."""
    acts = {name: not is_fixed_at(prior, 0.0) for name, prior in priors.priors.items()}
    for name in acting_environment(acts):
        stated = [test.id for test in experiments if name in test.environment]
        missing = [test.id for test in experiments if name not in test.environment]
        if stated and missing:
            raise InputError(
                f"{missing[0]}: key {ENVIRONMENT_KEYS[name]!r} is missing, expected it because "
                f"{stated[0]} of the same joint fit has it and the priors let rates depend on it."
            )


def _check_not_in_prior(experiment: Experiment, priors: PriorSet) -> None:
    """Refuse a flow law as prior that the test itself has gone into."""
    test = experiment.peak
    if test is None or priors.flow_law is None:
        return
    for row in priors.flow_law.tests:
        if row.may_be(test):
            raise InputError(
                f"{experiment.id}: may be the test with {row} that its prior of the flow law was "
                "fitted to, expected a flow law from other tests (pyburgers fit-rates "
                "--without EXPERIMENT.toml) so that no reading counts twice."
            )


def _with_shared(own: PriorSet, common: PriorSet, shared: Sequence[str]) -> PriorSet:
    """Priors of a test with those of shared parameters exchanged for those of all tests."""
    return own.exchanging(*(common[name] for name in shared))


def _check_same_free(experiments: Sequence[Experiment], priors: Sequence[PriorSet]) -> None:
    """Ask for the same free parameters in all tests."""
    for experiment, own in zip(experiments, priors, strict=True):
        for name in sorted({*own.free} ^ {*priors[0].free}):
            raise InputError(
                f"{experiment.id}: {name} is {'free' if name in own.free else 'known'}, unlike in "
                f"{experiments[0].id}, expected it free in all tests of a joint fit or in none."
            )


def _check_pooling(problem: Problem) -> None:
    """Refuse pooling that has no meaning with the priors."""
    priors = problem.priors[0]
    replaced = problem.coordinates[0].replaced_parameter
    if replaced in problem.partial:
        reference = problem.likelihood.reference.label
        raise InputError(
            f"--pool {replaced}=partial: the {reference} is sampled in its place, expected shared "
            "or separate."
        )
    if priors.flow_law is None:
        return
    kinds = {problem.pooling.kinds[name] for name in FLOW_LAW}
    if kinds not in ({"shared"}, {"separate"}):
        raise InputError(
            f"--pool: found {', '.join(f'{n}={problem.pooling.kinds[n]}' for n in FLOW_LAW)}, "
            "expected all shared or all separate because they have a joint prior."
        )


def stated_priors(experiment: Experiment) -> dict[str, Prior]:
    """Return priors of the test and its apparatus, by the parameter."""
    source = "stated with the test"
    return {name: _normal(name, one, source) for name, one in experiment.stated.items()}


def condition_priors(experiment: Experiment) -> tuple[Prior, ...]:
    """Return the priors of the errors of a test's conditions, and its environment as known."""
    stated = {one.parameter: Stated(0.0, one.sd) for one in experiment.uncertain}
    stated |= {name: Stated(value, 0.0) for name, value in experiment.environment.items()}
    source = "stated in the file of the test"
    return tuple(_normal(name, one, source) for name, one in stated.items())


def _normal(name: str, stated: Stated, source: str) -> Prior:
    """Return the normal prior of a stated number, cut at zero where it cannot be negative."""
    parameter = PARAMETER_BY_NAME[name]
    if stated.sd == 0:
        return fixed_prior(parameter, stated.value, source)
    return normal_prior(parameter, stated.value, stated.sd, source)
