"""Tables of peak stresses and their priors: what is read, converted, written and refused."""

from collections.abc import Callable
from dataclasses import fields, replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE
from refusals import refusal, written

from pyburgers.common.errors import InputError
from pyburgers.flow_law_tables.description import groups
from pyburgers.flow_law_tables.inputs import (
    COLUMNS,
    FLOW_LAW_PARAMETERS,
    PeakStrain,
    PeakStressData,
    default_peak_stress_priors,
    load_peak_stress,
    load_peak_stress_priors,
    save_peak_stress,
    without_test,
)
from pyburgers.kinds.kind import load_experiment
from pyburgers.model.peak_test import PeakTest
from pyburgers.model.priors import save_priors

TABLE = """\
id = "table-1"
material = "ice"
protocol = "peak_stress"

[data]
file = "points.csv"
temperature_column = "T"
temperature_unit = "degC"
stress_column = "s"
stress_unit = "MPa"
strain_rate_column = "rate"
strain_rate_unit = "1e-6/s"
grain_size_column = "d"
grain_size_unit = "mm"
relative_stress_uncertainty_column = "u"

[provenance]
kind = "measured"
source = "Somebody (2020)"
"""
POINTS = "T,s,rate,d,u\n-10,5,40,0.2,0.01\n-10,8,200,0.2,0.02\n-20,9,100,0.6,0\n"
STATED = "[peak_strain]\nmean = 0.02\nsd = 0.004\n\n[provenance]"
PRIORS = ICE.parent / "priors" / "peak_stress" / "ice.toml"

Write = Callable[..., Path]


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write a table with replaced text and its data file; return the TOML's path."""

    def write(*replacements: tuple[str, str], points: str = POINTS) -> Path:
        return written(tmp_path / "table.toml", TABLE, replacements, {"points": points})

    return write


def test_a_saved_table_is_read_back_unchanged(write: Write, tmp_path: Path) -> None:
    for stated, strain in ((STATED, PeakStrain(0.02, 0.004)), ("[provenance]", None)):
        data = load_peak_stress(write(("[provenance]", stated)))
        assert data.peak_strain == strain
        copy = tmp_path / str(strain)
        copy.mkdir()
        assert_equal(load_peak_stress(save_peak_stress(data, copy)), data)


def test_the_rows_of_a_curve_are_left_out() -> None:
    table = load_peak_stress(ICE / "peak_stress_qi_goldsby_2021.toml")
    curve = load_experiment(ICE / "PIL40.toml")
    others = without_test(table, curve)
    assert others.n_points == 22
    np.testing.assert_allclose(np.setdiff1d(table.stress, others.stress), [8.03e6])
    with pytest.raises(InputError, match=r"no row may be PIL40 with 0\.000169 1/s, .*expected"):
        without_test(others, curve)
    record = load_experiment(ICE.parent / "olivine" / "olivine_twin.toml")
    with pytest.raises(InputError, match="has no stress at a constant rate"):
        without_test(table, record)
    few = replace(table, **{name: getattr(table, name)[7:10] for name in COLUMNS})
    with pytest.raises(InputError, match="2 rows are left, expected at least 3"):
        without_test(few, curve)


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


def assert_equal(one: PeakStressData, other: PeakStressData) -> None:
    for field in fields(one):
        np.testing.assert_array_equal(getattr(one, field.name), getattr(other, field.name))


def test_everything_is_converted_to_si(write: Write) -> None:
    data = load_peak_stress(write())
    np.testing.assert_allclose(data.temperature, [263.15, 263.15, 253.15])
    np.testing.assert_allclose(data.stress, [5e6, 8e6, 9e6])
    np.testing.assert_allclose(data.strain_rate, [4e-5, 2e-4, 1e-4])
    np.testing.assert_allclose(data.grain_size, [2e-4, 2e-4, 6e-4])
    np.testing.assert_allclose(data.relative_stress_uncertainty, [0.01, 0.02, 0.0])
    exact = load_peak_stress(write(('relative_stress_uncertainty_column = "u"\n', "")))
    np.testing.assert_array_equal(exact.relative_stress_uncertainty, 0.0)


def test_the_published_table_has_23_tests_in_two_groups() -> None:
    data = load_peak_stress(ICE / "peak_stress_qi_goldsby_2021.toml")
    assert data.n_points == 23
    assert [group.points.size for group in groups(data)] == [18, 5]
    assert 263.0 < data.mean_conditions.temperature < 264.1
    assert data.provenance.kind == "measured"


def test_groups_share_grain_size_and_temperature(write: Write) -> None:
    rows = "".join(f"{t},{s},40,{d},0\n" for t, s, d in ((-10, 5, 1), (-30, 6, 1), (-11.5, 7, 1)))
    data = load_peak_stress(write(points="T,s,rate,d,u\n" + rows + "-10,8,40,2,0\n"))
    assert [sorted(group.points.tolist()) for group in groups(data)] == [[1], [0, 2], [3]]


WRONG_POINTS = [
    (POINTS.replace("8,200", "-8,200"), "data row 2: the stress is -8e+06 in SI units"),
    (POINTS.replace("5,40", "5,0"), "data row 1: the strain rate is 0 in SI units"),
    (POINTS.replace("0.02", "-0.02"), "relative stress uncertainty is -0.02"),
    (POINTS.replace("0.02", "2"), "relative stress uncertainty of 2, expected a fraction"),
    (POINTS.replace("-20,", "-300,"), "the temperature is -26.85"),
    (POINTS.replace("-20,", "5000,"), "found 5273.15, expected kelvin between 50 and 3000"),
    (POINTS.replace("0.6,", "2300,"), "grain size: found 2.3, expected metres"),
    ("T,s,rate,d,u\n-10,5,40,0.2,0\n", "found 1 rows, expected at least 3"),
    (POINTS.replace(",8,", ",5,").replace(",9,", ",5,"), "all stresses are 5e+06 Pa"),
    (POINTS.replace(",8,", ",eight,"), "found 'eight', expected a number"),
    (POINTS.replace("T,s", "T,stress"), "column 's' is not in"),
]
WRONG_KEYS = [
    ('temperature_unit = "degC"', 'temperature_unit = "degF"', "'K' or 'degC'"),
    ('stress_unit = "MPa"', 'stress_unit = "bar"', "unit 'bar' is not a unit of stress"),
    ('grain_size_column = "d"\n', "", "key 'grain_size_column' in [data] is missing"),
    (
        'protocol = "peak_stress"',
        'protocol = "constant_rate"',
        "key 'protocol': found 'constant_rate', expected 'peak_stress' (the kind of table).",
    ),
    ('id = "table-1"', 'id = "table 1"', "key 'id'"),
    ('stress_column = "s"', "stress_column = true", "expected a column name"),
    ('file = "points.csv"', 'file = "none.csv"', "does not exist"),
    ("[provenance]", STATED.replace("0.02", "2.0"), "key 'mean' in [peak_strain]"),
]


@pytest.mark.parametrize(
    ("points", "keys", "expected"),
    [
        *((points, (), expected) for points, expected in WRONG_POINTS),
        *((POINTS, ((old, new),), expected) for old, new, expected in WRONG_KEYS),
    ],
)
def test_wrong_tables_are_refused_in_one_sentence(
    write: Write, points: str, keys: tuple[tuple[str, str], ...], expected: str
) -> None:
    assert expected in refusal(write(*keys, points=points), load_peak_stress)


@pytest.mark.parametrize(
    ("old", "new", "expected"),
    [
        ("[parameters.stress_scatter]", "[parameters.stress_noise]", "unknown key 'stress_noise'"),
        ('family = "half_normal"', 'family = "uniform"', "'half_normal'"),
        ("location = -7.29e-4", "location = 7.29e-4", "so the sign is a misprint"),
    ],
)
def test_wrong_priors_are_refused_in_one_sentence(
    tmp_path: Path, old: str, new: str, expected: str
) -> None:
    text = PRIORS.read_text(encoding="utf-8")
    path = written(tmp_path / "priors.toml", text, ((old, new),), {})
    assert expected in refusal(path, load_peak_stress_priors)
    with pytest.raises(InputError, match="material 'basalt' has no default priors"):
        default_peak_stress_priors("basalt")


def test_saved_priors_are_read_back_unchanged(tmp_path: Path) -> None:
    priors = default_peak_stress_priors("ice")
    assert list(priors.priors) == [parameter.name for parameter in FLOW_LAW_PARAMETERS]
    save_priors(priors, tmp_path / "ice.toml", FLOW_LAW_PARAMETERS)
    assert load_peak_stress_priors(tmp_path / "ice.toml") == priors
