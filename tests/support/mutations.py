"""Strategies of Hypothesis for input files and options: good ones that were changed; tables."""

import copy
from collections.abc import Mapping
from typing import Any

from hypothesis import strategies as st

TEXT = st.text(st.characters(exclude_categories=["Cs"]), max_size=20)
NUMBERS = st.one_of(
    st.integers(-(10**20), 10**20),
    st.floats(),
    st.sampled_from([0, -1, 1e-320, 1e308, -1e308, 10**400, 2**31, 2**63]),
)
NAMES = st.sampled_from(
    ["", ".", "..", "../x", "/dev/zero", "/dev/null", "a\0b", "x" * 5000, "nan", "-", "~x", "%s{}"]
)
VALUES = st.recursive(
    st.one_of(NUMBERS, TEXT, NAMES, st.booleans(), st.datetimes(), st.dates()),
    lambda inner: st.lists(inner, max_size=4) | st.dictionaries(TEXT, inner, max_size=3),
    max_leaves=5,
)
"""What a key of a TOML file may hold."""


def _places(table: Any) -> list[tuple[Any, Any]]:
    """Every container in a table with each of its keys or indices."""
    keys = table if isinstance(table, dict) else range(len(table))
    found = [(table, key) for key in keys]
    for key in keys:
        if isinstance(table[key], dict | list):
            found += _places(table[key])
    return found


@st.composite
def changed_tables(draw: st.DrawFn, table: Mapping[str, Any]) -> dict[str, Any]:
    """Contents of a TOML file with one to three entries changed, added, renamed or taken out."""
    changed: dict[str, Any] = copy.deepcopy(dict(table))
    for _ in range(draw(st.integers(1, 3))):
        places = _places(changed)
        if not places:
            break
        container, key = draw(st.sampled_from(range(len(places))).map(places.__getitem__))
        match draw(st.sampled_from(["value", "number", "scaled", "delete", "rename", "add"])):
            case "value":
                container[key] = draw(VALUES)
            case "number":
                container[key] = draw(NUMBERS)
            case "scaled" if isinstance(container[key], float):
                container[key] = container[key] * draw(st.sampled_from([-1, 0, 1e-3, 1e3, 1e12]))
            case "delete":
                del container[key]
            case "rename" if isinstance(container, dict):
                container[draw(TEXT)] = container.pop(key)
            case _ if isinstance(container, dict):
                container[draw(TEXT)] = draw(VALUES)
            case _:
                container.append(draw(VALUES))
    return changed


CELLS = st.one_of(
    NUMBERS.map(str),
    st.sampled_from(["", "nan", "inf", "-inf", "1e400", "x", '"', ",", "\0", "1,2", "#", "\u2028"]),
)


@st.composite
def changed_bytes(draw: st.DrawFn, content: bytes) -> bytes:
    """Contents of a text file with something cut, inserted, or cells and lines changed."""
    start = draw(st.integers(0, len(content)))
    end = min(len(content), start + draw(st.integers(0, 40)))
    lines = content.split(b"\n")
    line = draw(st.integers(0, len(lines) - 1))
    match draw(st.sampled_from(["cut", "bytes", "text", "cell", "drop", "repeat", "move", "long"])):
        case "cut":
            return content[:start]
        case "bytes":
            return content[:start] + draw(st.binary(max_size=20)) + content[end:]
        case "text":
            return content[:start] + draw(TEXT).encode() + content[end:]
        case "cell":
            cells = lines[line].split(b",")
            cells[draw(st.integers(0, len(cells) - 1))] = draw(CELLS).encode()
            lines[line] = b",".join(cells)
        case "drop":
            del lines[line]
        case "repeat":
            lines[line:line] = [lines[line]] * draw(st.integers(1, 50))
        case "move":
            lines.insert(draw(st.integers(0, len(lines) - 1)), lines.pop(line))
        case "long":
            lines[line] += b"0" * 200_000
    return b"\n".join(lines)


WRITTEN = st.sampled_from(
    [
        *("{:.6g}", "{:.17g}", "{:.3e}", "{:,.2f}", "{:+.4f}", "{:.0f}", "{:.2f} %", "{:.3f} MPa"),
        *("{:.3E}", "0{:.1f}", "2024-03-01 09:00:{:02.0f}", "01.03.2024 09:{:02.0f}"),
        *("9:{:.0f} PM", "12/31/1999 {:.1f}", "={:g}", "{:x}", "{:>12.3f}"),
        *("\u2212{:.2f}", "\u0661{:.0f}", "{:g}d3"),
    ]
)
"""How a number stands in a cell."""

COLUMN_NAMES = st.one_of(
    TEXT,
    st.sampled_from(
        [
            *("time_s", "strain", "stress_MPa", "frequency_Hz", "tan_delta", "tan_delta_sd"),
            *("seed", "Zeit [s]", "Dehnung (%)", "Spannung / MPa", "time", "time"),
            *("=1+1", "1.5", "#", "a;b"),
        ]
    ),
)


@st.composite
def text_tables(draw: st.DrawFn) -> tuple[list[str | int], bytes]:
    """Columns, by name or number, and content of a table of any length, layout and language."""
    width = draw(st.integers(1, 5))
    names = draw(st.lists(COLUMN_NAMES, min_size=width, max_size=width))
    ways = list(enumerate((draw(WRITTEN) for _ in range(width)), 1))
    length = draw(st.sampled_from([0, 1, 2, 3, 8, 30, 3000]))
    rows = [
        [_written(way, 0.25 * number * place) for place, way in ways] for number in range(length)
    ]
    above = [draw(st.sampled_from([names, [f"[{name}]" for name in names]]))]
    above += draw(st.sampled_from([[], [["s", "%", "MPa", "", "-"][:width]], [[]]]))
    rows = [*draw(st.sampled_from([[], above])), *rows]
    for _ in range(draw(st.integers(0, 3)) if rows else 0):
        row = draw(st.sampled_from(rows))
        match draw(st.sampled_from(["cell", "short", "wide", "long"])):
            case "short":
                del row[-1:]
            case "wide":
                row.append(draw(CELLS))
            case "long":
                row.append("7" * 100_000)
            case _ if row:
                row[draw(st.integers(0, len(row) - 1))] = draw(CELLS | TEXT)
    separator = draw(st.sampled_from([",", ";", "\t", "|", " ", "  ", ", "]))
    quote = draw(st.sampled_from(["", "", '"', "'", '"""']))
    lines = [separator.join(f"{quote}{cell}{quote}" for cell in row) for row in rows]
    head = draw(st.sampled_from([[], ["# somebody"], ["Test: 1", ""], ["sep=;"], ['"', "%"]]))
    end = draw(st.sampled_from(["\n", "\n", "\r\n", "\r", "\n\n"]))
    text = end.join([*head, *lines, draw(st.sampled_from(["", "", "# end", '"', "\x1a"]))])
    if draw(st.booleans()):  # a decimal comma
        text = text.replace(".", ",")
    encoding = draw(st.sampled_from(["utf-8", "utf-8", "utf-8-sig", "utf-16", "utf-32", "cp1252"]))
    return [*names, *range(width + 2)], text.encode(encoding, errors="replace")


def _written(way: str, number: float) -> str:
    return way.format(round(number) if way.endswith("x}") else number)
