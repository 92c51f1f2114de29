"""Whole tests left out of joint fits of ice: marginal likelihoods add up, a true law predicts."""

from pathlib import Path

import numpy as np
import pytest
from common_flow_law import with_common_flow_law

from pyburgers.comparison.by_tests import compare_by_test
from pyburgers.comparison.conclusions import sentences_by_test
from pyburgers.comparison.marginal_likelihood import log_marginal_likelihood
from pyburgers.comparison.results import difference_by_test
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.model.priors import default_priors
from pyburgers.sampling.options import SamplerOptions

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("programs")]

OPTIONS = SamplerOptions(chains=2, warmup=400, draws=400, seed=20261120)


@pytest.fixture(scope="module")
def experiments() -> list[ConstantRateExperiment]:
    return [with_common_flow_law(name) for name in ("PIL40", "PIL105")]


@pytest.fixture(scope="module")
def joints(
    experiments: list[ConstantRateExperiment], tmp_path_factory: pytest.TempPathFactory
) -> dict[str, Fit]:
    folder = tmp_path_factory.mktemp("joint")
    pools = {"default": None, "separate": {"all": "separate"}}
    return {
        name: fit(experiments, default_priors("ice"), pool=pool, out=folder / name, options=OPTIONS)
        for name, pool in pools.items()
    }


def test_marginal_likelihoods_of_separate_tests_multiply(
    experiments: list[ConstantRateExperiment], joints: dict[str, Fit], tmp_path: Path
) -> None:
    """Twice: against fits of single tests, and against the joint fit without the other test."""
    (both,) = compare_by_test({"fit": joints["separate"]}, command="test").results.values()
    for k, test in enumerate(both.tests):
        (experiment,) = (e for e in experiments if e.id == test)
        alone = fit(experiment, default_priors("ice"), out=tmp_path / test, options=OPTIONS)
        single = log_marginal_likelihood(alone)
        error = float(np.hypot(both.error[k], single.error))
        print(f"{test}: {both.elpd[k]:.3f} +- {both.error[k]:.3f}, alone {single}")
        assert error < 0.5
        assert both.elpd[k] == pytest.approx(single.value, abs=4 * error)


def test_tests_of_one_material_are_predicted_better_where_it_is_shared(
    joints: dict[str, Fit],
) -> None:
    comparison = compare_by_test(joints, command="test")
    for sentence in sentences_by_test(comparison):
        print(sentence)
    shared, apart = (comparison.results[name] for name in ("default", "separate"))
    difference, _, monte_carlo = difference_by_test(shared, apart)
    assert list(comparison.results) == ["default", "separate"]
    assert difference > 4 + 4 * monte_carlo
