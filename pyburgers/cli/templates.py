"""Experiment files as a person would write them: keys with comments, of every kind of test."""

import json
from collections.abc import Callable, Iterator, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any

from pyburgers.cli.guessing import GuessedColumn
from pyburgers.common.text_tables import TextTable
from pyburgers.common.units import UNITS

COMMENTS_AT = 36
"""Column at which comments start."""


@dataclass(frozen=True)
class Description:
    """What is known of a test that a file is written for.

    Attributes
    ----------
    file : str
        Its text file, as seen from the file that is written.
    table : TextTable
        How that looks.
    columns : mapping of str to GuessedColumn
        What its columns hold.
    values : mapping
        Answers, by the name of the question (`pyburgers.cli.new.QUESTIONS`).
    """

    file: str
    table: TextTable
    columns: Mapping[str, GuessedColumn]
    values: Mapping[str, Any]


def experiment_text(test: Description) -> str:
    """Return the text of an experiment file."""
    values = test.values
    errors = [
        _optional("temperature_sd_K = 2.0", "how well the temperature is known"),
        _optional("stress_calibration_sd = 0.02", "relative error of the load cell"),
    ]
    if values["protocol"] == "attenuation":  # tables are fitted at their stated conditions
        errors = []
    lines = [
        _line("id", values["id"], "names the run and its files"),
        _line("material", values["material"], "its priors are taken unless --priors is given"),
        _line("protocol", values["protocol"], "the kind of test"),
        _line("temperature_K", values["temperature_K"]),
        _line("initial_grain_size_m", values["grain_size_m"], "mean, at the start"),
        *errors,
        "",
        *_PROTOCOLS[values["protocol"]](test),
        "",
        "[provenance]",
        _line("kind", values["kind"], "measured, digitised or synthetic"),
        _line("source", values["source"], "who, when, where"),
        '# doi = "..."',
    ]
    return "\n".join(lines) + "\n"


def _line(key: str, value: object, comment: str = "") -> str:
    """Return a key with its value and a comment."""
    text = f"{key} = {_toml(value)}"
    return _with_comment(text, comment) if comment else text


def _with_comment(text: str, comment: str) -> str:
    return f"{text:<{COMMENTS_AT}}# {comment}"


def _optional(text: str, comment: str) -> str:
    """Return a key as a comment, for whoever has it."""
    return _with_comment(f"# {text}", comment)


def _toml(value: object) -> str:
    if isinstance(value, bool):
        return str(value).lower()
    if isinstance(value, float):
        return repr(value)
    return json.dumps(value, ensure_ascii=False)


def _file_keys(test: Description) -> Iterator[str]:
    """How the text file is laid out, where it is not as by default."""
    if test.table.separator != ",":
        yield _line("separator", "whitespace", 'or ","')
    if test.table.names is None:
        yield _line("header", False, "columns are named by their numbers from 1")


def _column(
    test: Description, quantity: str, key: str | None = None, comment: str = ""
) -> list[str]:
    """Return the keys of a column and its unit, of one that is there."""
    guessed, key = test.columns.get(quantity), key or quantity
    if guessed is None:
        return []
    lines = [_line(f"{key}_column", guessed.column, comment)]
    units = UNITS.get(quantity.removesuffix("_uncertainty"), ())
    if guessed.unit is not None and not quantity.endswith("_uncertainty"):
        others = ", ".join(unit for unit in units if unit != guessed.unit)
        lines.append(_line(f"{key}_unit", guessed.unit, f"or {others}" if others else ""))
    return lines


def _constant_rate(test: Description) -> list[str]:
    position = "strain" if "strain" in test.columns else "time"
    late_strain = 20.0 if test.columns[position].unit == "percent" else 0.2
    return [
        _with_comment("[[segments]]", "one for each imposed strain rate"),
        _line("start_strain", 0.0, "a fraction, where this rate starts"),
        _line("strain_rate_per_s", test.values["strain_rate_per_s"]),
        "",
        "[data]",
        _line("file", test.file),
        *_file_keys(test),
        *_column(test, position),
        *_column(test, "stress", comment="differential stress, compression positive"),
        _optional("stress_uncertainty = 0.05", "of a reading, in the unit of the stress"),
        _optional("[[microstructure]]", "measured in the sample, at one strain or more"),
        _optional(f"strain = {late_strain}", "in strain_unit of [data], else a fraction"),
        "# grain_size_m = 165e-6",
        "# grain_size_sd_m = 8e-6",
    ]


def _loading_history(test: Description) -> list[str]:
    time = test.columns["time"]
    ends = test.table.numbers(time.column)
    values = test.values
    stage = [
        _line("start_time", float(min(0.0, *ends))),
        _line("end_time", float(max(ends))),
    ]
    if values.get("stress_MPa") is not None:
        control, own = "stress", [_line("stress", values["stress_MPa"], "in stage_stress_unit")]
    elif values.get("strain_rate_per_s") is not None:
        own = [_line("strain_rate_per_s", values["strain_rate_per_s"])]
        control = "strain_rate"
    else:
        control, own = "stress_series", []
    comment = {"stress_series": "the readings of the stress drive the test"}.get(
        control, "what is imposed; others: docs/loading_history.md"
    )
    return [
        _line("stage_time_unit", time.unit, "of the stages; s, min or h"),
        _line("stage_stress_unit", "MPa", "of the stages; Pa, MPa or GPa"),
        _line("compression", "positive", "or negative: of stages and data"),
        _line("strain_measure", "true", "or engineering; stress_measure likewise"),
        "",
        _with_comment("[[stages]]", "one after the other, without gaps"),
        _line("control", control, comment),
        *stage,
        *own,
        "",
        "[data]",
        _line("file", test.file),
        *_file_keys(test),
        *_column(test, "time", comment="on the clock of the stages"),
        *_column(test, "strain"),
        *_column(test, "stress"),
        _optional("strain_uncertainty = 0.002", "of a reading, in its unit"),
    ]


def _forced_oscillation(test: Description) -> list[str]:
    lines = [
        _with_comment("[oscillation]", "all optional"),
        _optional("period_s = 300.0", "else estimated from the strain"),
        _line("background", "kept", "or removed: docs/model.md"),
        "",
        "[data]",
        *_file_keys(test),
    ]
    for quantity in ("strain", "stress"):
        lines += [
            _line(f"{quantity}_file", test.file),
            *_column(test, "time", f"{quantity}_time"),
            *_column(test, quantity),
        ]
        error = f"{quantity}_uncertainty"
        if error in test.columns:
            lines += _column(test, error)
        else:
            lines.append(_line(error, test.values[error], f"of every {quantity}, in its unit"))
    return lines


def _attenuation(test: Description) -> list[str]:
    values, columns = test.values, test.columns
    readings = test.table.numbers(columns["attenuation"].column)
    lines = [
        "[attenuation]",
        _line("deformation", values["deformation"], "axial or shear: of modulus and stresses"),
    ]
    if values["deformation"] == "shear":
        lines.append(_line("poisson_ratio", values["poisson_ratio"], "or bulk_modulus_Pa"))
    lines += [
        _optional(f"{name}_Pa = 1e6", "of every row")
        for name in ("median_stress", "amplitude")
        if name not in columns
    ]
    lines += ["", "[data]", _line("file", test.file), *_file_keys(test)]
    lines += _column(test, "period" if "period" in columns else "frequency")
    lines += _column(test, "temperature")
    for name in ("median_stress", "amplitude"):
        if name in columns:
            lines.append(_line(f"{name}_column", columns[name].column))
            stress_unit = columns[name].unit
    if "median_stress" in columns or "amplitude" in columns:
        lines.append(_line("stress_unit", stress_unit))
    logarithms = any(value < 0 for value in readings)
    form = "log10_tan_delta" if logarithms else "tan_delta"
    lines += [
        _line("attenuation_column", columns["attenuation"].column),
        _line("attenuation_form", form, "tan_delta (1/Q is the same) or log10_tan_delta"),
    ]
    if "attenuation_uncertainty" in columns:
        lines += _column(test, "attenuation_uncertainty")
    else:
        lines.append(_optional("attenuation_uncertainty = 1e-3", "of tan delta itself"))
    lines += _column(test, "limit")
    if "modulus" in columns:
        lines += [
            *_column(test, "modulus"),
            *_column(test, "modulus_uncertainty"),
        ]
    return lines


_PROTOCOLS: Mapping[str, Callable[[Description], list[str]]] = MappingProxyType(
    {
        "constant_rate": _constant_rate,
        "forced_oscillation": _forced_oscillation,
        "loading_history": _loading_history,
        "attenuation": _attenuation,
    }
)
"""What the files of each kind of test have of their own."""
