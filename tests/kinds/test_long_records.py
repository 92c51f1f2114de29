"""Long records: read in a time that grows with their length, and thinned."""

from pathlib import Path
from typing import Any

import numpy as np
import pytest

import pyburgers
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.loading_history.driver import MAX_LOOKED_AT, kept_readings, looked_at


def curve(n: int, **keys: Any) -> ConstantRateExperiment:
    """Two rates, of which the second softens, with noise."""
    rng = np.random.default_rng(3)
    strain = np.linspace(0.2, 20.0, n) / 100
    stress = 5 * (1 - np.exp(-strain / 0.01)) - (strain > 0.1) + 0.05 * rng.standard_normal(n)
    return pyburgers.ConstantRateTest(
        strain=strain,
        strain_unit="fraction",
        stress=stress,
        stress_unit="MPa",
        strain_rate=[1e-4, 1e-5],
        start_strain=[0, 0.1],
        temperature_K=263,
        grain_size_um=500,
        material="ice",
        **keys,
    )


def test_a_long_curve_is_thinned_and_told() -> None:
    test = curve(10_000)
    assert 350 < test.n_points <= 400
    assert (test.strain[0], test.strain[-1]) == (0.002, 0.2)
    # Denser where the stress rises: a tenth of the strain has more than a fifth of the readings.
    assert np.count_nonzero(test.strain < 0.02) > 0.2 * test.n_points
    (notice,) = (one for one in test.notices if "readings are used" in one)
    assert notice.startswith(f"{test.n_points} of 10000 readings are used ('max_readings')")
    assert curve(400).n_points == 400
    assert curve(1000, max_readings=60).n_points <= 60


@pytest.mark.parametrize("most", [100, 400, 1000])
def test_a_copy_of_a_thinned_curve_has_its_readings(most: int, tmp_path: Path) -> None:
    test = curve(2000, max_readings=most)
    test.to_toml(tmp_path / "copy.toml")
    copy = pyburgers.load_experiment(tmp_path / "copy.toml")
    assert isinstance(copy, ConstantRateExperiment)
    np.testing.assert_array_equal(copy.strain, test.strain)
    np.testing.assert_array_equal(copy.stress, test.stress)
    assert copy.notices == test.notices


def cycles(n: int, **keys: Any) -> pyburgers.OscillationExperiment:
    """Ten readings of each cycle, with noise."""
    rng = np.random.default_rng(4)
    time = 10.0 * np.arange(n)
    phase = 2 * np.pi * time / 100
    return pyburgers.ForcedOscillation(
        time=time,
        time_unit="s",
        strain=1e-3 * np.sin(phase) + 1e-5 * rng.standard_normal(n),
        strain_unit="fraction",
        strain_uncertainty=1e-5,
        stress=50 * np.sin(phase + 0.3) + rng.standard_normal(n),
        stress_unit="MPa",
        stress_uncertainty=1.0,
        temperature_K=1423,
        grain_size_um=10,
        material="olivine",
        **keys,
    )


def test_of_a_long_oscillation_stresses_of_all_phases_are_used(tmp_path: Path) -> None:
    """Each tenth stress would have one phase."""
    test = cycles(4000)
    (notice,) = (one for one in test.notices if "readings are used" in one)
    assert notice.startswith("400 of 4000 readings are used ('max_readings')")
    assert test.record.stress.size == 4000
    phases, counts = np.unique(test.prepared.time % 100, return_counts=True)
    assert phases.size == 10
    assert counts.min() > 30
    # Readings of the whole record, in their order and each with its own stress.
    assert np.all(np.diff(test.prepared.time) > 0)
    assert test.prepared.time[-1] > 39_800
    assert set(zip(test.prepared.time, test.stress, strict=True)) < set(
        zip(test.record.stress_time, test.record.stress, strict=True)
    )
    assert cycles(400).n_points == 400
    little_more = cycles(450)
    assert little_more.n_points == 400
    assert np.all(np.diff(little_more.prepared.time) > 0)
    few = cycles(4000, max_readings=60)
    few.to_toml(tmp_path / "copy.toml")
    copy = pyburgers.load_experiment(tmp_path / "copy.toml")
    assert copy.n_points == few.n_points == 60
    np.testing.assert_array_equal(copy.response, few.response)
    assert copy.notices == few.notices


def test_of_a_long_series_means_are_looked_at() -> None:
    time = np.linspace(0, 100, 50_001)
    value = 3 + 0.5 * time + np.random.default_rng(1).standard_normal(time.size)
    few, mean = looked_at(time, value)
    assert few.size == MAX_LOOKED_AT
    assert (few[0], few[-1], mean[0], mean[-1]) == (0, 100, value[0], value[-1])
    inside = slice(1, -1)
    assert np.std((mean - 3 - 0.5 * few)[inside]) == pytest.approx(0.2, rel=0.1)


def test_of_a_million_readings_some_are_kept_at_once() -> None:
    time, rng = np.linspace(1.0, 6e4, 1_000_000), np.random.default_rng(2)
    response = 1e-4 * (time / 6e4) ** 0.4 + 2e-6 * rng.standard_normal(time.size)
    kept = kept_readings(time, response, np.array([0.0]), 400)
    assert 300 < kept.size <= 400
    assert (kept[0], kept[-1]) == (0, time.size - 1)


def test_a_long_series_becomes_legs_by_its_means() -> None:
    time, rng = np.linspace(0, 100, 20_001), np.random.default_rng(4)
    stress = np.interp(time, [0, 40, 100], [1.0, 1.0, 2.0])
    test = pyburgers.LoadingHistory(
        stages=[{"control": "stress_series", "start_time": 0, "end_time": 100}],
        time=time,
        time_unit="h",
        stress=stress + 0.01 * rng.standard_normal(time.size),
        stress_unit="MPa",
        strain=0.1 + time / 100,
        strain_unit="percent",
        temperature_K=263,
        grain_size_um=500,
        material="ice",
    )
    told = "20001 readings of the stress, averaged to 2000, became 2 legs"
    assert any(told in notice for notice in test.notices)
    assert test.legs[0].end_time == pytest.approx(40 * 3600, rel=0.02)
    assert test.legs[1].end_value == pytest.approx(2e6, rel=0.002)
