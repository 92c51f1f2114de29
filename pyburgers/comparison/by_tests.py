"""How well joint fits predict a whole test that they have not seen, or fits of one test a part.

The density of a test given the others, its own parameters integrated out under their priors, is a
ratio of marginal likelihoods: that of all tests over that of all but this one. The joint fit is
repeated without each test for the latter. The same holds for parts of a single test, such as the
temperatures of a table of attenuation.
"""

import logging
from collections.abc import Callable, Mapping
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pyburgers.checks.fit_checks import CheckKind
from pyburgers.common.errors import InputError
from pyburgers.comparison.marginal_likelihood import log_marginal_likelihood
from pyburgers.comparison.results import ComparisonByTest, LeaveOneTestOut
from pyburgers.comparison.same_data import check_same_data, stacking_weights
from pyburgers.fitting.fit import Fit, fit_problem
from pyburgers.protocols.stan_data import SolverOptions
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory

logger = logging.getLogger(__name__)

FloatArray = npt.NDArray[np.float64]
IntArray = npt.NDArray[np.int64]

LEFT_OUT_FOLDER = "leave_out"
"""Folder in a run of the fits without single tests, by their names."""


def compare_by_test(
    joints: Mapping[str, Fit], *, command: str = "pyburgers.compare_by_test(...)"
) -> ComparisonByTest:
    """Compare joint fits of the same tests by how well they predict each from the others.

    Parameters
    ----------
    joints : mapping of str to Fit
        At least one, by name.
    command : str
        What regenerates the fits without single tests, for their manifests.

    Raises
    ------
    InputError
        If the fits are of different data, or one has no likelihood.
    SamplingError
        If a fit without a test fails.
    """
    for joint in joints.values():
        check_several_tests(joint)
    check_same_data(joints)
    found = {name: leave_one_test_out(joint, command=command) for name, joint in joints.items()}
    return _ordered(found, joints)


def compare_kept_by_test(joints: Mapping[str, Fit]) -> ComparisonByTest | None:
    """Compare those joint fits by test for which an earlier comparison left every test out.

    Parameters
    ----------
    joints
        As for `compare_by_test`.

    Returns
    -------
    ComparisonByTest or None
        Of the fits without single tests in the run directories, None where there are none. Nothing
        is fitted.
    """
    check_same_data(joints)
    found = {}
    for name, joint in joints.items():
        kept = _kept_without(joint)
        if kept is not None:
            found[name] = _left_out(joint, kept.__getitem__)
    return _ordered(found, joints) if found else None


def _ordered(found: Mapping[str, LeaveOneTestOut], joints: Mapping[str, Fit]) -> ComparisonByTest:
    """Put results in order, the best first, and weigh them."""
    ordered = dict(sorted(found.items(), key=lambda item: -item[1].total))
    return ComparisonByTest(
        results=ordered,
        weights=stacking_weights(np.array([result.elpd for result in ordered.values()])),
        variants={name: joints[name].variant.short_text for name in ordered},
    )


def _kept_without(joint: Fit) -> Mapping[str, Fit] | None:
    """Return the finished fits without each test, None where one is missing."""
    folders = {test: joint.directory.path / LEFT_OUT_FOLDER / test for test in joint.problem.parts}
    for folder in folders.values():
        run = RunDirectory(folder)
        if not run.manifest_file.is_file() or run.read_manifest().get("status") != "complete":
            return None
    return {test: Fit.load(folder) for test, folder in folders.items()}


def check_several_tests(joint: Fit) -> None:
    """Check that a test, or a part of a single one, can be left out of a fit.

    Raises
    ------
    InputError
        If it is of one test without parts.
    """
    if len(joint.problem.parts) < 2:
        raise InputError(
            f"{joint.directory.path}: is not a joint fit, it is a fit of {joint.problem.name} "
            "alone, expected at least two tests, or a test with parts, to leave one out."
        )


def leave_one_test_out(
    joint: Fit, *, command: str = "pyburgers.comparison.by_tests.leave_one_test_out(...)"
) -> LeaveOneTestOut:
    """Leave each test of a joint fit out in turn, fitting again without it.

    The fits are in ``leave_out/TEST`` in the run directory; those that are there are continued.

    Parameters
    ----------
    joint : Fit
        Of at least two tests, with their data.
    command
        As for `compare_by_test`, which says what is raised.
    """
    check_several_tests(joint)

    def again(test: str) -> Fit:
        logger.info(f"{joint.directory.path.name}: fitting again without {test}.")
        out = joint.directory.path / LEFT_OUT_FOLDER / test
        return fit_without(joint, test, out, command=command)

    return _left_out(joint, again)


def _left_out(joint: Fit, fit_others: Callable[[str], Fit]) -> LeaveOneTestOut:
    """Relate the marginal likelihood of all tests to that of all but each.

    Parameters
    ----------
    joint : Fit
        Of at least two tests.
    fit_others : callable
        Receives the name of a test, returns the fit without it.
    """
    parts = joint.problem.parts
    tests = tuple(sorted(parts))
    all_tests = log_marginal_likelihood(joint)
    doubts = _doubts(joint, joint.problem.name)
    without = []
    for test in tests:
        others = fit_others(test)
        without.append(log_marginal_likelihood(others))
        same = others.problem.name == joint.problem.name
        name = f"{joint.problem.name} without {test}" if same else others.problem.name
        doubts += _doubts(others, name)
    return LeaveOneTestOut(
        tests=tests,
        n_points=np.array([parts[test] for test in tests]),
        all_tests=all_tests,
        without=tuple(without),
        doubts=doubts,
        kind=joint.problem.parts_name,
    )


def fit_without(joint: Fit, test: str, out: Path, *, command: str) -> Fit:
    """Repeat a joint fit without one of its tests, with the same prior densities of what is left.

    Parameters
    ----------
    joint : Fit
        A joint fit.
    test : str
        Name of the test.
    out : Path
        Run directory.
    command : str
        What regenerates it, for the manifest.

    Raises
    ------
    InputError
        If `out` holds something else.
    SamplingError
        If no chain finished.
    """
    solver = joint.manifest["solver"]
    return fit_problem(
        joint.problem.without(test),
        out=out,
        options=SamplerOptions(**joint.manifest["sampler"]),
        solver=SolverOptions(solver["tolerance"], solver["max_num_steps"]),
        command=f"{command} ({test} left out)",
    )


def _doubts(joint: Fit, name: str) -> tuple[str, ...]:
    """Say which checks of its draws a fit failed."""
    failed = [
        result.name
        for result in joint.checks()
        if not result.passed and result.check.kind is CheckKind.SAMPLING
    ]
    if not failed:
        return ()
    return (
        f"The fit of {name} failed its check of {' and '.join(failed)}: its "
        "marginal likelihood may be off by more than the error says.",
    )
