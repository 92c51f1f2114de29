"""Predictions of a test that was fitted itself: compliance and zero of the strain are inferred."""

from dataclasses import replace

import numpy as np
import pytest
from history_twins import history_twin

from pyburgers.common.array_types import FloatArray
from pyburgers.fitting.new_test import (
    TEST_PARAMETERS,
    Source,
    apparatus_values,
    parameters_for_other_test,
)
from pyburgers.fitting.prediction import predict_test
from pyburgers.fitting.prior_draws import prior_draws
from pyburgers.kinds.conditions import conditions_of
from pyburgers.kinds.experiment import Stated
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.problem import problem_of
from pyburgers.model.priors import default_priors

N_DRAWS = 5


def with_apparatus(test: HistoryExperiment) -> HistoryExperiment:
    return replace(
        test,
        apparatus_compliance=Stated(1e-10, 1e-11),
        strain_offset=Stated(2e-4, 1e-4),
    )


FITTED = with_apparatus(history_twin("creep", 12))
OTHER = replace(with_apparatus(history_twin("creep", 16, seed=1)), id="other")
INFERRED = "As the fit inferred it for"


def source_of(*experiments: HistoryExperiment) -> Source:
    """A fit of tests, of each the draws of its prior, solved."""
    problem = problem_of(list(experiments), default_priors("ice"))
    tests = {
        own.name: prior_draws(one, own.priors[0], draws=N_DRAWS, seed=number)
        for number, (one, own) in enumerate(zip(experiments, problem.alone(), strict=True))
    }
    passed = [conditions_of(one.experiment, one.posterior) for one in tests.values()]
    return Source(problem, tests, next(iter(tests.values())).posterior, passed, ())


@pytest.fixture(scope="module")
def source(programs: None) -> Source:
    return source_of(FITTED)


def drawn(source: Source, test: str, name: str) -> FloatArray:
    group = source.tests[test].posterior["posterior"].to_dataset()
    values: FloatArray = group[name].to_numpy().ravel()
    return values


def test_a_fitted_test_has_the_apparatus_of_its_draws(source: Source) -> None:
    for test in (FITTED, replace(FITTED, id="renamed")):
        prediction = predict_test(source, test)
        own = prediction.posterior["posterior"].to_dataset()
        for name in TEST_PARAMETERS:
            expected = drawn(source, FITTED.id, name)
            assert np.ptp(expected) > 0
            np.testing.assert_array_equal(own[name].to_numpy().ravel(), expected)
        assert f"{INFERRED} {FITTED.id}: " in " ".join(prediction.notes)


def test_another_test_has_that_of_its_file(source: Source) -> None:
    kept = np.arange(2000) % N_DRAWS
    values, notes = apparatus_values(source, OTHER, kept, np.random.default_rng(1))
    assert notes == []
    assert values["strain_offset"].mean() == pytest.approx(2e-4, rel=0.05)
    assert np.unique(values["strain_offset"]).size == kept.size


def test_what_its_file_now_states_otherwise_is_that_of_the_file(source: Source) -> None:
    changed = replace(FITTED, strain_offset=Stated(5e-3, 0.0))
    kept = np.arange(N_DRAWS)
    values, notes = apparatus_values(source, changed, kept, np.random.default_rng(1))
    np.testing.assert_array_equal(values["strain_offset"], 5e-3)
    own = drawn(source, FITTED.id, "apparatus_compliance")
    np.testing.assert_array_equal(values["apparatus_compliance"], own)
    assert notes == [f"{INFERRED} {FITTED.id}: compliance of the apparatus."]
    parameters = {"apparatus_compliance": 1.1e-10, "strain_offset": 1e-4, "maxwell_modulus": 4e9}
    kept_ones = dict(parameters)
    assert parameters_for_other_test(parameters, FITTED, FITTED) == (parameters, [])
    del kept_ones["strain_offset"]
    assert parameters_for_other_test(parameters, FITTED, changed) == (kept_ones, [])
    assert parameters_for_other_test(parameters, FITTED, OTHER) == ({"maxwell_modulus": 4e9}, [])


def test_of_several_fitted_tests_the_name_counts(programs: None) -> None:
    """Two tests with the same readings: the one of the name, not the first."""
    copy = replace(FITTED, id="copy")
    joint = source_of(FITTED, copy)
    kept = np.arange(N_DRAWS)
    values, notes = apparatus_values(joint, copy, kept, np.random.default_rng(1))
    np.testing.assert_array_equal(values["strain_offset"], drawn(joint, "copy", "strain_offset"))
    assert "inferred it for copy" in notes[0]
