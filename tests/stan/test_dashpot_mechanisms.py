"""A dashpot of two and three mechanisms: limits, gradients, tables, priors, export, refusals."""

from collections.abc import Mapping
from pathlib import Path

import history_oracle
import numpy as np
import oracle
import oscillation_oracle
import pytest
from conftest import ICE
from evaluated_laws import names_of, value_of
from history_twins import BACKSTRESS, GRAIN_SIZE, SECOND, TEMPERATURE, THIRD, TRUTH, history_twin
from ice_spectrum import PERIODS, ice_spectrum
from jacobians import assert_jacobian_is_that_of_the_map, parameters_named
from log_density import assert_gradient_along, program_with
from stan_data import parameters_in

from pyburgers import (
    Regime,
    attenuation_spectrum,
    fixed,
    flow_rate,
    load_experiment,
    normal,
)
from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forced_oscillation.experiment import with_background
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import given_parameters, program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.laws import MECHANISMS
from pyburgers.model.parameters import FURTHER_MECHANISMS
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import variant_of, with_variant
from pyburgers.predictions.stated_laws import laws_of

OLIVINE = ICE.parent / "olivine" / "olivine_twin.toml"
pytestmark = pytest.mark.usefixtures("programs")

EXACT = SolverOptions(tolerance=1e-12, max_num_steps=10_000_000)
IN_SERIES = {**SECOND, "second_in_series": 1.0}
LAWS = tuple(law for law in MECHANISMS["second"] if law != "none")
NETWORKS: Mapping[str, Mapping[str, float]] = {
    "side by side": SECOND,
    "in series": IN_SERIES,
    "three side by side": THIRD,
    "third in series with the second": {**THIRD, "third_in_series": 1.0},
    "third beside two in series": {**THIRD, "second_in_series": 1.0},
    "three in series": {**THIRD, "second_in_series": 1.0, "third_in_series": 1.0},
}
of_every_network = pytest.mark.parametrize("numbers", NETWORKS.values(), ids=NETWORKS)


def like_the_first(
    values: Mapping[str, float], which: tuple[str, ...] = ("second",)
) -> dict[str, float]:
    """Numbers of further mechanisms that are the first one once more, without a fabric."""
    rate = oracle.dashpot_rate(values, TEMPERATURE, 2e6, GRAIN_SIZE, 1.0)
    return {
        **{
            f"{one}_{name}": values[name]
            for one in which
            for name in ("stress_exponent", "grain_size_exponent", "activation_enthalpy")
        },
        **{f"{one}_rate": float(rate) for one in which},
        "mechanism_reference_stress": 2e6,
        "mechanism_reference_grain_size": GRAIN_SIZE,
        "mechanism_reference_temperature": TEMPERATURE,
    }


def faster(values: Mapping[str, float], factor: float) -> dict[str, float]:
    """The same flow law with another rate, at all stresses, grain sizes and temperatures."""
    return {**values, "beta": values["beta"] + np.log(factor) / values["activation_enthalpy"]}


def assert_same(test: Experiment, one: Mapping[str, float], other: Mapping[str, float]) -> None:
    found, expected = (simulate(test, values, solver=EXACT) for values in (one, other))
    for column in ("stress_Pa", "strain"):
        scale = np.abs(expected[column]).max()
        np.testing.assert_allclose(found[column], expected[column], rtol=0, atol=1e-8 * scale)


@pytest.mark.parametrize("name", ["load and unload", "mixed"])
def test_limits_are_dashpots_of_one_mechanism(name: str) -> None:
    test, plain = history_twin(name, 30), {**TRUTH, "steady_state_fabric_factor": 1.0}
    assert_same(test, {**plain, **SECOND, "second_rate": 1e-25}, plain)
    assert_same(test, {**plain, **IN_SERIES, "second_rate": 1e25}, plain)
    twice = {**plain, **like_the_first(plain)}
    assert_same(test, twice, faster(plain, 2.0))
    assert_same(test, {**twice, "second_in_series": 1.0}, faster(plain, 0.5))
    thrice = {**plain, **like_the_first(plain, ("second", "third"))}
    assert_same(test, thrice, faster(plain, 3.0))
    assert_same(test, {**thrice, "third_in_series": 1.0}, faster(plain, 1.5))
    assert_same(test, {**thrice, "second_in_series": 1.0}, faster(plain, 1.5))
    in_series = {"second_in_series": 1.0, "third_in_series": 1.0}
    assert_same(test, {**thrice, **in_series}, faster(plain, 1 / 3))


@of_every_network
def test_a_curve_is_that_of_the_independent_solution(numbers: Mapping[str, float]) -> None:
    curve = load_experiment(ICE / "PIL40.toml")
    values = {**TRUTH, **numbers}
    strain = np.array([1e-4, 0.003, 0.03, 0.2])
    stress = simulate(curve, values, at=strain, solver=EXACT)["stress_Pa"]
    rate = np.ptp(curve.position) / curve.duration
    at = curve.temperature, curve.initial_grain_size
    expected = history_oracle.at_rates(values, *at, [(0.0, rate)], strain)
    np.testing.assert_allclose(stress, expected[history_oracle.STRESS], rtol=1e-6)
    without = simulate(curve, TRUTH, at=strain)["stress_Pa"]
    assert np.abs(stress / without - 1).max() > 0.1


def oscillation_of(numbers: Mapping[str, float]) -> tuple[FloatArray, FloatArray]:
    """Stress (Pa) of an oscillation of olivine: the program's and scipy's."""
    test = with_background(load_forced_oscillation(OLIVINE), "removed")
    assert test.true_parameters is not None
    values = {**test.true_parameters, **numbers}
    time = test.prepared.start + np.linspace(20.0, 900.0, 45)
    found = simulate(test, values, at=time, solver=EXACT)["stress_Pa"].to_numpy()
    return found, oscillation_oracle.solution(test, values, time)[0]


def test_an_oscillation_is_that_of_the_independent_solution() -> None:
    second = {
        **SECOND,
        "second_rate": 1e-4,
        "second_stress_exponent": 1.0,
        "mechanism_reference_stress": 1e8,
        "mechanism_reference_grain_size": 2e-5,
        "mechanism_reference_temperature": 1423.0,
    }
    frozen = {"critical_strain_grain_size": 1e9}
    # Grains that grow for an instant near zero stress cost precision.
    for others, precision in ((frozen, 1e-6), ({}, 1e-3)):
        found, expected = oscillation_of({**second, **others})
        scale = np.abs(expected).max()
        np.testing.assert_allclose(found, expected, rtol=0, atol=precision * scale)
    plain, _ = oscillation_of({})
    assert np.abs(found - plain).max() > 0.02 * scale
    slower = {**second, **frozen, "second_rate": 1e-8, "second_in_series": 1.0}
    third = {
        "third_rate": 1e-8,
        "third_stress_exponent": 1.0,
        "third_grain_size_exponent": 2.0,
        "third_activation_enthalpy": 3e5,
        "third_in_series": 1.0,
    }
    for numbers in (slower, {**slower, **third}, {**second, **frozen, **third}):
        in_series, expected = oscillation_of(numbers)
        np.testing.assert_allclose(in_series, expected, rtol=0, atol=1e-6 * scale)


@pytest.mark.parametrize("which", ["second", "third"])
@pytest.mark.parametrize("law", LAWS)
def test_gradients_are_slopes_of_the_density(law: str, which: str, tmp_path: Path) -> None:
    test = history_twin("mixed", 16)
    choices = {"second_mechanism": "in_series", f"{which}_mechanism": law}
    priors = with_variant(default_priors("ice"), test, choices)
    if law != "diffusion":
        about = normal(2.0, 0.1, "1", lower=1.0)
        free = {f"{which}_{name}": about for name in ("stress_exponent", "grain_size_exponent")}
        priors = priors.with_(**free)
    problem = problem_of([test], priors)
    names = [name for name in FURTHER_MECHANISMS[which] if name in problem.layout.names]
    assert len(names) == (1 if law == "diffusion" else 3)
    assert_gradient_along(problem, names, tmp_path)


CHOICES = (
    ("diffusion", "none"),
    ("in_series", "none"),
    ("power_law", "diffusion"),
    ("power_law", "in_series"),
    ("in_series", "power_law"),
    ("in_series", "diffusion"),
    ("in_series", "in_series"),
)


@pytest.mark.parametrize("choice", CHOICES, ids=" ".join)
@pytest.mark.parametrize("source", ["history", "curve"])
def test_the_rate_of_all_mechanisms_is_sampled(
    source: str, choice: tuple[str, str], tmp_path: Path
) -> None:
    test: Experiment = load_experiment(ICE / "PIL40.toml")
    if source == "history":
        test = history_twin("mixed", 8)
    second, third = choice
    choices = {"second_mechanism": second, "third_mechanism": third}
    problem = problem_of([test], with_variant(default_priors("ice"), test, choices))
    data = program_data(problem, solver=SolverOptions(), use_likelihood=False)
    program = program_with(problem.likelihood.program, data, tmp_path)
    rng = np.random.default_rng(4)
    point = data["unit"] * rng.standard_normal(data["n_coordinates"])
    free = parameters_named(problem.free)
    values = parameters_in(assert_jacobian_is_that_of_the_map(program, point, free))
    (coordinates,) = problem.coordinates
    place = coordinates.quantities.index(problem.likelihood.reference.name)
    stress = data["stress_scale"][0]
    grain_size = test.initial_grain_size
    rate, first = oracle.all_rates(values, test.temperature, stress, 0.0, grain_size, 1.0)
    assert abs(np.log(rate / first)) > 1e-6
    log_quantity = np.log(rate)
    if source == "curve":
        log_at_rate = np.log(data["reference_stress_rate"][0] / rate)
        log_quantity = np.log(stress) + log_at_rate / values["stress_exponent"]
    assert coordinates.of_quantity(place, log_quantity) == pytest.approx(point[place], abs=1e-8)


def test_a_table_has_the_sum_of_the_fluidities(tmp_path: Path) -> None:
    table = ice_spectrum(tmp_path)
    linear = {**TRUTH, "stress_exponent": 1.0, "grain_size_exponent": 0.0}
    # A first mechanism of 1e-12 1/(Pa s).
    slower = np.log(1e-12) / linear["activation_enthalpy"] + 1 / (GAS_CONSTANT * TEMPERATURE)
    linear_ones = {"second_stress_exponent": 1.0, "third_stress_exponent": 1.0}
    values = {**linear, "beta": slower, **THIRD, **linear_ones}
    both = simulate(table, values, at=[*table.conditions.place, *(1 + table.conditions.place)])
    found = np.exp(both["log_reading"].to_numpy())
    second, _ = oracle.all_rates(values, TEMPERATURE, 1.0, 0.0, GRAIN_SIZE, 1.0)
    omega = 2 * np.pi / np.array(PERIODS)
    kelvin = 1 / (values["kelvin_modulus"] + 1j * omega * values["kelvin_viscosity"])
    compliance = 1 / values["maxwell_modulus"] + kelvin - 1j * second / omega
    np.testing.assert_allclose(found[:3], -compliance.imag / compliance.real, rtol=1e-7)
    np.testing.assert_allclose(found[3:], 1 / np.abs(compliance), rtol=1e-7)
    assert second > 2e-12


def test_tables_need_amplitudes_of_what_is_not_linear() -> None:
    table = load_attenuation(ICE.parent / "olivine" / "attenuation_A1802.toml")
    olivine = default_priors("olivine", "attenuation")
    linear = {"maxwell": "linear"}
    problem_of([table], with_variant(olivine, table, {**linear, "second_mechanism": "diffusion"}))
    with pytest.raises(InputError, match="maxwell=linear, alone or with second_mechanism=diff"):
        problem_of(
            [table], with_variant(olivine, table, {**linear, "second_mechanism": "power_law"})
        )
    with pytest.raises(InputError, match="second_mechanism=in_series is not for tests of the"):
        with_variant(olivine, table, {**linear, "second_mechanism": "in_series"})


@pytest.mark.parametrize("exponent", [1.0, 1.8])
def test_stress_cycles_add_what_each_mechanism_loses(exponent: float) -> None:
    """With the numbers of the first mechanism, two more treble the fluidity."""
    values = {**TRUTH, "stress_exponent": exponent, "beta": 0.0}
    values["beta"] = 1 / (GAS_CONSTANT * TEMPERATURE) - np.log(2e6) / 62e3 * exponent
    for regime in (Regime(0.0, 1e5), Regime(2e6, 1e6)):
        found, expected = (
            attenuation_spectrum(
                one, [1e-3], [regime], temperature=TEMPERATURE, grain_size=GRAIN_SIZE
            )["loss_compliance"]
            for one in (
                {**values, **like_the_first(values, ("second", "third"))},
                faster(values, 3.0),
            )
        )
        np.testing.assert_allclose(found, expected, rtol=1e-9)


@of_every_network
def test_the_flow_rate_and_the_exported_law_are_those_of_the_equations(
    numbers: Mapping[str, float],
) -> None:
    values = {**TRUTH, **numbers}
    expected, first = oracle.all_rates(values, TEMPERATURE, 5e6, 0.0, GRAIN_SIZE, 0.9)
    rate = flow_rate(values, 5e6, temperature=TEMPERATURE, grain_size=GRAIN_SIZE, fabric_factor=0.9)
    np.testing.assert_allclose(rate, expected, rtol=1e-10)
    laws = laws_of(given_parameters("ice", values), history_twin("creep", 4))
    names = names_of(
        values, temperature=TEMPERATURE, fabric_factor=0.9, grain_size=GRAIN_SIZE, stress=5e6
    )
    mechanisms = laws["mechanisms"]
    assert isinstance(mechanisms, dict)
    rates = {name: value_of(law, names) for name, law in mechanisms.items()}
    assert rates["first_mechanism"] == pytest.approx(float(first), rel=1e-9)
    assert len(rates) == 2 + ("third_rate" in numbers)
    assert value_of(str(laws["flow_law"]), rates) == pytest.approx(float(expected), rel=1e-9)


def test_exported_hardening_is_that_of_the_first_mechanism() -> None:
    values = {**TRUTH, **SECOND, **BACKSTRESS}
    laws = laws_of(given_parameters("ice", values), history_twin("creep", 4))
    first = {"first_mechanism": 3e-5, "backstress": 2e6, "temperature": TEMPERATURE}
    stored = value_of(str(laws["hardening_law"]), {**values, **first, "R": GAS_CONSTANT})
    expected = oracle.backstress_rate(values, TEMPERATURE, 2e6, 3e-5, GRAIN_SIZE)
    assert stored == pytest.approx(expected, rel=1e-9)


@pytest.mark.parametrize("which", ["second", "third"])
@pytest.mark.parametrize("law", LAWS)
def test_weak_priors_follow_the_test(law: str, which: str) -> None:
    test, priors = history_twin("mixed", 16), default_priors("ice")
    part = f"{which}_mechanism"
    if which == "third":
        priors = with_variant(priors, test, {"second_mechanism": "power_law"})
    changed = with_variant(priors, test, {part: law})
    assert set(changed.free) - set(priors.free) == {f"{which}_rate"}
    stress = changed["mechanism_reference_stress"].location
    assert stress == float(f"{test.largest_stress:.0e}")
    rate = stress / priors["kelvin_viscosity"].mean_sd()[0]
    assert changed[f"{which}_rate"].location == float(f"{rate:.0e}")
    for name, value in MECHANISMS[which][law].held.items():
        assert changed[name].location == value


def test_numbers_of_a_prior_file_stay() -> None:
    test = history_twin("mixed", 16)
    priors = default_priors("ice").with_(
        second_stress_exponent=normal(2.0, 0.2, "1", lower=1.0),
        second_grain_size_exponent=fixed(2.0, "1"),
    )
    changed = with_variant(priors, test, {"second_mechanism": "power_law"})
    for name in ("second_stress_exponent", "second_grain_size_exponent"):
        assert changed[name] == priors[name]
    assert set(changed.free) - set(default_priors("ice").free) == {
        "second_rate",
        "second_stress_exponent",
    }


def test_a_third_mechanism_needs_a_second() -> None:
    test, priors = history_twin("mixed", 16), default_priors("ice")
    with pytest.raises(InputError, match=r"third_mechanism=diffusion without a second mechanism"):
        with_variant(priors, test, {"third_mechanism": "diffusion"})
    both = {"third_mechanism": "in_series", "second_mechanism": "power_law"}
    either_way = [
        with_variant(priors, test, dict(order)) for order in (both.items(), [*both.items()][::-1])
    ]
    assert [variant_of(one, test).record() | both for one in either_way] == [
        variant_of(one, test).record() for one in either_way
    ]
