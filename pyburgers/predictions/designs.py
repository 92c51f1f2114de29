"""Which further test would decide a quantity, or between two laws: expected before it is done.

Draws of a fit are truths. Each is solved for a candidate test and read with noise, so that a
quantity and new readings have a joint distribution. An estimator of the quantity from the readings
has a mean squared error that no posterior exceeds on average, whatever their joint distribution.
Estimators are made from some draws, with their noise, and judged on others. As in a joint fit with
default pooling, the new sample shares flow law and moduli with the fitted one, and has a
microstructure of its own.
"""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral
from types import NoneType

import numpy as np
import pandas as pd
from scipy import linalg

from pyburgers.checks.prior_influence import OF_NOISE
from pyburgers.common.array_types import BoolArray, IntArray
from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.common.errors import InputError, require_type
from pyburgers.comparison.same_data import check_same_data
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.prediction import Prediction
from pyburgers.fitting.sampled_fit import A_FIT
from pyburgers.kinds.conditions import conditions_of, doubts, hours_of
from pyburgers.predictions.design_plans import UNCERTAINTIES, Candidate, DesignPlan
from pyburgers.predictions.other_tests import answers, draws_of
from pyburgers.sampling.options import LIMITS

FOLDS = 10
"""Parts of the draws; each is judged by what the others say."""

MOST_FEATURES = 12
"""Combinations of readings at most that an estimator uses: more fit the noise of the draws."""

LEAST_SIGNAL = 0.01
"""Variance, in that of the noise, below which a combination of readings tells nothing."""

FAR = 3.0
"""Standard deviations from the middle within which readings count as they are."""

STRONG_SIGNAL = 1.0
"""Variance, in that of the noise, above which a combination of readings also enters in products."""

ROUNDED_HOURS = 0.9
"""Share of the length of a test from which on hours that a plan states are rounded ones."""

LEAST_DRAWS = 200
"""Draws below which a design cannot be judged."""

SAME_MATERIAL = (
    "These widths assume that the new sample has the flow law and moduli of the fitted one, and a "
    "microstructure of its own; samples differ, so that a laboratory will find larger ones."
)


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

    Raises
    ------
    InputError
        If a parameter is fixed or not shared by the tests, draws are too few, or new readings
        have no noise. Likewise if `against` is the same fit or one of other data.

    Examples
    --------
    >>> plan = pyburgers.DesignPlan(("maxwell_modulus",), {"again": pyburgers.Candidate(test)})
    >>> found = pyburgers.design(fit, plan, draws=200)
    >>> bool(found.table["maxwell_modulus_width"]["again"] < 1)
    True
    """
    _check_types(fit, plan, against, {"draws": draws, "choose": choose, "seed": seed})
    _check(fit, plan.about, draws)
    most = LIMITS["seed"][1] - 2 * len(plan.candidates)
    if not 0 <= seed <= most:
        raise InputError(f"seed is {seed}, expected a number from 0 to {most} (option --seed).")
    if against is not None:
        _check_other_law(fit, against)
    # Each candidate has noise of its own: with one seed, differences between tests would have none.
    seeds = dict(zip(plan.candidates, range(seed, seed + len(plan.candidates)), strict=True))
    predictions = {
        name: fit.predict(one.experiment, draws=draws, new_sample=True, seed=seeds[name])
        for name, one in plan.candidates.items()
    }
    others = dict[str, Prediction]()
    rows, features = dict[str, dict[str, float | str]](), dict[str, list[FloatArray]]()
    kept = _common_draws(list(predictions.values()))
    fitted = next(iter(fit.tests().values())).posterior["posterior"].to_dataset()
    truths = {name: _scaled(all_draws(fitted[name])[kept]) for name in plan.about}
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
        if against is not None:
            others[name] = other = against.predict(
                candidate.experiment, draws=draws, new_sample=True, seed=seeds[name] + len(seeds)
            )
            every = _common_draws([other])
            other_signal, other_noisy = _readings(other, candidate.n_readings, every)
            both = np.vstack([noisy, other_noisy])
            told = telling_combinations(name, signal, both, np.vstack([signal, other_signal]))
            rows[name]["told_apart"] = share_told_apart(told, len(noisy))
    table = pd.DataFrame.from_dict(rows, orient="index").rename_axis("candidate")
    within = [name for name, row in rows.items() if not row["beyond_limits"]]
    cautions = [*_cautions_of_plan(plan, predictions), *_cautions(fit, predictions)]
    if against is not None:
        run = against.directory.path.name
        of_other = _cautions(against, others)
        cautions += [f"{run}: {one}" for one in of_other if one not in cautions]
    return Design(
        table,
        _one_after_the_other(truths, features, within, choose),
        (*cautions, SAME_MATERIAL),
    )


def _check_types(
    fit: Fit, plan: DesignPlan, against: Fit | None, numbers: Mapping[str, int]
) -> None:
    """Refuse arguments of another type, and a plan without candidates."""
    require_type("fit", fit, Fit, A_FIT)
    require_type("plan", plan, DesignPlan, "a plan, as of pyburgers.load_design_plan")
    require_type("against", against, (Fit, NoneType), A_FIT)
    for name, number in numbers.items():
        require_type(name, number, Integral, "a whole number")
    if not plan.candidates:
        raise InputError("candidates: found none, expected at least one, as pyburgers.Candidate.")
    for name, one in plan.candidates.items():
        require_type(f"candidates: {name}", one, Candidate, "a pyburgers.Candidate")


def _check_other_law(fit: Fit, against: Fit) -> None:
    """Refuse a fit from which the other cannot be told apart by its law alone."""
    first, second = (one.directory.path for one in (fit, against))
    if first.resolve() == second.resolve():
        raise InputError(
            f"--against {second}: found the run itself, expected a fit of the same data with "
            "another law."
        )
    check_same_data({str(first): fit, str(second): against})


def _cautions_of_plan(plan: DesignPlan, predictions: Mapping[str, Prediction]) -> list[str]:
    """Return doubts about tests and about what the plan states of them."""
    found = list[str]()
    for name, candidate in plan.candidates.items():
        test, drawn = candidate.experiment, predictions[name].posterior["posterior"].to_dataset()
        found += (f"{name}: {one}" for one in doubts(test.to_be_solved()))
        for key in UNCERTAINTIES:
            noise = f"{key.partition('_')[0]}_noise"
            stated = test.noises.get(noise)
            if stated and not np.allclose(drawn[noise], stated):
                found.append(
                    f"{name}: {key} is not used, because new readings have the noise of the fit."
                )
        for answer in answers(predictions[name]):
            n_places = len(_places(draws_of(predictions[name], answer)[1]))
            if n_places < candidate.n_readings:
                found.append(
                    f"{name}: readings is {candidate.n_readings}, but {answer.shown.name} is "
                    f"solved at {n_places} places, which are all read."
                )
        lasts = hours_of(test)
        if candidate.hours is not None and candidate.hours < ROUNDED_HOURS * lasts:
            found.append(
                f"{name}: hours is {candidate.hours:.3g}, but the test lasts {lasts:.3g} h."
            )
    return found


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
        if name in OF_NOISE:
            raise InputError(
                f"{name}: is a parameter of the residuals, expected one of the flow law, the "
                "moduli or the microstructure."
            )
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
    of_fit = next(iter(fit.tests().values())).posterior["posterior"].sizes
    if (kept := of_fit["chain"] * of_fit["draw"]) < LEAST_DRAWS:
        raise InputError(
            f"{fit.directory.path}: found {kept} draws, expected at least {LEAST_DRAWS}; fit again."
        )


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
    """Solutions and new readings for `kept` draws, each (n_kept, at most `n` a quantity)."""
    at = np.isin(prediction.posterior["posterior"]["fit_draw"].to_numpy(), kept)
    signals, readings = [], []
    for answer in answers(prediction):
        solved, new = draws_of(prediction, answer)
        places = _places(new)
        places = places[places_read(len(places), n)]
        signals.append(solved[at][:, places])
        readings.append(new[at][:, places])
    return np.hstack(signals), np.hstack(readings)


def _places(new: FloatArray) -> IntArray:
    """Places at which all draws of new readings (n_draws, n) have one."""
    return np.flatnonzero(np.isfinite(new).all(axis=0))


def places_read(number: int, n: int) -> IntArray:
    """Return which places a candidate is read at: at most `n`, evenly spaced, with the last."""
    return np.unique(np.linspace(number - 1, 0, n).round().astype(np.int64))


def telling_combinations(
    name: str, signal: FloatArray, readings: FloatArray, solutions: FloatArray
) -> list[FloatArray]:
    """Combine `readings` (m, k) to (m, n_features) so that `solutions` (m, k) differ beyond noise.

    `signal` (n, k): solutions of the first n readings, whose differences are the noise. Readings
    are taken by their logarithm where they lie far out: a few draws would hide what all others say.
    Each of `FOLDS` has combinations of its own, made from the draws that it does not judge.
    """
    if not (np.ptp(readings[: len(signal)] - signal, axis=0) > 0).all():
        raise InputError(
            f"{name}: new readings have no noise, because the fit has read no such quantity, "
            "expected strain_uncertainty or stress_uncertainty_MPa of the candidate in the plan."
        )
    low, middle, high = np.quantile(readings, (0.16, 0.5, 0.84), axis=0)
    far = FAR * (high - low) / 2
    signal, readings, solutions = (
        np.arcsinh((one - middle) / far) for one in (signal, readings, solutions)
    )
    noise = readings[: len(signal)] - signal
    return [
        _combined(noise[~judged[: len(noise)]], readings, solutions[~judged])
        for judged in _judged(len(readings), len(noise))
    ]


def _judged(number: int, n_first: int) -> Iterator[BoolArray]:
    """Which of `number` rows, of which `n_first` are of one law, each fold judges."""
    draw = np.r_[np.arange(n_first), np.arange(number - n_first)]
    return (draw % FOLDS == fold for fold in range(FOLDS))


def _combined(noise: FloatArray, readings: FloatArray, solutions: FloatArray) -> FloatArray:
    """Combine `readings` (m, k) so that `solutions` (n, k) differ most against `noise` (n', k)."""
    scale, middle = noise.std(axis=0), solutions.mean(axis=0)
    half = linalg.cholesky(_correlation((noise - noise.mean(axis=0)) / scale), lower=True)
    white = linalg.solve_triangular(half, ((solutions - middle) / scale).T, lower=True)
    directions, sizes, _ = linalg.svd(white, full_matrices=False)
    telling = min(MOST_FEATURES, int(np.sum(sizes**2 / len(solutions) > LEAST_SIGNAL)))
    seen = linalg.solve_triangular(half, ((readings - middle) / scale).T, lower=True)
    return np.asarray((directions[:, :telling].T @ seen).T)


def _correlation(noise: FloatArray) -> FloatArray:
    """Correlation of standardized `noise` (n, k), nearer to none where few draws tell it.

    As far as in Schäfer and Strimmer (2005, doi:10.2202/1544-6115.1175). The correlation of many
    readings is near singular; a ten-thousandth keeps it invertible.
    """
    found = noise.T @ noise / len(noise)
    spread = ((noise**2).T @ noise**2 / len(noise) - found**2) / len(noise)
    apart = ~np.eye(len(found), dtype=bool)
    share = min(1.0, float(spread[apart].sum() / max(np.sum(found[apart] ** 2), 1e-300)))
    return (1.0 - share) * found + (share + 1e-4) * np.eye(len(found))


def _scaled(values: FloatArray) -> FloatArray:
    """Logarithms of values that are all positive, else the values."""
    return np.log(values) if (values > 0).all() else values


def _widths(truths: Mapping[str, FloatArray], features: Sequence[FloatArray]) -> dict[str, float]:
    """Root mean squared error of each quantity over its present standard deviation, at most 1."""
    return {f"{name}_width": expected_width(values, features) for name, values in truths.items()}


def expected_width(truth: FloatArray, features: Sequence[FloatArray]) -> float:
    """Error of an estimator of `truth` (n,) from `features` of each fold (n, k), over the sd.

    It is linear in the features, or in them and products of the strong ones, whichever errs less:
    a sample with a microstructure of its own makes the best estimator a curve. At most 1.
    """
    errors = (_errors_when_judged(truth, features, curved) for curved in (False, True))
    return min(1.0, *(float(np.sqrt(np.mean(one**2)) / truth.std()) for one in errors))


def _errors_when_judged(
    truth: FloatArray, features: Sequence[FloatArray], curved: bool
) -> FloatArray:
    """Errors of the best sum of terms of `features` for `truth` (n,), each fold by the others."""
    errors = np.empty(len(truth))
    for judged, one in zip(_judged(len(truth), len(truth)), features, strict=True):
        strong = one[:, one.var(axis=0) > 1.0 + STRONG_SIGNAL]
        first, second = np.triu_indices(strong.shape[1] if curved else 0)
        terms = np.column_stack([np.ones(len(truth)), one, strong[:, first] * strong[:, second]])
        coefficients, *_ = linalg.lstsq(terms[~judged], truth[~judged])
        errors[judged] = truth[judged] - terms[judged] @ coefficients
    return errors


def share_told_apart(features: Sequence[FloatArray], n_first: int) -> float:
    """Share of rows of `features` (n, k), `n_first` of one law, given to the right one of two."""
    is_first = np.arange(len(features[0])) < n_first
    right = np.empty(len(is_first), bool)
    for judged, one in zip(_judged(len(is_first), n_first), features, strict=True):
        first, second = (
            _log_normal_density(one[judged], one[~judged & of_law])
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
    if (
        plan.most_hours is not None
        and max(candidate.hours or 0, hours_of(candidate.experiment)) > plan.most_hours
    ):
        return f"longer than {plan.most_hours:.3g} h"
    return ""


def _one_after_the_other(
    truths: Mapping[str, FloatArray],
    features: Mapping[str, Sequence[FloatArray]],
    within: Sequence[str],
    choose: int,
) -> pd.DataFrame:
    """Choose candidates: each time the least mean of log widths, together with those chosen.

    No width exceeds the one before: an estimator may leave out the readings of a further test.
    """
    chosen, rows = list[str](), []
    before = dict.fromkeys((f"{name}_width" for name in truths), 1.0)
    while len(chosen) < min(choose, len(within)):
        found = {}
        for name in within:
            if name not in chosen:
                folds = zip(*(features[one] for one in (*chosen, name)), strict=True)
                together = [np.hstack(parts) for parts in folds]
                widths = _widths(truths, together)
                found[name] = {key: min(width, before[key]) for key, width in widths.items()}
        best = min(found, key=lambda name: float(np.mean(np.log([*found[name].values()]))))
        chosen.append(best)
        before = found[best]
        rows.append({"candidate": best, **found[best]})
    return pd.DataFrame(rows)
