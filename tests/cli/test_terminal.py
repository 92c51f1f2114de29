"""Tables and verdicts in a terminal: 80 columns, colours only where they are wanted."""

import re
import sys

import pandas as pd
import pytest
from terminal import Terminal

from pyburgers.cli.terminal import LEAST_FOLDED, WIDTH, print_checks, print_table
from pyburgers.fitting.fit import Fit
from pyburgers.page.tables import parameter_table


def test_the_table_of_a_fit_fits_and_holds_what_its_page_holds(
    small_fit: Fit, capsys: pytest.CaptureFixture[str]
) -> None:
    table = parameter_table(small_fit.summary("SI"), small_fit.priors)
    print_table(table, ["quantity", "unit"])
    lines = capsys.readouterr().out.splitlines()
    assert max(map(len, lines)) <= WIDTH
    assert lines[0].split()[:2] == ["quantity", "unit"]
    words = " ".join(lines).split()
    for column in ("unit", "mean", "sd", "5 %", "95 %", "ESS bulk", "R-hat"):
        assert set(" ".join(table[column]).split()) <= set(words)


def test_many_columns_come_in_blocks_that_repeat_what_a_row_is_about(
    capsys: pytest.CaptureFixture[str],
) -> None:
    columns = {f"test {k}": ["1.234 ± 0.567", "0.1 ± 0.2"] for k in range(9)}
    print_table(pd.DataFrame({"quantity": ["a", "b"], **columns}), ["quantity"])
    blocks = capsys.readouterr().out.rstrip("\n").split("\n\n")
    assert len(blocks) > 1
    shown = [block.splitlines()[0] for block in blocks]
    assert all(line.startswith("quantity ") for line in shown)
    assert all(sum(f"test {k}" in line for line in shown) == 1 for k in range(9))
    assert max(len(line) for block in blocks for line in block.splitlines()) <= WIDTH


@pytest.mark.parametrize("width", [60, 80, 120])
def test_a_column_that_is_too_wide_takes_several_lines(
    width: int, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("pyburgers.cli.terminal.WIDTH", width)
    decided = ", ".join(f"test_{k}: both (of E_K, ε_c1)" for k in range(5))
    row = {"quantity": "critical strain of the grain size", "unit": "fraction"}
    found = {"pooling": "separate", "decided by": decided, "test_1": "0.6 ± 0.2"}
    print_table(pd.DataFrame([{**row, **found}]), ["quantity", "unit", "pooling"])
    first, *others = capsys.readouterr().out.rstrip("\n").split("\n\n")
    starts = {name: first.index(name) for name in first.splitlines()[0].split()}
    ends = [*list(starts.values())[1:4], width]
    texts = [
        " ".join(line[start:end].strip() for line in first.splitlines()[1:]).strip()
        for start, end in zip(list(starts.values())[:4], ends, strict=True)
    ]
    assert texts == [*row.values(), "separate", decided]
    assert ends[0] > LEAST_FOLDED
    assert all(block.startswith("quantity ") for block in others)
    assert max(map(len, first.splitlines())) <= width


CONFLICTS = ("A: Prior and data disagree about this.", "B: Prior and data disagree about that.")


@pytest.mark.parametrize(
    ("blocks", "title"),
    [
        ([CONFLICTS], "Do prior and data agree? NO"),
        ([(), ("n is decided by the prior of Q.",)], "Bounds and priors to mind"),
    ],
)
def test_what_the_data_do_not_agree_with_or_decide_has_a_block_of_its_own(
    blocks: list[tuple[str, ...]], title: str, capsys: pytest.CaptureFixture[str]
) -> None:
    without = print_checks([])
    assert title.split("? ")[0] not in capsys.readouterr().out
    assert print_checks([], *blocks) == without
    printed = capsys.readouterr().out
    assert printed.endswith("\n" + "\n".join([title, *blocks[-1]]) + "\n")


@pytest.mark.parametrize(("no_colour", "coloured"), [(None, True), ("1", False)])
def test_colours_are_for_terminals_that_want_them(
    no_colour: str | None, coloured: bool, monkeypatch: pytest.MonkeyPatch
) -> None:
    terminal = Terminal()
    monkeypatch.setattr(sys, "stdout", terminal)
    monkeypatch.setenv("TERM", "xterm-256color")
    monkeypatch.delenv("NO_COLOR", raising=False)
    if no_colour is not None:
        monkeypatch.setenv("NO_COLOR", no_colour)
    print_checks([])
    assert bool(re.search(r"\033\[[\d;]*3\dm", terminal.getvalue())) is coloured


def test_rows_of_shared_parameters_are_printed_once(capsys: pytest.CaptureFixture[str]) -> None:
    tests = [f"a_test_of_a_long_name_{k}" for k in range(6)]
    shared = {tests[0]: "1.0 ± 0.1", **dict.fromkeys(tests[1:], "the same")}
    own = {test: f"{k} ± 1" for k, test in enumerate(tests)}
    rows = [{"quantity": "shared one", **shared}, {"quantity": "own one", **own}]
    print_table(pd.DataFrame(rows), ["quantity"])
    out = capsys.readouterr().out
    assert (out.count("shared one"), out.count("own one")) == (1, 3)
    assert all(f"{k} ± 1" in out for k in range(6))
