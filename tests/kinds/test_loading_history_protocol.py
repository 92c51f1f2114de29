"""What is particular to loading histories: sides of jumps, priors of readings, minimum rates."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from history_twins import TRUTH, history_twin
from synthetic_fit import uniform

from pyburgers.checks.discrepancies import place_text
from pyburgers.common.errors import InputError
from pyburgers.kinds.experiment import Stated
from pyburgers.kinds.forward import simulate, simulate_data
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.likelihood import LIKELIHOOD
from pyburgers.kinds.loading_history.stan_data import leg_of_times
from pyburgers.kinds.problem import problem_of
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import variant_of, with_variant

ICE = default_priors("ice")


@pytest.fixture(scope="module")
def unloaded() -> HistoryExperiment:
    """Loaded to 1500 s, unloaded to 2500 s, loaded again to 4000 s."""
    return history_twin("load and unload", 12)


def test_of_equal_times_the_second_is_behind_the_jump(unloaded: HistoryExperiment) -> None:
    time = np.array([0.0, 1500.0, 1500.0, 1500.0, 2500.0, 4000.0])
    assert leg_of_times(unloaded, time).tolist() == [0, 0, 1, 1, 1, 2]


def test_a_reading_at_the_start_of_a_stage_is_behind_the_jump(unloaded: HistoryExperiment) -> None:
    one = replace(
        unloaded,
        time=np.array([10.0, 1500.0, 1500.0, 2500.0]),
        reading_stage=np.array([0, 0, 1, 2]),
        reading=np.zeros(4),
    )
    time, place = one.reading_places()
    assert leg_of_times(one, time)[place].tolist() == [0, 0, 1, 2]
    strain = simulate(one, dict(TRUTH), at=time)["strain"].to_numpy()[place]
    elastic = (5e6 - 5e5) / TRUTH["maxwell_modulus"]
    assert strain[1] - strain[2] == pytest.approx(elastic, rel=1e-9)


def test_strain_readings_bring_their_noise_and_correlate(unloaded: HistoryExperiment) -> None:
    (priors,) = problem_of([unloaded], ICE).priors
    assert priors["stress_noise"].is_fixed
    assert not priors["strain_noise"].is_fixed
    assert priors["residual_correlation_time"].location == pytest.approx(400.0)
    assert variant_of(priors, unloaded).residuals == "autocorrelated"
    # What the prior file says stays.
    own = ICE.exchanging(uniform("strain_noise", 1e-5, 1e-3))
    chosen = with_variant(own, unloaded, {"residuals": "independent"})
    (priors,) = problem_of([unloaded], chosen).priors
    assert priors["strain_noise"].family == "uniform"
    assert variant_of(priors, unloaded).residuals == "independent"


def test_stress_readings_alone_are_as_in_tests_at_constant_rate() -> None:
    relaxation = history_twin("relaxation", 12)
    (priors,) = problem_of([relaxation], ICE).priors
    assert priors.free == ICE.free
    with pytest.raises(InputError, match="correlate in time"):
        problem_of([relaxation], ICE.exchanging(uniform("residual_correlation_strain", 0.01, 1)))


def test_apparatus_and_offset_are_those_of_the_file(unloaded: HistoryExperiment) -> None:
    stated = replace(
        unloaded, apparatus_compliance=Stated(2e-11, 5e-12), strain_offset=Stated(1e-4, 0.0)
    )
    (priors,) = problem_of([stated], ICE).priors
    compliance, offset = priors["apparatus_compliance"], priors["strain_offset"]
    assert (compliance.family, compliance.location, compliance.scale) == ("normal", 2e-11, 5e-12)
    assert compliance.lower == 0
    assert offset.is_fixed
    assert offset.location == 1e-4
    other = replace(unloaded, id="other")
    with pytest.raises(InputError, match="apparatus_compliance is known"):
        problem_of([stated, other], ICE)


@pytest.mark.parametrize(
    ("days", "told"),
    [(1e-3, "time 43.2 to 86.4 s"), (1.0, "time 12 to 24 h"), (40.0, "time 20 to 40 d")],
)
def test_places_are_told_in_the_unit_of_the_figures(days: float, told: str) -> None:
    along = xr.Dataset({"time": ("point", 86400.0 * days * np.array([0.0, 0.5, 1.0]))})
    assert place_text(LIKELIHOOD, along, 1, 2) == told


def test_simulated_readings_scatter_about_the_solution_as_they_should() -> None:
    twin = history_twin("mixed", 60)
    values = {**dict(TRUTH), "residual_correlation_time": 20.0}
    one, two = (
        simulate_data(twin, values, np.random.default_rng(3), source="test") for _ in range(2)
    )
    np.testing.assert_array_equal(one.reading, two.reading)
    exact = simulate_data(
        twin,
        {**values, "stress_noise": 1e-9, "strain_noise": 1e-15},
        np.random.default_rng(3),
        source="test",
    )
    scatter = one.reading - exact.reading
    strain = one.response_is_strain
    assert np.std(scatter[strain]) == pytest.approx(TRUTH["strain_noise"], rel=0.3)
    assert np.std(scatter[~strain]) == pytest.approx(TRUTH["stress_noise"], rel=0.3)
    # The twin comes from another solver.
    assert np.abs(twin.reading - exact.reading)[strain].max() < 5 * TRUTH["strain_noise"]


@pytest.fixture
def stated(unloaded: HistoryExperiment) -> HistoryExperiment:
    """The same with a compliant apparatus and an offset in its file."""
    return replace(
        unloaded, apparatus_compliance=Stated(1e-9, 1e-10), strain_offset=Stated(1e-2, 0.0)
    )


def test_a_solution_has_the_apparatus_and_the_zero_that_the_test_states(
    unloaded: HistoryExperiment, stated: HistoryExperiment
) -> None:
    plain = simulate(unloaded, dict(TRUTH))
    found = simulate(stated, dict(TRUTH))
    expected = plain["strain"] + 1e-9 * plain["stress_Pa"] + 1e-2
    np.testing.assert_allclose(found["strain"], expected, rtol=1e-7)
    # What is given wins, part by part.
    given = simulate(stated, {**TRUTH, "apparatus_compliance": 0.0})
    np.testing.assert_allclose(given["strain"], plain["strain"] + 1e-2, rtol=1e-7)


def test_an_imposed_strain_holds_the_share_of_a_stated_apparatus() -> None:
    relaxation = replace(history_twin("relaxation", 12), apparatus_compliance=Stated(1e-10, 0.0))
    stated = simulate(relaxation, dict(TRUTH))
    given = simulate(relaxation, {**TRUTH, "apparatus_compliance": 1e-10})
    rigid = simulate(relaxation, {**TRUTH, "apparatus_compliance": 0.0})
    np.testing.assert_array_equal(stated["stress_Pa"], given["stress_Pa"])
    assert stated["stress_Pa"].iloc[10] < 0.8 * rigid["stress_Pa"].iloc[10]


def test_the_truth_of_simulated_readings_holds_what_they_were_made_with(
    stated: HistoryExperiment,
) -> None:
    def made(values: Mapping[str, float]) -> HistoryExperiment:
        return simulate_data(stated, values, np.random.default_rng(3), source="test")

    one = made(TRUTH)
    assert one.true_parameters == {**TRUTH, "apparatus_compliance": 1e-9, "strain_offset": 1e-2}
    np.testing.assert_array_equal(made(one.true_parameters).reading, one.reading)
    # Values that say all, such as draws from the prior, stay as they are, in their order.
    drawn = {"strain_offset": 2e-2, "apparatus_compliance": 3e-10, **TRUTH}
    other = made(drawn).true_parameters
    assert other is not None
    assert list(other.items()) == list(drawn.items())


def test_stress_is_read_where_strain_is_imposed_and_the_other_way_round() -> None:
    mixed = history_twin("mixed", 12)
    read = LIKELIHOOD.is_read(mixed, np.array([0.0, 500.0, 1000.0, 1000.0, 3500.0]))
    assert read.tolist() == [[True, True, True, False, False], [False, False, False, True, True]]
