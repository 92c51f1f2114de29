"""Loading histories against closed forms and an independent solver."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import history_oracle
import history_twins
import numpy as np
import oracle
import pytest
from history_oracle import BACKSTRESS as BACKSTRESS_ROW
from history_oracle import DASHPOT, KELVIN, PATH, STRAIN, STRESS
from history_twins import (
    BACKSTRESS,
    DISLOCATIONS,
    GRAIN_SIZE,
    PIEZOMETER,
    POWER_LAW_KELVIN,
)

from pyburgers.cmdstan.program import load_program
from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.loading_history.stages import Leg
from pyburgers.model.parameters import PROGRAM_PARAMETERS, STANDARD_VALUES

VALUES = Path(__file__).parent / "loading_history_values.stan"
TEMPERATURE = 263.0
ICE = {
    **STANDARD_VALUES,
    "maxwell_modulus": 4e9,
    "kelvin_modulus": 1e9,
    "kelvin_viscosity": 3e11,
    "stress_exponent": 3.8,
    "grain_size_exponent": 0.5,
    "activation_enthalpy": 62e3,
    "beta": -7.29e-4,
    "steady_state_grain_size": 90e-6,
    "steady_state_fabric_factor": 0.5,
    "critical_strain_grain_size": 0.05,
    "critical_strain_fabric": 0.1,
    "stress_noise": 1.0,
}
SECOND = {**history_twins.SECOND, "second_rate": 2e-6}
THIRD = {**history_twins.THIRD, "second_rate": 2e-6, "third_rate": 1e-6}
LINEAR = {
    "stress_exponent": 1.0,
    "grain_size_exponent": 0.0,
    "beta": -2.7e-4,  # a viscosity of 3e13 Pa s
    "activation_enthalpy": 62e3,
    "steady_state_grain_size": GRAIN_SIZE,
    "steady_state_fabric_factor": 1.0,
}


def leg(driven: Any, start: float, end: float, value: float, rate: float = 0.0) -> Leg:
    return Leg(driven, start, end, value, rate, TEMPERATURE, 0)


def solve(
    values: Mapping[str, float],
    legs: Sequence[Leg],
    times: Sequence[FloatArray],
    tolerance: float = 1e-12,
) -> FloatArray:
    """Stress (Pa), total, Kelvin, path, dashpot strain, d/d_0, backstress (Pa): shape (7, n)."""
    rows = [
        [
            float(one.driven == "stress"),
            one.end_time - one.start_time,
            one.start_value,
            one.rate,
            one.temperature,
        ]
        for one in legs
    ]
    data = {
        "n_legs": len(legs),
        "n_times": sum(map(len, times)),
        "parameter": [values[p.name] for p in PROGRAM_PARAMETERS],
        "leg": rows,
        "time": np.concatenate(
            [
                np.minimum((at - one.start_time) / (one.end_time - one.start_time), 1.0)
                for at, one in zip(times, legs, strict=True)
            ]
        ).tolist(),
        "n_in_leg": [len(at) for at in times],
        "initial_grain_size": GRAIN_SIZE,
        "stress_scale": 1e7,
        "strain_scale": 1e-2,
        "tolerance": tolerance,
        "n_elements": 1,  # of the Kelvin part
        "element": [[0.0, 0.0, 1.0]],
    }
    return np.asarray(load_program(VALUES).evaluate(data)["solution"]).T[[0, 1, 2, 3, 4, 5, 7]]


def viscosity(values: Mapping[str, float]) -> float:
    """Of a linear dashpot, Pa s."""
    return 1 / oracle.rate_factor(values, TEMPERATURE)


def test_creep_and_recovery_of_a_linear_body_have_the_closed_form() -> None:
    values = ICE | LINEAR
    stress, loaded, end = 5e6, 4e3, 1e4
    legs = [leg("stress", 0.0, loaded, stress), leg("stress", loaded, end, 0.0)]
    times = [
        np.concatenate([[0.0], np.geomspace(1e-3, loaded, 40)]),
        loaded + np.concatenate([[0.0], np.geomspace(1e-3, end - loaded, 40)]),
    ]
    found = solve(values, legs, times)
    time = np.concatenate(times)
    kelvin_time = values["kelvin_viscosity"] / values["kelvin_modulus"]

    def creep(since: FloatArray) -> FloatArray:
        since = np.maximum(since, 0.0)
        return stress * (
            -np.expm1(-since / kelvin_time) / values["kelvin_modulus"] + since / viscosity(values)
        )

    on = (np.arange(time.size) < times[0].size) * stress
    expected = on / values["maxwell_modulus"] + creep(time) - creep(time - loaded)
    np.testing.assert_array_equal(found[0], on)
    np.testing.assert_allclose(found[1], expected, rtol=0, atol=1e-7 * expected.max())
    np.testing.assert_allclose(found[1], expected, rtol=1e-7)


def test_relaxation_of_a_power_law_body_has_the_closed_form() -> None:
    values = ICE | {
        "kelvin_modulus": 1e19,
        "kelvin_viscosity": 1e22,
        "steady_state_grain_size": GRAIN_SIZE,
        "steady_state_fabric_factor": 1.0,
    }
    legs = [leg("stress", 0.0, 1.0, 8e6), leg("strain", 1.0, 1e5, 0.0)]
    times = [np.array([1.0]), 1.0 + np.geomspace(1e-2, 1e5 - 1, 60)]
    found = solve(values, legs, times)[0]
    n = values["stress_exponent"]
    factor = oracle.rate_factor(values, TEMPERATURE) * GRAIN_SIZE ** -values["grain_size_exponent"]
    expected = (
        8e6 ** (1 - n) + (n - 1) * values["maxwell_modulus"] * factor * (times[1] - 1.0)
    ) ** (1 / (1 - n))
    assert expected[-1] < 0.5 * expected[0]
    np.testing.assert_allclose(found[1:], expected, rtol=1e-7)


def random_history(rng: np.random.Generator) -> tuple[list[Leg], list[FloatArray]]:
    """1 to 6 legs of any kind, and times in them."""
    legs, times, start = [], [], 0.0
    for _ in range(rng.integers(1, 7)):
        end = start + 10 ** rng.uniform(1, 4)
        temperature = TEMPERATURE + rng.uniform(-5, 5)
        if rng.random() < 0.5:
            rate = rng.choice([0.0, 1.0, 1.0]) * 10 ** rng.uniform(-6.5, -4)
            rate *= rng.choice([1.0, 1.0, -0.2]) * min(1.0, 0.05 / (rate * (end - start) + 1e-12))
            legs.append(Leg("strain", start, end, 0.0, rate, temperature, 0))
        else:
            first, last = rng.uniform(-2e6, 9e6, 2)
            if rng.random() < 0.5:
                last = first
            rate = (last - first) / (end - start)
            legs.append(Leg("stress", start, end, first, rate, temperature, 0))
        since = np.geomspace(1e-3, 1.0, rng.integers(1, 12)) * (end - start)
        times.append(start + np.concatenate([[0.0], since]))
        start = end
    return legs, times


COMPLIANT = {**PIEZOMETER, "apparatus_compliance": 1e-10}

MATERIALS: Mapping[str, Mapping[str, float]] = {
    "standard": {},
    "hardening": {"steady_state_fabric_factor": 1.6, "steady_state_grain_size": 400e-6},
    "compliant apparatus": {"apparatus_compliance": 3e-10},
    "power-law Kelvin": POWER_LAW_KELVIN,
    "hyperbolic sine": {"breakdown_stress": 5e6, "stress_exponent": 3.0},
    "threshold stress": {"threshold_stress": 1e6, "stress_exponent": 3.0},
    "backstress": BACKSTRESS,
    "backstress of a linear dashpot": {
        **BACKSTRESS,
        **LINEAR,
        "beta": 3.1e-5,  # a viscosity of 3e11 Pa s
        "recovery_exponent": 1.0,
    },
    "backstress, sine and power-law Kelvin": {
        **BACKSTRESS,
        "breakdown_stress": 5e6,
        "stress_exponent": 3.0,
        "kelvin_stress_exponent": 3.0,
        "kelvin_reference_stress": 2e6,
    },
    "dislocations": DISLOCATIONS,
    "dislocations, sine and piezometer": {
        **DISLOCATIONS,
        "breakdown_stress": 2e6,
        "stress_exponent": 1.0,
        "beta": 2e-5,
        "kelvin_stress_exponent": 3.0,
        "kelvin_reference_stress": 2e6,
        **COMPLIANT,
    },
    "backstress, threshold and piezometer": {
        **BACKSTRESS,
        "threshold_stress": 5e5,
        **COMPLIANT,
    },
    "second mechanism": SECOND,
    "second mechanism in series": {**SECOND, "second_in_series": 1.0},
    "third mechanism in series with the second": {**THIRD, "third_in_series": 1.0},
    "third mechanism beside two in series": {**THIRD, "second_in_series": 1.0},
    "second mechanism, threshold in series": {
        **SECOND,
        "second_in_series": 1.0,
        "threshold_stress": 5e5,
    },
    "second mechanism, backstress, piezometer": {
        **SECOND,
        **BACKSTRESS,
        "kelvin_stress_exponent": 3.0,
        "kelvin_reference_stress": 2e6,
        **COMPLIANT,
    },
    "piezometer": COMPLIANT,
}


@pytest.mark.parametrize(
    ("material", "number"),
    [*((one, 8) for one in MATERIALS), pytest.param("standard", 100, marks=pytest.mark.slow)],
)
def test_random_histories_agree_with_an_independent_solver(material: str, number: int) -> None:
    """0.1 % is asked for, much less is found."""
    rng = np.random.default_rng(18)
    values = {**ICE, **MATERIALS[material]}
    one_sign = values["reference_backstress"] > 0  # of dislocations
    for _ in range(number):
        legs, times = random_history(rng)
        if one_sign:
            legs = [
                replace(one, start_value=abs(one.start_value), rate=abs(one.rate)) for one in legs
            ]
        found = solve(values, legs, times, tolerance=1e-10)
        expected = history_oracle.history(values, GRAIN_SIZE, legs, times)
        for row, wanted, least in (
            (0, STRESS, 0),
            (1, STRAIN, 1e-10),
            (2, KELVIN, 1e-10),
            (3, PATH, 1e-10),
            (4, DASHPOT, 1e-10),
            (6, BACKSTRESS_ROW, 1e-2),
        ):
            within = 2e-6 * np.abs(expected[wanted]).max() + least
            np.testing.assert_allclose(
                found[row], expected[wanted], rtol=0, atol=within, err_msg=str(legs)
            )


PANELS = np.concatenate([[0.0], np.geomspace(1e-6, 1.0, 40)])
"""Ends of the panels of a leg, as shares of its duration: dense at its start."""

NODES, WEIGHTS = np.polynomial.legendre.leggauss(8)


def in_panels(one: Leg) -> tuple[FloatArray, FloatArray]:
    """Times (s) in a leg between its ends, and their weights (s) in an integral over it."""
    half = 0.5 * np.diff(PANELS)[:, np.newaxis]
    middle = PANELS[:-1, np.newaxis] + half
    duration = one.end_time - one.start_time
    time = one.start_time + duration * (middle + half * NODES).ravel()
    return time, duration * (half * WEIGHTS).ravel()


def microstructure(
    values: Mapping[str, float], path: FloatArray, relative_size: FloatArray
) -> tuple[FloatArray, FloatArray]:
    """Grain size (m) and fabric factor after a path strain; a piezometer has sizes of its own."""

    def settled(start: float, name: str, critical: str) -> FloatArray:
        kept: FloatArray = np.exp(-path / values[critical])
        return values[name] + (start - values[name]) * kept

    size = settled(GRAIN_SIZE, "steady_state_grain_size", "critical_strain_grain_size")
    if values["piezometer_reference_grain_size"] > 0:
        size = GRAIN_SIZE * relative_size
    return size, settled(1.0, "steady_state_fabric_factor", "critical_strain_fabric")


def stored(values: Mapping[str, float], stress: float, kelvin: float) -> FloatArray:
    """Energy (J/m3) in the Maxwell spring, the apparatus and the Kelvin spring."""
    compliances = 1 / values["maxwell_modulus"], values["apparatus_compliance"]
    parts = [0.5 * compliance * stress**2 for compliance in compliances]
    return np.array([*parts, 0.5 * values["kelvin_modulus"] * kelvin**2])


WORKED: Sequence[Leg] = (
    leg("strain", 0.0, 400.0, 0.0, 5e-5),
    leg("strain", 400.0, 2000.0, 0.0, 0.0),
    leg("stress", 2000.0, 5000.0, 4e6),
    leg("stress", 5000.0, 5600.0, 4e6, 2e3),
    leg("stress", 5600.0, 8000.0, 1e6),
    leg("strain", 8000.0, 8500.0, 0.0, 4e-5),
)
"""Constant rate, relaxation, creep, a ramp of the stress, partial unloading, constant rate."""


@pytest.mark.parametrize("material", MATERIALS)
def test_the_work_of_the_load_is_stored_or_dissipated(material: str) -> None:
    """The integral of stress over strain at the end of every leg, to 1e-8 of the work.

    The work knows what is imposed and what comes out, its parts the constitutive equations.
    """
    values = {**ICE, **MATERIALS[material]}
    nodes = [in_panels(one) for one in WORKED]
    times = [
        np.concatenate([[one.start_time], time, [one.end_time]])
        for one, (time, _) in zip(WORKED, nodes, strict=True)
    ]
    found = np.split(
        solve(values, WORKED, times, tolerance=1e-13), np.cumsum(list(map(len, times)))[:-1], axis=1
    )
    work, moved = 0.0, 0.0
    dissipated = np.zeros(2)  # in the Kelvin dashpot, and in that of the flow law
    last = np.zeros(2)  # stress and strain
    for one, (_, weight), columns in zip(WORKED, nodes, found, strict=True):
        stress, strain, kelvin, path, _, relative_size, backstress = columns
        within = slice(1, -1)
        # Springs alone answer a jump, in proportion.
        before = work
        work += 0.5 * (last[0] + stress[0]) * (strain[0] - last[1])
        if one.driven == "strain":
            work += one.rate * float(weight @ stress[within])
        else:
            at_ends = stress[-1] * strain[-1] - stress[0] * strain[0]
            work += at_ends - one.rate * float(weight @ strain[within])
        moved += abs(work - before)
        size, fabric = microstructure(values, path, relative_size)
        rates = np.array(
            [
                oracle.kelvin_rate(values, TEMPERATURE, *at)
                for at in zip(stress[within], kelvin[within], strict=True)
            ]
        )
        flow, _ = oracle.all_rates(values, TEMPERATURE, stress, backstress, size, fabric)
        flow = flow[within]
        driving = stress[within] - values["kelvin_modulus"] * kelvin[within]
        dissipated += [weight @ (driving * rates), weight @ (stress[within] * flow)]
        energy = stored(values, stress[-1], kelvin[-1])
        assert energy.sum() + dissipated.sum() == pytest.approx(work, abs=1e-8 * moved), one
        last = np.array([stress[-1], strain[-1]])
    # No part is so small that it could be missing.
    used = energy[energy > 0]
    assert used.size == 2 + (values["apparatus_compliance"] > 0)
    assert np.concatenate([used, dissipated]).min() > 1e-4 * work


def test_the_strain_of_a_stress_gives_that_stress_back() -> None:
    """Strain readings so dense that straight lines between them are good to 1e-8 of strain."""
    load = [leg("stress", 0.0, 10.0, 0.0, 3e5), leg("stress", 10.0, 3010.0, 3e6)]
    dense = np.union1d(np.geomspace(1e-2, 3e3, 1000), np.linspace(1.0, 3e3, 4000))
    time = [np.linspace(0.0, 10.0, 400), 10.0 + dense]
    stress, strain, *_ = solve(ICE, load, time)
    at = np.concatenate([time[0], time[1]])
    legs = [
        leg("strain", at[k], at[k + 1], 0.0, (strain[k + 1] - strain[k]) / (at[k + 1] - at[k]))
        for k in np.flatnonzero(np.diff(at) > 0)
    ]
    found = solve(ICE, legs, [np.array([one.end_time]) for one in legs], tolerance=1e-11)[0]
    expected = stress[1:][np.diff(at) > 0]
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-5 * expected.max())
