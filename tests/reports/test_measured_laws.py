"""Measured dunite in the study: its fits, and what the page says about steps of the rate."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from common import UNSURE_BEST
from dunite import (
    APPARATUS,
    JOINT_RUN,
    ONE_RATE,
    STEPPED,
    TOGETHER,
    LawsTried,
    dunite_tasks,
    rate_steps_section,
)
from synthetic_fit import make_fit, with_problem

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.checks.verdicts import Verdict
from pyburgers.comparison.by_points import compare
from pyburgers.comparison.results import LeaveOneOut
from pyburgers.drawing.style import image
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import SampledFit
from pyburgers.model.variants import variant_of, with_variant
from pyburgers.sampling.options import SamplerOptions


def test_measured_tests_are_fitted_alone_by_several_laws_and_together() -> None:
    tasks = dunite_tasks(SamplerOptions())
    assert list(tasks) == [ONE_RATE, *STEPPED, JOINT_RUN]
    for name, task in tasks.items():
        assert all(one.provenance.kind != "synthetic" for one in task.problem.experiments)
        assert [one.id for one in task.problem.experiments] == (
            list(TOGETHER) if name == JOINT_RUN else [name]
        )
    for name, (_, laws) in STEPPED.items():
        problem = tasks[name].problem
        record = variant_of(problem.given_priors, problem.experiments[0]).record()
        assert {part: record[part] for part in laws} == laws
    pooling = tasks[JOINT_RUN].problem.pooling
    assert {pooling.kinds[name] for name in APPARATUS} == {"separate"}


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fit]:
    """A standard fit and one with a law of its own, whose n is three times as uncertain."""
    folder = tmp_path_factory.mktemp("runs")
    standard = make_fit(folder / "A", name="A", kind="measured", draws=200)
    other = make_fit(folder / "A", name="A", kind="measured", draws=200)
    priors = with_variant(other.priors, other.experiment, {"residuals": "autocorrelated"})
    other = with_problem(other, replace(other.experiment, id="A_other"), priors.resolved(8e6))
    draws = other.posterior["posterior"].to_dataset()
    n = draws["stress_exponent"]
    other.posterior["posterior"] = draws.assign(stress_exponent=n.mean() + 3 * (n - n.mean()))
    return {"A": standard, "A_other": other}


def answer(
    monkeypatch: pytest.MonkeyPatch,
    described: Mapping[str, Outcome],
    sampled: Outcome = Outcome.YES,
) -> None:
    """Decide what describes the data."""

    def told(fit: SampledFit) -> dict[CheckKind, Verdict]:
        assert isinstance(fit, Fit)
        outcomes = (sampled, described[fit.experiment.id])
        return {
            kind: Verdict(kind, outcome, f"Because {outcome.value}.")
            for kind, outcome in zip(CheckKind, outcomes, strict=True)
        }

    monkeypatch.setattr(SampledFit, "verdicts", told)


def test_the_law_that_describes_is_named_with_the_width_of_n(
    fits: dict[str, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    answer(monkeypatch, {"A": Outcome.NO, "A_other": Outcome.YES})
    section = rate_steps_section(fits)
    told = section.paragraphs[0]
    assert told.startswith("A: of 2 models, residuals=autocorrelated describes the data as far as")
    assert "3.0 times as wide as with the standard model" in told
    assert "not which physics is missing" in told
    (table,) = section.tables
    assert table.saved["sd_ratio"].tolist() == [1.0, pytest.approx(3.0)]
    assert table.bad["describes the data?"] == [True, False]
    assert table.shown["describes the data?"].tolist() == ["NO", "yes"]
    (figure,) = section.figures
    assert "residuals=autocorrelated" in figure.title
    assert image(figure.draw(), "png").startswith(b"\x89PNG")


def test_the_page_says_where_no_law_describes_or_was_sampled_well_or_is_compared(
    fits: dict[str, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    answer(monkeypatch, {"A": Outcome.NO, "A_other": Outcome.CANNOT_TELL})
    laws = LawsTried.of(fits)
    told = laws.conclusion()
    assert told.startswith("A: none of 2 models is shown to describe the data. The one that")
    assert told.endswith("an interval that leaves out what the model misses.")
    assert laws.comparison is not None
    assert laws.chosen == next(iter(laws.comparison.results))
    answer(monkeypatch, {"A": Outcome.YES, "A_other": Outcome.NO}, sampled=Outcome.CANNOT_TELL)
    told = LawsTried.of(fits).conclusion()
    assert "standard describes the data" in told
    assert told.endswith("Because cannot tell.")
    answer(monkeypatch, {"A": Outcome.YES})
    alone = LawsTried.of({"A": fits["A"]})
    assert alone.conclusion().startswith("A: of one model, standard describes the data as far as")
    assert alone.table()["outcome"].tolist() == [""]


def test_a_law_is_not_said_to_be_worse_where_an_elpd_may_be_far_off(fits: dict[str, Fit]) -> None:
    sure = LeaveOneOut(np.zeros(9), np.zeros(9), np.zeros(9, dtype=bool), 1.0)
    unsure = replace(sure, pareto_k=np.full(9, 0.9))
    far = replace(sure, elpd=np.full(9, -9.0))
    compared = compare(fits)
    nine = replace(compared, position=compared.position[:9])
    doubtful = replace(sure, doubts=("R-hat failed",))
    for best, outcomes in (
        (sure, ["best", "worse"]),
        (unsure, ["best", "cannot tell"]),
        (doubtful, [UNSURE_BEST, "cannot tell"]),
    ):
        results = dict(zip(fits, (best, far), strict=True))
        table = LawsTried(fits, replace(nine, results=results)).table()
        assert table["outcome"].tolist() == outcomes
        assert table["elpd_difference"].tolist() == [0.0, 81.0]


def test_each_test_has_an_answer_of_its_own(
    fits: dict[str, Fit], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    second = make_fit(tmp_path, name="B", kind="measured", draws=100, seed=2)
    answer(monkeypatch, {"A": Outcome.NO, "A_other": Outcome.YES, "B": Outcome.YES})
    section = rate_steps_section({**fits, "B": second})
    assert [paragraph.split(":")[0] for paragraph in section.paragraphs] == ["A", "B"]
    assert section.tables[0].shown["test"].tolist() == ["A", "A", "B"]
    assert len(section.figures) == 2
