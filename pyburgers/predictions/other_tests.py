"""What a fit predicts of another test, as tables: bands along its clock, readings, scores."""

import numpy as np
import numpy.typing as npt
import pandas as pd
from scipy.special import log_ndtr, logsumexp, ndtri_exp

from pyburgers.common.draws import FloatArray, all_draws, evenly_spaced
from pyburgers.common.errors import InputError
from pyburgers.common.units import count_points
from pyburgers.drawing.view import shown_clock
from pyburgers.fitting.prediction import Prediction
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.model.read_quantities import ReadQuantity
from pyburgers.posterior.labelled_draws import response_in

QUANTILES = (5, 25, 50, 75, 95)
"""Percentages of the tables."""

BANDS = (50, 90)
"""Percentages of new readings inside the bands that are scored."""

COMPARED = 400
"""Draws at most whose replicated readings say what scores are to be expected."""

OVERVIEW = 8
"""Rows of `overview_table`."""

MIXED = 1000
"""Draws at most that give a density together."""

ROUNDED = 1e-4
"""By how much draws of logarithms at an upper limit may lie above it, for they are rounded."""

DENSITY = "log predictive density a reading"


def answers(prediction: Prediction) -> tuple[ReadQuantity, ...]:
    """Return what the test answers with: of what can be read, that which is read somewhere."""
    likelihood = likelihood_of(prediction.experiment)
    read = _is_read(prediction)
    return tuple(one for one, places in zip(likelihood.read, read, strict=True) if places.any())


def clock_of(prediction: Prediction, answer: ReadQuantity) -> FloatArray:
    """Return the positions (SI) on the clock of `draws_of` an answer, shape (n,)."""
    clock = likelihood_of(prediction.experiment).clock
    every: FloatArray = prediction.posterior["predictions"][clock.name].to_numpy()
    return every[_places(prediction, answer)]


def draws_of(prediction: Prediction, answer: ReadQuantity) -> tuple[FloatArray, FloatArray]:
    """Return draws (SI) of solution and new readings, NaN if imposed, by clock, (n_draws, n)."""
    likelihood = likelihood_of(prediction.experiment)
    predictions = prediction.posterior["predictions"].to_dataset()
    solved, new = (
        all_draws(predictions[name]).astype(np.float64)
        for name in (answer.name, f"{answer.name}_replicated")
    )
    read = _is_read(prediction)[likelihood.read.index(answer)]
    places = _places(prediction, answer)
    return solved[:, places], np.where(read, new, np.nan)[:, places]


def shown_draws(prediction: Prediction, answer: ReadQuantity) -> tuple[FloatArray, FloatArray]:
    """Return `draws_of` an answer as tables and figures show it (`ReadQuantity.shown`), SI."""
    solved, new = draws_of(prediction, answer)
    return as_shown(answer, solved), as_shown(answer, new)


def as_shown(quantity: ReadQuantity, values: FloatArray) -> FloatArray:
    """Return values of a quantity that is read (SI) as those that are shown of it, SI."""
    return values if quantity.logarithm_of is None else np.exp(values)


def is_upper_limit(experiment: Experiment) -> npt.NDArray[np.bool_]:
    """Return whether each reading is an upper limit, shape (n_points,)."""
    return np.asarray(experiment.response <= experiment.response_limit)


def _places(prediction: Prediction, answer: ReadQuantity) -> npt.NDArray[np.bool_]:
    """Where the solution is that of an answer: not where another one has its name, (n,)."""
    likelihood, read = likelihood_of(prediction.experiment), _is_read(prediction)
    others = [one.name == answer.name and one != answer for one in likelihood.read]
    return np.asarray(~np.any(read[others], axis=0))


def _is_read(prediction: Prediction) -> npt.NDArray[np.bool_]:
    """Which quantity is read along the clock of the predictions, shape (n_read, n)."""
    likelihood = likelihood_of(prediction.experiment)
    at = prediction.posterior["predictions"][likelihood.clock.name].to_numpy()
    return likelihood.is_read(prediction.experiment, at)


def band_table(prediction: Prediction) -> pd.DataFrame:
    """Return bands of solution and new readings (SI), NaN if imposed, along the clock."""
    shown = answers(prediction)
    clock, at = likelihood_of(prediction.experiment).clock, clock_of(prediction, shown[0])
    columns = {clock.column: at, **prediction.experiment.conditions_at(at)}
    for one in shown:
        solved, new = shown_draws(prediction, one)
        name = one.shown.column
        columns |= {**_quantiles(solved, name), **_quantiles(new, f"new_{name}")}
    return pd.DataFrame(columns)


def overview_table(prediction: Prediction) -> pd.DataFrame:
    """Return bands at a few positions for people, as text in display units."""
    experiment = prediction.experiment
    clock = shown_clock(experiment)
    table = band_table(prediction)
    shown = table.iloc[np.linspace(0, len(table) - 1, OVERVIEW).round().astype(int)]

    def bands(column: str, factor: float) -> list[str]:
        low, median, high = (shown[f"{column}_q{q}"] * factor for q in (5, 50, 95))
        rows = zip(low, median, high, strict=True)
        return [
            "imposed" if np.isnan(middle) else f"{middle:.4g} [{least:.4g}, {most:.4g}]"
            for least, middle, most in rows
        ]

    at = shown[clock.column].to_numpy()
    along = {clock.label: at * clock.display_factor, **experiment.conditions_at(at)}
    columns = {name: [f"{value:.4g}" for value in values] for name, values in along.items()}
    for one in (answer.shown for answer in answers(prediction)):
        columns[f"{one.label}, median and 90 %"] = bands(one.column, one.display_factor)
        columns[f"new readings of {one.name}"] = bands(f"new_{one.column}", one.display_factor)
    return pd.DataFrame(columns)


def reading_table(prediction: Prediction) -> pd.DataFrame:
    """Return what each reading of a test is predicted to be, and what it is, in SI units.

    Columns of a quantity are those of `band_table` and that of its readings, NaN at readings of
    another. share_below is the share of predicted readings below the measured one, or at most at
    its limit. Raises `InputError` if the test has no data.
    """
    experiment = _with_data(prediction)
    likelihood = likelihood_of(experiment)
    new = _new_readings(prediction)
    solved = all_draws(response_in(prediction.posterior, "model_response"))
    quantities, is_limit = read_quantities(experiment), is_upper_limit(experiment)
    columns = {likelihood.clock.column: experiment.position}
    columns |= experiment.conditions_at(experiment.position)
    if len(likelihood.read) > 1:
        columns["quantity"] = np.array([one.shown.name for one in quantities])
    for one in dict.fromkeys(quantities):
        name, is_of_it = one.shown.column, np.array([other == one for other in quantities])
        measured, of_solutions, of_new = (
            as_shown(one, np.where(is_of_it, values, np.nan))
            for values in (experiment.response, solved, new)
        )
        columns[f"measured_{name}"] = measured
        columns |= {**_quantiles(of_solutions, name), **_quantiles(of_new, f"new_{name}")}
    is_below = np.where(is_limit, new <= experiment.response, new < experiment.response)
    return pd.DataFrame({**columns, "is_limit": is_limit, "share_below": is_below.mean(axis=0)})


def read_quantities(experiment: Experiment) -> list[ReadQuantity]:
    """Return what each reading is of, shape (n_points,)."""
    read = likelihood_of(experiment).read
    return [read[number] for number in experiment.quantity]


def score_table(prediction: Prediction) -> pd.DataFrame:
    """Score a prediction against the readings of its test.

    Expected scores come from replicated readings, scored in the same way. Each set is a test that
    one of the draws would give. Readings of a test have one truth in common, so that the coverage
    in a test scatters widely about its mean.

    Returns
    -------
    DataFrame
        Index score: the coverage of bands of new readings, and the mean ln density of a reading
        (per SI unit) by all draws. Columns found, expected (mean over replicated
        tests), expected_q5, expected_q95. Column share_below: the share of replicated tests with
        a score below the one found.

    Raises
    ------
    InputError
        If the test has no data, or there is only one draw.

    Examples
    --------
    >>> scores = pyburgers.score_table(fit.predict(test))
    """
    experiment = _with_data(prediction)
    new = _new_readings(prediction)
    if len(new) < 2:
        raise InputError(f"{experiment.id}: found one draw, expected at least two for a score.")
    kept = evenly_spaced(np.arange(len(new)), MIXED)
    own = evenly_spaced(np.arange(len(kept)), COMPARED)
    readings = np.vstack([experiment.response, new[kept[own]]])
    scores = {
        f"coverage of the {band} % band": _coverage(readings, new, kept[own], band)
        for band in BANDS
    }
    scores[DENSITY] = _mean_log_density(prediction, readings, kept, own)
    return pd.DataFrame.from_dict(
        {
            name: {
                "found": values[0],
                "expected": values[1:].mean(),
                "expected_q5": np.quantile(values[1:], 0.05),
                "expected_q95": np.quantile(values[1:], 0.95),
                "share_below": np.mean(values[1:] < values[0]),
            }
            for name, values in scores.items()
        },
        orient="index",
    ).rename_axis("score")


def score_sentence(prediction: Prediction, scores: pd.DataFrame) -> str:
    """Say how the readings of a test lie in what was predicted.

    Parameters
    ----------
    prediction : Prediction
        Of a test with data.
    scores : DataFrame
        Its `score_table`.

    Examples
    --------
    >>> prediction = fit.predict(test)
    >>> sentence = pyburgers.score_sentence(prediction, pyburgers.score_table(prediction))
    """
    said = [
        f"{_share(scores, row, 'found')} in the {band} % band (the draws expect "
        f"{_share(scores, row, 'expected')}, and in 90 % of such tests "
        f"{_share(scores, row, 'expected_q5')} to {_share(scores, row, 'expected_q95')})"
        for band, row in zip(BANDS, scores.index, strict=False)
    ]
    density = scores.loc[DENSITY]
    unit = likelihood_of(prediction.experiment).response.si_unit
    per = "" if unit == "1" else f" (per {unit})"
    return (
        f"Of {count_points(prediction.experiment.n_points)} lie {' and '.join(said)}; the "
        f"{DENSITY}{per} is {density['found']:.2f} (expected {density['expected']:.2f}, "
        f"{density['expected_q5']:.2f} to {density['expected_q95']:.2f})."
    )


def surprise_sentence(prediction: Prediction, scores: pd.DataFrame) -> str:
    """Say which scores lie outside of what the draws expect of 90 % of such tests.

    Parameters
    ----------
    prediction : Prediction
        Of a test with data.
    scores : DataFrame
        Its `score_table`.

    Examples
    --------
    >>> prediction = fit.predict(test)
    >>> sentence = pyburgers.surprise_sentence(prediction, pyburgers.score_table(prediction))
    """
    outside = scores[~scores["found"].between(scores["expected_q5"], scores["expected_q95"])]
    points = count_points(prediction.experiment.n_points)
    expected = "what the draws expect of 90 % of such tests"
    if outside.empty:
        return f"all scores of its {points} are within {expected}."
    return f"outside {expected}, over its {points}: {', '.join(outside.index)}."


def _share(scores: pd.DataFrame, row: str, column: str) -> str:
    return f"{100 * scores[column][row]:.0f} %"


def _with_data(prediction: Prediction) -> Experiment:
    experiment = prediction.experiment
    if experiment.n_points == 0:
        raise InputError(f"{experiment.id}: the experiment has no data, expected a [data] table.")
    return experiment


def _new_readings(prediction: Prediction) -> FloatArray:
    """Return readings with noise at the observed positions, shape (n_draws, n_points)."""
    new = all_draws(response_in(prediction.posterior, "posterior_predictive"))
    limit = prediction.experiment.response_limit
    return np.where(new <= limit + ROUNDED, limit, new)


def _quantiles(draws: FloatArray, column: str) -> dict[str, FloatArray]:
    found = np.quantile(draws.astype(np.float64), np.array(QUANTILES) / 100, axis=0)
    return {f"{column}_q{q}": values for q, values in zip(QUANTILES, found, strict=True)}


def _coverage(
    readings: FloatArray, new: FloatArray, own: npt.NDArray[np.int64], band: int
) -> FloatArray:
    """Share of the points of each set of readings inside a band, shape (n_sets,).

    The first set is measured; the others are those of some of the draws (`own`), each of which is
    left out of the band for its own set, which would else reach out to it.
    """
    tail = (1 - band / 100) / 2
    low, high = (
        np.vstack([np.quantile(new, share, axis=0), _quantiles_without(new, own, share)])
        for share in (tail, 1 - tail)
    )
    return np.asarray(np.mean((readings >= low) & (readings <= high), axis=1))


def _quantiles_without(
    new: FloatArray, left_out: npt.NDArray[np.int64], share: float
) -> FloatArray:
    """Quantile of all draws but one, for each one left out, shape (n_left_out, n_points)."""
    order = np.argsort(new, axis=0)
    in_order = np.take_along_axis(new, order, axis=0)
    rank = np.argsort(order, axis=0)[left_out]
    last = len(new) - 2
    below = int(share * last)
    # Without a draw, those above it move down by one.
    lower, upper = (
        np.where(place < rank, in_order[place], in_order[place + 1])
        for place in (below, min(below + 1, last))
    )
    return np.asarray(lower + (share * last - below) * (upper - lower))


def _mean_log_density(
    prediction: Prediction,
    readings: FloatArray,
    kept: npt.NDArray[np.int64],
    own: npt.NDArray[np.int64],
) -> FloatArray:
    """Mean over points of the log density that kept draws give to sets of readings, (n_sets,).

    The first set is measured; the others are replicated from some of the kept draws, each of which
    is left out where its own set is scored: a draw knows the truth that its set was made from,
    which no prediction does. A reading at an upper limit counts with the probability of that.
    """
    experiment = prediction.experiment
    solved = all_draws(response_in(prediction.posterior, "model_response"))
    group = prediction.posterior["posterior"].to_dataset()
    values = {str(name): all_draws(column) for name, column in group.items()}
    noise = likelihood_of(experiment).reading_noise(experiment, values, solved)
    solved, noise = solved[kept], noise[kept]
    limit, bounded = experiment.response_limit, is_upper_limit(experiment)
    if bounded.any():
        # A solution stops at a limit: how far below it the model lies, the likelihood there knows.
        log_share = all_draws(response_in(prediction.posterior, "log_likelihood"))[kept]
        below = noise[:, bounded] * ndtri_exp(log_share[:, bounded])
        solved[:, bounded] = limit[bounded] - below
    found = np.empty(len(readings))
    for number, reading in enumerate(readings):
        distance = (reading - solved) / noise
        density = np.where(
            reading <= limit,
            log_ndtr(distance),
            -0.5 * distance**2 - np.log(noise) - 0.5 * np.log(2 * np.pi),
        )
        if number > 0:
            density = np.delete(density, own[number - 1], axis=0)
        found[number] = np.mean(logsumexp(density, axis=0) - np.log(len(density)))
    return found
