"""The discrepancy of a law in a test that was not fitted: the same share of the response."""

from collections.abc import Collection, Mapping

import numpy as np
import xarray as xr

from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import Problem
from pyburgers.kinds.program_data import solve
from pyburgers.kinds.stan_data import REFERENCE_SOLVER
from pyburgers.model.parameters import STANDARD_VALUES
from pyburgers.model.read_quantities import BY_NOISE

NONE_HERE = " have none here, and their bands are too narrow."


def carry_discrepancy(
    values: Mapping[str, FloatArray], fitted: Problem, experiment: Experiment
) -> tuple[dict[str, FloatArray], list[str]]:
    """Return values with the discrepancy of a new test over its reading errors, and notes.

    A discrepancy stays the same share of the response, and correlates over the same share of the
    test. It is carried over only to quantities that the fit reads, because the misfit of another
    one depends on the law. It is a multiple of all noises, so others must have none. `values`
    (n_draws,): parameters by name (SI), the discrepancy as `draw_values` has it.
    """
    found = dict(values)
    if not values.get("discrepancy", np.zeros(1)).any():
        return found, []
    likelihood, first = likelihood_of(experiment), fitted.experiments[0]
    here, there = experiment.residual_correlation, first.residual_correlation
    known = _known_noises(fitted)
    unknown = [name for name in experiment.noises if name not in known]
    takes_one = "discrepancy" in experiment.laws.get("residuals", ("discrepancy",))
    alone = (
        "The fit knows the discrepancy of its law in readings of "
        f"{_names_of(known)} alone: new readings"
    )
    stays_apart = len(unknown) < len(experiment.noises) and all(
        experiment.noises[name] is None for name in unknown
    )
    if not (takes_one and stays_apart):
        found |= {
            name: np.full_like(values["discrepancy"], STANDARD_VALUES[name])
            for name in ("discrepancy", here)
        }
        why = (
            alone
            if takes_one
            else f"Tests of the protocol {experiment.protocol} take no discrepancy of the law: "
            "new readings"
        )
        return found, [f"{why}{NONE_HERE}"]
    at = np.unique(experiment.position) if experiment.n_points else likelihood.grid(experiment)
    mean = {name: float(own.mean()) for name, own in values.items()}
    solution = solve(experiment, {**mean, "discrepancy": 0.0}, at, solver=REFERENCE_SOLVER)
    squares = [
        (solution[f"grid_{one.name}"][places] / values[one.noise][:, np.newaxis]) ** 2
        for one, places in zip(likelihood.read, likelihood.is_read(experiment, at), strict=True)
        if places.any() and one.noise in known
    ]
    found["discrepancy"] = values["discrepancy"] * np.sqrt(
        np.mean(np.concatenate(squares, axis=1), axis=1)
    )
    if here != there:
        spans = [one.span[1] - one.span[0] for one in (experiment, first)]
        found[here] = values[there] * (spans[0] / spans[1])
        found[there] = np.full_like(values[there], STANDARD_VALUES[there])
    return found, [f"{alone} of {_names_of(unknown)}{NONE_HERE}"] if unknown else []


def _known_noises(fitted: Problem) -> set[str]:
    """Return the noises of what a fit reads."""
    return {name for test in fitted.experiments for name in test.noises}


def _names_of(noises: Collection[str]) -> str:
    return " and ".join(sorted(BY_NOISE[name].name for name in noises))


def discrepancy_sentences(
    experiment: Experiment,
    values: Mapping[str, FloatArray],
    fitted: Problem,
    predictions: xr.Dataset,
) -> list[str]:
    """Say how much of the variance of new readings the discrepancy makes, for each quantity read.

    `values` (n_draws,): parameters by name (SI), those of the draws with a solution.
    """
    discrepancy = values.get("discrepancy", np.zeros(1))
    if not discrepancy.any():
        return []
    likelihood, known = likelihood_of(experiment), _known_noises(fitted)
    at = predictions[likelihood.clock.name].to_numpy()
    said = []
    for one, places in zip(likelihood.read, likelihood.is_read(experiment, at), strict=True):
        if places.any() and one.noise in known:
            solved = all_draws(predictions[one.name]).astype(np.float64)[:, places]
            noise = values[one.noise]
            parts = np.array(
                [np.mean((discrepancy * noise) ** 2), solved.var(axis=0).mean(), np.mean(noise**2)]
            )
            shares = 100 * parts / parts.sum()
            size, whole = np.sqrt([parts[0], np.mean(solved**2)])
            said.append(
                f"The discrepancy of the law is carried over as a share of the {one.name}, "
                f"{100 * size / whole:.2g} %: {size * one.display_factor:.3g} {one.display_unit}. "
                f"It makes {shares[0]:.0f} % of the variance of new readings along the test, "
                f"parameters make {shares[1]:.0f} %, reading errors {shares[2]:.0f} %; bands of "
                "the solution hold parameters alone."
            )
    return said
