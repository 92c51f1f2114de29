"""Tables as CSV: numbers and texts as they are, and no cell that a spreadsheet would compute."""

import csv
import io
from pathlib import Path

import pandas as pd
import pytest
from hypothesis import given
from hypothesis import strategies as st

import pyburgers
from pyburgers.common.cells import number_in
from pyburgers.common.csv_tables import FORMULA_STARTS, comment_lines, csv_text

TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=10)
CELLS = TEXT | st.builds(str.__add__, st.sampled_from(FORMULA_STARTS), TEXT)


def cells(text: str) -> list[list[str]]:
    return list(csv.reader(io.StringIO(text, newline="")))


@given(st.lists(CELLS, min_size=2, max_size=2, unique=True), st.lists(CELLS, min_size=2))
def test_no_text_is_a_formula(names: list[str], texts: list[str]) -> None:
    """In a column, in its name, in the index, and beside what is no text."""
    table = pd.DataFrame({names[0]: texts, "mixed": [*texts[:-1], None]})
    for index in (False, True):
        named = table.set_axis(texts).rename_axis(names[1]) if index else table
        found = [cell for row in cells(csv_text(named, index=index)) for cell in row]
        formulas = [cell for cell in found if cell.startswith(FORMULA_STARTS)]
        assert all(number_in(cell) is not None for cell in formulas)


@pytest.mark.parametrize(
    ("text", "written"),
    [
        ('=HYPERLINK("http://x")', '\'=HYPERLINK("http://x")'),
        ("@SUM(A1)", "'@SUM(A1)"),
        ("+1+cmd|' /C calc'!A0", "'+1+cmd|' /C calc'!A0"),
        ("-2+3", "'-2+3"),
        ("-2.5e-3", "-2.5e-3"),
        ("+4", "+4"),
        ("PIL40=a", "PIL40=a"),
    ],
)
def test_an_apostrophe_stands_before_a_formula_alone(text: str, written: str) -> None:
    table = pd.DataFrame({text: [text]}, index=pd.Index([text], name="test"))
    assert cells(csv_text(table, index=True)) == [["test", written], [written, written]]


def test_other_cells_are_those_of_pandas() -> None:
    table = pd.DataFrame(
        {
            "number": [-1.25e-300, float("nan"), float("-inf")],
            "count": [-1, 0, 1],
            "is": [True, False, True],
            "text": ["a, b", None, 'the "n"'],
        },
        index=pd.Index(["a", "b", "c"], name="name"),
    )
    assert csv_text(table, index=True) == table.to_csv()
    assert csv_text(table, float_format="%.2g") == table.to_csv(index=False, float_format="%.2g")


def test_comments_have_no_formula_behind_a_separator() -> None:
    notes = ["Test: a,=1+1;@b", "two\nlines, -1"]
    assert comment_lines(notes) == "# Test: a, =1+1; @b\n# two lines, -1\n"


def test_one_module_writes_tables() -> None:
    package = Path(pyburgers.__file__).parent
    writing = {file.stem for file in package.rglob("*.py") if ".to_csv(" in file.read_text("utf-8")}
    assert writing == {"csv_tables"}
