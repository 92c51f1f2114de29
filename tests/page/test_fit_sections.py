"""Fits of the same data: alike sentences once, numbers side by side, one figure unfolded."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import sketch_pictures
from page import Page, page_of
from synthetic_fit import make_fit, with_problem

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.fitting.fit import Fit
from pyburgers.model.variants import with_variant
from pyburgers.page.fit_sections import SameData, Section, by_data, write_section
from pyburgers.page.joint_section import strayed
from pyburgers.page.tables import DECISION

FEW = (
    "kelvin_modulus",
    "kelvin_viscosity",
    "activation_enthalpy",
    "beta",
    "steady_state_grain_size",
    "steady_state_fabric_factor",
    "critical_strain_grain_size",
    "critical_strain_fabric",
)
WORDS_OF_A_FIT = 160
"""Unfolded, of a fit that describes its data."""


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fit]:
    """Two of the same data, one of which failed, and one of other data."""
    runs = tmp_path_factory.mktemp("runs")
    return {
        "good": make_fit(runs / "good", name="A", chains=2, draws=300, fixed=FEW),
        "other": make_fit(runs / "other", name="B", chains=2, draws=300, fixed=FEW, seed=2),
        "failed": make_fit(runs / "failed", name="A", chains=2, draws=300, fixed=FEW, apart=3.0),
    }


@pytest.fixture(scope="module")
def sections(fits: Mapping[str, Fit], tmp_path_factory: pytest.TempPathFactory) -> list[Section]:
    out = tmp_path_factory.mktemp("page")
    (out / "tables").mkdir()
    return [write_section(name, name, fits[name], out) for name in ("good", "failed")]


@pytest.fixture(scope="module")
def page(fits: Mapping[str, Fit], tmp_path_factory: pytest.TempPathFactory) -> Page:
    with pytest.MonkeyPatch.context() as patch:
        sketch_pictures(patch)
        out = tmp_path_factory.mktemp("together")
        return page_of(list(fits.values()), out)


def decided(section: Section, by: Mapping[str, str]) -> Section:
    """Return it with what decides some quantities, by symbol; the others are left to the data."""
    parameters = section.parameters.assign(
        **{DECISION: [by.get(symbol, "data") for symbol in section.parameters["symbol"]]}
    )
    return replace(section, parameters=parameters)


def test_the_table_says_which_quantity_is_another_one_in_another_fit(
    sections: list[Section],
) -> None:
    one = sections[0]
    priors = with_variant(one.fit.priors, one.fit.experiment, {"residuals": "discrepancy"})
    other = replace(one, name="smooth", fit=with_problem(one.fit, one.fit.experiment, priors))
    rows = SameData((one, other)).values["quantity"].tolist()
    assert "stress residual (not the same in all fits)" in rows
    assert "Maxwell modulus" in rows
    assert (
        "stress residual" in SameData((one, replace(one, name="again"))).values["quantity"].tolist()
    )


def test_fits_of_the_same_data_are_put_together(fits: Mapping[str, Fit], tmp_path: Path) -> None:
    found = [[name for _, name, _ in group] for group in by_data(_named(fits))]
    assert found == [["good", "failed"], ["other"]]
    measured = make_fit(tmp_path, name="A", kind="measured", chains=2, draws=300, fixed=FEW)
    groups = by_data(_named({**fits, "measured": measured}))
    assert [name for _, name, _ in groups[-1]] == ["measured"]


def _named(fits: Mapping[str, Fit]) -> list[tuple[str, str, Fit]]:
    return [(name, name, fit) for name, fit in fits.items()]


def test_alike_answers_are_told_once_and_others_by_name(sections: list[Section]) -> None:
    both = SameData(tuple(sections))
    good, failed = both.answers(CheckKind.SAMPLING)
    assert (good.of, good.outcome) == (("good",), Outcome.YES)
    assert (failed.of, failed.outcome) == (("failed",), Outcome.NO)
    assert any(line.startswith("R-hat: ") for line in failed.lines)
    twice = SameData((sections[0], replace(sections[0], name="again")))
    (told,) = twice.answers(CheckKind.SAMPLING)
    assert told.of == ("good", "again")
    (alone,) = SameData((sections[0],)).answers(CheckKind.SAMPLING)
    assert alone.of == ()


def test_a_conflict_names_the_fits_that_have_it(sections: list[Section]) -> None:
    quiet, loud = (
        replace(section, entry=replace(section.entry, conflict=conflict))
        for section, conflict in zip(sections, (None, "n"), strict=True)
    )
    (said,) = SameData((quiet, loud)).conflicts
    assert (said.lines, said.of) == (("n",), ("failed",))
    assert SameData((quiet,)).conflicts == []
    # What a bound decides is told in a line to unfold.
    told = (("A bound decides.",), ("A bound decides.", "n is of Q_M."))
    group = SameData(
        tuple(
            replace(section, entry=replace(section.entry, decisions=decisions))
            for section, decisions in zip(sections, told, strict=True)
        )
    )
    assert [(said.lines, said.of) for said in group.decisions] == [
        (("A bound decides.",), ("good", "failed")),
        (("n is of Q_M.",), ("failed",)),
    ]


def test_parameters_move_between_fits_that_were_sampled_well(sections: list[Section]) -> None:
    good, failed = sections
    again = replace(good, name="again")
    assert SameData((good, failed)).shifts == ()
    moves, left_out = SameData((good, failed, again)).shifts
    assert moves.startswith("From good to again parameters move by")
    assert left_out == "Left out, because the posterior was not sampled well: failed."


def test_unlikely_priors_are_to_mind(fits: Mapping[str, Fit], tmp_path: Path) -> None:
    fit = fits["good"]
    assert not any("priors of" in one for one in fit.cautions)
    odd = with_problem(fit, fit.experiment, replace(fit.priors, material="halite"))
    said = odd.prior_doubts[0]
    assert said.endswith("are priors of halite, the data are of ice.")
    assert f"Priors: {said}" in odd.cautions
    assert said in odd.prior_decisions()
    (tmp_path / "tables").mkdir()
    assert said in write_section("odd", "odd", odd, tmp_path).entry.decisions


def test_what_is_the_priors_is_named_below_the_table(sections: list[Section]) -> None:
    one = SameData((decided(sections[0], {"p": "prior", "n": "conflict"}),))
    assert list(one.values.columns) == ["symbol", "quantity", "unit", "value", DECISION]
    assert [row["symbol"] for row in one.left_to_prior] == ["p"]
    assert len(one.values) + 1 == len(sections[0].parameters)
    disputed = one.values["symbol"][pd.Series(one.doubtful[DECISION])]
    assert disputed.tolist() == ["n"]


def test_numbers_of_several_fits_stand_side_by_side(sections: list[Section]) -> None:
    good = decided(sections[0], {"p": "prior", "n": "prior"})
    failed = decided(sections[1], {"p": "prior", "E_M": "conflict"})
    both = SameData((good, failed))
    rows = both.values.set_index("symbol")
    assert [row["symbol"] for row in both.left_to_prior] == ["p"]
    assert "p" not in rows.index
    assert rows["good"]["n"] == "prior"
    marked = "prior [read off these data]"
    read_off = SameData((decided(sections[0], {"n": marked}), failed))
    assert read_off.values.set_index("symbol")["good"]["n"] == marked
    assert "n" in {
        row["symbol"] for row in SameData((decided(sections[0], {"n": marked}),)).left_to_prior
    }
    numbers = failed.parameters.set_index("symbol").loc["n"]
    assert rows["failed"]["n"] == f"{numbers['mean']} ± {numbers['sd']}"
    assert rows["failed"]["E_M"].endswith(" [conflict]")
    assert both.values["symbol"][pd.Series(both.doubtful["failed"])].tolist() == ["E_M"]
    # A quantity of one fit alone is empty in the others.
    few = replace(sections[1], parameters=sections[1].parameters.iloc[:2])
    values = SameData((sections[0], few)).values
    assert len(values) > 2
    assert (values["failed"].iloc[2:] == "").all()


def test_a_number_that_another_prior_decides_stands_with_its_name(sections: list[Section]) -> None:
    good = decided(sections[0], {"n": "prior (of Q_M)", "p": "data"})
    alone = SameData((good,))
    assert "n" not in [row["symbol"] for row in alone.left_to_prior]
    assert alone.values.set_index("symbol").loc["n", DECISION] == "prior (of Q_M)"
    both = SameData((good, decided(sections[1], {"n": "data"})))
    rows = both.values.set_index("symbol")
    assert rows["good"]["n"].endswith(" [prior (of Q_M)]")
    assert both.values["symbol"][pd.Series(both.doubtful["good"])].tolist() == ["n"]


def test_one_section_holds_fits_of_the_same_data(page: Page) -> None:
    assert not page.open
    assert page.ids.index("good") < page.ids.index("failed") < page.ids.index("other")
    assert page.tags.count("section") == 5  # overview, two sets of data, how to read, again
    assert "failed: figures, intervals, priors" in page.text
    # Contents, answers and overview lead to the fit that stands folded in the section of another.
    assert page.references.count(("a", "#failed")) >= 3
    # What speaks against a fit is not folded.
    assert "✗ failed: The posterior was not sampled well." in page.unfolded
    assert "R-hat" in page.unfolded


def test_a_page_has_few_words_until_it_is_unfolded(
    fits: Mapping[str, Fit], sketched: None, tmp_path: Path
) -> None:
    third = make_fit(tmp_path / "third", name="C", chains=2, draws=300, fixed=FEW, seed=3)
    counts = []
    for number, more in enumerate(([], [fits["good"]])):
        out = tmp_path / str(number)
        found = page_of([fits["other"], third, *more], out)
        counts.append(len(found.unfolded.split()))
        assert len(found.text.split()) > 2 * counts[-1]
    assert counts[1] - counts[0] < WORDS_OF_A_FIT


def test_a_reference_stress_far_from_that_of_the_test_alone_is_told() -> None:
    """Of two tests, the second of which has a fit alone."""
    table = pd.DataFrame(
        {
            "quantity": ["stress_exponent", "reference_stress", "reference_stress"],
            "test": ["A", "A", "B"],
            "mean": [3.5, 200e6, 406e6],
            "sd": [0.1, 4e6, 4e6],
            "separate_mean": [3.6, np.nan, 380e6],
            "separate_sd": [0.2, np.nan, 10e6],
        }
    )
    told = strayed(table)
    assert told is not None
    assert "reference stress of B (+2.6 sd)" in told
    assert "of A" not in told
    assert "the tests do not agree on what they share" in told
    assert strayed(table.assign(mean=[3.5, 200e6, 390e6])) is None
