"""Which fits are of the same data, how they are weighed, and what speaks against their draws."""

from collections.abc import Mapping, Sequence
from typing import Any, TypeVar

import numpy as np

from pyburgers.checks.fit_checks import CheckKind
from pyburgers.common.atomic_files import sha256_of_json
from pyburgers.common.draws import FloatArray
from pyburgers.common.errors import InputError, require_type
from pyburgers.comparison.results import LeaveOneOut, LeaveOneTestOut
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import A_FIT, SampledFit
from pyburgers.model.parameters import CONDITIONS
from pyburgers.model.variants import ModelVariant
from pyburgers.posterior.labelled_draws import MICROSTRUCTURE
from pyburgers.sampling.run import decisive

Result = TypeVar("Result", LeaveOneOut, LeaveOneTestOut)

STACKING_TOLERANCE = 1e-8
MAX_STACKING_STEPS = 100_000
"""Stacking weights are settled when a step changes none by more than the tolerance."""


def sampling_doubts(one: SampledFit, name: str, consequence: str) -> tuple[str, ...]:
    """Say which checks of its draws a fit of something failed, and what that means here."""
    made = [result for result in one.checks() if result.check.kind is CheckKind.SAMPLING]
    failed = [result.name for result in made if not result.passed]
    if not failed:
        return ()
    return (f"The fit of {name} failed its check of {' and '.join(failed)}: {consequence}.",)


def tests_of(one: Fit) -> tuple[Fit, ...]:
    """Return a fit as fits of its tests, in the order of their names."""
    return tuple(test for _, test in sorted(one.tests().items()))


def data_hash(one: Fit) -> str:
    """Hash of observed values and of where they were observed, in all tests."""
    if one.is_joint:
        return sha256_of_json({name: data_hash(test) for name, test in one.tests().items()})
    columns = {
        group: one.posterior[group].to_dataset().data_vars
        for group in ("observed_data", "constant_data")
    }
    if MICROSTRUCTURE in one.posterior.children:
        measured = one.posterior[MICROSTRUCTURE].to_dataset()[["measured", "error"]]
        columns[MICROSTRUCTURE] = measured.reset_coords().data_vars  # strains and times with them
    values = {
        group: {str(name): values.to_numpy().tolist() for name, values in variables.items()}
        for group, variables in columns.items()
    }
    return sha256_of_json(decisive(values))


def require_fits_by_name(argument: str, fits: Mapping[str, Fit]) -> None:
    """Refuse an argument that is no mapping of fits."""
    by_name = 'fits by name, such as {"shared": one, "separate": other}'
    require_type(argument, fits, Mapping, by_name)
    for name, one in fits.items():
        require_type(f"{argument}: {name}", one, Fit, A_FIT)


def check_same_data(fits: Mapping[str, Fit]) -> None:
    """Raise `InputError` if fits are of different data, or one has no likelihood."""
    (first, one), *others = fits.items()
    for name, other in fits.items():
        if not other.manifest["use_likelihood"]:
            raise InputError(f"{name}: was sampled without likelihood, expected a fit of its data.")
    wanted = data_hash(one)
    for name, other in others:
        if data_hash(other) != wanted:
            raise InputError(
                f"{name}: is a fit of other data than {first} ({_data_text(other)}, "
                f"{_data_text(one)}), expected fits of the same data."
            )


def fits_alone(joint: Fit, separate: Sequence[Fit]) -> dict[str, Fit | None]:
    """Return the first fit of the same data and laws, or None, for every test of a joint fit."""

    def compared(one: Fit) -> tuple[str, ModelVariant, frozenset[str]]:
        errors = CONDITIONS.intersection(one.posterior["posterior"].data_vars)
        return data_hash(one), one.variant, errors

    by_test = [(compared(other), other) for other in separate]
    found: dict[str, Fit | None] = {}
    for name, fit in joint.tests().items():
        wanted = compared(fit)
        found[name] = next((other for key, other in by_test if key == wanted), None)
    return found


def _data_text(one: Fit) -> str:
    """Say what a fit is of."""
    tests = tests_of(one)
    names = "+".join(test.experiment.id for test in tests)
    return f"{names} with {sum(test.experiment.n_points for test in tests)} points"


def origins(fits: Mapping[str, Fit], *, command: str) -> dict[str, Any]:
    """Return where the numbers of a comparison come from, with the command that regenerates it."""
    return {
        "command": command,
        "fits": {
            name: {
                "directory": one.directory.path.name,
                "fingerprint": one.manifest["fingerprint"],
                "variant": one.variant.record(),
                **({"pooling": one.problem.pooling.record()} if one.is_joint else {}),
            }
            for name, one in fits.items()
        },
        "data": data_hash(next(iter(fits.values()))),
    }


def best_first(found: Mapping[str, Result]) -> tuple[dict[str, Result], FloatArray]:
    """Return results in order of falling elpd, and their `stacking_weights`."""
    ordered = dict(sorted(found.items(), key=lambda item: -item[1].total))
    return ordered, stacking_weights(np.array([result.elpd for result in ordered.values()]))


def stacking_weights(elpd: FloatArray) -> FloatArray:
    """Return weights of a mixture, the best for its leave-one-out elpd (n_fits, n_points)."""
    # Any factor common to all fits at a point drops out.
    density = np.exp(elpd - elpd.max(axis=0))
    weights: FloatArray = np.full(len(elpd), 1.0 / len(elpd))
    # Expectation maximisation: the objective is concave and rises with every step.
    for _ in range(MAX_STACKING_STEPS):
        share = weights[:, np.newaxis] * density
        updated = (share / share.sum(axis=0)).mean(axis=1)
        settled = np.abs(updated - weights).max() < STACKING_TOLERANCE
        weights = updated
        if settled:
            break
    return weights
