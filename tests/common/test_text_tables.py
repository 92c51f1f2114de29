"""Tables in the files of instruments, spreadsheets and programs: found, read as numbers, told."""

import datetime
import sys
from pathlib import Path

import pytest
from openpyxl import Workbook, load_workbook

from pyburgers.common.errors import InputError
from pyburgers.common.text_tables import TextTable, look_at

ROWS = [(0.0, 0.0, 0.1), (0.5, 0.01, 1.2), (1.0, 0.02, 2.3), (1.5, 0.03, 3.1)]


def rows(separator: str, decimal: str = ".", before: str = "") -> str:
    lines = (separator.join(f"{value:.3f}" for value in row) for row in ROWS)
    return "".join(f"{before}{line.replace('.', decimal)}\n" for line in lines)


def looked_at(tmp_path: Path, text: str | bytes) -> TextTable:
    path = tmp_path / "table.txt"
    path.write_bytes(text.encode() if isinstance(text, str) else text)
    return look_at(path)


LAYOUTS = {
    "rheometer in steps": (
        "Filename\ta.tri\nDiameter\t25.0\tmm\n\n[step]\nCreep - 1\ntime\tstrain\tstress\n"
        "s\t%\tMPa\n" + rows("\t"),
        ["time [s]", "strain [%]", "stress [MPa]"],
    ),
    "rheometer, UTF-16": (
        (
            "Test:\tCreep 1\n\nInterval and data points:\t1\t4\n"
            "Interval data:\tTime\tStrain\tStress\n\t[s]\t[%]\t[Pa]\n" + rows("\t", before="\t")
        ).encode("utf-16"),
        ["Interval data:", "Time [s]", "Strain [%]", "Stress [Pa]"],
    ),
    "load frame with a table of results": (
        '"Results Table 1"\n"","Maximum Load"\n"","(N)"\n"1","1234.5"\n\n"Raw Data"\n'
        '"Time","Extension","Load"\n"(s)","(mm)","(N)"\n' + rows(","),
        ["Time (s)", "Extension (mm)", "Load (N)"],
    ),
    "load frame": (
        "MTS793|MPT|ENU|1|2|.|/|:|1|0|0|A\n\nData Header:\tTime:\t12.1\tSec\t3/1/2024 9:00:00 AM\n"
        "Running Time\tAxial Displacement\tAxial Force\nSec\tmm\tkN\n" + rows("\t"),
        ["Running Time [Sec]", "Axial Displacement [mm]", "Axial Force [kN]"],
    ),
    "thermal simulator": (
        "TIME\tStrain\tForce\nsec\t\tkp\n" + rows("\t"),
        ["TIME [sec]", "Strain", "Force [kp]"],
    ),
    "units that files do not know": (
        "Time,Strain,Force,Count\nday,%,MPa,ADU\n" + rows(",", before="1,"),
        ["Time [day]", "Strain [%]", "Force [MPa]", "Count [ADU]"],
    ),
    "dynamic analyser, Latin-1": (
        ("Probe: Salz 1\r\nLänge 10,0 mm\r\n\r\nFrequenz;|E*|;tan delta\r\nHz;MPa;\r\n").encode(
            "cp1252"
        )
        + rows(";", ",").encode(),
        ["Frequenz [Hz]", "|E*| [MPa]", "tan delta"],
    ),
    "graphical program with a row without comment": (
        "LabVIEW Measurement\t\nWriter_Version\t2\nDate\t2024/03/01\nTime\t09:00:00.123\n"
        "***End_of_Header***\t\n\t\nSamples\t4\t4\t\nX0\t0.0E+0\t0.0E+0\t\n***End_of_Header***\t\t\t\n"
        "X_Value\tStrain\tStress\tComment\n" + rows("\t"),
        ["X_Value", "Strain", "Stress", "Comment"],
    ),
    "German spreadsheet": (
        "Zeit (s);Dehnung (%);Spannung (MPa)\n".encode("utf-8-sig") + rows(";", ",").encode(),
        ["Zeit (s)", "Dehnung (%)", "Spannung (MPa)"],
    ),
    "spreadsheet that names its separator": (
        "sep=;\nTime (s);Strain;Stress\n" + rows(";", ","),
        ["Time (s)", "Strain", "Stress"],
    ),
    "decimal commas between blanks": ("t e s\n" + rows("  ", ","), ["t", "e", "s"]),
    "rows with numbers": (
        '"","time","strain","stress"\n'
        + "".join(f'"{k}",{line}\n' for k, line in enumerate(rows(",").splitlines(), start=1)),
        ["", "time", "strain", "stress"],
    ),
    "rows with numbers that have no name": (
        '"time" "strain" "stress"\n'
        + "".join(f'"{k}" {line}\n' for k, line in enumerate(rows(" ").splitlines(), start=1)),
        ["", "time", "strain", "stress"],
    ),
    "numbers for names": ("Period,263,268\n" + rows(","), ["Period", "263", "268"]),
    "end of an old text": ("t,e,s\n" + rows(",") + "\x1a", ["t", "e", "s"]),
    "matrix of a program": (rows("   ", before="  "), ["1", "2", "3"]),
    "keys and values ahead": (
        "Sample,PIL40\nTemperature,263\nDiameter,25.4\n\nTime (s),Strain,Stress\n" + rows(","),
        ["Time (s)", "Strain", "Stress"],
    ),
    "empty cells and a word behind": (
        "Time,Strain,Stress,,\n" + rows(",").replace("\n", ",,\n") + ",,,,\nEnd of test\n",
        ["Time", "Strain", "Stress"],
    ),
}


@pytest.mark.parametrize(("text", "described"), LAYOUTS.values(), ids=LAYOUTS)
def test_the_table_of_numbers_is_found(
    text: str | bytes, described: list[str], tmp_path: Path
) -> None:
    table = looked_at(tmp_path, text)
    assert table.problems == ()
    assert [table.described(column) for column in table.columns] == described
    numbers = [numbers for column in table.columns if (numbers := table.numbers(column))]
    assert numbers[-3:] == [list(column) for column in zip(*ROWS, strict=True)]
    assert any("row of units" in note for note in table.notes) == (table.units is not None)


def test_what_was_done_is_told(tmp_path: Path) -> None:
    text = "Länge 10\n\nZeit;Dehnung\ns;%\n0;0,1\n1;-9999\n2;NaN\n3;0,2\nEnde\n".encode("cp1252")
    assert looked_at(tmp_path, text).notes == (
        "table.txt: the text is not UTF-8 and was read as Latin-1 (Windows-1252).",
        "table.txt: line 1 ahead of the table was passed over.",
        "table.txt: line 9 behind the table was passed over.",
        "table.txt: line 4 is a row of units (s, %).",
        "table.txt: column 'Dehnung': -9999, NaN (in 2 of 4 rows) stands for no reading.",
        "table.txt: numbers have decimal commas.",
    )


@pytest.mark.parametrize("separator", [",", ";", "\t", "  "])
def test_words_about_a_table_without_names_are_passed_over(separator: str, tmp_path: Path) -> None:
    """As without the key ``header``, so that a file with it is read as it was looked at."""
    table = looked_at(tmp_path, f"Creep of ice 12\n{rows(separator)}End of test\n")
    stated = look_at(table.path, table.separator, header=False)
    assert (stated.names, stated.rows, stated.problems) == (None, table.rows, ())
    assert stated.notes == table.notes
    assert len(stated.notes) == 2


def test_names_and_bad_cells_are_rows_where_there_is_said_to_be_no_header(tmp_path: Path) -> None:
    for first in ("t,e,s\n", "0,?,1\n"):
        path = looked_at(tmp_path, first + rows(",")).path
        assert len(look_at(path, header=False).rows) == 1 + len(ROWS)


STAMPS = {
    "clock": ("9:00:00\n9:00:30\n10:00:00", [0, 30, 3600]),
    "fractions of seconds": ("09:00:00.25\n09:00:01.5\n09:00:02", [0, 1.25, 1.75]),
    "minutes and seconds": ("00:00.5\n00:37.5\n59:59.75\n1:00:10.0", [0, 37, 3599.25, 3609.5]),
    "midnight": ("23:00:00\n23:30:00\n00:30:00", [0, 1800, 5400]),
    "morning and afternoon": ("11:59:30 AM\n12:00:00 PM\n1:00:00 pm", [0, 30, 3630]),
    "ISO": ("2024-02-28T23:00:00\n2024-02-29T00:00:00Z", [0, 3600]),
    "ISO with a zone": ("2024-03-01T10:00:00+01:00\n2024-03-01T09:00:30Z", [0, 30]),
    "day first": ("28/02/2024 23:59\n01/03/2024 00:59", [0, 90000]),
    "month first": ("2/28/2024 23:59\n3/1/2024 00:59", [0, 90000]),
    "the order that grows": (
        "09/03/2024 8:00\n10/03/2024 8:00\n08/04/2024 8:00",
        [0, 86400, 2592000],
    ),
    "points": ("28.02.2024 23:59:00\n01.03.2024 00:59:00", [0, 90000]),
    "names of months": ("28-Feb-2024 09:00:00\n01-Mar-2024 09:00:00", [0, 172800]),
    "days": ("2024-02-28\n2024-03-01", [0, 172800]),
}


@pytest.mark.parametrize(("cells", "seconds"), STAMPS.values(), ids=STAMPS)
def test_time_stamps_are_seconds_since_the_first_row(
    cells: str, seconds: list[float], tmp_path: Path
) -> None:
    lines = [f"{cell},{k}.5" for k, cell in enumerate(cells.splitlines())]
    table = looked_at(tmp_path, "\n".join(["When,strain", *lines]))
    assert table.is_time_stamps("When")
    assert not table.is_time_stamps("strain")
    assert table.numbers("When") == seconds
    assert "'When' holds time stamps, read as seconds since the first row" in table.notes[0]


def test_a_clock_of_the_test_keeps_its_zero(tmp_path: Path) -> None:
    for dates in (("", "", ""), ("Date,", "3/1/2024,", "3/2/2024,")):
        rows = "{}Elapsed time,e\n{}0:00:30,1\n{}30:00:30,2\n".format(*dates)
        table = looked_at(tmp_path, rows)
        assert table.numbers("Elapsed time") == [30, 108030]
        assert any("as seconds since 0:00" in note for note in table.notes)


def test_a_date_and_a_time_of_day_are_one_time(tmp_path: Path) -> None:
    table = looked_at(tmp_path, "Date,Time,e\n2/28/2024,23:59,1\n3/1/2024,0:59,2\n")
    assert table.numbers("Time") == [0, 90000]
    assert not table.is_time_stamps("Date")
    assert table.numbers("Date") == []
    assert "'Time' with 'Date' holds time stamps" in table.notes[0]


@pytest.mark.parametrize("date", ["", "12/16/2022,"])
def test_noon_that_is_written_as_12_am(date: str, tmp_path: Path) -> None:
    clocks = ("11:00:00 AM", "12:00:00 AM", "1:00:00 PM")
    rows = "".join(f"{date}{clock},{k}\n" for k, clock in enumerate(clocks))
    table = looked_at(tmp_path, f"{'Date,' if date else ''}Time,e\n{rows}")
    assert table.numbers("Time") == [0, 3600, 7200]
    assert "12 AM was read as noon" in table.notes[1]


@pytest.mark.parametrize(
    "cells",
    [
        "01:30\n01:45",
        "01:30\n01:45.5",
        "2024-03-01 01:30.5\n2024-03-01 01:45.5",
        "03/04/2024\n03/05/2024",
    ],
)
def test_a_time_stamp_with_two_meanings_is_no_time_and_is_told(cells: str, tmp_path: Path) -> None:
    lines = [f"{cell},{k}" for k, cell in enumerate(cells.splitlines())]
    table = looked_at(tmp_path, "\n".join(["When,strain", *lines]))
    assert not table.is_time_stamps("When")
    assert table.numbers("When") == []
    assert "can be read in more than one way: write them as 2024-03-01 09:00:00" in table.notes[0]


def test_numbers_like_a_sentinel_are_readings_where_others_are_near(tmp_path: Path) -> None:
    assert looked_at(tmp_path, "t,e\n0,-9000\n1,-9999\n2,-9500\n").numbers("e")[1] == -9999


def workbook(path: Path, **sheets: list[list[object]]) -> Path:
    book = Workbook()
    book.remove(book.worksheets[0])
    for name, cells in sheets.items():
        sheet = book.create_sheet(name)
        for row in cells:
            sheet.append(row)
    book.save(path)
    return path


def test_a_workbook_is_read_from_the_sheet_with_the_numbers(tmp_path: Path) -> None:
    start = datetime.datetime(2024, 3, 1, 9)
    times = [start + datetime.timedelta(minutes=k) for k in range(3)]
    data: list[list[object]] = [["Creep"], ["When", "Strain"], [None, "%"]]
    data += [[time, 0.1 * k] for k, time in enumerate(times)]
    table = look_at(workbook(tmp_path / "book.xlsx", Notes=[["Sample", "PIL40"]], Data=data))
    assert [table.described(column) for column in table.columns] == ["When", "Strain [%]"]
    assert table.numbers("When") == [0, 60, 120]
    assert "the sheet 'Data' of the workbook is read" in table.notes[0]
    assert table.problems == ()


def test_a_number_that_a_workbook_shows_in_percent_is_no_fraction(tmp_path: Path) -> None:
    path = workbook(tmp_path / "book.xlsx", Data=[["t", "e", "f"], [0, 0.07, 7], [1, 0.2, 20]])
    book = load_workbook(path)
    for row in book["Data"].iter_rows(min_row=2):
        row[1].number_format, row[2].number_format = "0.00%", '0.0"%"'
    book.save(path)
    table = look_at(path)
    assert [cells for _, cells in table.rows] == [("0", "7%", "7"), ("1", "20%", "20")]
    assert (table.numbers("e"), table.numbers("f")) == ([], [7, 20])


def test_a_workbook_with_two_tables_is_a_problem(tmp_path: Path) -> None:
    cells: list[list[object]] = [["t", "e"], [0, 1], [1, 2]]
    table = look_at(workbook(tmp_path / "book.xlsx", one=cells, two=cells))
    assert "found readings in 2 sheets (one, two)" in table.problems[0]


@pytest.mark.parametrize(
    ("start", "words"),
    [(b"PK\x03\x04", "cannot be opened"), (b"\xd0\xcf\x11\xe0", "of the old form")],
)
def test_a_workbook_that_cannot_be_read(start: bytes, words: str, tmp_path: Path) -> None:
    with pytest.raises(InputError, match=f"{words}.*save the sheet as CSV UTF-8"):
        looked_at(tmp_path, start + 40 * b"\x14\x00")


def test_a_workbook_without_its_reader(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setitem(sys.modules, "openpyxl", None)
    with pytest.raises(InputError, match=r"needs openpyxl: install pyburgers\[excel\], or save"):
        looked_at(tmp_path, b"PK\x03\x04")


def test_a_row_that_is_longer_than_the_names_in_a_comment_has_numbered_cells(
    tmp_path: Path,
) -> None:
    table = looked_at(tmp_path, "# strain\n\n0.25\n0.5\t0\n0.75\n1\n1.25\n1.5\n1.75\n")
    assert table.hidden_names == ("strain",)
    assert [table.described(column) for column in table.columns] == ["strain", "2"]


def test_blanks_that_separate_thousands_separate_no_cells(tmp_path: Path) -> None:
    table = looked_at(tmp_path, "time (s)\tstress (MPa)\n0\t0\n900\t2\n1 000\t3\n1 100\t4\n")
    assert table.columns == ("time (s)", "stress (MPa)")


@pytest.mark.parametrize(
    ("cells", "is_doubted"),
    [("900;1\n1,000;2\n1,100;3\n", True), ("900;1,125\n1000;2,250\n1100;3,125\n", False)],
)
def test_commas_between_semicolons_are_doubted_beside_whole_hundreds(
    cells: str, is_doubted: bool, tmp_path: Path
) -> None:
    table = looked_at(tmp_path, f"time (s);stress (MPa)\n{cells}")
    assert any("may separate thousands or decimals" in one for one in table.problems) == is_doubted
