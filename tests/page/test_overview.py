"""The top of a page: names of fits, rows, both answers, conflicts."""

from dataclasses import replace
from pathlib import Path
from types import MappingProxyType

import pytest
from synthetic_fit import make_fit, make_prior, with_problem

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.checks.prior_influence import Bound, Influence
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit
from pyburgers.page.names import file_key, joint_key, page_keys, page_names
from pyburgers.page.overview import (
    CONFLICT_COLUMN,
    answers,
    bad_answers,
    entry_of,
    overview_table,
    remedies,
)

SAMPLING, DESCRIPTION = CheckKind.SAMPLING, CheckKind.DESCRIPTION


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    """A fit whose chains did not meet."""
    return make_fit(tmp_path_factory.mktemp("run"), chains=2, draws=300, apart=3.0)


def influence(name: str, distance: float) -> Influence:
    """What a quantity far from its prior owes to it."""
    return Influence(name, {name: 0.5}, distance=distance, conflict_probability=1e-4)


def test_a_row_has_both_answers_with_what_failed(fit: Fit) -> None:
    checks = fit.checks()
    entry = entry_of("A", "A", fit, checks, {})
    assert entry.verdicts[SAMPLING].outcome is Outcome.NO
    failed = [c.name for c in checks if c.check.kind is SAMPLING and not c.passed]
    assert entry.row["sampled well?"] == f"NO: {', '.join(failed)}"
    assert entry.row["describes the data?"].startswith(entry.verdicts[DESCRIPTION].outcome.value)
    assert entry.row["model"] == "standard"
    assert bad_answers([entry])["sampled well?"] == [True]


def test_the_answer_for_all_fits_is_no_where_it_is_for_one(fit: Fit, tmp_path: Path) -> None:
    good = make_fit(tmp_path, name="B", chains=2, draws=600)
    entries = [
        entry_of("A", "A", fit, fit.checks(), {}),
        entry_of("B", "B", good, good.checks(), {}),
    ]
    sampled, _ = answers(entries)
    assert sampled.outcome is Outcome.NO
    assert [entry.name for entry in sampled.doubtful] == ["A"]
    sampled, _ = answers(entries[1:])
    assert sampled.outcome is good.sampled_well
    assert overview_table(entries)["run"].tolist() == ["A", "B"]


def test_a_row_names_what_is_furthest_out_and_what_a_bound_decides(tmp_path: Path) -> None:
    names = ("stress_exponent", "beta", "maxwell_modulus", "kelvin_modulus")
    influences = {name: influence(name, k + 2.0) for k, name in enumerate(names)}
    good = make_fit(tmp_path, chains=2, draws=600)
    entry = entry_of("A", "A", good, good.checks(), influences)
    told = entry.row[CONFLICT_COLUMN]
    assert told.startswith("E_K (+5.0 sd of a normal prior), E_M (+4.0 sd of a normal prior)")
    assert told.endswith("and 2 more")
    assert entry.conflict is not None
    assert "stress exponent (+2.0 sd of a normal prior)" in entry.conflict
    piled = replace(influences["beta"], bound=Bound("lower", 1.0, 0.6, is_physical=False))
    entry = entry_of("A", "A", good, good.checks(), {"beta": replace(piled, distance=0.0)})
    assert entry.row[CONFLICT_COLUMN].endswith("; at a bound: β")
    assert "60 % of the draws lie within 0.5 sd of it" in entry.decisions[0]


def test_the_exponent_of_a_row_says_who_decides_it(tmp_path: Path) -> None:
    good = make_fit(tmp_path, chains=2, draws=600)
    by_enthalpy = Influence("stress_exponent", {"activation_enthalpy": -0.94})
    entry = entry_of("A", "A", good, good.checks(), {"stress_exponent": by_enthalpy})
    assert entry.row["stress exponent n"].endswith(", prior (of Q_M)")
    assert "The prior of activation enthalpy decides stress exponent" in entry.decisions[0]
    known = make_fit(tmp_path / "known", chains=2, draws=50, fixed=("stress_exponent",))
    entry = entry_of("A", "A", known, known.checks(), {})
    assert entry.row["stress exponent n"] == "3.779 (fixed)"


def test_draws_of_no_use_say_nothing_of_prior_and_data(tmp_path: Path) -> None:
    """Of five draws prior and data were said to disagree."""
    far = make_prior("stress_exponent", "normal", 40.0, 1.0)
    for draws, told in ((5, False), (600, True)):
        fit = make_fit(tmp_path / str(draws), chains=2, draws=draws)
        priors = {**fit.priors.priors, "stress_exponent": far}
        moved = with_problem(
            fit, fit.experiment, replace(fit.priors, priors=MappingProxyType(priors))
        )
        assert bool(moved.prior_conflicts()) == told
        words = set(moved.summary()["decided_by"])
        assert ("cannot tell" in words) != told


def test_doubts_are_told_without_what_to_do_and_that_once(fit: Fit, tmp_path: Path) -> None:
    good = make_fit(tmp_path, name="B", chains=2, draws=600)
    entries = [
        entry_of("A", "A", fit, fit.checks(), {}),
        entry_of("A2", "A2", fit, fit.checks(), {}),
        entry_of("B", "B", good, good.checks(), {}),
    ]
    found = remedies(entries)
    ((said, concerned),) = (
        (text, fits) for (check, text), fits in found.items() if check == "R-hat"
    )
    assert [entry.name for entry in concerned] == ["A", "A2"]
    assert said.startswith("sample again with a longer --warmup, with --overwrite or another --out")
    doubts = entries[0].doubts(SAMPLING)
    assert doubts[0] == "The posterior was not sampled well."
    assert doubts[1].startswith("R-hat: The chains have not yet found the same distribution")
    assert not any(text in line for _, text in found for line in doubts)
    assert entries[2].doubts(SAMPLING) == ["The posterior was sampled well."]


def test_fits_are_called_after_their_folders(tmp_path: Path) -> None:
    fits = [
        make_fit(tmp_path / folder, chains=1, draws=20) for folder in ("warm", "x/cold", "y/cold")
    ]
    assert page_keys(fits[:2]) == ["warm", "cold"]
    assert page_keys(fits[1:]) == ["x_cold", "y_cold"]
    with pytest.raises(InputError, match="warm: found this run twice"):
        page_keys([fits[0], fits[0]])


def test_a_page_calls_fits_by_words(tmp_path: Path) -> None:
    folders = {
        "dunite_4581": "dunite 4581",
        "dunite_4581_kelvin_power_law": "dunite 4581, kelvin power law",
        "of_another_test": "of another test",
    }
    fits = [
        make_fit(tmp_path / folder, name="dunite_4581", chains=1, draws=20) for folder in folders
    ]
    assert page_names(fits) == list(folders.values())
    # Two folders that would be called alike keep their own names.
    alike = make_fit(tmp_path / "dunite 4581", name="dunite_4581", chains=1, draws=20)
    assert page_names([alike, *fits])[:2] == ["dunite 4581", "dunite_4581"]


@pytest.mark.parametrize(
    "name", ["../../etc/passwd", "a b", "<b>", '"', "a/b", "..", ".hidden", "ä", "x\ny", ""]
)
def test_names_cannot_leave_their_folder_nor_meet(name: str, tmp_path: Path) -> None:
    key = file_key(name)
    file = tmp_path / f"{key}_summary.csv"
    assert file.resolve().parent == tmp_path
    assert not key.startswith(".")
    assert not set(key) & set("/\\ \"'<>&#%\n")
    assert key == file_key(name)
    assert key != file_key(f"{name}_")


def test_simple_names_stay_as_they_are() -> None:
    assert file_key("dunite_4581+x") == "dunite_4581+x"
    assert file_key("joint: test") == "joint.test"
    assert joint_key("both") == "joint_both"
    assert file_key("a b") != file_key("a_b")
