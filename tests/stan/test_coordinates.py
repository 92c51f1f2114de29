"""Coordinates of the sampler: the Jacobian is that of the map, whatever the coordinates."""

from collections.abc import Mapping, Sequence
from dataclasses import replace
from itertools import product
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE, resolved_priors, valley_of, with_fixed
from history_twins import TRUTH, history_twin
from jacobians import assert_jacobian_is_that_of_the_map, parameters_named
from log_density import Program, program_with
from stan_data import one_test_data, parameter_in
from truth_as_mode import at_truth

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.loading_history.valley import LoadingHistoryValley
from pyburgers.kinds.problem import plain_coordinates
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.kinds.valley import ValleyReference
from pyburgers.model.parameters import PARAMETERS
from pyburgers.model.priors import PriorSet, default_priors
from pyburgers.model.variants import with_variant

pytestmark = pytest.mark.usefixtures("programs")

SOLVER = SolverOptions()
SIZE = len(PARAMETERS)
VARIANTS = [{}, {"fabric": "constant"}, {"grain_size": "constant"}]
"""Where grain size and fabric evolve, and where one of them does."""

MECHANISMS = [
    {"second_mechanism": "diffusion"},
    {"second_mechanism": "in_series", "third_mechanism": "power_law"},
    {"second_mechanism": "power_law", "third_mechanism": "in_series"},
]
RATES = {"second_rate": 3e-6, "third_rate": 8e-6}
"""Of further mechanisms, 1/s: neither all of the flow nor nothing of it."""

SOFTENING = ("grain_size_exponent", "critical_strain_grain_size", "critical_strain_fabric")


def program_for(
    experiment: ConstantRateExperiment,
    priors: PriorSet,
    valley: ValleyReference | None,
    folder: Path,
) -> Program:
    data = one_test_data(experiment, priors, solver=SOLVER, reference=valley)
    return program_with(LIKELIHOOD.program, data, folder)


def stress_at(program: Program, coordinate: FloatArray) -> FloatArray:
    columns = program.values_at(coordinate)
    return np.array([columns[name] for name in columns if name.startswith("response_model.")])


def assert_jacobian_at_three_points(program: Program, names: Sequence[str]) -> None:
    rng = np.random.default_rng(12)
    for _ in range(3):
        point = rng.standard_normal(len(names))
        assert_jacobian_is_that_of_the_map(program, point, parameters_named(names))


OTHERS = [*VARIANTS, {"residuals": "discrepancy"}]


@pytest.mark.parametrize(
    ("system", "variant"),
    [*product(["plain", "valley"], OTHERS), *product(["valley"], MECHANISMS)],
    ids=str,
)
def test_log_jacobian_is_that_of_the_map(
    system: str, variant: Mapping[str, str], tmp_path: Path
) -> None:
    """That of mechanisms in plain coordinates is held by test_dashpot_mechanisms.py."""
    experiment = load_constant_rate(ICE / "PIL72.toml")
    missed = {"discrepancy": 0.8, "residual_correlation_strain": 0.01, **RATES}
    truth = {**(experiment.true_parameters or {}), **missed}
    experiment = replace(experiment, true_parameters=truth)
    priors = with_variant(resolved_priors(experiment), experiment, variant)
    names = plain_coordinates(experiment, priors).parameters
    valley = valley_of(experiment, priors) if system == "valley" else None
    if valley is not None:  # widths of noise and correlation never follow the noise
        follows = np.arange(len(names)) < names.index("stress_noise")
        valley = replace(valley, noise_exponent=valley.noise_exponent * follows)
    program = program_for(experiment, priors, valley, tmp_path)
    assert_jacobian_at_three_points(program, names)


@pytest.mark.parametrize("variant", [*VARIANTS, *MECHANISMS, {"kelvin": "two_elements"}], ids=str)
def test_log_jacobian_of_a_creep_test_is_that_of_the_map(
    variant: Mapping[str, str], tmp_path: Path
) -> None:
    """Whose plain coordinate is the flow rate at its stress, with ln S_0 solved from times."""
    twin = history_twin("creep", 12)
    truth = {**(twin.true_parameters or {}), "peak_strength": 0.5, "peak_time_decades": 1.0}
    truth |= RATES
    twin = replace(twin, true_parameters=truth)
    known = {"residual_correlation_time", "residual_correlated_share"}
    priors = with_fixed(default_priors(twin.material, twin.protocol), {k: TRUTH[k] for k in known})
    priors = with_variant(priors, twin, variant)
    reference, _ = LoadingHistoryValley().reference(at_truth(twin, priors, SOLVER))
    assert reference.pins.time_spent.all()
    data = one_test_data(twin, priors, solver=SOLVER, reference=reference)
    program = program_with(likelihood_of(twin).program, data, tmp_path)
    assert_jacobian_at_three_points(program, plain_coordinates(twin, priors).parameters)


@pytest.mark.parametrize("variant", VARIANTS, ids=str)
def test_the_curve_stays_when_what_softens_changes(
    variant: Mapping[str, str], tmp_path: Path
) -> None:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    priors = with_variant(resolved_priors(experiment), experiment, variant)
    names = plain_coordinates(experiment, priors).parameters
    softening = [names.index(name) for name in SOFTENING if name in names]
    test = at_truth(experiment, priors, SOLVER)
    systems = {
        "plain": (None, test.mode.coordinate),
        "valley": (valley_of(experiment, priors), np.zeros(len(names))),
    }
    moved = {}  # largest relative change of the stress where the dashpot flows
    for system, (valley, centre) in systems.items():
        program = program_for(experiment, priors, valley, tmp_path)
        stress = stress_at(program, centre)
        changes = [
            stress_at(program, centre + step * np.eye(len(names))[k]) / stress - 1
            for k in softening
            for step in (-1.5, 1.5)
        ]
        flowing = slice(int(np.argmax(stress)), None)
        moved[system] = np.abs(changes)[:, flowing].max()
    assert moved["valley"] < 0.01
    assert moved["plain"] > 0.05


def test_the_elastic_rise_stays_when_the_kelvin_element_becomes_a_second_spring(
    tmp_path: Path,
) -> None:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    priors = resolved_priors(experiment)
    valley = valley_of(experiment, priors)
    program = program_for(experiment, priors, valley, tmp_path)
    names = plain_coordinates(experiment, priors).parameters
    rise = np.argmax(experiment.stress > experiment.stress.max() / 2)

    def rise_and_modulus(viscosity_coordinate: float) -> tuple[float, float]:
        coordinate = np.zeros(SIZE)
        coordinate[names.index("kelvin_viscosity")] = viscosity_coordinate
        columns = program.values_at(coordinate)
        assert viscosity_coordinate == 0 or parameter_in(columns, "kelvin_viscosity") < 2e10
        return columns[f"response_model.{rise + 1}"], parameter_in(columns, "maxwell_modulus")

    stress, modulus = rise_and_modulus(0.0)
    for viscosity_coordinate in (-5.5, -6.5):
        other_stress, other_modulus = rise_and_modulus(viscosity_coordinate)
        assert other_modulus > 1.05 * modulus
        # To the accuracy of a Kelvin element under a stress that grows in proportion to time.
        assert other_stress == pytest.approx(stress, rel=0.01)
