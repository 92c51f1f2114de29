"""A dashpot with a backstress: limits, steady states, density, gradients, priors, refusals."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import oracle
import pytest
from conftest import ICE
from evaluated_laws import names_of, value_of
from history_twins import (
    BACKSTRESS,
    DISLOCATIONS,
    GRAIN_SIZE,
    TEMPERATURE,
    TRUTH,
    history_twin,
)
from ice_spectrum import PERIODS, ice_spectrum
from imagined_tests import imagined_history
from scipy.optimize import brentq

from pyburgers import load_experiment
from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stages import Control, Stage
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import given_parameters
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.laws import HARDENING_LAWS
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import with_variant
from pyburgers.predictions.stated_laws import laws_of

pytestmark = pytest.mark.usefixtures("programs")

EXACT = SolverOptions(tolerance=1e-13, max_num_steps=10_000_000)
CHOICE = {"hardening": "backstress"}
PARAMETERS = HARDENING_LAWS["backstress"].parameters
ENDLESS = {"backstress_limit": 1e25}
FROZEN = {
    **TRUTH,
    "grain_size_exponent": 0.0,
    "steady_state_fabric_factor": 1.0,
    "activation_enthalpy": 60e3,
}
STIFF = {"kelvin_modulus": 1e20, "kelvin_viscosity": 1e22}


def beta(rate: float, stress: float, exponent: float) -> float:
    """Of a dashpot of the frozen material that has a rate (1/s) at a stress (Pa)."""
    log_factor = np.log(rate) - exponent * np.log(stress)
    return float(log_factor / 60e3 + 1 / (GAS_CONSTANT * TEMPERATURE))


def flowing(rate: float, stress: float, exponent: float, **others: float) -> dict[str, float]:
    flow = {"stress_exponent": exponent, "beta": beta(rate, stress, exponent)}
    return {**FROZEN, **STIFF, **flow, **others}


def of_one_stage(control: Control, value: float, duration: float) -> HistoryExperiment:
    return imagined_history(Stage(control, 0.0, duration, TEMPERATURE, value))


@pytest.mark.parametrize("name", ["load and unload", "mixed"])
def test_without_recovery_a_linear_dashpot_is_a_kelvin_element(name: str) -> None:
    test = history_twin(name, 30)
    modulus, viscosity = 0.8e9, 1.2e11
    no_flow = {**flowing(1e-30, 1e6, 1.0), "kelvin_modulus": modulus, "kelvin_viscosity": viscosity}
    kelvin = simulate(test, no_flow, solver=EXACT)
    dashpot = flowing(1e6 / viscosity, 1e6, 1.0, hardening_modulus=modulus, **ENDLESS)
    hardened = simulate(test, dashpot, solver=EXACT)
    for column in ("stress_Pa", "strain"):
        scale = np.abs(kelvin[column]).max()
        np.testing.assert_allclose(hardened[column], kelvin[column], rtol=0, atol=1e-8 * scale)
    assert kelvin["kelvin_strain"].max() > 1e-4
    assert np.abs(hardened["kelvin_strain"]).max() < 1e-12


def test_creep_of_a_power_law_without_recovery_has_the_closed_form() -> None:
    """The effective stress q = stress - H strain has dq/dt = -H A q^n."""
    stress, exponent, modulus = 5e6, 3.5, 2e9
    rate = 1e-5  # at the stress
    values = flowing(rate, stress, exponent, hardening_modulus=modulus, **ENDLESS)
    time = np.geomspace(1.0, 1e5, 30)
    found = simulate(of_one_stage("stress", stress, 1e5), values, at=time, solver=EXACT)
    slowing = (exponent - 1) * modulus * rate * stress**-exponent * time
    effective = (stress ** (1 - exponent) + slowing) ** (1 / (1 - exponent))
    expected = (stress - effective) / modulus + stress / values["maxwell_modulus"]
    np.testing.assert_allclose(found["strain"], expected, rtol=1e-8)
    assert effective[-1] < 0.5 * stress


@pytest.mark.parametrize("exponent", [1.0, 3.0])
@pytest.mark.parametrize("recovery", [0.0, 2e-3])
def test_a_steady_stress_balances_storage_and_recovery(recovery: float, exponent: float) -> None:
    rate = 1e-4
    others = {**BACKSTRESS, "recovery_rate": recovery, "hardening_modulus": 4e9}
    values = flowing(rate, 3e6, exponent, **others)
    found = simulate(of_one_stage("strain_rate", rate, 4e3), values, at=[4e3], solver=EXACT)
    slower = 1 / TEMPERATURE - 1 / values["kelvin_reference_temperature"]
    here = recovery * np.exp(-60e3 / GAS_CONSTANT * slower)

    def balance(share: float) -> float:
        lost = here * values["backstress_limit"] * share ** values["recovery_exponent"]
        return float(values["hardening_modulus"] * rate * (1 - share) - lost)

    share = brentq(balance, 0.0, 1.0, xtol=1e-14)
    expected = 3e6 + share * values["backstress_limit"]
    assert found["stress_Pa"].item() == pytest.approx(expected, rel=1e-8)


OF_DISLOCATIONS = {"hardening": "dislocations"}


def test_weak_priors_follow_the_test() -> None:
    test, priors = history_twin("mixed", 16), default_priors("ice")
    changed = with_variant(priors, test, CHOICE)
    assert set(changed.free) - set(priors.free) == {*PARAMETERS}
    medians = {name: changed[name].location for name in PARAMETERS[:3]}
    modulus = priors["kelvin_modulus"].mean_sd()[0]
    half, often = 0.5 * test.largest_stress, 10 / np.ptp(test.time)
    rounded = [float(f"{one:.0e}") for one in (modulus, half, often)]  # to one digit
    assert medians == dict(zip(PARAMETERS[:3], rounded, strict=True))
    enthalpy = priors["activation_enthalpy"].mean_sd()[0]
    assert changed["recovery_activation_enthalpy"].location == enthalpy


@pytest.mark.parametrize(
    ("law", "numbers", "other", "visible"),
    [
        (CHOICE, BACKSTRESS, {"hardening_modulus": 0.0}, 0.1),
        (OF_DISLOCATIONS, DISLOCATIONS, {"initial_backstress": 2e6}, 3e-3),
    ],
)
def test_a_curve_takes_it_as_the_history_that_it_is(
    law: Mapping[str, str],
    numbers: Mapping[str, float],
    other: Mapping[str, float],
    visible: float,
) -> None:
    curve = load_experiment(ICE / "PIL40.toml")
    history = likelihood_of(curve).as_history(curve)
    assert history.duration == curve.duration
    of_curve, of_history = (
        with_variant(default_priors("ice"), test, law) for test in (curve, history)
    )
    freed = HARDENING_LAWS[law["hardening"]].parameters
    assert [of_curve[name] for name in freed] == [of_history[name] for name in freed]
    strain = np.array([1e-4, 0.003, 0.03, 0.2])
    values = {**FROZEN, **numbers}
    stress = simulate(curve, values, at=strain)["stress_Pa"]
    # Strain over the one rate of the test is time.
    time = strain * curve.duration / np.ptp(curve.position)
    expected = simulate(history, values, at=time)["stress_Pa"]
    np.testing.assert_allclose(stress, expected, rtol=1e-7)
    changed = simulate(curve, {**values, **other}, at=strain)["stress_Pa"]
    assert np.abs(stress / changed - 1).max() > visible


LINEAR_FORM = {"hardening_modulus": 2e9, "recovery_rate": 2e-3, "recovery_exponent": 1.0}


def assert_cycles_have_the_compliance_of(
    table: AttenuationExperiment,
    values: Mapping[str, float],
    place: int,
    *,
    settling: float,
    about: float = 0.0,
    hold: float = 0.0,
) -> tuple[complex, float]:
    """Compare cycles after a hold (s), which settle in a time (s), with the place of a table.

    Returns the compliance (1/Pa) and ln(tan delta).
    """
    both = simulate(table, values, at=[*table.conditions.place, *(1 + table.conditions.place)])
    log_tan_delta, log_modulus = both["log_reading"].to_numpy().reshape(2, 3)[:, place]
    period, n_cycles = PERIODS[place], 10 + int(np.ceil(settling / PERIODS[place]))
    # Chords of a sine have other harmonics, and compliances are of the fundamental alone.
    knots = np.linspace(0.0, n_cycles, 40 * n_cycles + 1)
    time, stress = hold + knots * period, about + 100.0 * np.sin(2 * np.pi * knots)
    if hold > 0:
        time, stress = np.append(0.0, time), np.append(about, stress)
    stage = Stage("stress_series", 0.0, time[-1], TEMPERATURE, 0.0)
    test = imagined_history(replace(stage, knots=tuple(zip(time, stress, strict=True))))
    found = complex_compliance(test, values, period)
    assert -found.imag / found.real == pytest.approx(np.exp(log_tan_delta), rel=1e-4)
    assert 1 / abs(found) == pytest.approx(np.exp(log_modulus), rel=1e-4)
    return found, float(log_tan_delta)


def complex_compliance(
    test: HistoryExperiment, values: Mapping[str, float], period: float
) -> complex:
    """Fundamental of the strain over that of the stress in the last four cycles, 1/Pa."""
    time = test.end_time + period * np.linspace(-4.0, 0.0, 1600, endpoint=False)
    found = simulate(test, values, at=time, solver=EXACT)
    wave = np.exp(2j * np.pi * time / period)
    drift = np.linspace(-1, 1, time.size)
    terms = np.column_stack([wave.real, wave.imag, drift**0, drift, drift**2])
    parts = [np.linalg.lstsq(terms, found[name], rcond=None)[0] for name in ("strain", "stress_Pa")]
    strain, stress = (complex(one[0], one[1]) for one in parts)
    return complex(np.conj(strain / stress))


@pytest.mark.parametrize("place", [0, 1, 2])
def test_small_cycles_in_time_have_the_compliance_of_a_table(place: int, tmp_path: Path) -> None:
    table = ice_spectrum(tmp_path)
    linear = flowing(5e-6, 1e6, 1.0, kelvin_modulus=5e9, kelvin_viscosity=1e11)
    values = {**linear, **BACKSTRESS, **LINEAR_FORM}
    _, log_tan_delta = assert_cycles_have_the_compliance_of(table, values, place, settling=2e3)
    without = simulate(table, linear, at=[*table.conditions.place])["log_reading"].to_numpy()
    assert abs(without[place] - log_tan_delta) > 3e-3


def test_tables_take_the_linear_form_about_zero_stress_alone(tmp_path: Path) -> None:
    table, priors = ice_spectrum(tmp_path), default_priors("ice", "attenuation")
    with pytest.raises(InputError, match="about zero stress a power law neither flows nor"):
        with_variant(priors, table, CHOICE)
    twin = load_attenuation(ICE / "attenuation_twin.toml")
    linear = with_variant(priors, twin, {"maxwell": "linear", **CHOICE})
    assert {"hardening_modulus", "recovery_rate"} == {*linear.free} & {*PARAMETERS}
    with pytest.raises(InputError, match="recovery_exponent fixed at 1"):
        simulate(table, {**flowing(1e-5, 1e6, 1.0), **BACKSTRESS})
    with pytest.raises(InputError, match="takes cycles about zero stress"):
        problem_of([twin], linear)


@pytest.mark.parametrize(
    ("numbers", "backstresses"), [(BACKSTRESS, (0.0, 2e6)), (DISLOCATIONS, (1e5, 2e6))]
)
def test_exported_laws_are_those_of_the_program(
    numbers: Mapping[str, float], backstresses: tuple[float, float]
) -> None:
    test, values = history_twin("creep", 4), {**TRUTH, **numbers}
    laws = laws_of(given_parameters("ice", values), test)
    names = names_of(
        values, temperature=TEMPERATURE, fabric_factor=0.9, grain_size=GRAIN_SIZE, stress=5e6
    )
    for backstress in backstresses:
        here = {**names, "backstress": backstress}
        flow = value_of(str(laws["flow_law"]), here)
        expected, _ = oracle.all_rates(values, TEMPERATURE, 5e6, backstress, GRAIN_SIZE, 0.9)
        assert flow == pytest.approx(float(expected), rel=1e-9)
        stored = value_of(str(laws["hardening_law"]), {**here, "strain_rate": flow})
        assert stored == pytest.approx(
            oracle.backstress_rate(values, TEMPERATURE, backstress, flow, GRAIN_SIZE), rel=1e-9
        )
