"""How well joint fits predict a whole test that they have not seen, or fits of one test a part.

The density of a test given the others, its own parameters integrated out under their priors, is a
ratio of marginal likelihoods: that of all tests over that of all but this one. The joint fit is
repeated without each test for the latter. The same holds for parts of a single test, such as the
temperatures of a table of attenuation.
"""

from collections.abc import Mapping
from pathlib import Path

import numpy as np

from pyburgers.checks.prior_influence import read_off_sentences
from pyburgers.common.errors import InputError
from pyburgers.common.tasks import ALL_HERE, Workers
from pyburgers.comparison.marginal_likelihood import log_marginal_likelihood
from pyburgers.comparison.results import ComparisonByTest, LeaveOneTestOut
from pyburgers.comparison.same_data import (
    best_first,
    check_same_data,
    require_fits_by_name,
    sampling_doubts,
)
from pyburgers.fitting.campaign import Task, run_fits
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import require_whole
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.sampling.manifest import COMPLETE
from pyburgers.sampling.options import recorded_options
from pyburgers.sampling.run_directory import RunDirectory

LEFT_OUT_FOLDER = "leave_out"
"""Folder in a run of the fits without single tests, by their names."""

DOUBT = "its marginal likelihood may be off by more than the error says"
"""What a fit that was not sampled well means here."""


def compare_by_test(
    joints: Mapping[str, Fit],
    *,
    workers: Workers = ALL_HERE,
    command: str = "pyburgers.compare_by_test(...)",
) -> ComparisonByTest:
    """Compare joint fits of the same tests by how well they predict each from the others.

    Parameters
    ----------
    joints : mapping of str to Fit
        At least one, by name.
    workers : Workers
        Processes or executor for the fits without single tests.
    command : str
        Command that repeats those fits, for their manifests.

    Raises
    ------
    InputError
        If the fits are of different data, or one has no likelihood.
    SamplingError
        If a fit without a test fails.

    Examples
    --------
    >>> comparison = pyburgers.compare_by_test({"shared": joint, "separate": separate})
    """
    require_fits_by_name("joints", joints)
    fit_without_tests(joints, workers=workers, command=command)
    found = {name: _left_out(joint) for name, joint in joints.items()}
    return _ordered(found, joints)


def fit_without_tests(joints: Mapping[str, Fit], *, workers: Workers, command: str) -> None:
    """Repeat or continue joint fits without each test in ``leave_out/TEST``, priors the same."""
    for joint in joints.values():
        check_several_tests(joint)
    check_same_data(joints)
    run_fits(
        {
            folder: Task(
                joint.problem.without(test),
                recorded_options(joint.manifest["sampler"]),
                SolverOptions(**joint.manifest["solver"]),
                remark=f"({test} left out)",
            )
            for joint in joints.values()
            for test, folder in _folders_without(joint).items()
        },
        workers=workers,
        command=command,
    )


def compare_kept_by_test(joints: Mapping[str, Fit]) -> ComparisonByTest | None:
    """Compare joint fits by test where earlier fits left every test out; None if there are none."""
    check_same_data(joints)
    found = {}
    for name, joint in joints.items():
        if all(map(_is_complete, _folders_without(joint).values())):
            found[name] = _left_out(joint)
    return _ordered(found, joints) if found else None


def _ordered(found: Mapping[str, LeaveOneTestOut], joints: Mapping[str, Fit]) -> ComparisonByTest:
    """Put results in order, the best first, and weigh them."""
    variants = {name: joints[name].variant.short_text for name in found}
    return ComparisonByTest(*best_first(found), variants)


def _folders_without(joint: Fit) -> dict[str, Path]:
    """Run directories of the fits without each test."""
    above = joint.directory.path / LEFT_OUT_FOLDER
    return {test: above / test for test in sorted(joint.problem.parts)}


def _is_complete(folder: Path) -> bool:
    """Tell whether a fit is finished."""
    run = RunDirectory(folder)
    return run.manifest_file.is_file() and run.read_manifest().get("status") == COMPLETE


def check_several_tests(joint: Fit) -> None:
    """Raise `InputError` unless a test, or a part of a single one, can be left out of a fit."""
    require_whole(joint)
    if len(joint.problem.parts) < 2:
        raise InputError(
            f"{joint.directory.path}: is not a joint fit, it is a fit of {joint.problem.name} "
            "alone, expected at least two tests, or a test with parts, to leave one out."
        )


def _left_out(joint: Fit) -> LeaveOneTestOut:
    """Relate the marginal likelihood of all tests to that of all but each, from finished fits."""
    parts = joint.problem.parts
    tests = tuple(sorted(parts))
    all_tests = log_marginal_likelihood(joint)
    doubts = sampling_doubts(joint, joint.problem.name, DOUBT)
    without = []
    for test, folder in _folders_without(joint).items():
        others = Fit.load(folder)
        without.append(log_marginal_likelihood(others))
        same = others.problem.name == joint.problem.name
        name = f"{joint.problem.name} without {test}" if same else others.problem.name
        doubts += sampling_doubts(others, name, DOUBT)
    return LeaveOneTestOut(
        tests=tests,
        n_points=np.array([parts[test] for test in tests]),
        all_tests=all_tests,
        without=tuple(without),
        doubts=doubts,
        kind=joint.problem.parts_name,
        notes=read_off_sentences(joint.read_off),
    )
