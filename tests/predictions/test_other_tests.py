"""Tables and scores of predictions, against what is known of made-up draws."""

from dataclasses import replace

import numpy as np
import pytest
import xarray as xr
from figure_texts import texts
from scipy import stats
from synthetic_fit import make_experiment, make_priors

from pyburgers.common.errors import InputError
from pyburgers.fitting.prediction import Prediction
from pyburgers.predictions.figures import prediction_figure
from pyburgers.predictions.other_tests import (
    DENSITY,
    band_table,
    overview_table,
    reading_table,
    score_sentence,
    score_table,
)

NOISE = 1e5


def make_prediction(
    *, spread: float, off: float = 0.0, n_draws: int = 200, seed: int = 1
) -> Prediction:
    """Levels of the stress that scatter by `spread`, and readings `off` their centre (both Pa)."""
    rng = np.random.default_rng(seed)
    experiment = make_experiment("new", "measured", ((0.0, 1e-5),), rng)
    n = experiment.n_points
    level = 8e6 + spread * rng.normal(size=n_draws)
    stress = np.full(n, 8e6 + off) + NOISE * rng.normal(size=n)
    experiment = replace(experiment, stress=stress)
    solved = np.repeat(level[:, None], n, axis=1)
    new = solved + NOISE * rng.normal(size=solved.shape)
    dims = ("chain", "draw", "point")
    grid = ("chain", "draw", "strain")
    tree = xr.DataTree.from_dict(
        {
            "posterior": xr.Dataset({"stress_noise": (dims[:2], np.full((1, n_draws), NOISE))}),
            "predictions": xr.Dataset(
                {
                    "stress": (grid, solved[None, :, :9]),
                    "stress_replicated": (grid, new[None, :, :9]),
                },
                {"strain": np.linspace(0.01, 0.2, 9)},
            ),
            "model_response": xr.Dataset({"stress": (dims, solved[None])}),
            "posterior_predictive": xr.Dataset({"stress": (dims, new[None])}),
        }
    )
    caution = "Beyond what was fitted: strain rate 1e-05 1/s (fitted: 0.0001)."
    return Prediction(experiment, make_priors(), tree, "old", (caution,), ())


def test_bands_are_quantiles_in_si_units() -> None:
    prediction = make_prediction(spread=1e6)
    table = band_table(prediction)
    assert list(table.columns[:2]) == ["strain", "stress_Pa_q5"]
    stress = prediction.posterior["predictions"]["stress"].to_numpy()[0]
    np.testing.assert_allclose(table["stress_Pa_q75"], np.quantile(stress, 0.75, axis=0))
    new = prediction.posterior["predictions"]["stress_replicated"].to_numpy()[0]
    np.testing.assert_allclose(table["new_stress_Pa_q5"], np.quantile(new, 0.05, axis=0))
    shown = overview_table(prediction)
    assert shown["strain (%)"].iloc[-1] == "20"
    readings = reading_table(prediction)
    assert len(readings) == prediction.experiment.n_points
    assert 0.2 < readings["share_below"].mean() < 0.8


def test_the_density_is_that_of_all_draws_together() -> None:
    prediction = make_prediction(spread=3e5)
    stress = prediction.experiment.response
    solved = prediction.posterior["model_response"]["stress"].to_numpy()[0]
    each = np.log(stats.norm.pdf(stress, solved, NOISE).mean(axis=0))
    scores = score_table(prediction)
    assert scores["found"][DENSITY] == pytest.approx(each.mean())
    assert f"{each.mean():.2f}" in score_sentence(prediction, scores)


def test_what_is_expected_is_what_happens_where_the_draws_are_right() -> None:
    """Readings share one level, so that coverage in a test scatters far more than by chance."""
    expected = score_table(make_prediction(spread=5e5)).loc["coverage of the 50 % band"]
    assert expected["expected"] == pytest.approx(0.5, abs=0.05)
    assert expected["expected_q5"] < 0.1
    assert expected["expected_q95"] > 0.9
    rng = np.random.default_rng(5)
    shares = [
        float(score_table(made)["share_below"][DENSITY])
        for k in range(12)
        for made in [make_prediction(spread=5e5, off=5e5 * rng.normal(), n_draws=100, seed=k)]
    ]
    assert 0.3 < np.mean(shares) < 0.7
    far_off = score_table(make_prediction(spread=1e5, off=2e6))
    assert far_off["found"].iloc[1] == 0.0
    assert far_off["share_below"][DENSITY] == 0.0


@pytest.mark.parametrize("n_draws", [2, 3, 10, 20])
def test_the_band_of_a_replicated_test_is_made_without_its_own_draw(n_draws: int) -> None:
    prediction = make_prediction(spread=5e5, n_draws=n_draws)
    new = prediction.posterior["posterior_predictive"]["stress"].to_numpy()[0]
    scores = score_table(prediction)
    for band in (50, 90):
        tails = np.array([0.5 - band / 200, 0.5 + band / 200])
        shares = []
        for k, readings in enumerate(new):
            low, high = np.quantile(np.delete(new, k, axis=0), tails, axis=0)
            shares.append(np.mean((readings >= low) & (readings <= high)))
        found = scores["expected"][f"coverage of the {band} % band"]
        assert found == pytest.approx(np.mean(shares), abs=1e-12)


def test_known_noise_alone_gives_the_nominal_coverage() -> None:
    tables = [score_table(make_prediction(spread=0.0, n_draws=100, seed=seed)) for seed in range(8)]
    for band in (50, 90):
        rows = [table.loc[f"coverage of the {band} % band"] for table in tables]
        assert rows[0]["expected"] == pytest.approx(band / 100, abs=0.02)
        assert np.mean([row["found"] for row in rows]) == pytest.approx(band / 100, abs=0.04)


def test_the_figure_says_what_speaks_against_it() -> None:
    figure = prediction_figure(make_prediction(spread=1e6))
    written = " ".join(text.get_text() for text in texts(figure))
    written = " ".join(written.split())
    assert "predicted from old" in written
    assert "fitted: 0.0001" in written
    assert "measured data" in written


def test_scores_want_data_and_more_than_one_draw() -> None:
    prediction = make_prediction(spread=1e6, n_draws=1)
    with pytest.raises(InputError, match="at least two"):
        score_table(prediction)
    bare = replace(prediction, experiment=prediction.experiment.to_be_solved())
    with pytest.raises(InputError, match="has no data"):
        score_table(bare)
    assert len(band_table(bare)) == 9
