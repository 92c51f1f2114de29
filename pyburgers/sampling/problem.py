"""What a joint fit is about: tests of one material, their priors, and how they are pooled."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from types import MappingProxyType

from pyburgers.common.errors import InputError
from pyburgers.model.pooling import Pooling
from pyburgers.model.priors import FLOW_LAW, PriorSet
from pyburgers.model.variants import check_variant
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.program_data import plain_coordinates
from pyburgers.protocols.stan_data import PlainCoordinates


@dataclass(frozen=True)
class JointProblem:
    """Tests to be fitted together; made by `joint_problem`, which checks it.

    Attributes
    ----------
    experiments : tuple of ConstantRateExperiment
        At least one, with data, of different names. One alone is what is left where the other of
        two is left out; a partially pooled parameter still has centre and spread.
    given_priors : PriorSet
        For all tests, not resolved.
    priors : tuple of PriorSet
        Of each test, resolved; they differ only where a prior is a share of the largest stress.
    pooling : Pooling
        How the tests hang together.
    """

    experiments: tuple[ConstantRateExperiment, ...]
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
    def free(self) -> tuple[str, ...]:
        """Names of the parameters that are inferred in every test."""
        return self.priors[0].free

    @property
    def partial(self) -> tuple[str, ...]:
        """Names of the partially pooled ones among them."""
        return self.pooling.of_kind("partial", self.free)

    @property
    def shared(self) -> tuple[str, ...]:
        """Names of the shared ones among them."""
        return self.pooling.of_kind("shared", self.free)

    @property
    def coordinates(self) -> tuple[PlainCoordinates, ...]:
        """Plain coordinates of each test by itself; all stand for the same parameters."""
        return tuple(
            plain_coordinates(experiment, priors)
            for experiment, priors in zip(self.experiments, self.priors, strict=True)
        )


def joint_problem(
    experiments: Sequence[Experiment], priors: PriorSet, pooling: Pooling
) -> JointProblem:
    """Check tests, priors and pooling, and resolve the priors for each test.

    A prior that is a share of the largest stress takes that of the test, or of all tests where
    the parameter is shared.

    Parameters
    ----------
    experiments : sequence of Experiment
        Tests with data.
    priors : PriorSet
        Priors of every parameter, for all tests.
    pooling : Pooling
        How the tests hang together.

    Raises
    ------
    InputError
        If tests are of different materials or another protocol than constant_rate, have no data
        or the same name, or a pooling does not go with the priors.
    """
    suited = tuple(_suited(experiment, experiments[0], priors) for experiment in experiments)
    names = [experiment.id for experiment in suited]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f"{name}: stands {names.count(name)} times among the tests of a joint fit, "
                "expected different ones."
            )
    largest = [experiment.largest_stress for experiment in suited]
    common = priors.resolved(max(largest))
    resolved = tuple(
        _with_shared(priors.resolved(stress), common, pooling.of_kind("shared", priors.free))
        for stress in largest
    )
    problem = JointProblem(suited, priors, resolved, pooling)
    _check_pooling(problem)
    return problem


def _suited(experiment: Experiment, first: Experiment, priors: PriorSet) -> ConstantRateExperiment:
    """Return a test if it can take part in a joint fit."""
    if not isinstance(experiment, ConstantRateExperiment):
        raise InputError(
            f"{experiment.id}: is a test of the protocol {experiment.protocol}, expected "
            "constant_rate, the only one of joint fits."
        )
    if experiment.n_points == 0:
        raise InputError(f"{experiment.id}: the experiment has no data, expected a [data] table.")
    if experiment.material != first.material:
        raise InputError(
            f"{experiment.id}: is of the material {experiment.material}, expected "
            f"{first.material} like {first.id}, because a joint fit is of one material."
        )
    check_variant(priors, experiment)
    return experiment


def problem_without(problem: JointProblem, test: str) -> JointProblem:
    """Take a test out, and keep the prior densities of what is left.

    Where the prior of a shared parameter is a share of the largest stress, it stays that of all
    tests.

    Parameters
    ----------
    problem : JointProblem
        Of at least two tests.
    test : str
        Name of the test.
    """
    priors = _with_shared(problem.given_priors, problem.priors[0], problem.shared)
    kept = [experiment for experiment in problem.experiments if experiment.id != test]
    return joint_problem(kept, priors, problem.pooling)


def _with_shared(own: PriorSet, common: PriorSet, shared: Sequence[str]) -> PriorSet:
    """Priors of a test with those of shared parameters exchanged for those of all tests."""
    exchanged = {name: common[name] for name in shared}
    return replace(own, priors=MappingProxyType({**own.priors, **exchanged}))


def _check_pooling(problem: JointProblem) -> None:
    """Refuse pooling that has no meaning with the priors."""
    priors = problem.priors[0]
    replaced = problem.coordinates[0].replaced_parameter
    if replaced in problem.partial:
        raise InputError(
            f"--pool {replaced}=partial: the reference stress is sampled in its place, expected "
            "shared or separate."
        )
    if priors.flow_law is None:
        return
    kinds = {problem.pooling.kinds[name] for name in FLOW_LAW}
    if kinds not in ({"shared"}, {"separate"}):
        raise InputError(
            f"--pool: found {', '.join(f'{n}={problem.pooling.kinds[n]}' for n in FLOW_LAW)}, "
            "expected all shared or all separate because they have a joint prior."
        )
