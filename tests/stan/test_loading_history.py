"""Loading histories against closed forms and an independent solver."""

from collections.abc import Mapping, Sequence
from pathlib import Path
from typing import Any

import history_oracle
import numpy as np
import numpy.typing as npt
import oracle
import pytest
from history_oracle import DASHPOT, KELVIN, PATH, STRAIN, STRESS

from pyburgers.cmdstan.program import load_program
from pyburgers.model.parameters import PROGRAM_PARAMETERS, STANDARD_VALUES
from pyburgers.protocols.loading_history.stages import Leg

FloatArray = npt.NDArray[np.float64]

VALUES = Path(__file__).parent / "loading_history_values.stan"
GRAIN_SIZE = 230e-6
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
    """Stress (Pa), strain, Kelvin strain, path strain, dashpot strain, d/d_0: shape (6, n)."""
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
    return np.asarray(load_program(VALUES).evaluate(data)["solution"]).T[:6]


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


MATERIALS: Mapping[str, Mapping[str, float]] = {
    "standard": {},
    "hardening": {"steady_state_fabric_factor": 1.6, "steady_state_grain_size": 400e-6},
    "compliant apparatus": {"apparatus_compliance": 3e-10},
    "power-law Kelvin": {
        "kelvin_stress_exponent": 3.0,
        "kelvin_activation_enthalpy": 60e3,
        "kelvin_reference_stress": 2e6,
        "kelvin_reference_temperature": 260.0,
    },
    "hyperbolic sine": {"breakdown_stress": 5e6, "stress_exponent": 3.0},
    "piezometer": {
        "piezometer_reference_grain_size": 2e-3,
        "piezometer_exponent": 1.33,
        "piezometer_stress_floor": 1e6,
        "apparatus_compliance": 1e-10,
    },
}


@pytest.mark.parametrize("material", MATERIALS)
def test_random_histories_agree_with_an_independent_solver(material: str) -> None:
    """100 of the standard material: 0.1 % is asked for, much less is found."""
    rng = np.random.default_rng(18)
    values = {**ICE, **MATERIALS[material]}
    for _ in range(100 if material == "standard" else 8):
        legs, times = random_history(rng)
        found = solve(values, legs, times, tolerance=1e-10)
        expected = history_oracle.history(values, GRAIN_SIZE, legs, times)
        for row, wanted in ((0, STRESS), (1, STRAIN), (2, KELVIN), (3, PATH), (4, DASHPOT)):
            within = 2e-6 * np.abs(expected[wanted]).max() + (0 if wanted == STRESS else 1e-10)
            np.testing.assert_allclose(
                found[row], expected[wanted], rtol=0, atol=within, err_msg=str(legs)
            )


def test_strains_add_up() -> None:
    """Elastic, Kelvin and dashpot strain are the whole, in legs that are driven by either."""
    rng = np.random.default_rng(19)
    for _ in range(10):
        legs, times = random_history(rng)
        stress, strain, kelvin, _, dashpot, _ = solve(ICE, legs, times, tolerance=1e-9)
        parts = stress / ICE["maxwell_modulus"] + kelvin + dashpot
        np.testing.assert_allclose(strain, parts, rtol=0, atol=1e-8)
        imposed, before = 0.0, 0
        for one, at in zip(legs, times, strict=True):
            here = slice(before, before + at.size)
            if one.driven == "strain":
                # The first time is the start of the leg.
                imposed = strain[here][0] + one.rate * (at - one.start_time)
                np.testing.assert_allclose(strain[here], imposed, rtol=0, atol=1e-8)
            before += at.size


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
