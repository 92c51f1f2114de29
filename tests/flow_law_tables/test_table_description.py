"""Whether one flow law describes a table: what is missed, and how often by chance."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pytest
import xarray as xr

from pyburgers.checks.fit_checks import CheckedDraws, CheckResult, Outcome, run_checks
from pyburgers.flow_law_tables.description import LOG_STRESS, TABLE_CHECKS

FloatArray = npt.NDArray[np.float64]

SCATTER = 0.05
LOG_RATE = np.log(np.geomspace(1e-6, 5e-4, 18))
LOG_RATES = np.append(LOG_RATE, np.log(np.geomspace(3e-6, 2e-4, 6)))
GROUP = np.repeat([0, 1], [18, 6])
MIDDLE = LOG_RATES.mean()


@dataclass(frozen=True, eq=False)
class StraightLaw:
    """ln(stress) linear in ln(rate) and, for tests of the second group, ln(grain size).

    Attributes
    ----------
    log_rate, group : array, shape (n,)
        Of the tests.
    uncertainty : array, shape (n,)
        Stated, of ln(stress).
    """

    log_rate: FloatArray
    group: npt.NDArray[np.int64]
    uncertainty: FloatArray

    def data(self, seed: int) -> FloatArray:
        """ln(stress) as the law has it, with scatter."""
        rng = np.random.default_rng([seed, 1])
        law = 14.0 + (self.log_rate - MIDDLE) / 3.6 + 0.2 * self.group
        return np.asarray(law + np.hypot(SCATTER, self.uncertainty) * rng.standard_normal(law.size))

    def fit(self, data: FloatArray, seed: int, draws: int = 1000) -> CheckedDraws:
        """Draws of the posterior under flat priors, all errors in proportion to the scatter."""
        rng = np.random.default_rng([seed, 2])
        error = np.hypot(SCATTER, self.uncertainty) / SCATTER
        design = np.column_stack([np.ones_like(data), self.log_rate - MIDDLE, self.group])
        design = design[:, : 2 + np.ptp(self.group)]
        whitened = design / error[:, None]
        best, (squares,), *_ = np.linalg.lstsq(whitened, data / error)
        freedom = data.size - design.shape[1]
        scatter = np.sqrt(squares / rng.chisquare(freedom, draws))[:, None]
        factor = np.linalg.cholesky(np.linalg.inv(whitened.T @ whitened))
        away = scatter * (rng.standard_normal((draws, design.shape[1])) @ factor.T)
        model = (best + away) @ design.T
        replicas = model + scatter * error * rng.standard_normal(model.shape)
        dims = ("chain", "draw", "point")
        along = {
            "strain_rate": np.exp(self.log_rate),
            "temperature": np.full(data.size, 263.0),
            "grain_size": np.where(self.group == 0, 230e-6, 630e-6),
            "relative_stress_uncertainty": self.uncertainty,
            "group": self.group,
        }
        return CheckedDraws(
            xr.DataTree.from_dict(
                {
                    "observed_data": xr.Dataset({LOG_STRESS: ("point", data)}),
                    "model_response": xr.Dataset({LOG_STRESS: (dims, model[None])}),
                    "posterior_predictive": xr.Dataset({LOG_STRESS: (dims, replicas[None])}),
                    "posterior": xr.Dataset({"stress_scatter": (dims[:2], scatter.T)}),
                    "constant_data": xr.Dataset({k: ("point", v) for k, v in along.items()}),
                    "sample_stats": xr.Dataset(
                        {"diverging": (dims[:2], np.zeros((1, draws), dtype=bool))}
                    ),
                }
            )
        )


LAW = StraightLaw(LOG_RATES, GROUP, np.zeros(GROUP.size))


def failed(draws: CheckedDraws) -> dict[str, CheckResult]:
    return {
        one.name: one for one in run_checks(draws, TABLE_CHECKS) if one.outcome is not Outcome.YES
    }


def test_a_table_of_one_law_passes() -> None:
    draws = LAW.fit(LAW.data(1), 1)
    results = run_checks(draws, TABLE_CHECKS)
    assert [one.sentence for one in results if not one.passed] == []
    assert len({one.name for one in results}) == len(TABLE_CHECKS)
    assert "of the peak stresses lie inside the 90 % predictive band" in results[0].sentence


def bent(data: FloatArray) -> FloatArray:
    return np.asarray(data + 0.07 * ((LAW.log_rate - MIDDLE) / 2.0) ** 2)


def own_exponent(data: FloatArray) -> FloatArray:
    return data + np.where(GROUP == 1, 0.2 * (LAW.log_rate - MIDDLE), 0.0)


def outlier(data: FloatArray) -> FloatArray:
    return data - np.where(np.arange(data.size) == 4, 12 * SCATTER, 0.0)


def scattered(data: FloatArray) -> FloatArray:
    signs = np.random.default_rng(3).choice([-1, 1], GROUP.size)
    return np.asarray(data + np.where(GROUP == 1, 10 * SCATTER, 0.0) * signs)


@pytest.mark.parametrize(
    ("change", "check", "words"),
    [
        (
            bent,
            "bend along the rate",
            (
                "The stress exponent changes with the rate",
                "% below a line through those at the ends",
                "another mechanism",
            ),
        ),
        (
            own_exponent,
            "groups",
            (
                "the 6 tests at 630 µm and about 263 K lie",
                "below the flow law where they are slowest",
            ),
        ),
        (outlier, "largest residual", ("row 5 (", "% below the flow law")),
        (scattered, "size of residuals", ("the 6 tests at 630 µm",)),
    ],
)
def test_what_one_law_misses_is_told(
    change: Callable[[FloatArray], FloatArray], check: str, words: tuple[str, ...]
) -> None:
    found = failed(LAW.fit(change(LAW.data(1)), 1))[check]
    assert found.outcome is Outcome.NO
    assert [word for word in words if word not in found.sentence] == []


def test_a_test_stated_to_be_uncertain_is_no_outlier() -> None:
    uncertain = StraightLaw(LOG_RATES, GROUP, np.where(np.arange(GROUP.size) == 4, 0.5, 0.0))
    assert failed(uncertain.fit(outlier(LAW.data(1)), 1)) == {}


def test_two_rates_cannot_show_a_bend() -> None:
    rates = np.log(np.repeat([1e-6, 1e-5], 6))
    law = StraightLaw(rates, np.zeros(12, dtype=np.int64), np.zeros(12))
    found = failed(law.fit(law.data(1), 1))
    assert list(found) == ["bend along the rate"]
    assert found["bend along the rate"].outcome is Outcome.CANNOT_TELL
    assert "2 strain rates cannot show whether n changes" in found["bend along the rate"].sentence


def test_few_rows_cannot_tell() -> None:
    law = StraightLaw(LOG_RATE[::5], np.zeros(4, dtype=np.int64), np.zeros(4))
    for one in run_checks(law.fit(law.data(1), 1), TABLE_CHECKS):
        assert one.outcome is Outcome.CANNOT_TELL
        assert "4 readings are too few to tell" in one.sentence


def test_a_group_may_be_a_single_test() -> None:
    alone = np.where(np.arange(GROUP.size) == 23, 1, 0)
    law = StraightLaw(LOG_RATES, alone, np.zeros(GROUP.size))
    sentences = {
        one.name: one.sentence for one in run_checks(law.fit(law.data(1), 1), TABLE_CHECKS)
    }
    assert "No group is off as a whole: the 23 tests" in sentences["groups"]
    data = law.data(1)
    data[23] += 3.0
    shared = StraightLaw(LOG_RATES, np.zeros_like(alone), np.zeros(GROUP.size)).fit(data, 1)
    shared.posterior["constant_data"] = (
        shared.posterior["constant_data"].to_dataset().assign(group=("point", alone))
    )
    told = {one.name: one.sentence for one in run_checks(shared, TABLE_CHECKS)}["groups"]
    assert "the test at 230 µm and about 263 K lies" in told


@pytest.mark.slow
@pytest.mark.parametrize("n_groups", [1, 2])
def test_at_most_1_in_100_tables_of_one_law_fails_any_check(n_groups: int) -> None:
    here = n_groups > GROUP
    law = StraightLaw(LOG_RATES[here], GROUP[here], np.zeros(int(here.sum())))
    n_tables = 500
    count = sum(bool(failed(law.fit(law.data(seed), seed))) for seed in range(n_tables))
    assert count <= 0.01 * n_tables + 3.1 * np.sqrt(0.01 * n_tables), count
