"""Laws beside the linear Kelvin element and the power-law dashpot: one contract for all of them.

Every law with a stress or exponent of its own has a case, and runs through the same functions: its
limit, independent solutions in time, the density, gradients, priors and refusals.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import product
from pathlib import Path

import history_oracle
import numpy as np
import oracle
import oscillation_oracle
import pytest
from conftest import ICE
from history_oracle import GRAINS, KELVIN, STRESS
from history_twins import BACKSTRESS, PIEZOMETER, SECOND, TRUTH, history_twin
from imagined_tests import STEPS, imagined_curve
from independent_table import TRUTHS
from kind_examples import EXAMPLES
from log_density import assert_gradient_along, program_of
from stan_data import parameters_in

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forced_oscillation.experiment import with_background
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.problem import problem_of
from pyburgers.model.laws import (
    DASHPOT_LAWS,
    DASHPOT_STRESSES,
    HARDENING_LAWS,
    KELVIN_LAWS,
    NONLINEAR_KELVIN_PARAMETERS,
)
from pyburgers.model.parameters import STANDARD_VALUES
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import variant_of, with_variant
from pyburgers.predictions.attenuation import attenuation_spectrum
from pyburgers.predictions.stress_cycles import Regime

Schedule = Sequence[tuple[float, float]]
pytestmark = pytest.mark.usefixtures("programs")

OLIVINE = Path(__file__).parents[2] / "data" / "olivine" / "olivine_twin.toml"
STRAIN = np.concatenate([np.geomspace(1e-4, 0.01, 15), np.linspace(0.015, 0.2, 20)])
SLOW, FAST = ((0.0, 1e-6),), ((0.0, 1.69e-4),)
THERMAL = {
    "kelvin_activation_enthalpy": 60e3,
    "kelvin_reference_stress": 2e6,
    "kelvin_reference_temperature": 260.0,
}
MATERIALS: Mapping[str, Mapping[str, float]] = {
    "linear Kelvin element": {},
    "power-law Kelvin element": {"kelvin_stress_exponent": 2.5, "kelvin_reference_stress": 2e6},
    "piezometer": PIEZOMETER,
}


@dataclass(frozen=True)
class Case:
    """A law: `material` (SI) without it, values of its own parameter, and that of its limit.

    `conditions` are other parameters that it needs. `visible` is the least relative change of the
    stress at constant rate from the law without it. `oscillation` gives the parameters under an
    oscillation, the first value those without the law.
    """

    option: str
    material: Mapping[str, float]
    values: Sequence[float]
    limit: float
    conditions: Mapping[str, float]
    visible: float
    oscillation: tuple[Mapping[str, float], Mapping[str, float]]

    @property
    def parameter(self) -> str:
        part, name = self.option.split("=")
        laws = {"kelvin": KELVIN_LAWS, "maxwell": DASHPOT_LAWS}[part]
        return str(laws[name].parameters[0])

    def at(self, value: float, **others: float) -> dict[str, float]:
        return {**self.material, **self.conditions, self.parameter: value, **others}


def truth(file: Path) -> dict[str, float]:
    test = load_constant_rate(file) if file.parent == ICE else load_forced_oscillation(file)
    assert test.true_parameters is not None
    return dict(test.true_parameters)


_ICE, _OLIVINE = truth(ICE / "PIL40.toml"), truth(OLIVINE)
_LARGEST = with_background(load_forced_oscillation(OLIVINE), "removed").largest_stress

CASES = {
    case.option: case
    for case in (
        Case(
            "kelvin=power_law",
            dict(TRUTHS["fast"]),  # its Kelvin element counts
            (2.0, 3.5),
            1 + 1e-12,
            THERMAL,
            0.05,
            (
                _OLIVINE,
                {
                    "kelvin_stress_exponent": 2.5,
                    "kelvin_activation_enthalpy": 400e3,
                    "kelvin_reference_stress": 100e6,
                    "kelvin_reference_temperature": 1400.0,
                },
            ),
        ),
        Case(
            "maxwell=hyperbolic_sine",
            _ICE,
            (1e6, 8e6),
            1e12,
            {},
            0.02,
            (_OLIVINE, {"breakdown_stress": 0.3 * _LARGEST}),
        ),
        Case(
            "maxwell=threshold_stress",
            _ICE,
            (1e6, 5e6),
            1e-3,
            {},
            0.05,
            (
                # A dashpot that is a thousand times faster counts in this oscillation.
                {
                    **_OLIVINE,
                    "beta": _OLIVINE["beta"] + np.log(1e3) / _OLIVINE["activation_enthalpy"],
                },
                {"threshold_stress": 0.3 * _LARGEST},
            ),
        ),
    )
}
COMBINATIONS = [
    (option, material)
    for option, material in product(CASES, MATERIALS)
    if option.startswith("maxwell") or not {*MATERIALS[material]} & {*NONLINEAR_KELVIN_PARAMETERS}
]
"""Each law in each material that has no other law of the same part."""

DASHPOTS = [option for option in CASES if option.startswith("maxwell")]


def test_every_law_with_a_parameter_of_one_element_or_dashpot_has_a_case() -> None:
    laws = {"kelvin": KELVIN_LAWS, "maxwell": DASHPOT_LAWS}
    assert set(CASES) == {
        f"{part}={law.name}" for part, own in laws.items() for law in own.values() if law.own_stress
    }


def ice_test(segments: Schedule = STEPS, temperature: float = 260.0) -> ConstantRateExperiment:
    curve = imagined_curve(segments, max(0.2, segments[-1][0] + 0.1))
    return replace(curve, temperature=temperature)


def along(segments: Schedule = STEPS) -> FloatArray:
    return np.union1d(STRAIN, [start for start, _ in segments[1:]])


@pytest.mark.parametrize(("option", "material"), COMBINATIONS)
def test_at_its_limit_a_law_is_the_one_without_it(option: str, material: str) -> None:
    """Other arguments of the solver, the same solution."""
    case, others = CASES[option], MATERIALS[material]
    without, standard, limit = (
        simulate(ice_test(), values, at=along())
        for values in (
            {**case.material, **others},
            {**case.material, **others, case.parameter: STANDARD_VALUES[case.parameter]},
            {**case.material, **case.conditions, **others, case.parameter: case.limit},
        )
    )
    assert standard.equals(without)
    np.testing.assert_allclose(limit["stress_Pa"], without["stress_Pa"], rtol=1e-7)
    assert limit.attrs == without.attrs


def assert_agrees_with_scipy(
    parameters: Mapping[str, float], segments: Schedule, temperature: float = 260.0
) -> FloatArray:
    """Compare a simulated test with an independent solution; return its stress (Pa)."""
    strain = along(segments)
    found = simulate(ice_test(segments, temperature), parameters, at=strain)
    independent = history_oracle.at_rates(parameters, temperature, 230e-6, segments, strain)
    stress, kelvin_strain, grain_size = independent[[STRESS, KELVIN, GRAINS]]
    np.testing.assert_allclose(found["stress_Pa"], stress, rtol=1e-5)
    np.testing.assert_allclose(found["kelvin_strain"], kelvin_strain, rtol=1e-5, atol=1e-10)
    np.testing.assert_allclose(found["grain_size_m"], grain_size, rtol=1e-5)
    return found["stress_Pa"].to_numpy()


@pytest.mark.parametrize("which", [0, 1])
@pytest.mark.parametrize(("option", "material"), COMBINATIONS)
def test_solutions_agree_with_scipy(option: str, which: int, material: str) -> None:
    case, others = CASES[option], MATERIALS[material]
    stress = assert_agrees_with_scipy(case.at(case.values[which], **others), STEPS)
    without = case.at(STANDARD_VALUES[case.parameter], **others)
    apart = stress / simulate(ice_test(), without, at=along())["stress_Pa"] - 1
    assert np.max(np.abs(apart)) > case.visible


@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.5])
@pytest.mark.parametrize("temperature", [240.0, 271.0])
@pytest.mark.parametrize("segments", [SLOW, FAST, STEPS], ids=["slow", "fast", "steps"])
def test_the_kelvin_element_changes_with_temperature_as_in_scipy(
    segments: Schedule, temperature: float, exponent: float
) -> None:
    assert_agrees_with_scipy(CASES["kelvin=power_law"].at(exponent), segments, temperature)


@pytest.mark.parametrize("exponent", [1.0, 3.0])
def test_a_piezometer_at_a_slow_rate_agrees_with_scipy(exponent: float) -> None:
    assert_agrees_with_scipy(CASES["kelvin=power_law"].at(exponent, **PIEZOMETER), SLOW)


@pytest.mark.parametrize("option", CASES)
def test_an_oscillating_test_agrees_with_scipy(option: str) -> None:
    test = with_background(load_forced_oscillation(OLIVINE), "removed")
    without, law = CASES[option].oscillation
    time = test.prepared.start + np.linspace(20.0, 900.0, 45)
    independent = oscillation_oracle.solution(test, {**without, **law}, time)[0]
    scale = np.abs(independent).max()
    found = simulate(test, {**without, **law}, at=time)["stress_Pa"]
    np.testing.assert_allclose(found, independent, atol=2e-3 * scale, rtol=0)
    plain = simulate(test, without, at=time)["stress_Pa"]
    assert np.abs(plain - independent).max() > 0.02 * scale


def the_tests() -> dict[str, Experiment]:
    return {
        "constant rate": load_constant_rate(ICE / "PIL40.toml"),
        "loading history": history_twin("mixed", 16),
        "oscillation": load_forced_oscillation(OLIVINE),
    }


@pytest.mark.parametrize(
    ("kind", "choices"),
    [
        *(("constant rate", dict([option.split("=")])) for option in CASES),
        ("loading history", {"hardening": "backstress"}),
        ("loading history", {"hardening": "dislocations", "maxwell": "hyperbolic_sine"}),
    ],
    ids=str,
)
def test_the_log_likelihood_is_that_of_the_independent_solution(
    kind: str, choices: Mapping[str, str], tmp_path: Path
) -> None:
    test = the_tests()[kind]
    priors = default_priors("ice")
    problem = problem_of([test], with_variant(priors, test, choices))
    program, at = program_of(problem, tmp_path, seed=4, width=0.2)
    columns = program.values_at(at)
    values = parameters_in(columns)
    for name in set(problem.free) - set(priors.free):
        assert values[name] != STANDARD_VALUES.get(name)
    example = EXAMPLES[test.protocol]
    solution = example.solution(test, values, test.position)
    response = solution["stress_Pa"]
    if isinstance(test, HistoryExperiment):
        response = np.where(test.response_is_strain, solution["strain"], response)
    expected = example.log_likelihood(test, values, response)
    found = [columns[f"log_lik.{i + 1}"] for i in range(test.n_points)]
    np.testing.assert_allclose(found, expected, rtol=1e-5, atol=1e-5)


@pytest.mark.parametrize(
    ("kind", "others", "choices", "names"),
    [
        *(
            (kind, others, dict([option.split("=")]), (case.parameter, "kelvin_viscosity"))
            for kind in ("constant rate", "loading history", "oscillation")
            for option, case in CASES.items()
            for others in ({}, {"maxwell": "linear"})
        ),
        *(
            ("loading history", others, {"hardening": law}, HARDENING_LAWS[law].parameters)
            for law in ("backstress", "dislocations")
            for others in ({}, {"maxwell": "linear"}, {"kelvin": "power_law"})
        ),
    ],
    ids=str,
)
def test_gradients_are_slopes_of_the_density(
    kind: str,
    others: Mapping[str, str],
    choices: Mapping[str, str],
    names: Sequence[str],
    tmp_path: Path,
) -> None:
    """Every test passes a threshold; with n = 1 the slope of the rate jumps there."""
    test = the_tests()[kind]
    priors = with_variant(default_priors(test.material, test.protocol), test, others)
    assert_gradient_along(problem_of([test], with_variant(priors, test, choices)), names, tmp_path)


@pytest.mark.parametrize("option", DASHPOTS)
def test_the_prior_of_a_stress_is_about_a_share_of_the_largest_stress(option: str) -> None:
    ice, priors = load_constant_rate(ICE / "PIL40.toml"), default_priors("ice")
    law, name = option.removeprefix("maxwell="), CASES[option].parameter
    changed = with_variant(priors, ice, {"maxwell": law})
    share = {"breakdown_stress": 8e6, "threshold_stress": 8e5}[name]  # of 8.1 MPa, to one digit
    prior = changed[name]
    assert (prior.family, prior.location, prior.scale) == ("lognormal", share, 1.0)
    assert set(changed.free) - set(priors.free) == {name}


def test_two_laws_of_the_dashpot_are_refused() -> None:
    ice, priors = load_constant_rate(ICE / "PIL40.toml"), default_priors("ice")
    first, second = (
        with_variant(priors, ice, {"maxwell": law.name}) for law in DASHPOT_STRESSES.values()
    )
    name = [*DASHPOT_STRESSES][1]
    with pytest.raises(InputError, match=" and ".join(DASHPOT_STRESSES)):
        variant_of(first.exchanging(second[name]), ice)


@pytest.mark.parametrize("option", ["kelvin=power_law", "maxwell=threshold_stress"])
def test_tables_refuse_laws_without_a_closed_form(option: str) -> None:
    table, case = load_attenuation(ICE / "attenuation_twin.toml"), CASES[option]
    part, law = option.split("=")
    with pytest.raises(InputError, match=f"{option} is not for tests of"):
        with_variant(default_priors("ice", "attenuation"), table, {part: law})
    with pytest.raises(InputError, match=f"{option} is not for tests of"):
        simulate(
            table,
            {**(table.true_parameters or {}), **case.conditions, case.parameter: case.values[0]},
        )


@pytest.mark.parametrize(
    ("name", "values"),
    [
        *(
            (CASES[option].parameter, CASES[option].at(CASES[option].values[0]))
            for option in ("kelvin=power_law", "maxwell=threshold_stress")
        ),
        ("hardening_modulus", {**TRUTH, **BACKSTRESS}),
        ("second_in_series", {**TRUTH, **SECOND, "second_in_series": 1.0}),
    ],
)
def test_closed_forms_refuse_laws_without_one(name: str, values: Mapping[str, float]) -> None:
    regime = Regime(2e6, 1e6)
    words = f"{name}: found values other than {STANDARD_VALUES[name]:g}"
    with pytest.raises(InputError, match=words):
        attenuation_spectrum(values, [1e-3], [regime], temperature=263.0, grain_size=2e-4)


def flowing(rates: Schedule, **law: float) -> tuple[ConstantRateExperiment, dict[str, float]]:
    """A test of steady states, and a dashpot without a microstructure."""
    test = replace(ice_test(rates), final_strain=rates[-1][0] + 3.0)
    return test, {**_ICE, "grain_size_exponent": 0.0, "steady_state_fabric_factor": 1.0, **law}


@pytest.mark.parametrize("exponent", [1.0, 3.0])
def test_a_steady_stress_is_the_threshold_and_that_of_the_power_law(exponent: float) -> None:
    threshold, segments = 2e6, ((0.0, 1e-4), (3.0, 1e-6), (6.0, 5e-4))
    law = {"stress_exponent": exponent, "threshold_stress": threshold, "activation_enthalpy": 60e3}
    test, parameters = flowing(segments, **law)
    rates = np.array([rate for _, rate in segments])
    # A rate factor with which the power law has 3 MPa at the first rate.
    parameters["beta"] = (
        1 / (oracle.GAS_CONSTANT * test.temperature)
        + (np.log(rates[0]) - exponent * np.log(3e6)) / 60e3
    )
    found = simulate(test, parameters, at=np.array([3.0, 6.0, 9.0]))["stress_Pa"]
    expected = threshold + 3e6 * (rates / rates[0]) ** (1 / exponent)
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_up_to_the_threshold_the_dashpot_stands_still() -> None:
    test = history_twin("creep", 20)
    below, above = (
        simulate(test, {**TRUTH, "threshold_stress": threshold}) for threshold in (5.001e6, 4.9e6)
    )
    spring = below["stress_Pa"] / TRUTH["maxwell_modulus"]
    np.testing.assert_allclose(below["strain"], spring + below["kelvin_strain"], rtol=1e-14)
    assert (above["strain"].iloc[-1] - below["strain"].iloc[-1]) > 0


def test_steady_stress_of_the_second_equation_of_the_paper() -> None:
    breakdown, segments = 2e6, ((0.0, 1e-4), (3.0, 1e-6), (6.0, 5e-3))
    test, parameters = flowing(
        segments,
        stress_exponent=1.0,
        breakdown_stress=breakdown,
        beta=-3.3e-4,
        activation_enthalpy=30e3,
    )
    found = simulate(test, parameters, at=np.array([3.0, 6.0, 9.0]))["stress_Pa"]
    fluidity = oracle.rate_factor(parameters, test.temperature)
    rates = np.array([rate for _, rate in segments])
    expected = breakdown * np.arcsinh(rates / (fluidity * breakdown))
    assert expected.max() > 2 * breakdown
    np.testing.assert_allclose(found, expected, rtol=1e-6)


def test_a_steady_stress_may_be_any_number_of_breakdown_stresses() -> None:
    """Salt that hardens comes to 80, and its posterior goes beyond."""
    breakdown, times, enthalpy = 0.1e6, 160.0, 60e3
    log_factor = np.log(1e-5 / breakdown) - np.log(np.sinh(times))
    test, parameters = flowing(
        ((0.0, 1e-5),),
        stress_exponent=1.0,
        breakdown_stress=breakdown,
        activation_enthalpy=enthalpy,
        beta=log_factor / enthalpy + 1 / (oracle.GAS_CONSTANT * 260.0),
    )
    found = simulate(test, parameters, at=np.array([3.0]))["stress_Pa"].item()
    assert found == pytest.approx(times * breakdown, rel=1e-6)


def test_piezometric_grain_size_settles_at_that_of_the_stress() -> None:
    test = replace(ice_test(((0.0, 1e-4),)), final_strain=3.0)
    end = simulate(test, {**TRUTHS["fast"], **PIEZOMETER}, at=np.array([3.0])).iloc[-1]
    wanted = oracle.piezometer(end["stress_Pa"]) * 2e-3 / 0.015
    assert end["grain_size_m"] == pytest.approx(wanted, rel=1e-6)
