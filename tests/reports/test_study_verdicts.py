"""Verdicts: what the prior or one number grants is no finding of the data."""

import numpy as np
import pytest
from maor.statements import (
    Belief,
    Statement,
    Verdict,
    common_verdict,
    statements_table,
)

MANY = 200.0


@pytest.mark.parametrize(
    ("prior", "number", "posterior", "verdict"),
    [
        (0.3, 0.4, 0.99, Verdict.AGREES),
        (0.3, 0.4, 0.01, Verdict.DISAGREES),
        (0.3, 0.4, 0.5, Verdict.CANNOT_TELL),
        # The model cannot do otherwise, whatever the data say.
        (1.0, 1.0, 1.0, Verdict.CANNOT_FAIL),
        (0.0, 0.0, 0.0, Verdict.CANNOT_HOLD),
        # The prior says so by the rule by which the posterior would.
        (0.95, 0.97, 0.999, Verdict.PRIOR_GRANTS),
        # Sure now, hardly less so before: odds of 9.5 after 5.
        (0.83, 0.85, 0.905, Verdict.PRIOR_GRANTS),
        # The one number says it already: the rest of the curve added nothing.
        (0.3, 0.96, 0.97, Verdict.NUMBER_GRANTS),
        (0.04, 0.2, 0.001, Verdict.PRIOR_EXCLUDES),
        (0.5, 0.05, 0.001, Verdict.NUMBER_EXCLUDES),
    ],
)
def test_a_verdict_says_what_the_data_added(
    prior: float, number: float, posterior: float, verdict: Verdict
) -> None:
    assert Belief(prior, number, posterior, MANY).verdict is verdict


def test_too_few_effective_draws_cannot_tell_what_the_curve_added() -> None:
    assert Belief(0.3, 0.4, 0.99, 12.0).verdict is Verdict.CANNOT_TELL
    # What the prior grants does not hang on them.
    assert Belief(0.95, 0.4, 0.99, 12.0).verdict is Verdict.PRIOR_GRANTS


@pytest.mark.parametrize(
    ("prior", "number", "posterior", "verdict"),
    [
        (False, False, True, Verdict.AGREES),
        (False, None, True, Verdict.AGREES),
        (True, True, True, Verdict.PRIOR_GRANTS),
        (False, True, True, Verdict.NUMBER_GRANTS),
        (True, True, False, Verdict.DISAGREES),
        (True, None, False, Verdict.DISAGREES),
        (None, False, False, Verdict.NUMBER_EXCLUDES),
        # What does not hold without the data either is not theirs to deny.
        (False, False, False, Verdict.PRIOR_EXCLUDES),
        (True, False, None, Verdict.CANNOT_TELL),
    ],
)
def test_a_statement_about_a_distribution_holds_or_does_not(
    prior: bool | None, number: bool | None, posterior: bool | None, verdict: Verdict
) -> None:
    assert Belief(prior, number, posterior, MANY).verdict is verdict


def test_only_findings_of_the_whole_curve_count() -> None:
    assert {verdict for verdict in Verdict if verdict.counts} == {
        Verdict.AGREES,
        Verdict.DISAGREES,
    }


def test_samples_share_a_verdict_with_the_least_credit() -> None:
    assert common_verdict([Verdict.AGREES, Verdict.AGREES]) is Verdict.AGREES
    assert common_verdict([Verdict.AGREES, Verdict.PRIOR_GRANTS]) is Verdict.PRIOR_GRANTS
    assert common_verdict([Verdict.DISAGREES, Verdict.NUMBER_EXCLUDES]) is Verdict.NUMBER_EXCLUDES
    # Impossible in one sample, unlikely in the other: what they share is that the prior says so.
    assert common_verdict([Verdict.CANNOT_HOLD, Verdict.DISAGREES]) is Verdict.PRIOR_EXCLUDES
    assert common_verdict([Verdict.CANNOT_HOLD, Verdict.CANNOT_HOLD]) is Verdict.CANNOT_HOLD
    assert common_verdict([Verdict.CANNOT_FAIL, Verdict.NUMBER_GRANTS]) is Verdict.PRIOR_GRANTS
    assert common_verdict([Verdict.AGREES, Verdict.DISAGREES]) is Verdict.CANNOT_TELL
    assert common_verdict([]) is Verdict.CANNOT_TELL


def test_the_table_has_what_was_believed_before_beside_the_posterior() -> None:
    beliefs = {"a": Belief(0.3, 0.4, 0.99, MANY), "b": Belief(0.31, 0.5, 0.98, 150.0)}
    statement = Statement("key", "Fig. 1", "Text.", "Evidence.", beliefs, "Rule.")
    (row,) = statements_table([statement]).to_dict("records")
    assert row["prior"] == "0.30 / 0.31"
    assert row["prior and one number"] == "0.40 / 0.50"
    assert row["posterior"] == "0.99 / 0.98"
    assert row["effective draws"] == "200 / 150"
    assert row["of"] == "a / b"
    assert row["verdict"] == "agrees"
    assert np.all(statements_table([]).columns == list(row))
