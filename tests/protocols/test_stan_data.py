"""From experiment and priors to Stan's data: outputs of the solver, coordinates, priors."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import pytest
from conftest import ICE, with_fixed

from pyburgers.common.errors import InputError
from pyburgers.model.parameters import PARAMETERS, PROGRAM_PARAMETERS
from pyburgers.model.prior_families import Family, Prior
from pyburgers.model.priors import PriorSet, default_priors
from pyburgers.protocols.constant_rate.experiment import (
    ConstantRateExperiment,
    RateSegment,
    load_constant_rate,
)
from pyburgers.protocols.stan_data import (
    REFERENCE_STRESS,
    SolverOptions,
    StanData,
    constant_rate_data,
    plain_coordinates,
    with_later_additions,
)

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
    test: ConstantRateExperiment,
    priors: PriorSet | None = None,
    *,
    grid: Sequence[float] = (),
    use_likelihood: bool = True,
) -> StanData:
    return constant_rate_data(
        test,
        priors or ice(),
        solver=SolverOptions(),
        grid_strain=np.array(grid, dtype=np.float64),
        use_likelihood=use_likelihood,
    )


def test_repeated_strains_share_one_output() -> None:
    data = data_of(experiment([0.01, 0.02, 0.02, 0.03]))
    assert data["strain"] == [0.01, 0.02, 0.03]
    assert data["strain_of_point"] == [1, 2, 2, 3]
    assert data["n_strains_in_segment"] == [3]
    assert data["n_points"] == 4


def test_a_rate_step_is_the_last_output_of_the_segment_before() -> None:
    segments = ((0.0, 1e-4), (0.02, 1e-5), (0.05, 1e-6))
    data = data_of(experiment([0.01, 0.02, 0.03], segments))
    assert data["strain"] == [0.01, 0.02, 0.03, 0.05]
    assert data["n_strains_in_segment"] == [2, 2, 0]
    assert data["strain_of_point"] == [1, 2, 3]
    assert data["segment_start"] == [0.0, 0.02, 0.05]
    assert data["segment_rate"] == [1e-4, 1e-5, 1e-6]


@pytest.mark.parametrize("step", [0.051, 0.07, 1 / 30])
def test_a_strain_beside_a_step_by_rounding_is_the_step(step: float) -> None:
    beside = [float(np.nextafter(step, 0)), step, float(np.nextafter(step, 1))]
    data = data_of(experiment([0.01, *beside], ((0.0, 1e-4), (step, 1e-5))), grid=[*beside, 0.1])
    assert data["strain"] == [0.01, step]
    assert data["strain_of_point"] == [1, 2, 2, 2]
    assert data["n_strains_in_segment"] == [2, 0]
    assert data["grid_strain"] == [step, 0.1]
    assert data["n_grid_in_segment"] == [1, 1]


def test_without_grid_there_is_nothing_to_report() -> None:
    data = data_of(experiment([0.01], ((0.0, 1e-4), (0.05, 1e-5))))
    assert data["n_grid"] == 0
    assert data["grid_strain"] == []
    assert data["n_grid_in_segment"] == [0, 0]


def test_the_likelihood_can_be_switched_off() -> None:
    test = experiment([0.01])
    assert data_of(test)["use_likelihood"] == 1
    assert data_of(test, use_likelihood=False)["use_likelihood"] == 0


def test_priors_come_in_the_order_of_the_programs() -> None:
    data = data_of(experiment([0.01]))
    family, lower, upper = data["prior_family"], data["prior_lower"], data["prior_upper"]
    assert len(family) == len(PROGRAM_PARAMETERS)
    k = INDEX["stress_exponent"] - 1
    assert (family[k], lower[k], upper[k]) == (1, 2.7, 4.5)
    k = INDEX["stress_noise"] - 1
    assert (family[k], lower[k], upper[k]) == (2, 0.0, np.inf)


def test_reference_stress_stands_for_the_enthalpy() -> None:
    coordinates = plain_coordinates(experiment([0.01]), ice())
    assert coordinates.replaced_parameter == "activation_enthalpy"
    assert coordinates.parameters == tuple(parameter.name for parameter in PARAMETERS)
    assert data_of(experiment([0.01]))["replaced_parameter"] == INDEX["activation_enthalpy"]


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
    assert data["prior_location"][INDEX["critical_strain_fabric"] - 1] == 0.2


def test_with_both_fixed_no_reference_stress_is_sampled() -> None:
    priors = with_fixed(ice(), {"activation_enthalpy": 64e3, "beta": -7.29e-4})
    coordinates = plain_coordinates(experiment([0.01]), priors)
    assert coordinates.replaced_parameter is None
    assert REFERENCE_STRESS not in coordinates.quantities
    assert data_of(experiment([0.01]), priors)["replaced_parameter"] == 0


def test_with_everything_fixed_there_is_no_coordinate() -> None:
    values = {parameter.name: 1.0 for parameter in PARAMETERS}
    data = data_of(experiment([0.01]), with_fixed(ice(), values))
    assert data["n_coordinates"] == 0


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("tolerance", lambda: SolverOptions(tolerance=0.0)),
        ("tolerance", lambda: SolverOptions(tolerance=0.5)),
        ("tolerance", lambda: SolverOptions(tolerance=float("nan"))),
        ("max_num_steps", lambda: SolverOptions(max_num_steps=0)),
    ],
)
def test_solver_options_out_of_range_are_refused(
    name: str, make: Callable[[], SolverOptions]
) -> None:
    with pytest.raises(InputError, match=name):
        make()


def test_pins_of_earlier_runs_have_one_weight_for_all() -> None:
    data = data_of(experiment([0.01, 0.02]))
    five, six = [0.05, 1e6, 1e-5, 0.0, 2500.0], [0.05, 1e6, 1e-5, 0.0, 2500.0, 9000.0]
    read = with_later_additions({**data, "pin": [five], "further_pin": [six, five]})
    assert read["pin"] == [[*five, 2500.0]]
    assert read["further_pin"] == [six, [*five, 2500.0]]
