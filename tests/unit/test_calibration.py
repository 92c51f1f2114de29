"""Calibration: simulated data, ranks, and bands that notice what they should."""

import numpy as np
import numpy.typing as npt
import pytest
from conftest import ICE, resolved_priors
from scipy import stats

from pyburgers.calibration import counts_at_most, simulate_from_prior, simultaneous_band
from pyburgers.constant_rate import load_constant_rate
from pyburgers.simulation import simulate

N_DATA_SETS = N_DRAWS = 100


@pytest.fixture(scope="module")
def band() -> tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]]:
    return simultaneous_band(N_DATA_SETS, N_DRAWS, probability=0.95)


def share_outside(
    band: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]], *, shift: float, width: float
) -> float:
    """Share of calibrations of a standard normal posterior that leave the band."""
    rng = np.random.default_rng(7)
    outside = []
    for _ in range(400):
        truths = shift + width * rng.standard_normal(N_DATA_SETS)
        draws = rng.standard_normal((N_DATA_SETS, N_DRAWS))
        counts = counts_at_most((draws < truths[:, None]).sum(axis=1), N_DRAWS)
        outside.append(bool(np.any((counts < band[0]) | (counts > band[1]))))
    return float(np.mean(outside))


def test_a_right_posterior_leaves_the_band_as_often_as_it_should(
    band: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]],
) -> None:
    # 400 trials at 5 %: 99.9 % of correct bands are left in 2 to 9 % of them.
    low, high = (float(stats.binom.ppf(q, 400, 0.05)) / 400 for q in (0.0005, 0.9995))
    assert low <= share_outside(band, shift=0.0, width=1.0) <= high


@pytest.mark.parametrize(("shift", "width"), [(0.7, 1.0), (0.0, 1.6), (0.0, 0.6)])
def test_a_biased_or_wrongly_wide_posterior_leaves_the_band(
    band: tuple[npt.NDArray[np.int64], npt.NDArray[np.int64]], shift: float, width: float
) -> None:
    assert share_outside(band, shift=shift, width=width) > 0.9


def test_counts_are_of_ranks_at_most() -> None:
    assert counts_at_most([0, 0, 2, 3], 3).tolist() == [2, 2, 3]


def test_simulated_data_are_the_solution_at_a_prior_draw_with_noise(programs: None) -> None:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    priors = resolved_priors(experiment)
    simulated = simulate_from_prior(experiment, priors, seed=4)
    again = simulate_from_prior(experiment, priors, seed=4)
    np.testing.assert_array_equal(simulated.experiment.stress, again.experiment.stress)
    assert simulated.experiment.provenance.kind == "synthetic"
    truth = simulated.experiment.true_parameters
    assert truth is not None
    solution = simulate(experiment, truth, at=np.unique(experiment.strain))
    stress = np.interp(experiment.strain, solution["strain"], solution["stress_Pa"])
    deviation = (simulated.experiment.stress - stress) / truth["stress_noise"]
    # A sum of 61 squares of standard normal numbers.
    assert stats.chi2(experiment.n_points).cdf(float(np.sum(deviation**2))) == pytest.approx(
        0.5, abs=0.4999
    )
    assert simulated.reference_stress == solution.attrs["reference_stress"]
