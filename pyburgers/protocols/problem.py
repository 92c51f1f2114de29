"""What is fitted: tests of one material and protocol, their priors, and how they are pooled."""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
import numpy.typing as npt

from pyburgers.common.errors import InputError
from pyburgers.model.parameters import Parameter
from pyburgers.model.pooling import SEPARATE, Pooling
from pyburgers.model.priors import FLOW_LAW, PriorSet
from pyburgers.model.variants import check_variant
from pyburgers.protocols.coordinates import Layout, Mode, PlainCoordinates, layout_of
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.protocol import Protocol, protocol_of

FloatArray = npt.NDArray[np.float64]


@dataclass(frozen=True)
class Problem:
    """One or several tests to be fitted; made by `problem_of`, which checks it.

    Attributes
    ----------
    experiments : tuple of Experiment
        At least one, with data, of different names.
    given_priors : PriorSet
        For all tests, not resolved.
    priors : tuple of PriorSet
        Of each test, resolved; they differ only where a prior is a share of the largest stress.
    pooling : Pooling
        How the tests hang together; a partially pooled parameter has centre and spread even where
        one test alone is left.
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
    def protocol(self) -> Protocol[Any]:
        """Of all tests."""
        return protocol_of(self.experiments[0])

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

    @cached_property
    def layout(self) -> Layout:
        """Which coordinate stands for what."""
        return layout_of(
            self.free,
            len(self.experiments),
            self.pooling,
            [experiment.n_driving_errors for experiment in self.experiments],
        )

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

    def without(self, test: str) -> "Problem":
        """Take a test out, and keep the prior densities of what is left.

        Where the prior of a shared parameter is a share of the largest stress, it stays that of
        all tests.

        Parameters
        ----------
        test : str
            Name of one of at least two tests.
        """
        priors = _with_shared(self.given_priors, self.priors[0], self.shared)
        kept = [experiment for experiment in self.experiments if experiment.id != test]
        return problem_of(kept, priors, self.pooling)


@dataclass(frozen=True, eq=False)
class ProblemMode:
    """The highest density found of a problem.

    Attributes
    ----------
    tests : tuple of Mode
        Values of each test, and its plain coordinates by itself.
    coordinate : array, shape (n_coordinates,)
        Plain coordinates of all tests together.
    """

    tests: tuple[Mode, ...]
    coordinate: FloatArray


def one_test(experiment: Experiment, priors: PriorSet) -> Problem:
    """Return a test by itself with its resolved priors; nothing is checked, it may lack data."""
    return Problem((experiment,), priors, (priors,), SEPARATE)


def problem_of(
    experiments: Sequence[Experiment], priors: PriorSet, pooling: Pooling = SEPARATE
) -> Problem:
    """Check tests, priors and pooling, and resolve the priors for each test.

    A prior that is a share of the largest stress takes that of the test, or of all tests where
    the parameter is shared.

    Parameters
    ----------
    experiments : sequence of Experiment
        Tests with data.
    priors : PriorSet
        Priors of every parameter, for all tests.
    pooling : Pooling, optional
        How the tests hang together; default not at all.

    Raises
    ------
    InputError
        If tests are of different materials or protocols, have no data or the same name, or a
        pooling does not go with the priors.
    """
    names = [experiment.id for experiment in experiments]
    for name in names:
        if names.count(name) > 1:
            raise InputError(
                f"{name}: stands {names.count(name)} times among the tests of a joint fit, "
                "expected different ones."
            )
    for experiment in experiments:
        _check_test(experiment, experiments[0], priors)
    largest = [experiment.largest_stress for experiment in experiments]
    of_tests = protocol_of(experiments[0]).priors_of(experiments, priors)
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


def plain_coordinates(experiment: Experiment, priors: PriorSet) -> PlainCoordinates:
    """Choose origin and size of every free parameter and what the reference quantity replaces."""
    protocol = protocol_of(experiment)
    return coordinates_through(priors, protocol.reference, *protocol.reference_origin(experiment))


def coordinates_through(
    priors: PriorSet, reference: Parameter, origin: float, size: float
) -> PlainCoordinates:
    """Choose plain coordinates of free parameters, a point of the flow law among them.

    It replaces Q_M, or beta where Q_M cannot be replaced: a parameter with two finite bounds
    keeps its own coordinate, because its bounds would cut the replaced one obliquely.

    Parameters
    ----------
    priors : PriorSet
        Resolved priors.
    reference : Parameter
        The point: one of `pyburgers.model.parameters.REFERENCE_QUANTITIES`.
    origin, size : float
        Of its logarithm.
    """
    replaced = next(
        (
            name
            for name in ("activation_enthalpy", "beta")
            if not priors[name].is_fixed
            and not (np.isfinite(priors[name].lower) and np.isfinite(priors[name].upper))
        ),
        None,
    )
    rows = []
    for name in priors.free:
        prior = priors[name]
        if name == replaced:
            rows.append((reference.name, origin, size, -np.inf, np.inf))
        elif prior.family == "lognormal":
            # Its scale is that of the logarithm; the median sets the size.
            rows.append((name, 0.0, prior.location, prior.lower, prior.upper))
        else:
            rows.append((name, prior.location, prior.scale, prior.lower, prior.upper))
    quantities = tuple(row[0] for row in rows)
    numbers = np.array([row[1:] for row in rows], dtype=np.float64).reshape(len(rows), 4)
    return PlainCoordinates(quantities, tuple(priors.free), *numbers.T)


def _check_test(experiment: Experiment, first: Experiment, priors: PriorSet) -> None:
    """Check that a test can be fitted, together with a first one."""
    if experiment.n_points == 0:
        raise InputError(f"{experiment.id}: the experiment has no data, expected a [data] table.")
    for what, found, expected in (
        ("protocol", experiment.protocol, first.protocol),
        ("material", experiment.material, first.material),
    ):
        if found != expected:
            raise InputError(
                f"{experiment.id}: is of the {what} {found}, expected {expected} like {first.id}, "
                f"because a joint fit is of one {what}."
            )
    check_variant(priors, experiment)
    protocol_of(experiment).check_priors(experiment, priors)
    _check_not_in_prior(experiment, priors)


def _check_not_in_prior(experiment: Experiment, priors: PriorSet) -> None:
    """Refuse a flow law as prior that the test itself has gone into."""
    test = protocol_of(experiment).peak_test(experiment)
    if test is None or priors.flow_law is None:
        return
    for row in priors.flow_law.tests:
        if row.may_be(test):
            raise InputError(
                f"{experiment.id}: may be the test with {row} that its prior of the flow law was "
                "fitted to, expected a flow law from other tests (pyburgers fit-peak-stress "
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
        raise InputError(
            f"--pool {replaced}=partial: the {problem.protocol.reference.label} is sampled in its "
            "place, expected shared or separate."
        )
    if priors.flow_law is None:
        return
    kinds = {problem.pooling.kinds[name] for name in FLOW_LAW}
    if kinds not in ({"shared"}, {"separate"}):
        raise InputError(
            f"--pool: found {', '.join(f'{n}={problem.pooling.kinds[n]}' for n in FLOW_LAW)}, "
            "expected all shared or all separate because they have a joint prior."
        )
