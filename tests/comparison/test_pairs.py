"""What a difference of two fits comes to, and the sentence about weights."""

import math
from dataclasses import replace

import numpy as np
import pytest

from pyburgers.comparison.pairs import Pair, PairOutcome, doubt_about, weight_sentence


@pytest.mark.parametrize(
    ("difference", "error", "outcome"),
    [
        (3.3, 17.2, PairOutcome.CANNOT_TELL),
        (0.1, 4.2, PairOutcome.CANNOT_TELL),
        (9.0, 6.0, PairOutcome.CANNOT_TELL),
        (3.9, 0.5, PairOutcome.CANNOT_TELL),
        (1.0, 0.9, PairOutcome.ALIKE),
        (2.2, 0.7, PairOutcome.ALIKE),
        (4.0, 0.5, PairOutcome.BETTER),
        (28.0, 7.0, PairOutcome.BETTER),
    ],
)
def test_a_small_difference_of_large_error_is_no_likeness(
    difference: float, error: float, outcome: PairOutcome
) -> None:
    assert Pair("one", "other", difference, error).outcome is outcome


def test_each_outcome_has_its_words() -> None:
    said = [Pair("a", "b", *numbers).sentence() for numbers in ((9, 1), (1, 1), (3.3, 17.2))]
    assert said == [
        "a predicts these data clearly better than b (difference of elpd 9.0, standard error 1.0).",
        "a and b predict these data alike (difference of elpd 1.0, standard error 1.0).",
        "Cannot tell which of a and b predicts these data better (difference of elpd 3.3, standard "
        "error 17.2).",
    ]


def test_numbers_in_doubt_and_errors_that_are_none_decide_nothing() -> None:
    doubtful = Pair("a", "b", 9.0, 1.0, "the elpd of a may be far off")
    assert doubtful.outcome is PairOutcome.CANNOT_TELL
    assert doubtful.sentence().startswith("Cannot tell which of a and b predicts these data better")
    assert doubtful.sentence().endswith(
        "elpd 9.0, standard error 1.0), because the elpd of a may be far off."
    )
    assert replace(doubtful, difference=0.0).outcome is PairOutcome.CANNOT_TELL
    for error in (math.nan, math.inf):
        without = Pair("a", "b", 9.0, error)
        assert without.outcome is PairOutcome.CANNOT_TELL
        assert without.sentence().endswith("(difference of elpd 9.0, no standard error).")


def test_a_doubt_names_too_few_tests_and_fits_that_may_be_far_off() -> None:
    assert doubt_about("3 tests", 3, []) == ""
    assert doubt_about("2 tests", 2, []) == "a standard error over 2 tests says nothing"
    both = doubt_about("1 point", 1, ["a", "b"])
    assert both == (
        "a standard error over 1 point says nothing and the elpd of a and b may be far off"
    )


def test_a_larger_weight_of_the_worse_fit_is_explained() -> None:
    gains = np.array([0.5, 0.5, 0.5, 0.5, -3.0, -0.25])
    text = weight_sentence("a", "b", (0.17, 0.83), gains)
    assert text is not None
    assert "b has the larger weight (0.83 against 0.17) although its elpd is lower" in text
    assert "4 of 6 points better than a, by 2.0 together, and loses 3.2 at the others, 3.0" in text


def test_a_larger_weight_of_the_better_fit_needs_no_words() -> None:
    assert weight_sentence("a", "b", (0.6, 0.4), np.array([-1.0, 0.5])) is None
