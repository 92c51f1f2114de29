"""Sheared coordinates of oscillating tests: same posterior as in plain ones, exact Jacobian."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from functools import cache
from pathlib import Path
from typing import Literal

import numpy as np
import pytest
from charts_at_modes import chart_at_mode
from conftest import ICE, fixed, resolved_priors, with_fixed, with_priors
from jacobians import assert_jacobian_is_that_of_the_map, parameters_named
from kind_examples import short_twin
from log_density import Program, program_with
from oscillation_records import with_record
from prior_marginals import assert_prior_marginals
from stan_data import one_test_data, parameter_in, sheared_reference
from truth_as_mode import at_truth

from pyburgers.cmdstan.program import Density, load_program
from pyburgers.cmdstan.program import Program as CompiledProgram
from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.fitting.charts_at_modes import ChosenChart, ProblemMode
from pyburgers.kinds.forced_oscillation.experiment import (
    OscillationExperiment,
    with_background,
)
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forced_oscillation.harmonics import fundamentals
from pyburgers.kinds.forced_oscillation.likelihood import (
    LIKELIHOOD,
    LOG_RATE_STEP,
    N_SOLUTIONS,
    ShearedChart,
    ShearedReference,
)
from pyburgers.kinds.forced_oscillation.preparation import Background
from pyburgers.kinds.likelihood import AtMode, likelihood_of
from pyburgers.kinds.problem import one_test, problem_of
from pyburgers.kinds.program_data import chart_block
from pyburgers.kinds.stan_data import (
    PLAIN,
    REFERENCE_FLOW_RATE,
    SolverOptions,
    StanData,
    solver_block,
)
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import PriorSet, default_priors, load_priors
from pyburgers.sbc.data_sets import calibration_priors, simulate_from_prior

pytestmark = pytest.mark.usefixtures("programs")

KEPT_TEMPLATE = ICE.parent / "calibration" / "olivine_kept.toml"
TWIN_FILE = ICE.parent / "olivine" / "olivine_twin.toml"
TIGHT = SolverOptions(tolerance=1e-11, max_num_steps=1_000_000)
SAMPLING, LOOSE = SolverOptions(), SolverOptions(tolerance=1e-6)
# Whatever the slopes and their origin, the posterior is the same.
REFERENCE = sheared_reference([-0.7, 2.5, 0.8], [2.7, 0.6, 0.3])
FREE = default_priors("olivine").free
NARROW_PRIORS = Path(__file__).parents[1] / "data" / "narrow_olivine_priors.toml"
"""Those of Table 2 narrowed about the shipped twin."""


def twin_with(background: Background) -> OscillationExperiment:
    return with_background(load_forced_oscillation(TWIN_FILE), background).to_be_solved()


@pytest.fixture(params=["removed", "kept"])
def short(request: pytest.FixtureRequest) -> OscillationExperiment:
    return short_twin(request.param).to_be_solved()


def relaxing() -> OscillationExperiment:
    """Return a record whose bias falls from 98 MPa within cycles."""
    template = load_forced_oscillation(KEPT_TEMPLATE)
    priors = calibration_priors(template.material)
    simulated = simulate_from_prior(one_test(template, priors), seed=10, stress_range=(5e7, 5e8))
    (drawn,) = simulated.problem.experiments
    assert isinstance(drawn, OscillationExperiment)
    return drawn.to_be_solved()


@cache
def set_up(
    record: Background | Literal["relaxing"],
) -> tuple[AtMode[OscillationExperiment], ShearedReference]:
    """A record at its truth, and the sheared coordinates there, which take a second."""
    experiment = relaxing() if record == "relaxing" else twin_with(record)
    test = at_truth(experiment, resolved_priors(experiment), LOOSE)
    return test, ShearedChart().reference(test)[0]


def model_of(experiment: OscillationExperiment) -> CompiledProgram:
    return load_program(likelihood_of(experiment).program)


def two_points(data: StanData) -> StanData:
    """Data of a record that is cut after its second reading: a quick solution."""
    return {
        **data,
        "start_tau": [data["first_tau"][0] - 0.1],
        "point_end": [0, 2],
        **{name: data[name][:2] for name in ("tau", "stress_observed", "relative_noise")},
        "n_trend": [0],
        "trend_shape": [[], []],
        "trend_fit": [[], []],
    }


def program_in(
    experiment: OscillationExperiment,
    priors: PriorSet,
    sheared: ShearedReference | None,
    folder: Path,
) -> Program:
    """The density of two readings: coordinates know of the record, and of no solution."""
    data = one_test_data(experiment, priors, solver=TIGHT, reference=sheared)
    folder /= "plain" if sheared is None else "sheared"
    return program_with(likelihood_of(experiment).program, two_points(data), folder)


def density_less_jacobian(columns: Mapping[str, float]) -> float:
    return columns["log_density"] - columns["log_jacobian"]


def sheared_truth(
    experiment: OscillationExperiment, priors: PriorSet, reference: ShearedReference = REFERENCE
) -> FloatArray:
    """Sheared coordinates of the true parameters."""
    data = one_test_data(experiment, priors, solver=TIGHT)
    block = chart_block(one_test(experiment, priors), [reference])
    data |= {**block, "coordinate_system": PLAIN}
    position = {"coordinate": at_truth(experiment, priors, LOOSE).mode.coordinate.tolist()}
    return model_of(experiment).evaluate(data, position)["sheared_coordinate"]


def scattered(centre: FloatArray, seed: int, number: int) -> FloatArray:
    """Points from close by to as far away as the prior reaches."""
    rng = np.random.default_rng(seed)
    widths = np.geomspace(0.1, 1.5, number)[:, None]
    points: FloatArray = centre + widths * rng.standard_normal((number, centre.size))
    return points


def test_log_jacobian_is_that_of_the_map(short: OscillationExperiment, tmp_path: Path) -> None:
    priors = resolved_priors(short)
    program = program_in(short, priors, REFERENCE, tmp_path)
    for point in scattered(sheared_truth(short, priors), seed=7, number=2):
        assert_jacobian_is_that_of_the_map(program, point, parameters_named(FREE))


def assert_coordinates_work(
    experiment: OscillationExperiment, priors: PriorSet, folder: Path
) -> ShearedReference:
    """The set-up from the curvature works, and what it sets up has the right density."""
    test = at_truth(experiment, priors, LOOSE)
    mode, (reference, centre) = test.mode, ShearedChart().reference(test)
    assert np.all(np.isfinite(reference.flow_slope))
    plain, sheared = (
        program_in(experiment, priors, system, folder) for system in (None, reference)
    )
    here, there = plain.values_at(mode.coordinate), sheared.values_at(centre)
    for name in FREE:
        assert parameter_in(there, name) == pytest.approx(mode.values[name], rel=1e-8), name
    assert density_less_jacobian(there) == pytest.approx(density_less_jacobian(here), rel=1e-6)
    return reference


@pytest.mark.parametrize("name", FREE)
def test_coordinates_suit_whichever_parameter_is_fixed(name: str, tmp_path: Path) -> None:
    experiment = short_twin("kept").to_be_solved()
    assert experiment.true_parameters is not None
    priors = with_fixed(resolved_priors(experiment), {name: experiment.true_parameters[name]})
    assert_coordinates_work(experiment, priors, tmp_path)


def test_coordinates_suit_a_flow_law_without_grain_size(tmp_path: Path) -> None:
    experiment = short_twin("kept").to_be_solved()
    truth = experiment.true_parameters
    assert truth is not None
    # The same flow at the grain size of the start.
    beta = (
        truth["beta"]
        - truth["grain_size_exponent"]
        * np.log(experiment.initial_grain_size)
        / truth["activation_enthalpy"]
    )
    experiment = replace(experiment, true_parameters={**truth, "beta": beta})
    priors = with_fixed(resolved_priors(experiment), {"grain_size_exponent": 0.0})
    reference = assert_coordinates_work(experiment, priors, tmp_path)
    assert reference.flow_slope[0] != 0  # the record does say something about the flow


def bounded(name: str, location: float, scale: float) -> Prior:
    return Prior(
        name, "normal", location, scale, location - 5 * scale, np.inf, "SI", "with a lower bound"
    )


UNSUITED = {
    "bounded beta": ({"beta": bounded("beta", -8.6e-5, 1e-5)}, "beta"),
    "bounded enthalpy": (
        {"activation_enthalpy": bounded("activation_enthalpy", 445e3, 20e3)},
        "activation_enthalpy",
    ),
    "no place for the flow rate": (
        {
            "beta": fixed("beta", -9.2e-5),
            "activation_enthalpy": fixed("activation_enthalpy", 467e3),
        },
        "flow rate",
    ),
}


def chart_at_truth(
    experiment: OscillationExperiment,
    priors: PriorSet,
    wanted: str,
) -> ChosenChart:
    """Choose coordinates, with the truth in place of a search for the mode."""
    truth = at_truth(experiment, priors, LOOSE).mode
    data = one_test_data(experiment, priors, solver=LOOSE)
    mode = ProblemMode((truth,), truth.coordinate)
    return chart_at_mode(problem_of([experiment], priors), data, wanted=wanted, mode=mode)


@pytest.mark.parametrize("case", UNSUITED)
def test_priors_that_do_not_suit_fall_back_to_plain_ones(case: str) -> None:
    changed, word = UNSUITED[case]
    experiment = short_twin("kept").to_be_solved()
    priors = with_priors(resolved_priors(experiment), changed)
    found = chart_at_truth(experiment, priors, "auto")
    assert found.name == "plain"
    assert word in found.reason
    with pytest.raises(InputError, match=f"sheared coordinates do not apply.*{word}"):
        chart_at_truth(experiment, priors, "sheared")


def test_a_record_without_loss_does_not_suit() -> None:
    """Noise can turn the lag of a hardly dissipating sample around."""
    experiment = short_twin("kept").to_be_solved()
    record = experiment.record
    angle = 2 * np.pi / 300.0 * record.stress_time + 0.6
    elastic = replace(record, stress=100e6 + 50e6 * np.sin(angle))
    backwards = with_record(experiment, elastic).to_be_solved()
    prepared = backwards.prepared
    assert prepared.stress_fit.phase()[0] < prepared.strain_fit.phase()[0]
    found = chart_at_truth(backwards, resolved_priors(backwards), "auto")
    assert found.name == "plain"
    assert "stress is not ahead of the strain" in found.reason


def test_the_stretch_of_the_flow_rate_does_not_depend_on_its_slopes_at_the_mode() -> None:
    """Large slopes once put the mode where the coordinate was e^8 times too large."""
    test, reference = set_up("removed")
    experiment, priors = test.experiment, test.priors
    flow = test.coordinates.quantities.index(REFERENCE_FLOW_RATE)
    moderate, large = (
        sheared_truth(experiment, priors, replace(reference, flow_slope=np.array(slope)))[flow]
        for slope in ([0.0, 0.0, 1.0], [-6.4, -8.3, 1.4])
    )
    assert large == pytest.approx(moderate, rel=1e-9)
    # Below ten tenths of the loss, what all of it would be.
    assert -5 < moderate < 10


@pytest.mark.parametrize("record", ["removed", "kept", "relaxing"])
def test_dashpot_and_kelvin_element_share_the_loss_at_every_flow_rate(
    record: Background | Literal["relaxing"],
) -> None:
    """Closed form of the Kelvin element: what the shifts know of the dashpot is what is left."""
    test, reference = set_up(record)
    experiment, mode = test.experiment, test.mode
    rates = reference.first_log_rate + LOG_RATE_STEP * np.arange(N_SOLUTIONS)
    flow = test.coordinates.quantities.index(REFERENCE_FLOW_RATE)
    prepared = experiment.prepared
    grid = LIKELIHOOD.grid_block([experiment], [prepared.time])
    kelvin_compliance = 1 / (
        mode.values["kelvin_modulus"]
        + 2j * np.pi / prepared.period * mode.values["kelvin_viscosity"]
    )
    chosen = [2, 7, 11, 14]
    points = np.tile(mode.coordinate, (len(chosen), 1))
    points[:, flow] = test.coordinates.of_quantity(flow, rates[chosen])
    solved, found = test.generated_at(points, **grid)
    assert solved.all()
    stress = fundamentals(
        prepared.time,
        found["grid_stress"][0],
        period=prepared.period,
        degree=prepared.stress_fit.degree,
    )
    strain = prepared.strain_fit
    loss = -((strain.sine[0] + 1j * strain.cosine[0]) / stress).imag
    dashpot = np.exp(reference.log_dashpot_compliance[chosen])
    np.testing.assert_allclose(dashpot - kelvin_compliance.imag, loss, rtol=0.05)


def test_the_stretch_is_found_from_a_dashpot_that_stands_still() -> None:
    experiment = short_twin("kept").to_be_solved()
    truth = experiment.true_parameters
    assert truth is not None
    still = {**truth, "activation_enthalpy": 1.3 * truth["activation_enthalpy"]}
    experiment = replace(experiment, true_parameters=still)
    test = at_truth(experiment, resolved_priors(experiment), LOOSE)
    reference, centre = ShearedChart().reference(test)
    flow = test.coordinates.quantities.index(REFERENCE_FLOW_RATE)
    assert centre[flow] < -20  # the logarithm of a share of a tenth of the loss
    rates = reference.first_log_rate + LOG_RATE_STEP * np.arange(N_SOLUTIONS)
    at_stretch = np.interp(reference.log_rate_scale, rates, reference.log_dashpot_compliance)
    assert np.exp(at_stretch) == pytest.approx(0.1 * test.data["loss_compliance"][0], rel=1e-9)


@pytest.mark.slow
def test_a_record_whose_loss_is_all_the_dashpots_is_smooth_in_its_coordinates(
    tmp_path: Path,
) -> None:
    """There the solver's error spoils differences of gradients, and the log density, first."""
    template = twin_with("removed")
    priors = load_priors(NARROW_PRIORS)
    simulated = simulate_from_prior(one_test(template, priors), seed=1)
    (drawn,) = simulated.problem.experiments
    assert isinstance(drawn, OscillationExperiment)
    experiment = drawn.to_be_solved()
    truth = experiment.true_parameters
    assert truth is not None
    relaxation = truth["kelvin_viscosity"] / truth["kelvin_modulus"]
    assert relaxation < 0.01 * experiment.prepared.period
    data = one_test_data(experiment, priors, solver=SAMPLING)
    found = chart_at_mode(problem_of([experiment], priors), data)
    assert found.centre is not None
    assert found.covariance is not None
    widths: FloatArray = np.asarray(np.linalg.cholesky(found.covariance), dtype=np.float64)
    draws = found.centre + np.random.default_rng(2).standard_normal((3, 9)) @ widths.T
    chosen = {**data, **found.block}
    tight = {**chosen, **solver_block(SolverOptions(1e-7))}
    for point in draws:
        curvature = Density(model_of(experiment), tight).curvature(point, 0.25 * widths)
        # 3900 when the slopes of the flow rate were wrong, 4 since.
        assert np.linalg.eigvalsh(widths.T @ curvature @ widths).max() < 40
    near = draws[0] + 0.02 * np.random.default_rng(3).standard_normal((8, 9)) @ widths.T
    programs = (
        program_with(likelihood_of(experiment).program, content, tmp_path / name)
        for name, content in (("loose", chosen), ("tight", tight))
    )
    loose, exact = (
        np.array([one.columns_at({"coordinate": point.tolist()})["lp__"] for point in near])
        for one in programs
    )
    # Chains take what varies between neighbours for the density.
    assert np.std(loose - exact) < 0.2


def test_the_twin_is_sampled_in_sheared_coordinates() -> None:
    experiment = short_twin("removed").to_be_solved()
    found = chart_at_truth(experiment, resolved_priors(experiment), "auto")
    assert (found.name, found.block["coordinate_system"]) == ("sheared", 2)
    assert found.covariance is not None
    assert np.linalg.eigvalsh(found.covariance).min() > 0
    plain = chart_at_truth(experiment, resolved_priors(experiment), "plain")
    assert (plain.name, list(plain.block)) == ("plain", ["unit"])


def test_without_likelihood_coordinates_stay_plain() -> None:
    experiment = short_twin("kept").to_be_solved()
    priors = resolved_priors(experiment)
    data = one_test_data(experiment, priors, solver=SAMPLING, use_likelihood=False)
    found = chart_at_mode(problem_of([experiment], priors), data)
    assert (found.name, found.block, found.centre) == ("plain", {}, None)


def priors_about_the_truth(experiment: OscillationExperiment) -> PriorSet:
    """Priors that leave the flow rate within a factor of ten or so.

    Those of Table 2 leave it ten powers of ten, and the sheared coordinates of so wide a prior
    are as wide as the rate itself.
    """
    priors = resolved_priors(experiment)
    n, p, enthalpy, beta = (
        priors[name]
        for name in ("stress_exponent", "grain_size_exponent", "activation_enthalpy", "beta")
    )
    narrower = [
        replace(n, lower=3.1, upper=3.3),
        replace(p, lower=0.7, upper=0.9),
        replace(enthalpy, location=467e3, scale=5e3),
        replace(beta, location=-9.2e-5, scale=2e-6),
    ]
    return with_priors(priors, {prior.parameter: prior for prior in narrower})


@pytest.mark.slow
@pytest.mark.parametrize(
    ("sheared", "priors_of"),
    [(None, resolved_priors), (REFERENCE, priors_about_the_truth)],
    ids=["plain", "sheared"],
)
def test_without_likelihood_draws_have_the_priors_marginals(
    sheared: ShearedReference | None,
    priors_of: Callable[[OscillationExperiment], PriorSet],
    tmp_path: Path,
) -> None:
    experiment = short_twin("kept").to_be_solved()
    priors = priors_of(experiment)
    data = one_test_data(
        experiment,
        priors,
        solver=SolverOptions(tolerance=1e-3),
        use_likelihood=False,
        reference=sheared,
    )
    assert_prior_marginals(
        model_of(experiment),
        two_points(data),
        priors,
        tmp_path,
        draws=3000,
        least_size=1000,
        thin=3,  # successive draws are antithetic
    )
