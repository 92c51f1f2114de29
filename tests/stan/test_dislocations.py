"""The backstress of dislocations: steady states, limits, density, gradients, priors, refusals."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE
from history_twins import DISLOCATIONS, GRAIN_SIZE, TEMPERATURE, TRUTH, history_twin
from ice_spectrum import PERIODS, SPECTRUM
from log_density import assert_gradient_along
from scipy.optimize import brentq
from test_backstress import (
    EXACT,
    FROZEN,
    STIFF,
    assert_cycles_have_the_compliance_of,
    flowing,
    of_one_stage,
)
from truth_as_mode import at_truth

from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.loading_history.stages import Control
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.hardening import extension_sentences
from pyburgers.model.laws import HARDENING_LAWS
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.prior_families import fixed_prior
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import with_variant

pytestmark = pytest.mark.usefixtures("programs")

CHOICE = {"hardening": "dislocations"}
PARAMETERS = HARDENING_LAWS["dislocations"].parameters


@pytest.mark.parametrize("stress", [20e6, 60e6, 150e6])
@pytest.mark.parametrize("grain_size", [20e-6, 1e-3])
def test_creep_of_olivine_ends_in_the_steady_state_of_the_paper(
    stress: float, grain_size: float
) -> None:
    """Breithaupt et al. 2023 in their own numbers: A s^2 sinh[(sigma - s - s_d)/s_ref].

    Enthalpy, Peierls stress, hardening modulus and sources are those of olivine, the rates of
    recovery are chosen: they hold the Taylor stress s below the applied one.
    """
    temperature, enthalpy, modulus = 1573.0, 450e3, 135e9
    reference_stress = GAS_CONSTANT * temperature / enthalpy * 3.1e9
    activated = np.exp(-enthalpy / (GAS_CONSTANT * temperature))
    prefactor = 8.7096e6 * 1e-12 * activated  # 1/(Pa2 s)
    sources = 2 * 65e9 * 0.5e-9 / grain_size
    limit, pipes, boundaries = 1.8e9, 1e-44, 1e-36  # Pa, 1/(Pa5 s), 1/(Pa4 s)

    def flow(taylor: float) -> float:
        driving = (stress - taylor - sources) / reference_stress
        return float(prefactor * taylor**2 * np.sinh(driving))

    def storage(taylor: float) -> float:
        stored = flow(taylor) * ((taylor + sources) / taylor - taylor / limit)
        return stored - pipes * taylor**5 - boundaries * taylor**3 * sources

    steady = brentq(storage, 0.05 * stress, stress - sources, xtol=1e-6, rtol=1e-14)
    reference, d_k = 30e6, 100e-6
    rate_factor = prefactor * reference**2 / reference_stress  # of Garofalo's law with n = 1
    values = {
        **FROZEN,
        **STIFF,
        "maxwell_modulus": 160e9,
        "steady_state_grain_size": grain_size,
        "stress_exponent": 1.0,
        "activation_enthalpy": enthalpy,
        "beta": np.log(rate_factor) / enthalpy + 1 / (GAS_CONSTANT * temperature),
        "breakdown_stress": reference_stress,
        "hardening_modulus": modulus,
        "backstress_limit": limit,
        "recovery_rate": modulus * pipes * reference**4,
        "recovery_exponent": 5.0,
        "recovery_activation_enthalpy": enthalpy,
        "kelvin_reference_temperature": temperature,
        "initial_backstress": 0.05 * stress,
        "source_stress": sources * grain_size / d_k,
        "boundary_recovery": boundaries / (pipes * reference),
        "reference_backstress": reference,
        "kelvin_reference_grain_size": d_k,
    }
    duration = 100 * steady / (modulus * flow(steady))
    test = of_one_stage("stress", stress, duration)
    test = replace(
        test,
        material="olivine",
        temperature=temperature,
        initial_grain_size=grain_size,
        stages=(replace(test.stages[0], temperature=temperature),),
    )
    end = [0.9 * duration, duration]
    found = simulate(test, values, at=end, solver=EXACT)
    rate = np.diff(found["strain"]).item() / (0.1 * duration)
    assert rate == pytest.approx(flow(steady), rel=1e-8)
    assert 0.1 < steady / stress < 0.99


def test_a_backstress_that_does_not_change_is_a_threshold_and_a_factor() -> None:
    held = {
        **DISLOCATIONS,
        "hardening_modulus": 1e-6,
        "recovery_rate": 0.0,
        "initial_backstress": 1.5e6,
    }
    values = flowing(1e-5, 3e6, 3.0, **held, steady_state_grain_size=GRAIN_SIZE)
    stress, time = 5e6, np.geomspace(1.0, 1e4, 20)
    found = simulate(of_one_stage("stress", stress, 1e4), values, at=time, solver=EXACT)
    sources = 1e5 * 3e-4 / GRAIN_SIZE
    rate = 1e-5 * (1.5 / 3) ** 2 * ((stress - 1.5e6 - sources) / 3e6) ** 3
    expected = stress / values["maxwell_modulus"] + rate * time
    np.testing.assert_allclose(found["strain"], expected, rtol=1e-8)


@pytest.mark.parametrize("exponent", [1.0, 3.0])
def test_a_steady_rate_balances_storage_and_recovery(exponent: float) -> None:
    rate = 1e-4
    held = {**DISLOCATIONS, "steady_state_grain_size": GRAIN_SIZE}
    values = flowing(rate, 3e6, exponent, **held)
    found = simulate(of_one_stage("strain_rate", rate, 4e3), values, at=[4e3], solver=EXACT)
    slower = 1 / TEMPERATURE - 1 / values["kelvin_reference_temperature"]
    here = values["recovery_rate"] * np.exp(-60e3 / GAS_CONSTANT * slower)
    sources = 1e5 * 3e-4 / GRAIN_SIZE

    def balance(stored: float) -> float:
        ratio = stored / 3e6
        lost = here * (stored * ratio**4 + 2.0 * sources * ratio**3)
        return float(2e9 * rate * (1 + sources / stored - stored / 2e7) - lost)

    stored = brentq(balance, 1e5, 2e7, rtol=1e-14)
    # The rest of the stress drives fewer or more dislocations than at the reference.
    expected = stored + sources + 3e6 * (3e6 / stored) ** (2 / exponent)
    assert found["stress_Pa"].item() == pytest.approx(expected, rel=1e-8)


def test_sources_take_a_stress_of_dislocations_alone() -> None:
    test = history_twin("creep", 4)
    priors = default_priors(test.material, test.protocol)
    sources = fixed_prior(PARAMETER_BY_NAME["source_stress"], 1e6, "no dislocations")
    found, beside = (
        at_truth(test, own, SolverOptions()).solution(test.time)["grid_strain_rate"]
        for own in (priors, priors.exchanging(sources))
    )
    np.testing.assert_array_equal(found, beside)


def test_weak_priors_follow_the_test() -> None:
    test, priors = history_twin("mixed", 16), default_priors("ice")
    changed = with_variant(priors, test, CHOICE)
    assert set(changed.free) - set(priors.free) == {*PARAMETERS}
    largest, modulus = test.largest_stress, priors["maxwell_modulus"].mean_sd()[0]
    medians = [5 * largest, 0.1 * largest, 4e-10 * modulus / test.initial_grain_size]
    found = [changed[PARAMETERS[place]].location for place in (1, 3, 4)]
    assert found == [float(f"{one:.0e}") for one in medians]  # to one digit
    assert changed["reference_backstress"].location == float(f"{largest:.0e}")
    assert changed["recovery_exponent"].location == 5.0


@pytest.mark.parametrize(
    ("control", "value", "found"),
    [("stress", -5e6, "-5 MPa"), ("strain_rate", -1e-4, "an imposed strain of -0.1")],
)
def test_a_sample_that_is_pulled_is_refused(control: Control, value: float, found: str) -> None:
    pulled, priors = of_one_stage(control, value, 1e3), default_priors("ice")
    changed = with_variant(priors, history_twin("mixed", 16), CHOICE)
    message = f"found {found}, expected none in extension, or hardening=backstress"
    with pytest.raises(InputError, match=message):
        simulate(pulled, {**TRUTH, **DISLOCATIONS})
    with pytest.raises(InputError, match=message):
        with_variant(changed, pulled, {})


def test_readings_in_extension_are_refused() -> None:
    test = history_twin("relaxation", 16)
    noisy, pulled = (
        replace(test, reading=np.append(test.reading[:-1], share * test.largest_stress))
        for share in (-0.1, -0.5)
    )
    changed = with_variant(default_priors("ice"), noisy, CHOICE)
    with pytest.raises(InputError, match="takes stresses of one sign"):
        problem_of([pulled], changed)


@pytest.mark.parametrize(("rate", "warned"), [(-1e-6, False), (-1e-4, True)])
def test_a_solution_that_ends_in_extension_is_doubted(rate: float, warned: bool) -> None:
    test = history_twin("relaxation", 4)
    unloading = replace(test.stages[-1], control="strain_rate", end_time=700.0, value=rate)
    values = {**TRUTH, **DISLOCATIONS}
    solution = simulate(replace(test, stages=(test.stages[0], unloading)), values, at=[600, 700])
    said = extension_sentences(values["reference_backstress"], solution["stress_Pa"].to_numpy())
    assert bool(said) is warned
    assert not extension_sentences(0.0, solution["stress_Pa"].to_numpy())


def steady_table(folder: Path) -> AttenuationExperiment:
    """Return the spectrum of ice with small cycles about 4 MPa."""
    stress = "attenuation.median_stress_Pa = 4e6\nattenuation.amplitude_Pa = 100.0\nspectra"
    text = SPECTRUM.replace("spectra", stress)
    (folder / "spectrum.toml").write_text(text, encoding="utf-8")
    return load_attenuation(folder / "spectrum.toml")


@pytest.mark.parametrize("sine", [{}, {"breakdown_stress": 1.5e6, "stress_exponent": 1.0}])
@pytest.mark.parametrize("place", [0, 1, 2])
def test_small_cycles_about_steady_flow_have_the_compliance_of_a_table(
    place: int, sine: Mapping[str, float], tmp_path: Path
) -> None:
    table = steady_table(tmp_path)
    exponent = sine.get("stress_exponent", 3.0)
    values = {**flowing(1e-5, 3e6, exponent), **DISLOCATIONS, **sine}
    values |= {"kelvin_modulus": 5e9, "kelvin_viscosity": 1e11}
    values |= {"steady_state_grain_size": GRAIN_SIZE}
    # First to the steady state.
    found, _ = assert_cycles_have_the_compliance_of(
        table, values, place, settling=4e3, about=4e6, hold=1e5
    )
    of_flow = 1e-5 / 3e6 * PERIODS[place] / (2 * np.pi)  # a dashpot that is far from this one
    assert abs(-found.imag / of_flow - 1) > 0.1


def test_tables_take_it_about_steady_flow_alone() -> None:
    table, priors = (
        load_attenuation(ICE / "attenuation_twin.toml"),
        default_priors("ice", "attenuation"),
    )
    chosen = with_variant(priors, table, CHOICE)
    assert set(chosen.free) - set(priors.free) == {*PARAMETERS} - {"initial_backstress"}
    problem_of([table], chosen)
    conditions = replace(table.conditions, median_stress=0 * table.conditions.median_stress)
    with pytest.raises(InputError, match="expected one above 0 in every row"):
        problem_of([replace(table, conditions=conditions)], chosen)


def test_gradients_of_a_table_are_slopes_of_its_density(tmp_path: Path) -> None:
    table = load_attenuation(ICE / "attenuation_twin.toml")
    problem = problem_of([table], with_variant(default_priors("ice", "attenuation"), table, CHOICE))
    freed = [name for name in PARAMETERS if name != "initial_backstress"]
    assert_gradient_along(problem, freed, tmp_path, solver=SolverOptions())


def test_stresses_of_either_sign_are_refused() -> None:
    test = history_twin("creep", 8)
    turned = replace(
        test,
        stages=(
            *test.stages,
            replace(
                test.stages[-1], start_time=test.end_time, end_time=2 * test.end_time, value=-1e6
            ),
        ),
    )
    priors = with_variant(default_priors("ice"), test, CHOICE)
    with pytest.raises(InputError, match="of one sign, found -1 MPa"):
        problem_of([turned], priors)
