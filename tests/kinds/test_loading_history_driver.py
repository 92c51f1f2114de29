"""Series as lines with few corners, and thinned records."""

from itertools import pairwise

import numpy as np
import pytest

from pyburgers.kinds.loading_history.driver import (
    is_driven_by_rates,
    kept_readings,
    line_through,
    rate_steps,
    reading_error,
    scatter,
    tolerance_of,
    tolerances,
)


def ramps(time: np.ndarray) -> np.ndarray:
    return np.asarray(np.interp(time, [0, 5, 100, 105, 150, 160, 200], [0, 10, 10, 1, 1, 7, 7]))


def test_the_reading_error_of_ramps_with_noise() -> None:
    rng = np.random.default_rng(3)
    time = np.sort(rng.uniform(0, 200, 2000))
    value = ramps(time) + 0.05 * rng.standard_normal(time.size)
    assert reading_error(time, value) == pytest.approx(0.05, rel=0.1)


@pytest.mark.parametrize("seed", range(5))
@pytest.mark.parametrize("level", [0.0, 10.0])
def test_the_reading_error_of_noise_alone(seed: int, level: float) -> None:
    """What scatters is error where it turns as often as noise, however large beside the range."""
    time = np.linspace(0, 100, 400)
    value = level + 0.1 * np.random.default_rng(seed).standard_normal(time.size)
    assert reading_error(time, value) == pytest.approx(0.1, rel=0.15)
    assert line_through(time, value, tolerance_of(value, reading_error(time, value)))[0].size == 2


def test_few_readings_tell_no_error() -> None:
    time, value = np.arange(19.0), np.tile([5.0, 5.0, 2.0, 2.0], 5)[:19]
    assert scatter(time, value) > 1
    assert reading_error(time, value) == 0


@pytest.mark.parametrize("per_cycle", [4, 6, 8])
def test_cycles_are_no_noise(per_cycle: int) -> None:
    """Most readings are corners, and lie from their neighbours by a large part of the amplitude."""
    time = np.arange(10.0 * per_cycle)
    value = np.sin(2 * np.pi * time / per_cycle + 0.3)
    tolerance = tolerance_of(value, reading_error(time, value))
    assert tolerance < 0.11
    corners, line = line_through(time, value, tolerance)
    assert np.abs(np.interp(time, corners, line) - value).max() < 2 * tolerance


@pytest.mark.parametrize("seed", range(5))
def test_the_fewest_corners_through_noise(seed: int) -> None:
    rng = np.random.default_rng(seed)
    time = np.linspace(0, 200, 801)
    value = ramps(time) + 0.03 * rng.standard_normal(time.size)
    tolerance = tolerance_of(value, 0.03)
    corners, line = line_through(time, value, tolerance)
    assert corners.size == 7
    fitted = np.interp(time, corners, line)
    assert np.abs(fitted - value).max() < 2 * tolerance
    assert np.sqrt(np.mean((fitted - ramps(time)) ** 2)) < 0.03


def test_a_straight_line_is_one_leg() -> None:
    time = np.linspace(3, 9, 50)
    corners, line = line_through(time, 2 + 0.5 * time, 1e-6)
    np.testing.assert_array_equal(corners, [3, 9])
    np.testing.assert_allclose(line, [3.5, 6.5], rtol=1e-12)


def test_zeros_are_one_leg() -> None:
    """Without a stated error they pass a line of zeros by nothing."""
    time, value = np.linspace(3, 9, 50), np.zeros(50)
    corners, line = line_through(time, value, tolerances(time, value))
    np.testing.assert_array_equal(corners, [3, 9])
    np.testing.assert_array_equal(line, [0, 0])


def test_few_corners_by_trying_all() -> None:
    """No line with fewer corners at readings passes all readings: checked by trying each."""
    rng = np.random.default_rng(8)
    time, value = np.arange(9.0), rng.standard_normal(9)
    tolerance = 0.75

    def passes(inner: tuple[int, ...]) -> bool:
        knots = [0, *inner, 8]
        line = np.interp(time, time[knots], value[knots])
        return bool(np.all(np.abs(line - value) <= tolerance))

    subsets = [tuple(k for k in range(1, 8) if number >> (k - 1) & 1) for number in range(2**7)]
    fewest = min(len(inner) for inner in subsets if passes(inner))
    assert line_through(time, value, tolerance)[0].size == fewest + 2


def test_thinning_keeps_ends_ramps_and_transients() -> None:
    time = np.linspace(0.5, 1000, 2000)
    response = np.interp(time, [0, 500, 510, 1000], [0, 0, 1, 1]) + 0.2 * np.exp(-time / 10)
    kept = kept_readings(time, response, np.array([0.0, 500.0, 510.0]), 100)
    assert 70 < kept.size <= 100
    assert (kept[0], kept[-1]) == (0, 1999)
    assert np.all(np.diff(kept) > 0)
    assert np.count_nonzero((time[kept] >= 500) & (time[kept] <= 510)) > 12
    assert np.count_nonzero(time[kept] < 20) > 8
    assert np.diff(time[kept]).max() < 60


def test_a_short_record_stays_whole() -> None:
    time = np.arange(1.0, 20.0)
    np.testing.assert_array_equal(kept_readings(time, time, np.array([0.0]), 19), np.arange(19))


def test_a_line_follows_the_scatter_within_each_load() -> None:
    """Loads of 20, 10, 2 and 3 MPa, each with an error in proportion: 2 and 3 are no ramp."""
    rng = np.random.default_rng(3)
    loads = np.repeat([20.0, 10.0, 2.0, 3.0], 12)
    value = loads * (1 + 0.02 * rng.standard_normal(loads.size))
    time = np.arange(loads.size, dtype=np.float64)
    alike = line_through(time, value, tolerance_of(value, reading_error(time, value)))
    assert np.abs(np.interp(time, *alike) - loads)[24:].max() > 0.3
    corner, line = line_through(time, value, tolerances(time, value))
    found = np.interp(time, corner, line)
    np.testing.assert_allclose(found[24:], loads[24:], rtol=0.06)
    assert corner.size <= 14


def test_a_series_of_one_load_has_the_legs_of_its_error() -> None:
    """Where all loads scatter alike nothing changes, and rounding is no smaller scatter."""
    rng = np.random.default_rng(4)
    loads = np.repeat(np.arange(1.0, 9.0) * 2, 20)
    time = np.arange(loads.size, dtype=np.float64)
    value = np.round(loads + 0.05 * rng.standard_normal(loads.size), 1)
    corner, _ = line_through(time, value, tolerances(time, value))
    assert corner.size <= 2 * 8 + 3


@pytest.mark.parametrize("sign", [1, -1])
@pytest.mark.parametrize("seed", range(4))
def test_steps_of_the_rate_are_found(seed: int, sign: int) -> None:
    """Rates and their starts, with readings between the steps and at uneven times."""
    rng = np.random.default_rng(seed)
    rates = 10 ** rng.uniform(-6, -4, 3) * np.array([1, 30, 1])
    ends = np.cumsum(0.02 / rates)
    time = np.sort(np.concatenate([rng.uniform(*leg, 15) for leg in pairwise([0, *ends])]))
    strain = np.interp(time, [0, *ends], [0, 0.02, 0.04, 0.06])
    found = np.array(rate_steps(time, sign * (strain + 1e-5 * rng.standard_normal(time.size))))
    np.testing.assert_allclose(found[:, 1], rates, rtol=0.02)
    np.testing.assert_allclose(found[:, 0], [0, 0.02, 0.04], atol=5e-4)


@pytest.mark.parametrize("noise", [0, 1e-5, 3e-4])
def test_one_rate_has_no_steps(noise: float) -> None:
    rng = np.random.default_rng(5)
    time = np.linspace(10, 5000, 100)
    assert rate_steps(time, 1e-5 * time + noise * rng.standard_normal(100)) == ()
    assert rate_steps(time, 0.01 * np.sqrt(time / 5000)) == ()
    held = np.minimum(time, time[50])
    assert rate_steps(time, 1e-5 * held + 1e-11 * time) == ()


def test_creep_under_two_loads_is_driven_by_the_stress() -> None:
    """Strain is a line under each load, but so is the stress, in fewer legs."""
    time = np.arange(1.0, 41.0)
    strain = np.interp(time, [0, 20, 40], [0, 0.01, 0.04])
    load = np.where(time <= 20, 1e6, 2e6)
    assert not is_driven_by_rates(time, strain, load)
    assert is_driven_by_rates(time, strain, load * (1 - np.exp(-((time - 1) % 20 + 1) / 6)))
