"""From experiment and priors to Stan's data: outputs of the solver, coordinates, priors."""

from collections.abc import Sequence
from dataclasses import replace
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
from conftest import ICE, with_fixed
from stan_data import one_test_data

from pyburgers.common.errors import InputError
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, RateSegment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.problem import plain_coordinates
from pyburgers.kinds.stan_data import REFERENCE_STRESS, SolverOptions, StanData
from pyburgers.model.parameters import PARAMETERS, PLACE
from pyburgers.model.prior_families import Family, Prior
from pyburgers.model.priors import PriorSet, default_priors

INDEX = {parameter.name: k for k, parameter in enumerate(PARAMETERS, start=1)}


def experiment(
    strain: Sequence[float], segments: Sequence[tuple[float, float]] = ((0.0, 1e-4),)
) -> ConstantRateExperiment:
    return replace(
        load_constant_rate(ICE / "PIL40.toml"),
        segments=tuple(RateSegment(start, rate) for start, rate in segments),
        strain=np.array(strain),
        stress=np.linspace(1e6, 5e6, len(strain)),
        final_strain=0.1,
    )


def ice() -> PriorSet:
    return default_priors("ice").resolved(5e6)


def with_prior(priors: PriorSet, prior: Prior) -> PriorSet:
    return replace(priors, priors=MappingProxyType({**priors.priors, prior.parameter: prior}))


def data_of(
    test: ConstantRateExperiment, priors: PriorSet | None = None, *, grid: Sequence[float] = ()
) -> StanData:
    return one_test_data(
        test, priors or ice(), solver=SolverOptions(), grid=np.array(grid, dtype=np.float64)
    )


def test_segments_are_legs_and_a_rate_step_is_the_end_of_the_one_before() -> None:
    segments = ((0.0, 1e-4), (0.02, 1e-5), (0.05, 1e-6))
    data = data_of(experiment([0.01, 0.02, 0.02, 0.03], segments))
    driven, duration, _, rate, temperature = np.transpose(data["leg"])
    assert driven.tolist() == [0.0] * 3
    np.testing.assert_allclose(duration, [200.0, 3000.0, 5e4], rtol=1e-12)
    assert rate.tolist() == [1e-4, 1e-5, 1e-6]
    assert temperature.tolist() == [experiment([0.01]).temperature] * 3
    assert data["n_outputs_in_leg"] == [2, 2, 0]
    np.testing.assert_allclose(data["output_time_in_leg"], [0.5, 1.0, 0.0, 1 / 3], rtol=1e-12)
    assert data["output_of_point"] == [1, 2, 3, 4]
    assert data["point_stage"] == [0, 0, 1, 1]


def test_strain_is_what_residuals_correlate_along_and_the_first_rate_that_of_s_0() -> None:
    data = data_of(experiment([0.01, 0.03], ((0.0, 1e-4), (0.02, 1e-5))), grid=[0.02, 0.1])
    assert data["point_position"] == [0.01, 0.03]
    assert data["grid_position"] == [0.02, 0.1]
    assert data["correlation_parameter"] == PLACE["residual_correlation_strain"]
    assert data["reference_stress_rate"] == [1e-4]


@pytest.mark.parametrize("step", [0.051, 0.07, 1 / 30])
def test_a_strain_beside_a_step_by_rounding_is_the_step(step: float) -> None:
    beside = [float(np.nextafter(step, 0)), step, float(np.nextafter(step, 1))]
    data = data_of(experiment([0.01, *beside], ((0.0, 1e-4), (step, 1e-5))), grid=[*beside, 0.1])
    assert data["n_outputs_in_leg"] == [2, 2]
    assert data["output_time_in_leg"][1:] == [1.0, 0.0, 0.0]
    assert data["n_grid_in_leg"] == [1, 3]
    assert data["grid_time_in_leg"] == [1.0, 0.0, 0.0, 1.0]


def test_without_grid_there_is_nothing_to_report() -> None:
    data = data_of(experiment([0.01], ((0.0, 1e-4), (0.05, 1e-5))))
    assert data["grid_end"] == [0, 0]
    assert data["grid_position"] == []
    assert data["n_grid_in_leg"] == [0, 0]


def test_reference_stress_stands_for_the_enthalpy() -> None:
    coordinates = plain_coordinates(experiment([0.01]), ice())
    assert coordinates.replaced_parameter == "activation_enthalpy"
    assert coordinates.parameters == tuple(parameter.name for parameter in PARAMETERS)
    assert data_of(experiment([0.01]))["replaced_parameter"] == [INDEX["activation_enthalpy"]]


@pytest.mark.parametrize(
    ("prior", "replaced"),
    [
        (("uniform", 65e3, 5e3, 60e3, 70e3), "beta"),
        (("lognormal", 65e3, 0.1, 0.0, np.inf), "activation_enthalpy"),
    ],
    ids=["two bounds", "one bound"],
)
def test_reference_stress_replaces_what_has_no_two_bounds(
    prior: tuple[Family, float, float, float, float], replaced: str
) -> None:
    changed = with_prior(ice(), Prior("activation_enthalpy", *prior, "J/mol", "test"))
    assert plain_coordinates(experiment([0.01]), changed).replaced_parameter == replaced


def test_a_fixed_parameter_is_no_coordinate() -> None:
    priors = with_fixed(ice(), {"activation_enthalpy": 64e3, "critical_strain_fabric": 0.2})
    coordinates = plain_coordinates(experiment([0.01]), priors)
    assert len(coordinates.quantities) == len(PARAMETERS) - 2
    assert "critical_strain_fabric" not in coordinates.parameters
    assert coordinates.replaced_parameter == "beta"
    data = data_of(experiment([0.01]), priors)
    assert data["prior_location"][0][INDEX["critical_strain_fabric"] - 1] == 0.2


def test_with_both_fixed_no_reference_stress_is_sampled() -> None:
    priors = with_fixed(ice(), {"activation_enthalpy": 64e3, "beta": -7.29e-4})
    coordinates = plain_coordinates(experiment([0.01]), priors)
    assert coordinates.replaced_parameter is None
    assert REFERENCE_STRESS not in coordinates.quantities
    assert data_of(experiment([0.01]), priors)["replaced_parameter"] == [0]


def test_with_everything_fixed_there_is_no_coordinate() -> None:
    values = {parameter.name: 1.0 for parameter in PARAMETERS}
    data = data_of(experiment([0.01]), with_fixed(ice(), values))
    assert data["n_coordinates"] == 0


@pytest.mark.parametrize(
    "option",
    [{"tolerance": 0.0}, {"tolerance": 0.5}, {"tolerance": np.nan}, {"max_num_steps": 0}],
    ids=str,
)
def test_solver_options_out_of_range_are_refused(option: dict[str, Any]) -> None:
    with pytest.raises(InputError, match=next(iter(option))):
        SolverOptions(**option)


def test_a_reference_too_small_for_a_number_has_a_coordinate() -> None:
    coordinates = plain_coordinates(experiment([0.01, 0.02]), ice())
    values = {name: ice()[name].sample(np.random.default_rng(1)) for name in ice().free}
    place = coordinates.quantities.index(REFERENCE_STRESS)
    assert coordinates.at(values, -1000.0)[place] < coordinates.at(values, -900.0)[place]
    given = coordinates.at({**values, REFERENCE_STRESS: 2e6})
    np.testing.assert_allclose(coordinates.at(values, float(np.log(2e6))), given)
