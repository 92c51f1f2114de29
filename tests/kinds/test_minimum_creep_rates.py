"""Where a history is a creep test, and the minimum rates that solutions have there."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import DUNITE
from history_twins import history_twin

from pyburgers.common.array_types import FloatArray
from pyburgers.drawing.views.creep import minimum_rate_table, minimum_rates
from pyburgers.kinds.loading_history.experiment import HistoryExperiment, creep_intervals
from pyburgers.kinds.loading_history.files import load_loading_history
from pyburgers.kinds.loading_history.likelihood import LIKELIHOOD
from pyburgers.kinds.loading_history.stages import Stage
from pyburgers.model.priors import PriorSet, default_priors

Rates = Callable[[FloatArray], FloatArray]

HOUR = 3600.0
LOAD = 5e6
DECAY = 0.05 * HOUR
"""Time over which the transient below fades (s)."""


@dataclass(frozen=True)
class Solved:
    """A test whose solutions are given."""

    experiment: HistoryExperiment
    posterior: xr.DataTree
    priors: PriorSet


def history_of(*stages: Stage) -> HistoryExperiment:
    return replace(history_twin("creep", 20), stages=stages)


def series(*knots: tuple[float, float]) -> HistoryExperiment:
    """A test with the stress (MPa) at some hours, linear in between."""
    corners = tuple((HOUR * hours, 1e6 * stress) for hours, stress in knots)
    return history_of(Stage("stress_series", 0.0, corners[-1][0], 260.0, knots=corners))


def solved(experiment: HistoryExperiment, *draws: Rates) -> Solved:
    """Solutions whose strain rates (1/s) are functions of time (s)."""
    time = LIKELIHOOD.grid(experiment)
    rate = np.array([draw(time) for draw in draws], dtype=np.float32)
    steps = 0.5 * (rate[:, 1:] + rate[:, :-1]) * np.diff(time)
    strain = np.concatenate([np.zeros((len(draws), 1)), np.cumsum(steps, axis=1)], axis=1)
    dims = ("chain", "draw", "time")
    values = {"strain_rate": (dims, rate[None]), "strain": (dims, strain[None])}
    predictions = xr.Dataset(values, coords={"time": time})
    posterior = xr.DataTree.from_dict({"predictions": predictions})
    return Solved(experiment, posterior, default_priors(experiment.material))


def softening_from(minimum: float) -> Rates:
    """Rates of a transient that fades while flow becomes faster, least at a time (s)."""
    rise = 1e-7 * np.exp(-minimum / DECAY) / DECAY
    return lambda t: 1e-8 + 1e-7 * np.exp(-t / DECAY) + rise * t


def plateau(steady: float) -> Rates:
    """Rates of a transient that has faded long before the end, behind which all are one number."""
    return lambda t: np.where(t < 0.5 * HOUR, steady + 1e-7 * np.exp(-t / DECAY), steady)


CREEP = history_of(Stage("stress", 0.0, HOUR, 260.0, LOAD))


def test_a_minimum_inside_has_its_rate_and_strain() -> None:
    minimum = np.array([0.25, 0.3, 0.25]) * HOUR
    curves = [softening_from(at) for at in minimum]
    (row,) = minimum_rates(solved(CREEP, *curves)).to_dict("records")
    least = [float(curve(at)) for curve, at in zip(curves, minimum, strict=True)]
    assert row["rate_per_s"] == pytest.approx(np.median(least), rel=0.01)
    assert row["rate_q5_per_s"] <= row["rate_per_s"] <= row["rate_q95_per_s"]
    rise = 1e-7 * np.exp(-minimum[0] / DECAY) / DECAY
    strain = (
        1e-8 * minimum[0]
        + 1e-7 * DECAY * -np.expm1(-minimum[0] / DECAY)
        + 0.5 * rise * minimum[0] ** 2
    )
    assert row["strain"] == pytest.approx(strain, rel=0.05)
    assert (row["minimum_inside"], row["least_at_end"]) == (1.0, 0.0)
    assert (row["stage"], row["stress_Pa"]) == (1, LOAD)


def test_a_plateau_has_no_strain_of_a_minimum() -> None:
    """The first of equal rates is no minimum, and errors of 1e-6 make none."""
    rng = np.random.default_rng(1)

    def with_errors(t: FloatArray) -> FloatArray:
        return plateau(1.1e-8)(t) * (1 + 1e-6 * rng.standard_normal(t.size))

    (row,) = minimum_rates(solved(CREEP, plateau(1e-8), with_errors)).to_dict("records")
    assert (row["minimum_inside"], row["least_at_end"]) == (0.0, 1.0)
    assert np.isnan([row["strain"], row["strain_q5"], row["strain_q95"]]).all()
    assert row["rate_per_s"] == pytest.approx(1.05e-8, rel=1e-3)


@pytest.mark.parametrize(("rise", "at_end"), [(-0.5, 1.0), (1.0, 0.0)])
def test_a_rate_that_falls_to_the_end_or_rises_has_no_minimum_inside(
    rise: float, at_end: float
) -> None:
    curve = solved(CREEP, lambda t: 1e-8 * (1 + rise * t / HOUR))
    (row,) = minimum_rates(curve).to_dict("records")
    assert (row["minimum_inside"], row["least_at_end"]) == (0.0, at_end)
    assert np.isnan(row["strain"])
    if at_end:
        assert row["rate_per_s"] == pytest.approx(5e-9)


def test_the_strain_is_that_of_draws_with_a_minimum_if_they_are_many() -> None:
    inside, flat = softening_from(0.25 * HOUR), plateau(1e-8)
    (alone,) = minimum_rates(solved(CREEP, inside)).to_dict("records")
    (many,) = minimum_rates(solved(CREEP, inside, inside, flat)).to_dict("records")
    assert many["minimum_inside"] == pytest.approx(2 / 3)
    assert many["strain"] == pytest.approx(alone["strain"])
    few = solved(CREEP, inside, flat, flat)
    (row,) = minimum_rates(few).to_dict("records")
    assert row["minimum_inside"] == pytest.approx(1 / 3)
    assert np.isnan(row["strain"])
    (table,) = minimum_rate_table(few)
    (shown,) = table.shown.to_dict("records")
    assert (shown["strain there (%)"], shown["strain, 5 to 95 %"]) == ("", "")
    assert (shown["minimum inside"], shown["least at the end"]) == ("33% of draws", "67% of draws")
    assert "plateau" in str(table.text)


def test_draws_that_run_backwards_do_not_count() -> None:
    forward, back = plateau(1e-8), lambda t: np.full_like(t, -1e-8)
    (row,) = minimum_rates(solved(CREEP, forward, forward, back)).to_dict("records")
    assert row["rate_q5_per_s"] == pytest.approx(1e-8)
    assert minimum_rates(solved(CREEP, forward, back, back)).empty
    assert minimum_rate_table(solved(CREEP, back)) == ()


def test_a_series_of_constant_stress_is_creep_like_a_stage_of_it() -> None:
    curve = softening_from(0.25 * HOUR)
    as_stage = minimum_rates(solved(CREEP, curve))
    as_series = minimum_rates(solved(series((0, 5), (1, 5)), curve))
    assert len(as_series) == 1
    assert as_series.equals(as_stage)


def test_every_load_of_a_series_has_a_row_and_ramps_have_none() -> None:
    """Rates at the corners are those of the ramps, and take no part."""
    loads = series((0, 0), (0.5, 4), (10, 4.02), (10.5, 0), (14, 0), (14.5, 6), (24, 5.98))

    def rates(t: FloatArray) -> FloatArray:
        hours = t / HOUR
        held = ((hours > 0.5) & (hours < 10)) | (hours > 14.5)
        return np.where(held, np.where(hours > 12, 4e-8, 1e-8), -1e-3)

    found = minimum_rates(solved(loads, rates))
    assert found["stress_Pa"].to_numpy() == pytest.approx([4.01e6, 5.99e6])
    assert found["rate_per_s"].to_numpy() == pytest.approx([1e-8, 4e-8])
    assert found["start_time_s"].to_numpy() == pytest.approx([0.5 * HOUR, 14.5 * HOUR])
    assert found["end_time_s"].to_numpy() == pytest.approx([10 * HOUR, 24 * HOUR])
    assert (found["stage"] == 1).all()


def test_a_short_load_of_a_series_has_a_row() -> None:
    """Of 47 hours in a stage of 1000, with ramps of half an hour beside it."""
    knots = ((0, 0), (0.5, 4), (47.5, 4), (48, 0), (500, 0), (500.5, 6), (999.5, 6), (1000, 0))
    first, second = creep_intervals(series(*knots))
    assert (first.start_time, first.end_time) == (0.5 * HOUR, 47.5 * HOUR)
    assert second.stress == 6e6


def test_the_measured_rate_is_that_of_the_readings() -> None:
    """Readings creep three times as fast as the solutions, and soften."""
    time = np.linspace(0.01, 1.0, 100) * HOUR
    minimum = 0.25 * HOUR
    curve = softening_from(minimum)
    rise = 1e-7 * np.exp(-minimum / DECAY) / DECAY
    strain = 1e-8 * time - 1e-7 * DECAY * np.expm1(-time / DECAY) + 0.5 * rise * time**2
    noise = 1e-9 * np.random.default_rng(1).standard_normal(time.size)
    test = replace(
        CREEP,
        time=time,
        reading_stage=np.zeros(time.size, dtype=np.int64),
        reading=3 * strain + noise,
    )
    found = solved(test, curve)
    (row,) = minimum_rates(found).to_dict("records")
    least = float(curve(np.array(minimum)))
    assert row["rate_per_s"] == pytest.approx(least, rel=0.01)
    assert row["measured_rate_per_s"] == pytest.approx(3 * least, rel=0.05)
    assert 0 < row["measured_rate_sd_per_s"] < 0.05 * least
    (table,) = minimum_rate_table(found)
    assert table.shown["measured rate there (1/s)"].tolist()[0].startswith(f"{3 * least:.1g}"[:1])
    few = replace(test, time=time[:4], reading_stage=test.reading_stage[:4], reading=strain[:4])
    (row,) = minimum_rates(solved(few, curve)).to_dict("records")
    assert np.isnan(row["measured_rate_per_s"])


def at_one_rate(time: FloatArray, noise: FloatArray) -> HistoryExperiment:
    """A test whose readings creep by 1e-8 1/s."""
    stage = np.zeros(time.size, dtype=np.int64)
    return replace(CREEP, time=time, reading_stage=stage, reading=1e-8 * time + noise)


def test_the_measured_rate_of_noisy_readings_is_not_too_low() -> None:
    """The least of many slopes would lie two standard errors below the rate."""
    time, rng = np.linspace(0.01, 1.0, 100) * HOUR, np.random.default_rng(2)
    tests = [at_one_rate(time, 1e-6 * rng.standard_normal(100)) for _ in range(25)]
    rows = pd.concat([minimum_rates(solved(one, softening_from(0.25 * HOUR))) for one in tests])
    errors = (rows["measured_rate_per_s"] - 1e-8) / rows["measured_rate_sd_per_s"]
    assert abs(errors.mean()) < 0.5


@pytest.mark.parametrize(
    ("minutes_between", "first", "last"), [(1, 9, 21), (3, 9, 21), (10, 0, 40), (15, 0, 60)]
)
def test_the_times_of_the_measured_rate_are_stated(
    minutes_between: int, first: float, last: float
) -> None:
    """They reach over a fifth of the hour, about its minimum at 15 minutes, or to the fifth."""
    time = np.arange(0.0, 61.0, minutes_between) * 60
    fit = solved(at_one_rate(time, np.zeros(time.size)), softening_from(0.25 * HOUR))
    (row,) = minimum_rates(fit).to_dict("records")
    ends = row["measured_start_time_s"] / 60, row["measured_end_time_s"] / 60
    assert ends == pytest.approx((first, last))
    (table,) = minimum_rate_table(fit)
    assert table.shown["measured over (min)"].tolist() == [f"{first} to {last}"]


def test_a_constant_force_is_creep_while_the_area_has_hardly_grown() -> None:
    """True stress under a constant force falls by the strain: here by 3 %, then by 12 % more."""
    (load,) = creep_intervals(series((0, 5), (4, 4.92), (9, 4.85), (10, 4.25)))
    assert (load.start_time, load.end_time) == (0.0, 9 * HOUR)
    assert load.stress == pytest.approx((4 * 4.96e6 + 5 * 4.885e6) / 9)


def test_the_first_of_an_unloading_is_no_creep() -> None:
    """A corner of a measured series may lie on the ramp, where the stress has fallen by 1.5 %."""
    (load,) = creep_intervals(series((0, 3.95), (0.05, 4), (10, 4), (10.1, 3.94), (11, 0)))
    assert (load.start_time, load.end_time) == (0.05 * HOUR, 10 * HOUR)
    salt = load_loading_history(DUNITE.parent / "halite" / "halite_z3.toml")
    for one in creep_intervals(salt):
        inside = [
            leg.rate
            for leg in salt.legs
            if one.start_time <= leg.start_time and leg.end_time <= one.end_time
        ]
        assert max(map(abs, inside)) < 1e5 / 86400


@pytest.mark.parametrize(
    ("knots", "reason"),
    [
        (((0, 0), (10, 5)), "a ramp"),
        (((0, 0), (5, 5), (5.4, 5), (10, 9)), "a short rest on a ramp"),
        (((0, 0), (10, 0)), "no load"),
        (((0, -5), (10, -5)), "tension"),
    ],
)
def test_what_is_no_creep(knots: tuple[tuple[float, float], ...], reason: str) -> None:
    assert creep_intervals(series(*knots)) == (), reason


def test_imposed_strain_is_no_creep() -> None:
    assert creep_intervals(history_twin("relaxation", 10)) == ()
    (load,) = creep_intervals(history_twin("mixed", 10))
    assert (load.stage, load.start_time, load.end_time) == (2, 1000.0, 3500.0)


def test_measured_salt_creeps_under_five_loads() -> None:
    salt = load_loading_history(DUNITE.parent / "halite" / "halite_z3.toml")
    loads = [one for one in creep_intervals(salt) if one.stress > 5e6]
    assert [round(one.stress / 1e6) for one in loads] == [11, 14, 16, 19, 21]
    assert all(3.9 < one.duration / 86400 < 4.1 for one in loads)
    rows = minimum_rates(solved(salt, lambda t: np.full_like(t, 1e-9)))
    assert {one.stress for one in loads} <= set(rows["stress_Pa"])


def times_in_loads(experiment: HistoryExperiment) -> list[int]:
    """How many times of the solution lie inside each load, its ends left out."""
    time = LIKELIHOOD.grid(experiment)
    return [
        int(np.sum((time > one.start_time) & (time < one.end_time)))
        for one in creep_intervals(experiment)
    ]


def loads_of_series(number: int) -> HistoryExperiment:
    """Loads of nine hours that grow by 1 MPa in the hour between them, all in one series."""
    knots = [(10.0 * k + hours, k + 1.0) for k in range(number) for hours in (0.0, 9.0)]
    return series(*knots, (10.0 * number, number + 1.0))


def test_loads_of_a_series_have_as_many_times_as_a_stage() -> None:
    salt = load_loading_history(DUNITE.parent / "halite" / "halite_z3.toml")
    for test in (salt, loads_of_series(3)):
        assert min(times_in_loads(test)) >= 40
        first = creep_intervals(test)[0]
        time = LIKELIHOOD.grid(test)
        since = (time[time > first.start_time] - first.start_time) / first.duration
        assert since[0] < 1.01e-4
        assert np.sum(since < 0.1) > np.sum((since > 0.4) & (since < 0.5))


def test_times_in_loads_have_a_limit_and_other_tests_none() -> None:
    stages = replace(CREEP, stages=(*CREEP.stages, Stage("stress", HOUR, 2 * HOUR, 260.0, 6e6)))
    for plain in (CREEP, stages, series((0, 5), (1, 5))):
        assert LIKELIHOOD.grid(plain).size < 50 * len(plain.stages)
    many = loads_of_series(16)
    assert len(creep_intervals(many)) == 16
    assert 480 < LIKELIHOOD.grid(many).size < 480 + 50


def test_a_minimum_in_one_load_of_a_series_is_told_closely() -> None:
    """Eight loads of which each is a short part of the series."""
    test = loads_of_series(8)
    load = creep_intervals(test)[4]
    minimum = 0.31 * HOUR
    curve = softening_from(minimum)

    def rates(t: FloatArray) -> FloatArray:
        inside = (t > load.start_time) & (t < load.end_time)
        return np.where(inside, curve(np.maximum(t - load.start_time, 0.0)), 1e-8)

    row = minimum_rates(solved(test, rates)).to_dict("records")[4]
    assert row["minimum_inside"] == 1.0
    assert row["rate_per_s"] == pytest.approx(float(curve(np.array(minimum))), rel=0.01)
