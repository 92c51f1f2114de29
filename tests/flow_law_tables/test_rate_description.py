"""Whether one flow law describes tables of rates: what is missed, and how often by chance."""

import json
from collections.abc import Callable, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
import pytest
import xarray as xr
from conftest import ICE

from pyburgers.checks.fit_checks import CheckedDraws, CheckResult, Outcome, run_checks
from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.flow_law_tables.description import LOG_READ, RATE_CHECKS
from pyburgers.flow_law_tables.program_data import groups
from pyburgers.flow_law_tables.table_files import load_rate_table
from pyburgers.flow_law_tables.tables import RateTable

SCATTER = 0.05
LOG_RATE = np.log(np.geomspace(1e-6, 5e-4, 18))
LOG_RATES = np.append(LOG_RATE, np.log(np.geomspace(3e-6, 2e-4, 6)))
GROUP = np.repeat([0, 1], [18, 6])
MIDDLE = LOG_RATES.mean()
EXPONENT = 3.6
TEMPERATURE = 263.0 + 0.4 * np.sin(np.arange(GROUP.size))


@dataclass(frozen=True, eq=False)
class StraightLaw:
    """ln(stress), whose errors are stated, linear in ln(rate); a group has grains of its own."""

    log_rate: FloatArray
    group: IntArray
    uncertainty: FloatArray

    def data(self, seed: int) -> FloatArray:
        """ln(stress) as the law has it, with scatter."""
        rng = np.random.default_rng([seed, 1])
        law = 14.0 + (self.log_rate - MIDDLE) / EXPONENT + 0.2 * self.group
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
        # Residuals are of ln(rate): a stress above the law is a rate below it.
        noise = scatter * error * rng.standard_normal(model.shape)
        dims = ("chain", "draw", "point")
        along = {
            "stress": np.exp(data),
            "strain_rate": np.exp(self.log_rate),
            "temperature": TEMPERATURE[: data.size],
            "grain_size": np.where(self.group == 0, 230e-6, 630e-6),
            "stress_is_imposed": np.zeros(data.size, dtype=np.int64),
        }
        names = [f"the {np.sum(self.group == k)} tests of {k}" for k in np.unique(self.group)]
        numbered = {
            "source": ("point", np.zeros_like(self.group), {"names": json.dumps(["lab"])}),
            "group": ("point", self.group, {"names": json.dumps(names)}),
        }
        left = {
            "residual": (dims, -EXPONENT * (data - model)[None]),
            "residual_replicated": (dims, -EXPONENT * noise[None]),
            "deviation": (dims, EXPONENT * (scatter * error)[None]),
        }
        return CheckedDraws(
            xr.DataTree.from_dict(
                {
                    "observed_data": xr.Dataset({LOG_READ: ("point", data)}),
                    "model_response": xr.Dataset({LOG_READ: (dims, model[None])}),
                    "residuals": xr.Dataset(left),
                    "constant_data": xr.Dataset(
                        {**{k: ("point", v) for k, v in along.items()}, **numbered}
                    ),
                    "sample_stats": xr.Dataset(
                        {"diverging": (dims[:2], np.zeros((1, draws), dtype=bool))}
                    ),
                }
            )
        )


LAW = StraightLaw(LOG_RATES, GROUP, np.zeros(GROUP.size))


UNKNOWN = {
    f"along {name}" for name in ("grain size", "pressure", "water fugacity", "melt fraction")
}
ASKED = tuple(check for check in RATE_CHECKS if check.name not in UNKNOWN)
"""Those that a table with two grain sizes is held against (`RateFit.asked_checks`)."""


def failed(draws: CheckedDraws) -> dict[str, CheckResult]:
    return {one.name: one for one in run_checks(draws, ASKED) if one.outcome is not Outcome.YES}


def test_a_table_of_one_law_passes() -> None:
    draws = LAW.fit(LAW.data(1), 1)
    results = run_checks(draws, ASKED)
    assert [one.sentence for one in results if not one.passed] == []
    assert len({one.name for one in results}) == len(ASKED)
    assert "of the readings lie inside the 90 % predictive band" in results[0].sentence


def test_what_nearly_all_fits_leave_is_told_in_percent() -> None:
    results = {one.name: one.sentence for one in run_checks(LAW.fit(LAW.data(7), 7), ASKED)}
    assert "(and 100 % somewhere; a no needs" in results["along stress"]


def bent(data: FloatArray) -> FloatArray:
    return np.asarray(data + 0.07 * ((LAW.log_rate - MIDDLE) / 2.0) ** 2)


def own_exponent(data: FloatArray) -> FloatArray:
    return data + np.where(GROUP == 1, 0.2 * (LAW.log_rate - MIDDLE), 0.0)


def outlier(data: FloatArray) -> FloatArray:
    return data - np.where(np.arange(data.size) == 4, 12 * SCATTER, 0.0)


def scattered(data: FloatArray) -> FloatArray:
    signs = np.where(np.arange(GROUP.size) % 2, 1.0, -1.0)
    return np.asarray(data + np.where(GROUP == 1, 10 * SCATTER, 0.0) * signs)


@pytest.mark.parametrize(
    ("change", "check", "words"),
    [
        (
            bent,
            "along stress",
            ("The law misses how rates change with stress", "another mechanism"),
        ),
        (
            own_exponent,
            "groups",
            ("the 6 tests of 1 lie at", "times the rate of the law where the stress is least"),
        ),
        (outlier, "largest residual", ("a row of lab (", "times the rate of the law")),
        (scattered, "size of residuals", ("the 6 tests of 1",)),
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


def test_two_grain_sizes_cannot_show_a_bend() -> None:
    found = {one.name: one for one in run_checks(LAW.fit(LAW.data(1), 1), RATE_CHECKS)}
    assert found["along grain size"].outcome is Outcome.CANNOT_TELL
    assert "2 values of the grain size cannot show" in found["along grain size"].sentence


def test_few_rows_cannot_tell() -> None:
    law = StraightLaw(LOG_RATE[::5], np.zeros(4, dtype=np.int64), np.zeros(4))
    for one in run_checks(law.fit(law.data(1), 1), RATE_CHECKS):
        assert one.outcome is Outcome.CANNOT_TELL
        assert "4 readings are too few to tell" in one.sentence


def test_a_group_may_be_a_single_test() -> None:
    alone = np.where(np.arange(GROUP.size) == 23, 1, 0)
    law = StraightLaw(LOG_RATES, np.zeros_like(alone), np.zeros(GROUP.size))
    data = law.data(1)
    data[23] += 3.0
    draws = law.fit(data, 1)
    along = draws.posterior["constant_data"].to_dataset()
    named = ("point", alone, {"names": json.dumps(["the 23 tests", "the test"])})
    draws.posterior["constant_data"] = along.assign(group=named)
    told = {one.name: one.sentence for one in run_checks(draws, ASKED)}["groups"]
    assert "the test lies at" in told


def made(**columns: Sequence[object]) -> RateTable:
    """Return a table of rows that differ in what is given."""
    table = load_rate_table(ICE / "rates" / "fan_2020.toml").rows(np.arange(4))
    changed: dict[str, Any] = {name: np.array(values) for name, values in columns.items()}
    return replace(table, **changed)


def test_groups_are_sources_or_share_grain_size_and_temperature() -> None:
    several = groups(made(source=["b", "a", "b", "a"]))
    assert {name: rows.tolist() for name, rows in several} == {
        "the rows of b": [0, 2],
        "the rows of a": [1, 3],
    }
    one = made(
        source=["a"] * 4,
        temperature=[263.15, 243.15, 261.65, 263.15],
        grain_size=[1e-3, 1e-3, 1e-3, np.nan],
    )
    assert {name: sorted(rows.tolist()) for name, rows in groups(one)} == {
        "the test at about 263.1 K": [3],
        "the test at 1000 µm and about 243.2 K": [1],
        "the 2 tests at 1000 µm and about 262.4 K": [0, 2],
    }
    measured = groups(load_rate_table(ICE / "rates" / "qi_goldsby_2021.toml"))
    assert [rows.size for _, rows in measured] == [18, 5]


@pytest.mark.slow
@pytest.mark.parametrize("n_groups", [1, 2])
def test_at_most_1_in_100_tables_of_one_law_fails_any_check(n_groups: int) -> None:
    here = n_groups > GROUP
    law = StraightLaw(LOG_RATES[here], GROUP[here], np.zeros(int(here.sum())))
    n_tables = 500
    count = sum(bool(failed(law.fit(law.data(seed), seed))) for seed in range(n_tables))
    assert count <= 0.01 * n_tables + 3.1 * np.sqrt(0.01 * n_tables), count
