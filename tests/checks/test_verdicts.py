"""The two verdicts: one question each, never answered beyond what the checks could tell."""

from dataclasses import replace

import pandas as pd
import pytest

from pyburgers.checks.fit_checks import (
    Check,
    CheckedDraws,
    CheckKind,
    CheckResult,
    Finding,
    Outcome,
)
from pyburgers.checks.verdicts import verdicts
from pyburgers.cli.terminal import print_checks

SAMPLING, DESCRIPTION = CheckKind.SAMPLING, CheckKind.DESCRIPTION
YES, NO, CANNOT_TELL = Outcome.YES, Outcome.NO, Outcome.CANNOT_TELL


def nothing(draws: CheckedDraws) -> Finding:
    raise AssertionError("only results are looked at")


def result(name: str, kind: CheckKind, outcome: Outcome, *, unusable: bool = False) -> CheckResult:
    check = Check(name, kind, nothing)
    return CheckResult(
        outcome, pd.DataFrame({"x": [1]}), f"The {name} says so", "do", unusable, check=check
    )


GOOD = (result("chains", SAMPLING, YES), result("shape", DESCRIPTION, YES))


def test_both_questions_are_answered_yes_where_all_checks_pass() -> None:
    answers = verdicts(GOOD)
    assert list(answers) == [SAMPLING, DESCRIPTION]
    for kind, verdict in answers.items():
        assert verdict.kind is kind
        assert verdict.outcome is YES
    assert answers[SAMPLING].sentence.startswith("The posterior was sampled well: ")
    assert answers[DESCRIPTION].sentence.startswith("The model describes the data: ")


def test_a_misfit_says_nothing_about_the_sampling() -> None:
    answers = verdicts([*GOOD, result("trend", DESCRIPTION, NO)])
    assert answers[SAMPLING].outcome is YES
    assert answers[DESCRIPTION].outcome is NO
    assert "the trend says so; do." in answers[DESCRIPTION].sentence


def test_only_useless_draws_leave_the_other_question_open() -> None:
    usable = verdicts([*GOOD, result("treedepth", SAMPLING, NO)])
    assert (usable[SAMPLING].outcome, usable[DESCRIPTION].outcome) == (NO, YES)
    useless = verdicts([*GOOD, result("R-hat", SAMPLING, NO, unusable=True)])
    assert (useless[SAMPLING].outcome, useless[DESCRIPTION].outcome) == (NO, CANNOT_TELL)
    assert "the R-hat says so" in useless[DESCRIPTION].sentence


def test_what_one_check_cannot_tell_is_no_yes() -> None:
    """Coverage alone is nearly automatic, so that it must not say that the model describes."""
    answers = verdicts([*GOOD, result("trend", DESCRIPTION, CANNOT_TELL)])
    assert answers[DESCRIPTION].outcome is CANNOT_TELL
    failed = verdicts([*GOOD, *(result(o.value, DESCRIPTION, o) for o in (CANNOT_TELL, NO))])
    assert failed[DESCRIPTION].outcome is NO


def test_a_yes_holds_what_the_checks_want_to_be_known_beside_it() -> None:
    noted = replace(result("size", DESCRIPTION, YES), note="a tenth is left over")
    answer = verdicts([*GOOD, noted])[DESCRIPTION]
    assert answer.outcome is YES
    assert answer.sentence.endswith("all 2 checks of it passed; a tenth is left over.")


def test_one_reason_of_several_checks_is_told_once() -> None:
    few = [result("few", DESCRIPTION, CANNOT_TELL), result("few", DESCRIPTION, CANNOT_TELL)]
    assert "Also" not in verdicts([*GOOD, *few])[DESCRIPTION].sentence
    other = result("other", DESCRIPTION, CANNOT_TELL)
    assert verdicts([*GOOD, *few, other])[DESCRIPTION].sentence.endswith(" Also: other.")


def test_nothing_is_said_about_data_that_took_no_part() -> None:
    answers = verdicts(GOOD[:1])
    assert (answers[SAMPLING].outcome, answers[DESCRIPTION].outcome) == (YES, CANNOT_TELL)
    assert "no check compared it with data" in answers[DESCRIPTION].sentence
    assert print_checks(GOOD[:1]) == 0


@pytest.mark.parametrize(
    ("more", "code"),
    [
        ((), 0),
        ((result("trend", DESCRIPTION, NO),), 4),
        ((result("trend", DESCRIPTION, CANNOT_TELL),), 4),
        ((result("R-hat", SAMPLING, NO, unusable=True),), 3),
        ((result("R-hat", SAMPLING, CANNOT_TELL),), 3),
        ((result("R-hat", SAMPLING, NO), result("trend", DESCRIPTION, NO)), 3),
    ],
)
def test_each_question_has_its_block_and_its_exit_code(
    more: tuple[CheckResult, ...], code: int, capsys: pytest.CaptureFixture[str]
) -> None:
    checks = [*GOOD, *more]
    assert print_checks(checks) == code
    out = capsys.readouterr().out
    first, second = out.index(SAMPLING.value), out.index(DESCRIPTION.value)
    for check in checks:
        told = out.index(f"  {check.name}: {check.sentence}")
        assert first < told
        assert (told > second) == (check.check.kind is DESCRIPTION)
    for verdict in verdicts(checks).values():
        assert f"{verdict.kind.value} {verdict.outcome.value.upper()}\n{verdict.sentence}" in out
