"""The measured creep of rock salt that comes with the project."""

import csv

import numpy as np
import pytest
from conftest import DUNITE

from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.files import load_loading_history
from pyburgers.model.priors import load_priors, shipped_prior_file

HALITE = DUNITE.parent / "halite"
HOUR = 3600.0


@pytest.fixture(scope="module")
def record() -> HistoryExperiment:
    return load_loading_history(HALITE / "halite_z3.toml")


def columns() -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Hours since the start of the history, differential stress (MPa) and strain (fraction)."""
    with (HALITE / "honorio_2024.csv").open(encoding="utf-8") as file:
        rows = list(csv.DictReader(line for line in file if not line.startswith("#")))
    kept = [row for row in rows if row["part"] == "creep"]
    names = ("time_h", "differential_stress_MPa", "axial_strain_percent")
    time, stress, strain = (np.array([float(row[name]) for row in kept]) for name in names)
    return time - time[0], stress, strain / 100


def test_the_record(record: HistoryExperiment) -> None:
    assert record.material == "halite"
    assert record.provenance.kind == "measured"
    assert record.provenance.licence == "CC BY 4.0"
    assert "Honorio" in record.provenance.source
    assert record.n_readings_in_file == 1728
    assert 180 < record.n_points <= 200
    assert record.end_time == pytest.approx((787.281 - 3.167) * HOUR)
    assert record.response.max() == pytest.approx(0.0157, rel=0.01)
    assert np.all(record.response_is_strain)


def test_five_loads_are_held_four_days_each(record: HistoryExperiment) -> None:
    held = [
        leg
        for leg in record.legs
        if leg.end_time - leg.start_time > 80 * HOUR and leg.start_value > 5e6
    ]
    loads = [(leg.start_value + leg.end_value) / 2e6 for leg in held]
    np.testing.assert_allclose(loads, [11.35, 13.86, 16.35, 18.84, 21.33], atol=0.03)
    for leg in held:
        assert abs(leg.end_value - leg.start_value) < 0.08e6
    assert len(record.legs) == 30


def test_the_driver_follows_the_measured_stress(record: HistoryExperiment) -> None:
    time, stress, _ = columns()
    corners, line = np.transpose(record.stages[0].knots)
    apart = stress - np.interp(time * HOUR, corners, line) / 1e6
    assert np.abs(apart).max() < 0.4
    assert np.sqrt(np.mean(apart**2)) < 0.05


def test_the_readings_that_are_kept_follow_the_record(record: HistoryExperiment) -> None:
    time, _, strain = columns()
    line = np.interp(time * HOUR, record.time, record.response)
    assert np.abs(line - strain).max() < 1e-4
    apart = np.abs(record.response[:, np.newaxis] - strain).min(axis=1)
    assert apart.max() < 1e-12  # the table's own readings, not averages


def test_the_priors_for_salt_that_hardens() -> None:
    hardening = load_priors(shipped_prior_file("halite", "hardening"))
    plain = load_priors(shipped_prior_file("halite"))
    factor, strain = (
        hardening.priors[name] for name in ("steady_state_fabric_factor", "critical_strain_fabric")
    )
    assert (factor.location, factor.upper) == (2.0, np.inf)
    assert strain.location == 0.02
    assert hardening.priors["maxwell_modulus"] == plain.priors["maxwell_modulus"]
    assert hardening.flow_law is None
