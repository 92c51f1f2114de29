"""Pins of the valley coordinates along loading histories, and the search for their mode."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import pytest
from conftest import FunctionValues
from history_twins import TRUTH, history_twin
from stan_values import CHARTS
from truth_as_mode import at_truth

from pyburgers.fitting.charts_at_modes import ProblemMode, choose_chart, find_mode
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stan_data import elements_block
from pyburgers.kinds.loading_history.valley import LoadingHistoryValley
from pyburgers.kinds.problem import plain_coordinates, problem_of
from pyburgers.kinds.program_data import density_of
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.kinds.valley import ValleyReference
from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import with_variant

pytestmark = pytest.mark.usefixtures("programs")

ICE = default_priors("ice")


def valley_of(experiment: HistoryExperiment) -> ValleyReference:
    test = at_truth(experiment, ICE, SolverOptions())
    reference, _ = LoadingHistoryValley().reference(test)
    return reference


def pin_times(reference: ValleyReference) -> np.ndarray:
    return reference.pins.knot_time[reference.pins.knot]


@pytest.mark.parametrize("name", ["creep", "load and unload", "relaxation", "mixed"])
def test_pins_lie_at_readings_where_strain_advances(name: str) -> None:
    twin = history_twin(name, 40)
    reference = valley_of(twin)
    pins, times = reference.pins, pin_times(reference)
    assert np.all(np.diff(pins.path_strain) > 0)
    assert np.isin(times, twin.time).all()
    still = {"relaxation": (600.0, 3600.0), "load and unload": (1500.0, 2500.0)}
    if name in still:
        start, end = still[name]
        assert not np.any((times > start) & (times < end))
    # The dashpot's rate is the unit at the reference point, and its strength there the softening.
    assert np.all(pins.strain_rate > 0.5)
    assert 1e-6 < pins.reference_rate < 1e-3
    assert pins.noise == ("stress_noise" if name == "relaxation" else "strain_noise")
    # Times count if strain advances under loads alone: those of the one that flows most.
    assert pins.time_spent.any() == (name in ("creep", "load and unload"))
    if name in ("creep", "relaxation"):  # logarithmic where strain is read
        place = plain_coordinates(twin, ICE).quantities.index("kelvin_modulus")
        assert (reference.linear_from[place] > 0) == (name == "relaxation")
    if name == "load and unload":
        # Half of them lie under the load that flows less.
        assert np.sum(times < 1500.0) == np.sum(times > 2500.0)
        # A jump of the stress takes no time: at the start, and at both changes of the load.
        jumps = np.flatnonzero(reference.knot[:, 0] == 0)
        np.testing.assert_allclose(reference.knot[jumps, 1], [5e6, 5e5, 6e6])


def test_pins_under_a_load_lie_where_the_kelvin_element_has_settled() -> None:
    reference = valley_of(history_twin("creep", 40))
    # The first one stands for all that comes before.
    np.testing.assert_allclose(reference.pins.strain_rate[1:], 1.0, atol=0.12)
    short = history_twin("creep", 40)
    few = short.time < 600.0  # four Kelvin times: too few settled readings
    early = replace(
        short,
        stages=(replace(short.stages[0], end_time=600.0),),
        time=short.time[few],
        reading=short.reading[few],
        reading_stage=short.reading_stage[few],
    )
    assert pin_times(valley_of(early)).min() < 300.0


@pytest.mark.parametrize("name", ["creep", "load and unload"])
def test_pins_stand_for_all_the_time_that_flow_takes_under_a_load(name: str) -> None:
    twin = history_twin(name, 40)
    start = twin.stages[-1].start_time
    reference = valley_of(twin)
    pins, times = reference.pins, pin_times(reference)
    assert pins.time_spent.sum() == pytest.approx(twin.time[-1] - start, rel=0.02)
    assert not pins.time_spent[times < start].any()
    # One pin stands for the beginning of each load.
    averaged = np.flatnonzero(pins.since_start)
    first, last = averaged[[0, -1]]
    assert averaged.size == (1 if name == "creep" else 2)
    assert pins.since_start[first] == times[first]
    assert pins.time_spent[last] == pins.since_start[last] == times[last] - start
    # Where times count it has no weight beside them. It softens less than the next one.
    assert np.flatnonzero(np.isinf(pins.relative_noise)).tolist() == [last]
    assert 0 < pins.path_strain[last] < (0.7 if start == 0 else 0.9) * pins.path_strain[last + 1]
    assert pins.unit[last] < pins.unit[last + 1]


def test_a_load_flows_nearly_as_much_wherever_the_softening_is_split() -> None:
    """Though ln S_0 follows from the time of another load."""
    twin, solver = history_twin("load and unload", 28), SolverOptions()
    problem = problem_of([twin], ICE)
    truth = at_truth(twin, ICE, solver).mode
    mode = ProblemMode((truth,), np.append(truth.coordinate, truth.driving_error))
    density = density_of(problem, solver)
    chart = choose_chart(problem, density, wanted="valley", seed=1, mode=mode)
    assert chart.centre is not None
    places = [chart.centre]
    for name in ("steady_state_grain_size", "critical_strain_grain_size"):
        at = np.arange(chart.centre.size) == problem.free.index(name)
        places += [chart.centre + shift * at for shift in (-1.5, 1.5)]
    solved, drawn = density.with_data(chart.block).generated_at(np.array(places))
    assert solved.all()
    end = np.flatnonzero(twin.time <= twin.stages[0].end_time)[-1]
    strain = drawn["response_model"][0, :, end]
    np.testing.assert_allclose(strain, strain[0], rtol=0.05)


def test_under_one_load_data_tell_how_little_flow_they_show() -> None:
    twin = history_twin("creep", 40)
    pins, values = valley_of(twin).pins, at_truth(twin, ICE, SolverOptions()).mode.values
    # A part of the noise, since some readings are independent of others.
    assert 0.2 < pins.seen_flow * (pins.unit @ pins.time_spent) / values["strain_noise"] < 1.0
    assert pins.replaced_deviation == ICE["activation_enthalpy"].scale
    other = valley_of(history_twin("relaxation", 40)).pins
    assert other.seen_flow == other.replaced_deviation == 0.0


def test_readings_whose_residuals_drift_count_as_fewer() -> None:
    creep, relaxation = (history_twin(name, 40) for name in ("creep", "relaxation"))
    pins = valley_of(creep).pins
    # Residuals forget after twice the correlation time: about 13 such spans, 60 readings.
    spans = creep.time[-1] / (2 * TRUTH["residual_correlation_time"])
    weighty = np.isfinite(pins.relative_noise)
    assert spans < pins.readings[weighty].sum() < 0.5 * creep.time.size
    # Those of a stress are independent.
    pins = valley_of(relaxation).pins
    assert pins.readings.sum() == pytest.approx(np.rint(pins.readings.sum()), abs=1e-9)


def test_stages_at_another_temperature_have_no_pins() -> None:
    twin = history_twin("load and unload", 40)
    warm = replace(twin.stages[2], temperature=twin.temperature + 5)
    times = pin_times(valley_of(replace(twin, stages=(*twin.stages[:2], warm))))
    assert times.max() < 1500


KELVIN_PARTS: Mapping[str, Mapping[str, float]] = {
    "linear": {},
    "two_elements": {"peak_strength": 1.0, "peak_time_decades": -0.5},
    "extended": {"relaxation_time_decades": 3.0, "relaxation_exponent": 0.3},
    "andrade": {"andrade_exponent": 0.3},
}


@pytest.mark.parametrize("name", ["creep", "load and unload", "mixed"])
@pytest.mark.parametrize("law", KELVIN_PARTS)
def test_the_kelvin_part_leaves_the_dashpot_its_strength_at_the_pins(
    law: str, name: str, function_values: FunctionValues
) -> None:
    """That of its softened material, (*) in `stan/charts/valley/valley.stan`."""
    twin = history_twin(name, 60)
    truth = {**(twin.true_parameters or {}), **KELVIN_PARTS[law]}
    twin = replace(twin, true_parameters=truth)
    test = at_truth(twin, with_variant(ICE, twin, {"kelvin": law}), SolverOptions())
    reference, _ = LoadingHistoryValley().reference(test)

    def softening_missed(**changed: float) -> float:
        """Range of what is left of the strength without the softening, over n pins."""
        values = {**test.mode.values, **changed}
        strength = function_values(
            "chart_values",
            {
                **CHARTS,
                **elements_block([(twin, test.priors)]),
                "parameter": [values[p.name] for p in PROGRAM_PARAMETERS],
                "temperature": twin.temperature,
                "initial_grain_size": twin.initial_grain_size,
                "n_knots": len(reference.knot),
                "knot": reference.knot.tolist(),
                "n_at_knots": len(reference.pin),
                "pin": reference.pin.tolist(),
            },
        )["strength_at_pins"]
        strain = reference.pins.path_strain
        of_fabric, of_grains = (
            np.log(end + (1 - end) * np.exp(-strain / values[critical]))
            for end, critical in (
                (values["steady_state_fabric_factor"], "critical_strain_fabric"),
                (
                    values["steady_state_grain_size"] / twin.initial_grain_size,
                    "critical_strain_grain_size",
                ),
            )
        )
        exponents = values["grain_size_exponent"] / values["stress_exponent"]
        return float(np.ptp(strength - of_fabric - exponents * of_grains))

    assert softening_missed() < 0.006
    # Its own parameters count at the pins, and not those at the reference point.
    assert softening_missed(kelvin_viscosity=4 * test.mode.values["kelvin_viscosity"]) > 0.012


@pytest.mark.slow
def test_the_search_for_the_mode_ends_at_one() -> None:
    """With the gradients of the sampling it ends where the density still rises."""
    problem = problem_of([history_twin("relaxation", 40)], ICE)
    found = find_mode(problem, density_of(problem, SolverOptions()), seed=1).coordinate
    exact = density_of(problem, SolverOptions(1e-9))
    # A slope says little by itself: widths of the coordinates are 0.01 to 2.
    assert exact.expected_rise(found, exact.laplace(found)) < 0.2


@pytest.mark.slow
def test_the_mode_of_a_test_in_stages_is_found_from_the_prior() -> None:
    """From arbitrary draws of it a climb may end where noise takes all readings up."""
    problem = problem_of([history_twin("mixed", 40)], ICE)
    for seed in (1, 2, 3):
        (mode,) = find_mode(problem, density_of(problem, SolverOptions()), seed=seed).tests
        for name in ("stress_noise", "strain_noise"):
            assert mode.values[name] < 3 * TRUTH[name]


def test_noise_does_not_hide_a_spring_softer_than_its_prior_says() -> None:
    """Climbs from the prior's draws end where it takes all readings up."""
    values = {
        **TRUTH,
        "maxwell_modulus": 2e7,
        "kelvin_modulus": 3.7e9,
        "kelvin_viscosity": 3.9e11,
        "activation_enthalpy": 65.8e3,
        "residual_correlated_share": 0.3,
    }
    problem = problem_of([history_twin("load and unload", 15, values=values)], ICE)
    (mode,) = find_mode(problem, density_of(problem, SolverOptions()), seed=1).tests
    assert mode.values["maxwell_modulus"] == pytest.approx(2e7, rel=0.01)
    assert mode.values["strain_noise"] < 1e-3
