"""Bands of ranks notice what they should, and verdicts say it in words."""

import numpy as np
import pytest
from scipy import stats

from pyburgers.common.array_types import IntArray
from pyburgers.sbc.rank_uniformity import (
    RankBands,
    counts_at_most,
    judge_ranks,
    rank_bands,
    simultaneous_band,
)

N_DATA_SETS = N_DRAWS = 100


@pytest.fixture(scope="module")
def band() -> tuple[IntArray, IntArray]:
    return simultaneous_band(N_DATA_SETS, N_DRAWS, probability=0.95)


def share_outside(band: tuple[IntArray, IntArray], *, shift: float, width: float) -> float:
    """Share of calibrations of a standard normal posterior that leave the band."""
    rng = np.random.default_rng(7)
    outside = []
    for _ in range(400):
        truths = shift + width * rng.standard_normal(N_DATA_SETS)
        draws = rng.standard_normal((N_DATA_SETS, N_DRAWS))
        counts = counts_at_most((draws < truths[:, None]).sum(axis=1), N_DRAWS)
        outside.append(bool(np.any((counts < band[0]) | (counts > band[1]))))
    return float(np.mean(outside))


# 400 trials at 5 %: 99.9 % of correct bands are left in 2 to 9 % of them.
RIGHT = [float(stats.binom.ppf(q, 400, 0.05)) / 400 for q in (0.0005, 0.9995)]


@pytest.mark.parametrize(
    ("shift", "width", "low", "high"),
    [(0.0, 1.0, *RIGHT), (0.7, 1.0, 0.9, 1.0), (0.0, 1.6, 0.9, 1.0), (0.0, 0.6, 0.9, 1.0)],
)
def test_a_biased_or_wrongly_wide_posterior_leaves_the_band_and_a_right_one_as_it_should(
    band: tuple[IntArray, IntArray], shift: float, width: float, low: float, high: float
) -> None:
    assert low <= share_outside(band, shift=shift, width=width) <= high


@pytest.fixture(scope="module")
def bands() -> RankBands:
    return rank_bands(N_DATA_SETS, N_DRAWS, n_quantities=10)


def ranks(*, shift: float = 0.0, width: float = 1.0) -> list[int]:
    """Ranks of truths of a given distribution among draws of a standard normal posterior."""
    rng = np.random.default_rng(3)
    truths = shift + width * rng.standard_normal(N_DATA_SETS)
    draws = rng.standard_normal((N_DATA_SETS, N_DRAWS))
    found: list[int] = (draws < truths[:, None]).sum(axis=1).tolist()
    return found


def test_joint_bands_hold_the_own_ones(bands: RankBands) -> None:
    assert np.all(bands.joint[0] <= bands.own[0])
    assert np.all(bands.joint[1] >= bands.own[1])
    assert np.any(bands.joint[1] > bands.own[1])
    assert counts_at_most([0, 0, 2, 3], 3).tolist() == [2, 2, 3]
    verdicts = judge_ranks({"one": [0, 0, 0]}, rank_bands(3, N_DRAWS, 1))
    assert verdicts["one"].verdict == "too few data sets"


@pytest.mark.parametrize(
    ("shift", "width", "words"),
    [
        (0.0, 2.0, "too narrow"),
        (0.0, 0.4, "too wide"),
        (1.2, 1.0, "too low"),
        (-1.2, 1.0, "too high"),
    ],
)
def test_a_wrong_posterior_is_not_calibrated_and_the_words_say_how(
    bands: RankBands, shift: float, width: float, words: str
) -> None:
    verdicts = judge_ranks({"right": ranks(), "wrong": ranks(shift=shift, width=width)}, bands)
    assert verdicts["right"].verdict == "calibrated"
    assert verdicts["right"].mean == pytest.approx(0.5, abs=0.1)
    assert verdicts["right"].spread == pytest.approx(1.0, abs=0.1)
    assert verdicts["wrong"].verdict == "not calibrated"
    assert words in verdicts["wrong"].sentence


def test_ranks_between_the_two_bands_are_within_chance(bands: RankBands) -> None:
    middle = N_DATA_SETS // 2
    for n_moved in range(middle):
        moved = np.arange(N_DATA_SETS)
        moved[middle : middle + n_moved] = middle
        if np.any(counts_at_most(moved, N_DRAWS) > bands.own[1]):
            break
    assert judge_ranks({"one": moved.tolist()}, bands)["one"].verdict == "within chance"
