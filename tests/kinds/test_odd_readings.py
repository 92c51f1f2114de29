"""Readings that may be none, and rows in a wrong order; good readings are not doubted."""

import numpy as np
import pytest

from pyburgers.kinds.constant_rate.experiment import remarks_on
from pyburgers.kinds.odd_readings import odd_readings, order_text

NOISE = 0.02 * np.random.default_rng(1).standard_normal(80)
STRAIN = np.linspace(0.001, 0.1, 80)
CURVE = 5.0 * (1.0 - np.exp(-STRAIN / 0.01)) + NOISE


@pytest.mark.parametrize("quantum", [None, 0.01, 0.1, 0.5, 1.0])
@pytest.mark.parametrize("noise", [True, False])
def test_good_readings_are_not_doubted(noise: bool, quantum: float | None) -> None:
    clean = CURVE - NOISE * (not noise)
    values = clean if quantum is None else quantum * np.round(clean / quantum)
    assert odd_readings(values, "stress (MPa)") == []
    assert odd_readings(-values, "stress (MPa)") == []


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        (np.minimum(CURVE, 4.9), "in a row are exactly 4.9, the largest"),
        (-np.minimum(CURVE, 4.9), "in a row are exactly -4.9, the largest"),
        (np.where(STRAIN > 0.05, 5.5, CURVE), "the end of its range"),
        (np.where(np.arange(80) // 5 == 8, 0.0, CURVE), "5 readings of stress are exactly 0"),
        (np.where(np.arange(80) == 8, 0.0, CURVE), "one stress is exactly 0 between larger ones"),
        (np.where(np.arange(80) == 8, 9999.0, CURVE), "one stress of 9999 is more than 10 times"),
        (np.where(np.arange(80) // 3 == 8, 9999.0, CURVE), "3 readings of stress, 9999, are more"),
    ],
)
def test_readings_that_may_be_none_are_told(changed: np.ndarray, words: str) -> None:
    (said,) = odd_readings(changed, "stress")
    assert words in said


def test_constant_readings_are_not_clipped() -> None:
    assert odd_readings(np.zeros(20), "strain") == odd_readings(np.ones(20), "strain") == []


def test_an_unloaded_stage_is_no_missing_reading() -> None:
    assert odd_readings(np.array([3.0, 3.1, 0.2, 0.0, 0.0, 0.0, 0.2, 3.2]), "stress") == []


@pytest.mark.parametrize(
    ("rows", "words"),
    [
        (np.arange(80)[::-1], "reverse order"),
        (np.tile(np.arange(40), 2), "repeats the first"),
        ([*range(70), *range(70, 60, -1)], "leave them out"),
        ([*range(30), *range(20, 70)], ""),
        ([5], ""),
        ([5, 5, 5], ""),
    ],
)
def test_what_rows_may_be_that_go_back(rows: np.ndarray, words: str) -> None:
    said = order_text(STRAIN[np.array(rows)])
    assert (words in said) == bool(said or not words)
    assert bool(said) == bool(words)


def test_rows_that_stand_twice_are_told() -> None:
    twice = np.repeat(STRAIN, 2), np.repeat(CURVE, 2)
    assert remarks_on(*twice)[0].startswith("Every row stands twice: remove one of each")
    jitter = np.repeat(STRAIN, 2), np.repeat(CURVE, 2) + 0.1 * np.arange(160)
    assert remarks_on(*jitter)[0] == (
        "80 points at the same strain as the point before: each counts as a reading."
    )
