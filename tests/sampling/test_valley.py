"""Reference point and pins of the valley coordinates."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ICE, resolved_priors, valley_of, with_fixed
from truth_as_mode import at_truth

from pyburgers.common.errors import InputError
from pyburgers.fitting.charts_at_modes import ProblemMode, at_mode, choose_chart, find_mode
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import ConstantRateValley
from pyburgers.kinds.likelihood import ChartUnsuited
from pyburgers.kinds.problem import plain_coordinates, problem_of
from pyburgers.kinds.program_data import density_of
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.kinds.together import pooling_for
from pyburgers.kinds.valley import NOISE_SCALED, middle_of_rise, noise_exponents
from pyburgers.model.priors import PriorSet
from pyburgers.model.variants import with_variant

pytestmark = pytest.mark.usefixtures("programs")


@pytest.fixture(scope="module")
def experiment() -> ConstantRateExperiment:
    return load_constant_rate(ICE / "PIL105.toml")


@pytest.fixture(scope="module")
def priors(experiment: ConstantRateExperiment) -> PriorSet:
    return resolved_priors(experiment)


def test_pins_lie_on_the_curve_where_the_dashpot_flows(
    experiment: ConstantRateExperiment, priors: PriorSet
) -> None:
    valley = valley_of(experiment, priors)
    strain, weight = valley.pin[:, 0], valley.pin[:, 4]
    assert np.all(np.diff(strain) > 0)
    assert strain[0] > 0.005  # beyond the elastic rise
    is_pin = valley.knot[:, 2] == 1
    stress = valley.knot[is_pin, 1]
    np.testing.assert_allclose(np.cumsum(valley.knot[:, 0])[is_pin], experiment.time_at(strain))
    observed = np.interp(strain, experiment.strain, experiment.stress)
    assert np.all(np.abs(stress - observed) < 4e5)  # four times the noise
    # All pins together weigh as much as the points where the dashpot flows.
    points = np.sum(weight * (1e5 / stress) ** 2)
    assert points == pytest.approx(np.count_nonzero(experiment.strain >= strain[0]), rel=0.4)


def test_what_follows_the_first_quantile_trusts_quiet_records_more() -> None:
    noisy, quiet = load_constant_rate(ICE / "PIL105.toml"), load_constant_rate(ICE / "PIL40.toml")
    first, rest = valley_of(noisy, resolved_priors(noisy)).pin[:, 4:6].T
    np.testing.assert_array_equal(first, rest)  # noise of 2 % of the stress and more
    first, rest = valley_of(quiet, resolved_priors(quiet)).pin[:, 4:6].T
    assert np.all(rest > 1.2 * first)


def test_the_mode_of_a_weak_curve_is_not_one_of_a_spring_so_soft_that_nothing_flows(
    experiment: ConstantRateExperiment,
) -> None:
    """Draws of the prior have ten times its stress, and climbs from most soften the spring."""
    stress = 3e6 + 3e5 * np.random.default_rng(3).standard_normal(experiment.stress.size)
    weak = replace(experiment, stress=stress)
    problem = problem_of([weak], resolved_priors(weak))
    (mode,) = find_mode(problem, density_of(problem, SolverOptions()), seed=3).tests
    assert mode.values["maxwell_modulus"] > 1e9
    assert mode.values["stress_noise"] < 5e5


def test_a_prior_that_fixes_the_fabric_does_not_suit(
    experiment: ConstantRateExperiment, priors: PriorSet
) -> None:
    name = "steady_state_fabric_factor"
    known = with_fixed(priors, {name: 0.5})
    problem, solver = problem_of([experiment], known), SolverOptions()
    (mode,) = find_mode(problem, density_of(problem, solver), seed=1).tests
    assert mode.values[name] == 0.5
    with pytest.raises(ChartUnsuited, match=f"{name} is not free"):
        ConstantRateValley().reference(at_mode(problem, mode, solver))


def test_a_dashpot_that_does_not_soften_does_not_suit(
    experiment: ConstantRateExperiment, priors: PriorSet
) -> None:
    laws = {"grain_size": "constant", "fabric": "constant"}
    test = at_truth(experiment, with_variant(priors, experiment, laws), SolverOptions())
    with pytest.raises(ChartUnsuited, match="neither grain size nor fabric evolves"):
        ConstantRateValley().reference(test)


def test_what_evolves_alone_is_each_tests_own(
    experiment: ConstantRateExperiment, priors: PriorSet
) -> None:
    """Where the fabric is constant d_ss is solved for, which is partially pooled by default."""
    tests = [experiment, replace(experiment, id="another")]
    pooling = pooling_for(tests)
    assert pooling.kinds["steady_state_grain_size"] == "partial"
    priors = with_variant(priors, experiment, {"fabric": "constant"})
    problem, solver = problem_of(tests, priors, pooling), SolverOptions()
    truth = at_truth(experiment, priors, solver).mode
    found = ProblemMode((truth, truth), np.zeros(problem.layout.size))
    with pytest.raises(InputError, match="steady_state_grain_size is partially pooled"):
        choose_chart(problem, density_of(problem, solver), wanted="valley", seed=1, mode=found)


def test_widths_follow_the_noise_as_far_as_the_data_set_them(
    experiment: ConstantRateExperiment, priors: PriorSet
) -> None:
    coordinates = plain_coordinates(experiment, priors)
    size = len(coordinates.quantities)
    precise = noise_exponents(coordinates, priors, np.zeros((size, size)), NOISE_SCALED)
    vague = noise_exponents(coordinates, priors, 100 * np.eye(size), NOISE_SCALED)
    scaled = np.isin(coordinates.quantities, NOISE_SCALED)
    np.testing.assert_array_equal(precise, scaled.astype(float))
    np.testing.assert_array_equal(vague, 0.0)


def test_widths_of_springs_follow_the_noise_whatever_unit_their_coordinate_has(
    experiment: ConstantRateExperiment, priors: PriorSet
) -> None:
    test = at_truth(experiment, priors, SolverOptions())
    chart = ConstantRateValley()
    reference, _ = chart.reference(test)
    place = test.coordinates.quantities.index("maxwell_modulus")
    # A coordinate in small parts of the compliance: one of them is a precise modulus.
    assert reference.linear_from[place] < 0
    size = reference.coordinate.size
    found = chart.rescaled(reference, test, np.eye(size)).noise_exponent
    assert found[place] > 0.99
    assert found[test.coordinates.quantities.index("kelvin_viscosity")] < 0.9


@pytest.mark.parametrize(("share", "middle"), [(1.0, 1.0), (0.6, 1.0), (0.1, 0.25)])
def test_an_elastic_rise_takes_time_whatever_part_of_it_the_spring_takes(
    share: float, middle: float
) -> None:
    time = np.array([0.0, 0.5, 2.0, 3.0])
    stress = share * np.minimum(time, 2.0)
    assert middle_of_rise(time, stress, elastic_rate=1.0) == middle
