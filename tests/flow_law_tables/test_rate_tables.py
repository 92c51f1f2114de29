"""Tables of steady rates and composite laws: what is read, converted, written and refused."""

from collections.abc import Callable
from dataclasses import replace
from itertools import permutations
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import ICE
from refusals import written

from pyburgers.common.errors import InputError
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.laws import (
    ENHANCEMENTS,
    load_rate_law,
    rate_law,
    save_rate_law,
    with_curve_flow_law,
    without_idle,
)
from pyburgers.flow_law_tables.table_files import load_rate_table, save_rate_table
from pyburgers.flow_law_tables.tables import (
    LABELS,
    NUMBERS,
    PeakStrain,
    RateTable,
    joined,
    without_test,
)
from pyburgers.kinds.experiment import DataKind
from pyburgers.kinds.kind import load_experiment
from pyburgers.model.peak_test import PeakTest
from pyburgers.model.priors import FLOW_LAW, default_priors

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


STATED = "[peak_strain]\nmean = 0.02\nsd = 0.004\n\n[provenance]"


def test_the_strain_of_the_peaks_is_read_saved_and_joined(write: Write, tmp_path: Path) -> None:
    data = load_rate_table(write(("[provenance]", STATED)))
    assert data.peak_strain == PeakStrain(0.02, 0.004)
    assert load_rate_table(save_rate_table(data, tmp_path)).peak_strain == data.peak_strain
    same_peaks = replace(data, id="same")
    assert joined([data, same_peaks]).peak_strain == data.peak_strain
    other = replace(same_peaks, peak_strain=None, source=np.full(data.n_rows, "other"))
    for softened, notices in ((False, 0), (True, 1)):
        table = joined([data, other], softened=softened)
        assert table.peak_strain is None
        assert sum("[peak_strain] of mine does" in one for one in table.notices) == notices
    without = joined([data, other], ["other"], softened=True)
    assert without.peak_strain == data.peak_strain
    assert not any("[peak_strain]" in one for one in without.notices)


@pytest.mark.parametrize("kinds", list(permutations(("measured", "digitised", "synthetic"), 2)))
def test_joined_tables_are_of_the_weakest_kind_in_any_order(
    write: Write, kinds: tuple[DataKind, ...]
) -> None:
    data = load_rate_table(write())
    tables = [
        replace(data, id=kind, provenance=replace(data.provenance, kind=kind)) for kind in kinds
    ]
    weakest = "synthetic" if "synthetic" in kinds else "digitised"
    assert joined(tables).provenance.kind == weakest


def test_the_rows_of_a_curve_are_left_out() -> None:
    table = load_rate_table(ICE / "rates" / "qi_goldsby_2021.toml")
    curve = load_experiment(ICE / "PIL40.toml")
    others = without_test(table, curve)
    assert others.n_rows == 22
    np.testing.assert_allclose(np.setdiff1d(table.stress, others.stress), [8.03e6])
    with pytest.raises(InputError, match=r"no row may be PIL40 with 0\.000169 1/s, .*expected"):
        without_test(others, curve)
    record = load_experiment(ICE.parent / "olivine" / "olivine_twin.toml")
    with pytest.raises(InputError, match="has no stress at a constant rate"):
        without_test(table, record)
    with pytest.raises(InputError, match="2 rows are left, expected at least 3"):
        without_test(table.rows(np.arange(7, 10)), curve)


@pytest.mark.parametrize(
    ("change", "same"),
    [
        ({}, True),
        ({"strain_rate": 1.005e-4}, True),
        ({"stress": 7.3e6, "temperature": 260.0}, True),
        ({"strain_rate": 1.03e-4}, False),
        ({"stress": 8e6}, False),
        ({"temperature": 255.0}, False),
        ({"grain_size": 3e-4}, False),
    ],
)
def test_records_that_differ_by_more_than_reporting_are_other_tests(
    change: dict[str, float], same: bool
) -> None:
    one = PeakTest(strain_rate=1e-4, stress=7e6, temperature=263.0, grain_size=2.3e-4)
    assert one.may_be(replace(one, **change)) is same


@pytest.mark.parametrize(
    ("name", "number"), [("stress", np.nan), ("strain_rate", -1e-6), ("temperature", 5000.0)]
)
def test_arrays_with_numbers_that_no_test_has_are_refused(
    write: Write, name: str, number: float
) -> None:
    data = load_rate_table(write())
    with pytest.raises(InputError, match=f"mine: .*{name.replace('_', ' ')}"):
        replace(data, **dict[str, Any]({name: np.full(data.n_rows, number)}))


def test_a_data_frame_is_a_table_too(write: Write) -> None:
    frame = pd.DataFrame({"T": [260.0, 250.0, 240.0], "s": [1.0, 2, 3], "r": [1e-7, 1e-7, 1e-8]})
    given: dict[str, Any] = {
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
    assert not data.notices
    renamed = {"T": frame["T"], "s (psi)": frame["s"], "r": frame["r"]}
    own = {**given["data"], "file": renamed, "stress_column": "s (psi)"}
    (notice,) = load_rate_table({**given, "data": own}).notices
    assert "for column 's (psi)', whose name says another unit" in notice


@pytest.mark.parametrize("path", MEASURED, ids=lambda path: path.stem)
def test_measured_tables_are_read_and_saved_unchanged(path: Path, tmp_path: Path) -> None:
    data = load_rate_table(path)
    assert data.provenance.kind == "measured"
    assert data.notices == ()
    assert same(load_rate_table(save_rate_table(data, tmp_path)), data)


def test_rows_that_stand_there_twice_are_told(write: Write) -> None:
    """They narrow each number as if they were tests of their own."""
    twice = load_rate_table(write(rows=ROWS + ROWS.partition("\n")[2]))
    assert "mine: 3 rows with the numbers of a row before" in "; ".join(twice.notices)
    once = load_rate_table(write())
    assert once.notices == ()
    both = joined([once, replace(once, id="other")])
    assert "mine, other: 3 rows in common" in "; ".join(both.notices)


def test_measured_tables_are_joined_and_saved(tmp_path: Path) -> None:
    data = joined([load_rate_table(path) for path in MEASURED])
    assert not data.notices
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


@pytest.mark.parametrize(
    "name", ["ice_power_law", "ice_flow_law", "ice_composite", "olivine_composite"]
)
def test_laws_are_saved_and_read_back(name: str, tmp_path: Path) -> None:
    law = rate_law(name)
    save_rate_law(law, tmp_path / f"{name}.toml")
    again = load_rate_law(tmp_path / f"{name}.toml")
    assert again.mechanisms == law.mechanisms
    for parameter in law.parameters:
        ours, theirs = law.priors[parameter.name], again.priors[parameter.name]
        assert theirs.family == ours.family
        assert theirs.numbers() == pytest.approx(ours.numbers(), rel=1e-12)


def test_a_power_law_takes_the_priors_of_a_curve(tmp_path: Path) -> None:
    curve = default_priors("ice")
    law = with_curve_flow_law(rate_law("ice_power_law"), curve)
    save_rate_law(law, tmp_path / "law.toml")
    for name in FLOW_LAW:
        assert law.priors[f"{name}[creep]"] == curve[name]
        again = load_rate_law(tmp_path / "law.toml").priors[f"{name}[creep]"]
        assert again.numbers() == pytest.approx(curve[name].numbers())
    assert "mechanism_rate[creep]" not in law.priors.priors
    assert law.priors["rate_scatter"] == rate_law("ice_power_law").priors["rate_scatter"]
    with pytest.raises(InputError, match="is no power law"):
        with_curve_flow_law(rate_law("ice_composite"), curve)


def test_parameters_that_no_row_can_tell_are_fixed() -> None:
    law = without_idle(rate_law("ice_composite"), sources=False, steady=[1])
    free = law.priors.free
    assert ENHANCEMENTS[0] in free
    assert ENHANCEMENTS[1] not in free
    assert "source_rate_spread" not in free
    with pytest.raises(InputError, match="unknown parameter"):
        law.at(n=3.0)


@pytest.mark.parametrize("grain_size", [[], [[1e-3, 2e-3]]])
def test_rates_are_told_at_conditions_in_a_list(grain_size: Any, creep: RateFit) -> None:
    with pytest.raises(InputError, match=r"temperature: found an array of shape .*, expected a"):
        creep.rates_at(250.0, 1e6, grain_size)
