"""Which further test would decide a quantity, or between two laws: expected before it is done.

Draws of a fit are truths. Each is solved for a candidate test and read with noise, so that a
quantity and new readings have a joint distribution. The best linear estimator of the quantity from
the readings has a mean squared error that no posterior exceeds on average, whatever their joint
distribution. Estimators are made from some draws and judged on others.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Annotated

import numpy as np
import pandas as pd
from pydantic import Field
from scipy import linalg

from pyburgers.common.array_types import IntArray
from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.common.toml_files import NAME, Table, read_toml
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.prediction import Prediction
from pyburgers.kinds.conditions import conditions_of
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.kind import load_experiment
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.predictions.other_tests import answers, draws_of

FOLDS = 10
"""Parts of the draws; each is judged by what the others say."""

MOST_FEATURES = 12
"""Combinations of readings at most that an estimator uses: more fit the noise of the draws."""

LEAST_SIGNAL = 0.01
"""Variance, in that of the noise, below which a combination of readings tells nothing."""

LEAST_DRAWS = 200
"""Draws below which a design cannot be judged."""

SAME_SAMPLE = (
    "These widths assume that the new sample has the parameters of the fitted one; samples differ, "
    "so that a laboratory will find larger ones."
)

READINGS = 40
"""Readings of a candidate by default, evenly spaced along its clock."""


class _CandidateTable(Table):
    file: str = Field(description="an experiment file; it may be without [data]")
    readings: int = Field(READINGS, ge=1, le=200, description="how many readings, 1 to 200")
    hours: float | None = Field(None, gt=0, description="cost of the test in hours")
    stress_uncertainty_MPa: float | None = Field(  # noqa: N815 - keys with units
        None, gt=0, description="standard deviation of a new reading of stress"
    )
    strain_uncertainty: float | None = Field(
        None, gt=0, description="standard deviation of a new reading of strain, a fraction"
    )


class _LimitTable(Table):
    stress_MPa: float | None = Field(None, gt=0, description="largest stress of the apparatus")  # noqa: N815 - keys with units
    hours: float | None = Field(None, gt=0, description="hours that there are for one test")


class _PlanFile(Table):
    about: list[str] = Field(min_length=1, description="a list of parameters to be narrowed")
    candidates: dict[Annotated[str, Field(pattern=NAME)], _CandidateTable] = Field(
        min_length=1, description="a table of tables: each candidate by its name"
    )
    limits: _LimitTable | None = Field(None, description="limits of the apparatus")


@dataclass(frozen=True, eq=False)
class Candidate:
    """A test that may be done.

    Attributes
    ----------
    experiment : Experiment
        The test; its data, if there are any, are not used.
    n_readings : int
        Number of readings, evenly spaced along its clock.
    hours : float, optional
        Cost of the test.

    Examples
    --------
    >>> pyburgers.Candidate(test, hours=2.0).n_readings
    40
    """

    experiment: Experiment
    n_readings: int = READINGS
    hours: float | None = None


@dataclass(frozen=True, eq=False)
class DesignPlan:
    """Tests that may be done, and the parameters that they are to narrow.

    Attributes
    ----------
    about : tuple of str
        Parameters.
    candidates : mapping of str to Candidate
        By name.
    largest_stress : float, optional
        Of the apparatus, Pa.
    most_hours : float, optional
        For one test.

    Examples
    --------
    >>> plan = pyburgers.DesignPlan(("maxwell_modulus",), {"again": pyburgers.Candidate(test)})
    >>> plan.largest_stress is None
    True
    """

    about: tuple[str, ...]
    candidates: Mapping[str, Candidate]
    largest_stress: float | None = None
    most_hours: float | None = None


@dataclass(frozen=True, eq=False)
class Design:
    """Expected results of candidate tests.

    Attributes
    ----------
    table : DataFrame
        A row for each candidate: ``hours``, ``largest_stress_MPa`` (95 % of the draws stay below),
        ``beyond_limits`` (a sentence, or empty). ``PARAMETER_width`` is the expected standard
        deviation of a parameter over the present one. With another law, ``told_apart`` is the
        share of simulated tests that are given to the law behind them.
    together : DataFrame
        A row for each step: the ``candidate`` that narrows most beside those above it, and the
        widths after it.
    cautions : tuple of str
        Doubts about both fits and their predictions.

    Examples
    --------
    >>> plan = pyburgers.DesignPlan(("maxwell_modulus",), {"again": pyburgers.Candidate(test)})
    >>> pyburgers.design(fit, plan, draws=200).together["candidate"].tolist()
    ['again']
    """

    table: pd.DataFrame
    together: pd.DataFrame
    cautions: tuple[str, ...]


def load_design_plan(path: str | Path) -> DesignPlan:
    """Read a plan of candidate tests.

    Parameters
    ----------
    path : path
        TOML file; files of candidates are found from its folder.

    Returns
    -------
    DesignPlan

    Raises
    ------
    InputError
        If the plan or the file of a candidate is wrong.

    Examples
    --------
    >>> plan = pyburgers.load_design_plan(data / "designs" / "ice.toml")
    >>> list(plan.candidates)[:2]
    ['again', 'slower']
    """
    path = given_path(path)
    file = read_toml(path, _PlanFile)
    if unknown := [name for name in file.about if name not in PARAMETER_BY_NAME]:
        raise InputError(
            f"{path}: about: found {unknown[0]!r}, expected parameters such as "
            "'stress_exponent' or 'kelvin_modulus'."
        )
    limits = file.limits
    stress = limits.stress_MPa if limits else None
    return DesignPlan(
        tuple(file.about),
        {name: _candidate(path, name, one) for name, one in file.candidates.items()},
        None if stress is None else 1e6 * stress,
        limits.hours if limits else None,
    )


def _candidate(path: Path, name: str, table: _CandidateTable) -> Candidate:
    """Load the test of a candidate, with the uncertainties that the plan states."""
    experiment = load_experiment(path.parent / table.file)
    for key, unit in (("stress_uncertainty_MPa", 1e6), ("strain_uncertainty", 1.0)):
        stated, field = getattr(table, key), key.removesuffix("_MPa")
        if stated is None:
            continue
        if not hasattr(experiment, field):
            raise InputError(
                f"{path}: candidates.{name}: found {key}, expected none: {experiment.id} "
                f"({experiment.protocol}) has no such readings."
            )
        experiment = replace(experiment, **{field: unit * stated})
    return Candidate(experiment, table.readings, table.hours)


def design(
    fit: Fit,
    plan: DesignPlan,
    *,
    against: Fit | None = None,
    choose: int = 1,
    draws: int = 1000,
    seed: int = 1,
) -> Design:
    """Compare tests that may be done next, by what they are expected to tell.

    Parameters
    ----------
    fit : Fit
        The present knowledge.
    plan : DesignPlan
        Candidates, and the parameters to be narrowed.
    against : Fit, optional
        Fit of the same data with another law: how often would a candidate tell the laws apart?
    choose : int
        Number of candidates that are chosen one after the other.
    draws : int
        Draws of the fit that are solved for every candidate, at least 200.
    seed : int
        Of the noise of new readings.

    Returns
    -------
    Design

    Raises
    ------
    InputError
        If a parameter is fixed or not shared by the tests, draws are too few, or new readings
        have no noise.

    Examples
    --------
    >>> plan = pyburgers.DesignPlan(("maxwell_modulus",), {"again": pyburgers.Candidate(test)})
    >>> found = pyburgers.design(fit, plan, draws=200)
    >>> bool(found.table["maxwell_modulus_width"]["again"] < 1)
    True
    """
    if not plan.candidates:
        raise InputError("candidates: found none, expected at least one, as pyburgers.Candidate.")
    _check(fit, plan.about, draws)
    # Each candidate has noise of its own: with one seed, differences between tests would have none.
    seeds = dict(zip(plan.candidates, range(seed, seed + len(plan.candidates)), strict=True))
    predictions = {
        name: fit.predict(one.experiment, draws=draws, seed=seeds[name])
        for name, one in plan.candidates.items()
    }
    others = {
        name: against.predict(one.experiment, draws=draws, seed=seeds[name] + len(seeds))
        for name, one in plan.candidates.items()
        if against is not None
    }
    rows, features = dict[str, dict[str, float | str]](), dict[str, FloatArray]()
    kept = _common_draws(list(predictions.values()))
    first = next(iter(predictions.values())).posterior["posterior"].to_dataset()
    known = np.isin(first["fit_draw"].to_numpy(), kept)
    truths = {name: _scaled(first[name].to_numpy()[0, known]) for name in plan.about}
    for name, prediction in predictions.items():
        candidate = plan.candidates[name]
        signal, noisy = _readings(prediction, candidate.n_readings, kept)
        features[name] = telling_combinations(name, signal, noisy, signal)
        stress = _largest_stress(prediction)
        rows[name] = {
            "hours": np.nan if candidate.hours is None else candidate.hours,
            "largest_stress_MPa": 1e-6 * stress,
            "beyond_limits": _beyond(plan, candidate, stress),
            **_widths(truths, features[name]),
        }
        if name in others:
            other = others[name]
            every = _common_draws([other])
            other_signal, other_noisy = _readings(other, candidate.n_readings, every)
            both = np.vstack([noisy, other_noisy])
            told = telling_combinations(name, signal, both, np.vstack([signal, other_signal]))
            rows[name]["told_apart"] = share_told_apart(told, len(noisy))
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("candidate")
    within = [name for name, row in rows.items() if not row["beyond_limits"]]
    cautions = _cautions(fit, predictions)
    if against is not None:
        run = against.directory.path.name
        of_other = _cautions(against, others)
        cautions += [f"{run}: {one}" for one in of_other if one not in cautions]
    return Design(
        table,
        _one_after_the_other(truths, features, within, choose),
        (*cautions, SAME_SAMPLE),
    )


def _cautions(fit: Fit, predictions: Mapping[str, Prediction]) -> list[str]:
    """Return doubts about a fit, and those about its predictions by the candidate."""
    found = (
        one if one in fit.cautions else f"{name}: {one}"
        for name, prediction in predictions.items()
        for one in prediction.cautions
    )
    return [*dict.fromkeys(found)]


def _check(fit: Fit, about: Sequence[str], draws: int) -> None:
    """Check that all draws know the parameters of a new test of the same material."""
    problem = fit.problem
    for name in about:
        if name not in problem.free:
            raise InputError(
                f"{name}: is fixed in the fit or no parameter of it, expected one of "
                f"{', '.join(problem.free)}."
            )
        if not problem.is_single and name not in problem.shared:
            raise InputError(
                f"{name}: differs between the tests of the fit, expected a shared one."
            )
    if draws < LEAST_DRAWS:
        raise InputError(f"draws: found {draws}, expected at least {LEAST_DRAWS}.")


def _common_draws(predictions: Sequence[Prediction]) -> IntArray:
    """Numbers of the draws of a fit, from 0 through all chains, that have every solution."""
    kept = predictions[0].posterior["posterior"]["fit_draw"].to_numpy()
    for prediction in predictions[1:]:
        kept = np.intersect1d(kept, prediction.posterior["posterior"]["fit_draw"].to_numpy())
    if len(kept) < LEAST_DRAWS:
        raise InputError(
            f"draws: {len(kept)} of the fit have a solution in every candidate, expected at least "
            f"{LEAST_DRAWS}: leave out the most extreme candidates, or ask for more draws."
        )
    return np.asarray(kept)


def _readings(prediction: Prediction, n: int, kept: IntArray) -> tuple[FloatArray, FloatArray]:
    """Solutions and new readings for `kept` draws, each (n_kept, at most `n` readings)."""
    at = np.isin(prediction.posterior["posterior"]["fit_draw"].to_numpy(), kept)
    signals, readings = [], []
    for answer in answers(prediction):
        solved, new = draws_of(prediction, answer)
        places = np.flatnonzero(np.isfinite(new).all(axis=0))
        places = places[places_read(len(places), n)]
        signals.append(solved[at][:, places])
        readings.append(new[at][:, places])
    return np.hstack(signals), np.hstack(readings)


def places_read(number: int, n: int) -> IntArray:
    """Return which places a candidate is read at: at most `n`, evenly spaced, with the last."""
    return np.unique(np.linspace(number - 1, 0, n).round().astype(np.int64))


def telling_combinations(
    name: str, signal: FloatArray, readings: FloatArray, solutions: FloatArray
) -> FloatArray:
    """Combine `readings` (m, k) to (m, n_features) so that `solutions` (m, k) differ beyond noise.

    `signal` (n, k): solutions of the first n readings, whose differences are the noise.
    """
    noise = np.atleast_2d(np.cov((readings[: len(signal)] - signal).T))
    scale = np.sqrt(np.diag(noise))
    if not (scale > 0).all():
        raise InputError(
            f"{name}: new readings have no noise, because the fit has read no such quantity, "
            "expected strain_uncertainty or stress_uncertainty_MPa of the candidate in the plan."
        )
    # Correlated noise of many readings is near singular; a ten-thousandth keeps it invertible.
    correlation = noise / np.outer(scale, scale) + 1e-4 * np.eye(len(scale))
    half = linalg.cholesky(correlation, lower=True)
    white = linalg.solve_triangular(half, ((solutions - solutions.mean(0)) / scale).T, lower=True)
    directions, sizes, _ = linalg.svd(white, full_matrices=False)
    telling = min(MOST_FEATURES, int(np.sum(sizes**2 / len(solutions) > LEAST_SIGNAL)))
    seen = linalg.solve_triangular(half, ((readings - solutions.mean(0)) / scale).T, lower=True)
    return np.asarray((directions[:, :telling].T @ seen).T)


def _scaled(values: FloatArray) -> FloatArray:
    """Logarithms of values that are all positive, else the values."""
    return np.log(values) if (values > 0).all() else values


def _widths(truths: Mapping[str, FloatArray], features: FloatArray) -> dict[str, float]:
    """Root mean squared error of each quantity over its present standard deviation, at most 1."""
    return {f"{name}_width": expected_width(values, features) for name, values in truths.items()}


def expected_width(truth: FloatArray, features: FloatArray) -> float:
    """Error of the linear estimator of `truth` (n,) from `features` (n, k), over the sd."""
    design = np.column_stack([np.ones(len(truth)), features])
    errors = np.empty(len(truth))
    for fold in range(FOLDS):
        judged = np.arange(len(truth)) % FOLDS == fold
        coefficients, *_ = linalg.lstsq(design[~judged], truth[~judged])
        errors[judged] = truth[judged] - design[judged] @ coefficients
    return min(1.0, float(np.sqrt(np.mean(errors**2)) / truth.std()))


def share_told_apart(features: FloatArray, n_first: int) -> float:
    """Share of rows of `features` (n, k), `n_first` of one law, given to the right one of two."""
    number = np.r_[np.arange(n_first), np.arange(len(features) - n_first)]
    is_first = np.arange(len(features)) < n_first
    right = np.empty(len(features), bool)
    for fold in range(FOLDS):
        judged = number % FOLDS == fold
        first, second = (
            _log_normal_density(features[judged], features[~judged & of_law])
            for of_law in (is_first, ~is_first)
        )
        right[judged] = (first > second) == is_first[judged]
    return 0.5 * float(right[is_first].mean() + right[~is_first].mean())


def _log_normal_density(at: FloatArray, drawn: FloatArray) -> FloatArray:
    """Log density at rows of `at`, up to a constant, of the normal distribution of `drawn`."""
    factor = linalg.cholesky(np.atleast_2d(np.cov(drawn.T)), lower=True)
    white = linalg.solve_triangular(factor, (at - drawn.mean(0)).T, lower=True)
    return np.asarray(-0.5 * np.sum(white**2, axis=0) - np.sum(np.log(np.diag(factor))))


def _largest_stress(prediction: Prediction) -> float:
    """Stress (Pa) exceeded in 5 % of the draws, or that a table of cycles states, if it does."""
    solved = prediction.posterior["predictions"].to_dataset()
    if "stress" not in solved:
        stated = conditions_of(prediction.experiment, prediction.posterior)
        return stated.get("stress", (0.0, np.nan))[1]
    stress = np.abs(all_draws(solved["stress"]))
    return float(np.quantile(stress.max(axis=1), 0.95))


def _beyond(plan: DesignPlan, candidate: Candidate, stress: float) -> str:
    """Say which limit of the apparatus a candidate exceeds; nothing if none."""
    if plan.largest_stress is not None and stress > plan.largest_stress:
        return f"stress above {1e-6 * plan.largest_stress:.3g} MPa"
    if plan.most_hours is not None and (candidate.hours or 0) > plan.most_hours:
        return f"longer than {plan.most_hours:.3g} h"
    return ""


def _one_after_the_other(
    truths: Mapping[str, FloatArray],
    features: Mapping[str, FloatArray],
    within: Sequence[str],
    choose: int,
) -> pd.DataFrame:
    """Choose candidates: each time the least mean of log widths, together with those chosen."""
    chosen, rows = list[str](), []
    while len(chosen) < min(choose, len(within)):
        found = {
            name: _widths(truths, np.hstack([features[one] for one in (*chosen, name)]))
            for name in within
            if name not in chosen
        }
        best = min(found, key=lambda name: float(np.mean(np.log([*found[name].values()]))))
        chosen.append(best)
        rows.append({"candidate": best, **found[best]})
    return pd.DataFrame(rows)
