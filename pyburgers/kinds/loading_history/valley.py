"""Pins of the valley coordinates along loading histories."""

from collections.abc import Mapping
from dataclasses import dataclass, fields

import numpy as np

from pyburgers.common.array_types import BoolArray, FloatArray, IntArray
from pyburgers.kinds.likelihood import AtMode, spread_over
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stages import Leg
from pyburgers.kinds.loading_history.stan_data import leg_of_readings
from pyburgers.kinds.valley import (
    FLOWING_SHARE,
    MIN_FLOWING_POINTS,
    N_PINS,
    Pins,
    ValleyChart,
    middle_of_rise,
    quantile_places,
)
from pyburgers.model.residual_laws import residual_parts

N_KNOTS = 60
"""Of all legs with imposed strain together, besides those at readings."""


MIN_KNOTS = 5
"""Of each of them."""


SETTLED_SHARE = 0.9
"""Where stress is imposed pins lie where the dashpot carries this share of the strain rate or more.

Earlier on its rate is what the Kelvin element leaves of one that is read: with an element softer
than that at the mode, pins there ask for a softening that the strain does not show. Tests with
less than `N_PINS` such readings have pins wherever the dashpot flows."""


SLOPE_NOISE = 2 * np.pi
"""Relative noise of a strain rate over that of the strain: of a wave over the flow."""


class LoadingHistoryValley(ValleyChart[HistoryExperiment]):
    """Pins lie at readings, where strain advances by flow; ln S_0 is that in the middle.

    Under loads alone, ln S_0 follows from times at the pins of the load with most flow. As many
    under the others keep their flow where the split of the softening changes.
    """

    def pins(self, test: AtMode[HistoryExperiment]) -> Pins:
        """Set pins where the dashpot carries nearly all of a read rate, or half an imposed one."""
        experiment, values = test.experiment, test.mode.values
        curve = _along(test)
        flowing = curve.flowing & curve.is_reading
        settled = flowing & curve.settled
        at_readings = settled if settled.sum() >= N_PINS else flowing
        loads = _loads_that_flow(experiment, curve, at_readings)
        strain_is_read = experiment.response_is_strain[np.cumsum(curve.is_reading) - 1]
        beside = max(2, -(-N_PINS // max(1, len(loads) - 1)))
        parts = [
            _under_load(curve, at_readings & (curve.leg == load), values, number)
            for load, number in zip(loads, [N_PINS] + [beside] * len(loads), strict=False)
        ] or [_wherever_it_flows(curve, at_readings, values, strain_is_read, N_PINS)]
        order = np.argsort(np.concatenate([one.at for one in parts]))
        at, averaged, noise, readings = (
            np.concatenate([getattr(one, field.name) for one in parts])[order]
            for field in fields(_Places)
        )
        is_first = np.isin(at, parts[0].at)
        start = np.searchsorted(curve.leg, curve.leg[at])
        since_start = np.where(averaged, curve.time[at] - curve.time[start], 0.0)

        def rate_or_average(rate: FloatArray, whole: FloatArray) -> FloatArray:
            """Rate at pins, where times since the start of the load are given that since then."""
            gained = whole[at] - np.where(start > 0, whole[start - 1], 0.0)
            average = gained / np.where(averaged, since_start, 1.0)
            return np.asarray(np.where(averaged, average, rate[at]))

        unit = rate_or_average(curve.dashpot_rate, curve.dashpot_strain)
        time_spent = np.zeros(at.size)
        time_spent[is_first] = _time_spent(curve, at[is_first], since_start[is_first])
        path_strain = curve.path_strain[at]
        for k in np.flatnonzero(averaged):
            path_strain[k] = _strain_at_rate(curve, start[k], at[k], unit[k])
        # Where stress is imposed, it is exactly linear between the ends of a leg.
        shows = np.where(curve.driven_by_stress, curve.is_end, curve.is_knot)
        kept = shows | np.isin(np.arange(curve.leg.size), at)
        strain_rate = rate_or_average(curve.strain_rate, curve.strain)
        return Pins(
            knot_time=curve.time[kept],
            knot_stress=curve.stress[kept],
            knot=np.searchsorted(np.flatnonzero(kept), at),
            unit=unit,
            path_strain=path_strain,
            strain_rate=strain_rate / unit,
            stress_rate=rate_or_average(curve.stress_rate, curve.stress) / unit,
            grain_size=curve.grain_size[at],
            # Where times count, the beginning of the load does so by its time alone.
            relative_noise=np.where(is_first & averaged, np.inf, noise),
            time_spent=time_spent,
            since_start=since_start,
            readings=readings,
            reference_rate=float(np.median(unit[is_first & ~averaged])),
            loading_time=_loading_time(experiment, curve, values),
            noise="strain_noise" if strain_is_read[flowing].mean() > 0.5 else "stress_noise",
            **_flow_without_data(
                test, float(unit @ time_spent), readings[is_first & ~averaged].sum()
            ),
        )


@dataclass(frozen=True, eq=False)
class _Curve:
    """The solution at the mode along all legs; a time at which two legs meet comes twice."""

    time: FloatArray
    leg: IntArray
    is_end: BoolArray
    is_knot: BoolArray
    is_reading: BoolArray
    stress: FloatArray
    strain: FloatArray
    path_strain: FloatArray
    dashpot_strain: FloatArray
    strain_rate: FloatArray
    stress_rate: FloatArray
    dashpot_rate: FloatArray
    grain_size: FloatArray
    flowing: BoolArray
    driven_by_stress: BoolArray
    settled: BoolArray


def _along(test: AtMode[HistoryExperiment]) -> _Curve:
    """Solve a test at its mode, dense at the start of every leg, and at the readings."""
    experiment, values = test.experiment, test.mode.values
    legs, of_reading = experiment.legs, leg_of_readings(experiment)
    n = max(MIN_KNOTS, N_KNOTS // len(legs))
    shape = np.union1d(np.geomspace(1e-3, 1.0, n // 2 + 1), np.linspace(0.0, 1.0, n // 2 + 1))
    starts, ends = np.transpose([(one.start_time, one.end_time) for one in legs])
    knots = spread_over(starts, ends, shape)
    times = [np.union1d(own, experiment.time[of_reading == k]) for k, own in enumerate(knots)]
    time, leg = np.concatenate(times), np.repeat(np.arange(len(legs)), [t.size for t in times])
    found = test.solution(time)
    elastic = 1 / values["maxwell_modulus"] + values["apparatus_compliance"]
    stress, strain = found["grid_stress"], found["grid_strain"] - values["strain_offset"]
    kelvin_strain = found["grid_kelvin_strain"]
    dashpot_strain = strain - elastic * stress - kelvin_strain
    parts = np.split(np.arange(time.size), np.cumsum([t.size for t in times])[:-1])
    dashpot_rate, stress_rate = (
        np.concatenate([np.gradient(along[part], time[part]) for part in parts])
        for along in (dashpot_strain, stress)
    )
    strain_rate = found["grid_strain_rate"]
    temperature = np.array([one.temperature for one in legs])[leg]
    driven_by_stress = np.array([one.driven == "stress" for one in legs])[leg]
    return _Curve(
        time=time,
        leg=leg,
        is_end=np.concatenate([np.isin(t, t[[0, -1]]) for t in times]),
        is_knot=np.concatenate([np.isin(t, own) for t, own in zip(times, knots, strict=True)]),
        is_reading=np.concatenate(
            [np.isin(t, experiment.time[of_reading == k]) for k, t in enumerate(times)]
        ),
        stress=stress,
        strain=strain,
        path_strain=found["grid_path_strain"],
        dashpot_strain=dashpot_strain,
        strain_rate=strain_rate,
        stress_rate=stress_rate,
        dashpot_rate=dashpot_rate,
        grain_size=found["grid_grain_size"],
        # The strength at another temperature hangs on Q_M.
        flowing=(strain_rate > 0)
        & (stress > 0)
        & (dashpot_rate >= FLOWING_SHARE * strain_rate)
        & (temperature == experiment.temperature),
        driven_by_stress=driven_by_stress,
        settled=~driven_by_stress | (dashpot_rate >= SETTLED_SHARE * strain_rate),
    )


@dataclass(frozen=True, eq=False)
class _Places:
    """Places of pins on a curve, under one load or wherever strain flows, (n,) each.

    `averaged`: whether a pin stands for all since the start of the load. The others: see `Pins`.
    """

    at: IntArray
    averaged: BoolArray
    relative_noise: FloatArray
    readings: FloatArray


def _wherever_it_flows(
    curve: _Curve,
    inside: BoolArray,
    values: Mapping[str, float],
    strain_is_read: BoolArray,
    number: int,
) -> _Places:
    """Place a number of pins at readings `inside`."""
    at = np.flatnonzero(inside)[quantile_places(curve.path_strain[inside], number)]
    slope_noise = SLOPE_NOISE * _strain_error(values) / np.ptp(curve.path_strain[inside])
    noise = np.where(strain_is_read[at], slope_noise, values["stress_noise"] / curve.stress[at])
    readings = _independent_readings(curve.time[inside], values)
    return _Places(at, np.zeros(at.size, bool), noise, np.full(at.size, readings / at.size))


def _under_load(
    curve: _Curve, inside: BoolArray, values: Mapping[str, float], number: int
) -> _Places:
    """Place a number of pins at readings `inside` a load, and one that stands for its beginning."""
    flow = _wherever_it_flows(curve, inside, values, np.ones(inside.size, bool), number)
    start = int(np.searchsorted(curve.leg, curve.leg[flow.at[0]]))
    end = _end_before(curve, start, flow.at)
    gained = curve.dashpot_strain[end] - curve.dashpot_strain[start]
    return _Places(
        np.concatenate([end, flow.at]),
        np.concatenate([np.ones(end.size, bool), flow.averaged]),
        np.concatenate([_strain_error(values) / gained, flow.relative_noise]),
        np.concatenate([np.full(end.size, flow.readings.sum()), flow.readings]),
    )


def _strain_error(values: Mapping[str, float]) -> float:
    """Error of ln strength from one of the strain, times the strain of the flow."""
    return values["strain_noise"] / values["stress_exponent"]


def _loads_that_flow(
    experiment: HistoryExperiment, curve: _Curve, at_readings: BoolArray
) -> list[int]:
    """Find constant loads that flow, that with most flow first, if all pins would lie under them.

    ln S_0 is then solved from times: the time of the whole strain of a load is what it fixes best.
    """
    loads, readings = np.unique(curve.leg[at_readings], return_counts=True)
    legs: tuple[Leg, ...] = experiment.legs
    if any(legs[k].driven == "strain" or legs[k].rate != 0 for k in loads):
        return []
    enough = loads[readings >= MIN_FLOWING_POINTS]
    flow = [np.ptp(curve.dashpot_strain[curve.leg == k]) for k in enough]
    return [int(enough[k]) for k in np.argsort(flow)[::-1]]


def _end_before(curve: _Curve, start: int, places: IntArray) -> IntArray:
    """Find the reading of a load, begun at `start`, up to which the first pin does not reach."""
    inside = np.arange(start, places[0])
    earlier = inside[curve.is_reading[inside] & (curve.time[inside] > curve.time[start])]
    if not earlier.size:
        return np.empty(0, dtype=np.int64)
    strain = curve.path_strain[places]
    reach = strain[0] - (strain[1] - strain[0]) / 2
    nearest = np.argmin(np.abs(curve.path_strain[earlier] - reach))
    return np.asarray(earlier[[nearest]])


def _strain_at_rate(curve: _Curve, start: int, end: int, rate: float) -> float:
    """Path strain at which the dashpot has a rate, between two places of the curve."""
    rising = np.maximum.accumulate(curve.dashpot_rate[start + 1 : end + 1])
    return float(np.interp(rate, rising, curve.path_strain[start + 1 : end + 1]))


def _time_spent(curve: _Curve, at: IntArray, since_start: FloatArray) -> FloatArray:
    """Time (s) that the dashpot spends near each pin; zeros where none stands for the beginning."""
    if not since_start.any():
        return np.zeros(at.size)
    flowed, until = curve.dashpot_strain[at], since_start[0]
    middle = (flowed[2:] + flowed[1:-1]) / 2
    edges = np.concatenate([flowed[:1], middle, [2 * flowed[-1] - middle[-1]]])
    return np.concatenate([[until], np.diff(edges) / curve.dashpot_rate[at[1:]]])


def _flow_without_data(
    test: AtMode[HistoryExperiment], flow_strain: float, readings: float
) -> dict[str, float]:
    """Return `seen_flow` and `replaced_deviation` of `Pins`, if there is a flow strain.

    Readings fix a strain that grows in proportion to time to the square root of 3 over their
    number, in units of their noise.
    """
    replaced = test.coordinates.replaced_parameter
    if not flow_strain or replaced is None:
        return {}
    return {
        "seen_flow": float(np.sqrt(3 / readings)) * test.mode.values["strain_noise"] / flow_strain,
        "replaced_deviation": float(test.priors[replaced].distribution().std()),
    }


def _independent_readings(time: FloatArray, values: Mapping[str, float]) -> float:
    """Count the independent readings that fix a slow change as well as those at times (s)."""
    drifting = min(1.0, 2 * values["residual_correlation_time"] / float(np.ptp(time)))
    share = residual_parts(values)[1] if drifting > 0 else 0.0
    return float(1 / (share * drifting + (1 - share) / time.size))


def _loading_time(
    experiment: HistoryExperiment, curve: _Curve, values: Mapping[str, float]
) -> float:
    """Time (s) of the elastic rise; under a jump of the stress twice that to the first reading."""
    first: Leg = experiment.legs[0]
    if first.driven == "stress":
        return 2 * float(experiment.time[experiment.time > 0].min())
    stiffness = 1 / (1 / values["maxwell_modulus"] + values["apparatus_compliance"])
    inside = curve.leg == 0
    return middle_of_rise(curve.time[inside], curve.stress[inside], stiffness * first.rate)
