"""Uncertain conditions in fits: what data say of them, what tests of one furnace have in common."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from conftest import Problem, with_fixed

from pyburgers.common.draws import all_draws
from pyburgers.common.units import with_error
from pyburgers.fitting.fit import Fit, fit
from pyburgers.fitting.prediction import Prediction
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.experiment import MeasuredMicrostructure, UncertainCondition
from pyburgers.kinds.forward import simulate_data
from pyburgers.kinds.problem import problem_of
from pyburgers.model.pooling import pooling_of
from pyburgers.model.priors import PriorSet
from pyburgers.page.joint_section import pooling_table, shown_pooling_table
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sbc.data_sets import check_template, simulate_from_prior

pytestmark = pytest.mark.usefixtures("programs")

RecordProperty = Callable[[str, object], None]
QUICK = SamplerOptions(chains=2, warmup=100, draws=100, seed=4, adapt_delta=0.8)
TEMPERATURE, CALIBRATION = "temperature_error", "stress_calibration_error"


def simulated(
    problem: Problem, seed: int, errors: dict[str, float], *conditions: UncertainCondition
) -> ConstantRateExperiment:
    """The small test as it comes out where its conditions are not as stated."""
    experiment = problem.experiment
    truth = {**(experiment.true_parameters or {}), **errors}
    rng = np.random.default_rng(seed)
    test = simulate_data(experiment, truth, rng, source=f"seed {seed}")
    return replace(test, id=f"seed_{seed}", uncertain=conditions)


def known_material(problem: Problem, *free: str) -> PriorSet:
    """Priors with all but the noise and some parameters known."""
    priors, truth = problem.priors, problem.experiment.true_parameters or {}
    names = [name for name in priors.free if name not in ("stress_noise", *free)]
    return with_fixed(priors, {name: truth[name] for name in names})


def draws_of(result: Fit | Prediction) -> xr.Dataset:
    return result.posterior["posterior"].to_dataset()


@pytest.mark.slow
def test_the_prior_comes_back_where_data_say_nothing(
    small_problem: Problem, tmp_path: Path
) -> None:
    """The curve fixes one flow rate, which the activation enthalpy takes up."""
    test = simulated(small_problem, 1, {}, UncertainCondition(TEMPERATURE, 0.5, None))
    priors = known_material(small_problem, "activation_enthalpy")
    longer = replace(QUICK, draws=600)
    drawn = all_draws(draws_of(fit(test, priors, out=tmp_path, options=longer))[TEMPERATURE])
    assert abs(drawn.mean()) < 0.1
    assert drawn.std() == pytest.approx(0.5, rel=0.12)


OTHER_SEEDS = (pytest.param(2, marks=pytest.mark.slow), pytest.param(3, marks=pytest.mark.slow))


OFF = [(TEMPERATURE, 5.0, 6.0, 1.0), (CALIBRATION, 0.05, 0.06, 0.02)]


@pytest.mark.parametrize(("condition", "stated", "error", "at_most"), OFF)
@pytest.mark.parametrize("seed", [1, *OTHER_SEEDS])
def test_a_wrong_condition_is_found_where_the_material_is_known(
    seed: int,
    condition: str,
    stated: float,
    error: float,
    at_most: float,
    small_problem: Problem,
    tmp_path: Path,
    record_property: RecordProperty,
) -> None:
    uncertain = UncertainCondition(condition, stated, None)
    test = simulated(small_problem, seed, {condition: error}, uncertain)
    result = fit(test, known_material(small_problem), out=tmp_path, options=QUICK)
    drawn = all_draws(draws_of(result)[condition])
    record_property("mean_sd", (float(drawn.mean()), float(drawn.std())))
    assert drawn.std() < at_most
    assert abs(drawn.mean() - error) < 3.5 * drawn.std()


@pytest.mark.slow
def test_tests_of_one_furnace_have_one_error(small_problem: Problem, tmp_path: Path) -> None:
    """Draws, summary, tables and a new test of the same furnace know it."""
    big, own = (UncertainCondition(TEMPERATURE, 5.0, name) for name in ("big", None))
    first, second = (simulated(small_problem, s, {TEMPERATURE: 6.0}, big) for s in (1, 2))
    third = simulated(small_problem, 3, {TEMPERATURE: -4.0}, own)
    joint = fit(
        [first, second, third],
        known_material(small_problem),
        out=tmp_path / "joint",
        options=QUICK,
    )
    drawn = draws_of(joint)
    shared, alone = f"{TEMPERATURE}[seed_1+seed_2]", f"{TEMPERATURE}[seed_3]"
    assert {name for name in drawn if str(name).startswith(TEMPERATURE)} == {shared, alone}
    for test in ("seed_1", "seed_2"):
        assert (draws_of(joint[test])[TEMPERATURE] == drawn[shared]).all()
    assert abs(float(drawn[shared].mean()) - 6) < 3.5 * float(drawn[shared].std())
    assert abs(float(drawn[alone].mean()) + 4) < 3.5 * float(drawn[alone].std())
    assert {shared, alone} <= set(joint.summary("SI").index)
    table = pooling_table(joint, []).set_index(["quantity", "test"])
    assert (table["pooling"][TEMPERATURE] == "by apparatus").all()
    shown = shown_pooling_table(table.reset_index()).set_index("quantity")
    expected = with_error(float(drawn[shared].mean()), float(drawn[shared].std(ddof=1)))
    assert shown["seed_1"]["true less stated temperature"] == expected
    again = Fit.load(joint.directory.path)
    assert again.problem.experiments[0].uncertain == (big,)

    new = replace(first.to_be_solved(), id="new")
    predicted = [
        all_draws(draws_of(joint.predict(replace(new, uncertain=stated)))[TEMPERATURE])
        for stated in ((big,), (own,))
    ]
    np.testing.assert_allclose(predicted[0], all_draws(drawn[shared]), rtol=1e-6)
    assert predicted[1].std() == pytest.approx(5.0, rel=0.2)
    elsewhere = joint.predict(replace(new, uncertain=()))
    assert TEMPERATURE not in elsewhere.posterior["posterior"]
    about = [note for note in elsewhere.notes if "true less stated temperature" in note]
    assert about == [
        "The true less stated temperature is taken as none, because the file states no error."
    ]


def test_simulated_tests_of_one_furnace_go_wrong_together(small_problem: Problem) -> None:
    """And their microstructure is measured anew."""
    big, own = (UncertainCondition(TEMPERATURE, 2.0, name) for name in ("big", None))
    seen = (MeasuredMicrostructure(0.02, 220e-6, 10e-6),)
    tests = [
        replace(small_problem.experiment, id=name, uncertain=(condition,), microstructure=seen)
        for name, condition in (("A", big), ("B", own), ("C", big))
    ]
    template = problem_of(tests, known_material(small_problem), pooling_of())
    check_template(template)
    made = simulate_from_prior(template, seed=3).problem
    errors = [(test.true_parameters or {})[TEMPERATURE] for test in made.experiments]
    assert errors[0] == errors[2] != errors[1]
    assert 0 not in errors
    sizes = [test.microstructure[0].grain_size for test in made.experiments]
    assert len({*sizes, 220e-6}) == 4
    assert made.owner(TEMPERATURE, 0) == "A_simulated_3+C_simulated_3"
