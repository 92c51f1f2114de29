"""Tables of steady rates and composite laws: what is read, converted, written and refused."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import ICE
from refusals import refusal, written

from pyburgers.common.errors import InputError
from pyburgers.flow_law_tables.rate_laws import (
    ENHANCEMENTS,
    load_rate_law,
    rate_law,
    save_rate_law,
    without_idle,
)
from pyburgers.flow_law_tables.rate_tables import (
    LABELS,
    NUMBERS,
    RateTable,
    joined,
    load_rate_table,
    save_rate_table,
)

TABLE = """\
id = "mine"
material = "ice"
protocol = "rates"

[data]
file = "rows.csv"
temperature_column = "T"
temperature_unit = "C"
stress_column = "s"
stress_unit = "MPa"
strain_rate_column = "rate"
strain_rate_unit = "1e-6/s"
grain_size_column = "d"
grain_size_unit = "mm"

[[tests]]
rows = { lab = "creep" }
imposed = "stress"
regime = "minimum"
geometry = "compression"
reading_error = 0.05
temperature_error_K = 0.2

[[tests]]
rows = { lab = "press" }
imposed = "strain_rate"
regime = "peak"
geometry = "shear"
source = "press-lab"
grain_size_error = 0.1

[provenance]
kind = "measured"
source = "Somebody (2020)"
"""
ROWS = "lab,T,s,rate,d\ncreep,-10,1,0.4,0.2\ncreep,-20,2,3,\npress,-5,0.5,9,1\n"
LAW = ICE.parent / "priors" / "rates" / "ice_composite.toml"
MEASURED = sorted((ICE / "rates").glob("*.toml"))

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write a table with replaced text and its data file; return the TOML's path."""

    def write(*replacements: tuple[str, str], rows: str = ROWS) -> Path:
        return written(tmp_path / "table.toml", TABLE, replacements, {"rows": rows})

    return write


def same(first: RateTable, second: RateTable) -> bool:
    def ordered(table: RateTable) -> pd.DataFrame:
        columns = {name: getattr(table, name) for name in (*NUMBERS, *LABELS)}
        frame = pd.DataFrame(columns)
        return frame.sort_values([*NUMBERS, *LABELS]).reset_index(drop=True)

    pd.testing.assert_frame_equal(ordered(first), ordered(second), rtol=1e-12)
    return (first.id, first.material, first.provenance) == (
        second.id,
        second.material,
        second.provenance,
    )


def test_rows_are_read_in_si_and_axial_equivalents(write: Write) -> None:
    data = load_rate_table(write())
    assert data.temperature == pytest.approx([263.15, 253.15, 268.15])
    assert data.stress == pytest.approx([1e6, 2e6, np.sqrt(3) * 5e5])
    assert data.strain_rate == pytest.approx([4e-7, 3e-6, 9e-6 / np.sqrt(3)])
    assert data.grain_size == pytest.approx([2e-4, np.nan, 1e-3], nan_ok=True)
    assert data.sources == ("mine", "press-lab")
    assert data.stress_is_imposed.tolist() == [True, True, False]
    assert data.reading_error.tolist() == [0.05, 0.05, 0.0]
    assert data.temperature_error.tolist() == [0.2, 0.2, 0.0]
    assert data.grain_size_error.tolist() == [0.0, 0.0, 0.1]
    assert data.log_read == pytest.approx(np.log([4e-7, 3e-6, np.sqrt(3) * 5e5]))


@pytest.mark.parametrize(
    ("stress", "rate"),
    [
        # Stress and strain rate tensors: axial, simple shear (shear stress, engineering rate).
        (np.diag([1.0, 0, 0]), np.diag([1.0, -0.5, -0.5])),
        (
            np.array([[0, 1.0, 0], [1.0, 0, 0], [0, 0, 0]]),
            np.array([[0, 0.5, 0], [0.5, 0, 0], [0, 0, 0]]),
        ),
    ],
    ids=["axial", "shear"],
)
@pytest.mark.parametrize("measure", ["applied", "octahedral"])
def test_equivalents_have_the_second_invariants_of_the_tensors(
    write: Write, stress: np.ndarray, rate: np.ndarray, measure: str
) -> None:
    deviator = stress - np.trace(stress) / 3 * np.eye(3)
    von_mises = np.sqrt(1.5 * np.sum(deviator**2))
    equivalent_rate = np.sqrt(2 / 3 * np.sum(rate**2))
    in_shear = stress[0, 0] == 0
    # Octahedral: root mean square of the deviator in principal axes.
    given = (
        (1.0, 1.0)
        if measure == "applied"
        else (np.sqrt(np.sum(deviator**2) / 3), np.sqrt(np.sum(rate**2) / 3))
    )
    rows = "lab,T,s,rate,d\n" + f"creep,-5,{given[0]!r},{given[1]!r},1\n" * 3
    geometry = "shear" if in_shear else "tension"
    kinds = TABLE.index('[[tests]]\nrows = { lab = "press"')
    text = TABLE[:kinds] + TABLE[TABLE.index("[provenance]") :]
    path = written(
        write().with_name("one.toml"),
        text,
        (('"compression"', f'"{geometry}"\nmeasure = "{measure}"'),),
        {"rows": rows.replace("np.float64(", "").replace(")", "")},
    )
    data = load_rate_table(path)
    assert data.stress[0] * 1e-6 == pytest.approx(von_mises, rel=1e-12)
    assert data.strain_rate[0] * 1e6 == pytest.approx(equivalent_rate, rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('imposed = "stress"', 'imposed = "load"', ["imposed", "load"]),
        ('regime = "minimum"', 'regime = "peak"', ["regime", "minimum or steady"]),
        ('regime = "peak"', 'regime = "minimum"', ["regime", "peak or steady"]),
        ('geometry = "shear"', 'geometry = "bending"', ["geometry", "bending"]),
        ('"MPa"', '"bar"', ["stress_unit", "bar"]),
        ('"C"', '"F"', ["temperature_unit"]),
        ('grain_size_unit = "mm"\n', "", ["grain_size_unit"]),
        ("reading_error = 0.05", "reading_error = 1.5", ["reading_error"]),
        ("reading_error = 0.05", "reeding_error = 0.05", ["reeding_error"]),
        ("temperature_error_K = 0.2", "temperature_error_K = -1", ["temperature_error_K"]),
        ('protocol = "rates"', 'protocol = "creep"', ["protocol"]),
        ('lab = "press"', 'lab = "creep"', ["exactly one"]),
        ('lab = "press"', 'lab = "none"', ["none"]),
        ('rows = { lab = "press" }\n', "", ["exactly one"]),
        ('"C"', '"K"', ["kelvin"]),
    ],
)
def test_every_corruption_of_a_table_is_refused(
    write: Write, old: str, new: str, words: list[str]
) -> None:
    text = refusal(write((old, new)), load_rate_table)
    assert all(word in text for word in words), text


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ("creep,-10,1,", "creep,-10,0,", ["the stress is 0"]),
        ("0.4,0.2", "-0.4,0.2", ["the strain rate is"]),
        ("0.4,0.2", "x,0.2", ["'x'"]),
        ("9,1\n", "9,2000\n", ["grain size"]),
        ("creep,-20,2,3,\n", "", ["at least 3"]),
        (",s,", ",sigma,", ["'s'"]),
    ],
)
def test_every_corruption_of_rows_is_refused(
    write: Write, old: str, new: str, words: list[str]
) -> None:
    text = refusal(write(rows=ROWS.replace(old, new)), load_rate_table)
    assert all(word in text for word in words), text


def test_a_reading_error_is_stated_once(write: Write) -> None:
    path = write(
        (
            'grain_size_unit = "mm"',
            'grain_size_unit = "mm"\nreading_error_column = "d"\nreading_error_unit = "1"',
        ),
    )
    assert "expected one of them" in refusal(path, load_rate_table)


def test_a_data_frame_is_a_table_too(write: Write) -> None:
    frame = pd.DataFrame({"T": [260.0, 250.0, 240.0], "s": [1.0, 2, 3], "r": [1e-7, 1e-7, 1e-8]})
    given = {
        "id": "frame",
        "material": "ice",
        "protocol": "rates",
        "data": {
            "file": dict(frame),
            "temperature_column": "T",
            "temperature_unit": "K",
            "stress_column": "s",
            "stress_unit": "MPa",
            "strain_rate_column": "r",
            "strain_rate_unit": "1/s",
        },
        "tests": [{"imposed": "stress", "regime": "minimum", "geometry": "tension"}],
        "provenance": {"kind": "synthetic", "source": "made for a test"},
    }
    data = load_rate_table(given)
    assert data.stress.tolist() == [1e6, 2e6, 3e6]
    assert np.isnan(data.grain_size).all()


@pytest.mark.parametrize("path", MEASURED, ids=lambda path: path.stem)
def test_measured_tables_are_read_and_saved_unchanged(path: Path, tmp_path: Path) -> None:
    data = load_rate_table(path)
    assert data.provenance.kind == "measured"
    assert data.notices == ()
    assert same(load_rate_table(save_rate_table(data, tmp_path)), data)


def test_measured_tables_are_joined_and_saved(tmp_path: Path) -> None:
    data = joined([load_rate_table(path) for path in MEASURED])
    assert data.n_rows > 500
    assert len(data.sources) == len(MEASURED) == 16
    assert same(load_rate_table(save_rate_table(data, tmp_path)), data)
    with pytest.raises(InputError, match="once"):
        joined([data, data])


def test_measured_tables_agree_at_like_conditions() -> None:
    """Octahedral values taken as axial ones would put a table off by a factor of twenty."""
    medians = {}
    for path in MEASURED:
        data = load_rate_table(path)
        alike = (abs(data.temperature - 263) < 8) & (abs(np.log(data.stress / 1e6)) < 1.6)
        data = data.rows(alike & (data.grain_size > 2e-4) & (data.regime != "steady"))
        if data.n_rows:
            log_rate = np.log(data.strain_rate) - 3.3 * np.log(data.stress / 1e6)
            to_263 = 80e3 / 8.314 * (1 / data.temperature - 1 / 263.15)
            medians[path.stem] = np.median(log_rate + to_263)
    assert len(medians) > 9
    middle = np.median(list(medians.values()))
    for name, one in medians.items():
        assert abs(one - middle) < np.log(3), name


@pytest.mark.parametrize("name", ["ice_power_law", "ice_composite", "olivine_composite"])
def test_laws_are_saved_and_read_back(name: str, tmp_path: Path) -> None:
    law = rate_law(name)
    save_rate_law(law, tmp_path / f"{name}.toml")
    again = load_rate_law(tmp_path / f"{name}.toml")
    assert again.mechanisms == law.mechanisms
    for parameter in law.parameters:
        ours, theirs = law.priors[parameter.name], again.priors[parameter.name]
        assert theirs.family == ours.family
        assert theirs.numbers() == pytest.approx(ours.numbers(), rel=1e-12)


@pytest.mark.parametrize(
    ("old", "new", "words"),
    [
        ('in_series_with = "sliding"', 'in_series_with = "melt"', ["in_series_with", "melt"]),
        ('name = "sliding"', 'name = "dislocation"', ["dislocation", "twice"]),
        ("premelting_temperature_K = 258.0", "premelting_temperature_K = 250.0", ["reference"]),
        ("premelting_temperature_K = 258.0\n", "", ["premelting_enthalpy"]),
        (".stress_exponent]", ".stres_exponent]", ["stres_exponent"]),
        ('family = "lognormal"', 'family = "normal"\nlower = 0.0', ["lognormal"]),
        ("[parameters.rate_scatter]", "[parameters.rate_scater]", ["rate_scater"]),
        ('unit = "kJ/mol"', 'unit = "eV"', ["eV"]),
    ],
)
def test_every_corruption_of_a_law_is_refused(
    tmp_path: Path, old: str, new: str, words: list[str]
) -> None:
    path = written(tmp_path / "law.toml", LAW.read_text(encoding="utf-8"), ((old, new),), {})
    text = refusal(path, load_rate_law)
    assert all(word in text for word in words), text


def test_parameters_that_no_row_can_tell_are_fixed() -> None:
    law = without_idle(rate_law("ice_composite"), sources=False, steady=[1])
    free = law.priors.free
    assert ENHANCEMENTS[0] in free
    assert ENHANCEMENTS[1] not in free
    assert "source_rate_spread" not in free
    with pytest.raises(InputError, match="unknown parameter"):
        law.at(n=3.0)
