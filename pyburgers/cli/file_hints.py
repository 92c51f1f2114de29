"""What may lie behind the errors of an experiment file, and numbers in it that are unlikely."""

from collections.abc import Iterator, Mapping
from pathlib import Path
from typing import Any

import numpy as np

from pyburgers.common.cells import DECIMAL_COMMA, ODD_MINUS
from pyburgers.common.errors import InputError
from pyburgers.common.text_tables import TextTable, look_at
from pyburgers.model.priors import shipped_prior_files
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.new_file import new_files

COARSE_GRAINS = 0.05
"""Grain size (m) beyond which a unit may be wrong."""

LARGE_STRESS, SMALL_STRESS = 2e10, 1e3
"""Largest stresses (Pa) of a test beyond which a unit may be wrong."""

MELTING_POINTS = {"ice": 273.16}
"""Temperature (K) above which a material is not solid at any pressure of such tests."""

SEPARATORS = {";": "semicolons", "\t": "tabs", " ": "white space", ",": "commas"}
FILE_KEYS = ("file", "strain_file", "stress_file")


def doubts(experiment: Experiment) -> list[str]:
    """Say which numbers of an experiment are unlikely."""
    found = []
    size, name = experiment.initial_grain_size, experiment.id
    if size > COARSE_GRAINS:
        found.append(f"{name}: grains of {size:g} m are unlikely; 230 um is 230e-6.")
    hottest, melting = float(experiment.temperatures.max()), MELTING_POINTS.get(experiment.material)
    if melting is not None and hottest > melting:
        found.append(
            f"{name}: {experiment.material} at {hottest:g} K is molten (from {melting:g} K); check "
            "the temperature."
        )
    if experiment.n_points:
        stress = experiment.largest_stress
        if stress > LARGE_STRESS:
            found.append(f"{name}: a stress of {stress / 1e9:g} GPa is unlikely; check its unit.")
        elif 0 < stress < SMALL_STRESS:
            found.append(f"{name}: a largest stress of {stress:g} Pa is unlikely; check its unit.")
    found += [f"{name}: {sentence}" for sentence in experiment.doubts]
    if experiment.material not in shipped_prior_files():
        found.append(
            f"{name}: there are no default priors of {experiment.material!r}, so that a fit needs "
            "--priors."
        )
    return found


def text_files(content: Mapping[str, Any]) -> Iterator[tuple[dict[str, Any], str]]:
    """Return the tables of a file that name text files, with the keys that do."""
    segments = content.get("segments")
    for table in (content.get("data"), *(segments if isinstance(segments, list) else ())):
        if isinstance(table, dict):
            for key in FILE_KEYS:
                if isinstance(table.get(key), str):
                    yield table, key


def hints(path: Path, content: Mapping[str, Any]) -> list[str]:
    """Say what may be behind errors: how the text files look beside what the file says of them.

    Parameters
    ----------
    path : Path
        The experiment file.
    content : mapping
        What it holds.
    """
    data = content.get("data")
    if not isinstance(data, dict):
        return []
    kind = new_files().get(str(content.get("protocol")))
    small_strain = (Experiment if kind is None else kind.experiment).small_strain
    found: list[str] = []
    for table, key in text_files(content):
        try:
            look = look_at(path.parent / str(data.get("data_root", "")) / table[key])
        except InputError:
            continue  # the error itself is told
        found += [f"{look.path}: {hint}" for hint in _hints_of(look, data, small_strain)]
        if content.get("compression") != "negative":
            found += [f"{look.path}: {hint}" for hint in _hints_of_signs(look, data)]
    return list(dict.fromkeys(found))


def _hints_of(look: TextTable, data: Mapping[str, Any], small_strain: float) -> Iterator[str]:
    header = data.get("header", True)
    if look.hidden_names is not None and header:
        names = ", ".join(look.hidden_names)
        yield (
            f"the names ({names}) stand in a line that starts with '#', which is passed over, and "
            "the first row of numbers is taken for them: remove that '#', or write header = false "
            "in [data] and the numbers of the columns from 1."
        )
    elif look.names is None and header and look.rows:
        yield (
            "the first row holds numbers: write header = false in [data] and the numbers of the "
            "columns from 1, such as strain_column = 1."
        )
    elif look.names is not None and not header:
        yield f"the first row holds names ({', '.join(look.names)}): remove header = false."
    said = data.get("separator", ",")
    fits = {",": [","], " ": ["whitespace"], "\t": ["tab"]}.get(look.separator, [])
    if look.separator == "\t" and look.is_alike_by_blanks:
        fits.append("whitespace")
    if len(look.columns) > 1 and said not in fits:
        remedy = {
            ",": "remove the key separator from [data]",
            ";": "write commas in their place, and points in numbers",
            "\t": 'write separator = "tab" in [data]',
        }.get(look.separator, 'write separator = "whitespace" in [data]')
        yield f"columns look as if {SEPARATORS[look.separator]} stood between them: {remedy}."
    for looks, what, remedy in (
        (ODD_MINUS, "starts with a character that is no minus sign", "write '-'"),
        (DECIMAL_COMMA, "looks like a number with a decimal comma", "write a point"),
    ):
        cells = look.cells_like(looks)
        if cells:
            line, cell = cells[0]
            more = f" (and {len(cells) - 1} more)" if len(cells) > 1 else ""
            yield f"line {line}: {cell!r}{more} {what}: {remedy}."
    yield from _hints_of_strain(look, data, small_strain)


def _hints_of_strain(
    look: TextTable, data: Mapping[str, Any], small_strain: float
) -> Iterator[str]:
    column, unit = data.get("strain_column"), data.get("strain_unit")
    if column not in look.columns:
        return
    strain = np.array(look.numbers(column))
    if not strain.size:
        return
    largest = float(np.max(np.abs(strain)))
    if unit == "fraction" and largest > 1:
        yield f"{column!r} reaches {largest:g}: is it in percent rather than a fraction?"
    if unit == "percent" and 0 < largest < 100 * small_strain:
        yield f"{column!r} reaches {largest:g} only: is it a fraction rather than percent?"


def _hints_of_signs(look: TextTable, data: Mapping[str, Any]) -> Iterator[str]:
    column = data.get("strain_column")
    strain = look.numbers(column) if column in look.columns else []
    if sum(value < 0 for value in strain) > len(strain) / 2:
        yield (
            f"strains in {column!r} are negative, but compression is positive in this model: turn "
            'the signs (in loading histories compression = "negative" says so).'
        )
