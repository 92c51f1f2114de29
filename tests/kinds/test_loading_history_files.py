"""Loading histories as they are read: stages become legs, and long records are thinned.

What files say otherwise is in tests/messages/loading_history.toml.
"""

from typing import Any

import numpy as np
import pytest
from history_files import history, stage

PERCENT = {"strain_unit": "percent"}
BOTH = {**PERCENT, "stress_unit": "MPa"}


@pytest.mark.parametrize("zero", [0.0, 2.0], ids="a zero of {} percent".format)
def test_constant_force(zero: float) -> None:
    time = np.linspace(0.0, 1000.0, 101)
    shortening = 0.15 * (time / 1000) ** 0.5
    test = history(
        [stage(1000.0, "stress", stress=1e6)],
        {"time": time, "strain": zero - 100 * np.log1p(-shortening)},
        PERCENT,
        stress_measure="engineering",
        strain_offset={"value": zero, "sd": 0.01, "unit": "percent"},
    )
    corners, stress = np.transpose(test.stages[0].knots)
    assert test.stages[0].control == "stress_series"
    np.testing.assert_allclose(np.interp(time, corners, stress), 1e6 * (1 - shortening), rtol=2e-3)
    assert len(test.legs) < 30


@pytest.mark.parametrize("stated", [{}, {"strain_uncertainty": 0.2}], ids=str)
def test_noise_of_the_strain_is_no_load_under_a_constant_force(stated: dict[str, float]) -> None:
    time = np.linspace(0.0, 1000.0, 201)
    noise = 2e-3 * np.random.default_rng(1).standard_normal(time.size)
    columns = {"time": time, "strain": 100 * (1e-4 * time + noise)}
    force = stage(1000.0, "stress", stress=1e6)
    test = history([force], columns, {**PERCENT, **stated}, stress_measure="engineering")
    (leg,) = test.legs
    assert leg.start_value == pytest.approx(1e6, rel=1e-3)
    assert leg.end_value == pytest.approx(1e6 * np.exp(-0.1), rel=5e-3)


@pytest.mark.parametrize("measure", ["true", "engineering"])
@pytest.mark.parametrize(
    "unloaded",
    [
        {"control": "stress", "stress": 0.0},
        {"control": "stress_rate", "start_stress": 0, "stress_rate": 0},
        {"control": "stress_series"},
        {"control": "stress_series", "tolerance": 0.01},
    ],
    ids=str,
)
def test_no_stress_after_a_load(unloaded: dict[str, Any], measure: str) -> None:
    time = np.linspace(0.0, 1000.0, 41)
    test = history(
        [
            stage(500.0, "stress", stress=1e6),
            {"start_time": 500.0, "end_time": 1000.0, **unloaded},
        ],
        {"time": time, "stress": 1.0 * (time < 500), "strain": 2.0 + 1.0 * (time < 500)},
        BOTH,
        stress_measure=measure,
    )
    (rest,) = (leg for leg in test.legs if leg.stage == 1)
    assert (rest.start_value, rest.rate) == (0.0, 0.0)
    assert not test.doubts


def test_constant_displacement_rate() -> None:
    columns = {"time": np.array([100.0, 200.0]), "stress": np.array([1.0, 2.0])}
    pressed = stage(200.0, "strain_rate", strain_rate_per_s=1e-3)
    legs = history([pressed], columns, {"stress_unit": "MPa"}, strain_measure="engineering").legs
    assert sum(leg.end_value for leg in legs) == pytest.approx(-np.log(0.8), rel=1e-12)
    for leg in legs:
        middle = 1e-3 / (1 - 1e-3 * (leg.start_time + leg.end_time) / 2)
        assert leg.rate == pytest.approx(middle, rel=1e-4)


def test_a_stress_series_becomes_legs() -> None:
    time = np.linspace(0.0, 1000.0, 501)
    true = np.interp(time, [0, 100, 600, 700, 1000], [0, 10, 10, 3, 3])
    noisy = true + 0.02 * np.random.default_rng(1).standard_normal(time.size)
    columns = {"time": time, "stress": noisy, "strain": 0.001 * time}
    test = history([stage(1000.0, "stress_series")], columns, BOTH)
    corners, stress = np.transpose(test.stages[0].knots)
    assert len(test.legs) == 4
    assert np.abs(np.interp(time, corners, stress) / 1e6 - true).max() < 0.04
    assert "Stage 1: 501 readings of the stress became 4 legs" in test.notices[0]


def test_a_tolerance_trades_legs_for_nearness() -> None:
    time = np.linspace(0.0, 1000.0, 501)
    columns = {"time": time, "stress": np.sqrt(time), "strain": 0.001 * time}
    coarse, fine = (
        history(
            [stage(1000.0, "stress_series", tolerance=tolerance)],
            columns,
            BOTH,
            stage_stress_unit="MPa",
        )
        for tolerance in (2.0, 0.5)
    )
    assert len(coarse.legs) < len(fine.legs)
    for test, tolerance in ((coarse, 2e6), (fine, 0.5e6)):
        line = np.interp(time, *np.transpose(test.stages[0].knots))
        assert np.abs(line - 1e6 * np.sqrt(time)).max() < 1.5 * tolerance
    assert "within about 2 MPa" in coarse.notices[0]


def test_a_strain_series_becomes_legs() -> None:
    time = np.linspace(0.0, 100.0, 101)
    strain = np.interp(time, [0, 30, 100], [0, 0.6, 1.3])
    columns = {"time": time, "stress": 1 + time, "strain": strain}
    legs = history([stage(100.0, "strain_series")], columns, BOTH).legs
    np.testing.assert_allclose([leg.rate for leg in legs], [2e-4, 1e-4], rtol=1e-6)
    np.testing.assert_allclose([leg.start_value for leg in legs], 0)


@pytest.mark.parametrize(
    "control", [{"control": "stress", "stress": 1e6}, {"control": "stress_series"}]
)
def test_several_readings_of_a_moment_are_kept_under_a_constant_stress(
    control: dict[str, Any],
) -> None:
    number = np.arange(900)
    time = np.append(0.0, number // 3 + 1.0)
    strain = 0.1 * time + np.append(0.0, 0.01 * (number % 3 - 1))
    columns = {"time": time, "stress": np.ones(901), "strain": strain}
    test = history([stage(300.0, **control)], columns, BOTH)
    assert test.n_readings_in_file == 901
    assert 350 < test.n_points <= 402
    assert (np.diff(test.time) == 0).any()
    assert np.isfinite(test.reading).all()
    same = "600 points of stage 1 at the same time as the point before: each counts as a reading."
    assert same in test.notices


@pytest.mark.parametrize(
    ("times", "told"),
    [
        ([1, 2, 3, 4, 4, 5, 6], []),
        (
            [1, 2, 3, 4, 4, 5, 5, 6, 6],
            ["2 points of stage 2 at the same time as the point before: each counts as a reading."],
        ),
        (
            [1, 2, 3, 4, 4, 4, 5, 5, 6, 6],
            ["Every row of stage 2 stands twice: remove one of each, as each counts as a reading."],
        ),
    ],
)
def test_readings_that_share_a_time_are_told_by_stage(times: list[float], told: list[str]) -> None:
    """One of each stage at the time between both is none of them."""
    time = np.array(times, dtype=np.float64)
    columns = {"time": time, "strain": 0.1 * time, "stage": 1 + (np.arange(time.size) > 3)}
    first, second = stage(4.0, "stress", stress=1e6), stage(6.0, "stress", stress=2e6)
    test = history([first, {**second, "start_time": 4.0}], columns, PERCENT)
    assert [one for one in test.notices if "counts as a reading" in one] == told


def test_long_records_are_thinned() -> None:
    time = np.linspace(1.0, 10000.0, 5000)
    columns = {"time": time, "strain": 0.1 * time**0.3}
    load = stage(10000.0, "stress", stress=1e6)
    test = history([load], columns, PERCENT)
    assert 300 < test.n_points <= 400
    assert test.n_readings_in_file == 5000
    assert (test.time[0], test.time[-1]) == (1.0, 10000.0)
    assert np.count_nonzero(test.time < 1000) > 0.3 * test.n_points
    assert f"{test.n_points} of 5000 readings are used" in test.notices[0]
    assert 30 < history([load], columns, {**PERCENT, "max_readings": 50}).n_points <= 50
