"""What one number of the data makes of draws of the prior."""

import numpy as np
import pytest
from maor.before_data import READING_ERROR, Knowledge, knowledge
from maor.ice_curves import PEAK_STRESS, peaks
from synthetic_fit import make_fit

from pyburgers.fitting.fit import Fit

N_DRAWS = 600


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("ice"), draws=50)


@pytest.fixture(scope="module")
def known(programs: None, fit: Fit) -> Knowledge:
    return knowledge(fit, PEAK_STRESS, n_draws=N_DRAWS, seed=1)


def test_the_peak_stress_weighs_the_draws_that_meet_it(known: Knowledge, fit: Fit) -> None:
    observed = fit.experiment.response.max()
    _, stress = peaks(known.prior)
    deviation = (stress / observed - 1) / READING_ERROR
    assert known.weights.sum() == pytest.approx(1)
    expected = np.exp(-(deviation**2) / 2)
    assert known.weights == pytest.approx(expected / expected.sum(), rel=1e-9, abs=1e-300)
    assert known.effective_draws == pytest.approx(expected.sum() ** 2 / (expected**2).sum())
    mean = known.weights @ stress
    assert mean == pytest.approx(observed, rel=2 * READING_ERROR)


def test_the_peak_stress_narrows_n_through_the_priors_of_the_flow_law(known: Knowledge) -> None:
    alone, with_peak = known.sd_before("stress_exponent")
    assert with_peak < 0.6 * alone
    # Nothing in a peak stress is about the fabric's critical strain.
    alone, with_peak = known.sd_before("critical_strain_fabric")
    assert with_peak > 0.3 * alone
