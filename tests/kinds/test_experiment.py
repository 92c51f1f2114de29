"""Tests at constant rate: times, where readings are looked for, numbers that no test has."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ICE
from refusals import refusal, written
from small_inputs import CURVE, EXPERIMENT

import pyburgers
from pyburgers.common.errors import InputError
from pyburgers.kinds.conditions import doubts, unlikely_grain_size, unlikely_pressure
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import Stated, of_kind
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.kind import load_experiment


@pytest.fixture
def curve() -> ConstantRateExperiment:
    return load_constant_rate(ICE / "PIL40.toml")


def test_the_environment_takes_the_place_of_data_root(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Neither depends on the current directory."""
    elsewhere = (("[data]", '[data]\ndata_root = "elsewhere"'),)
    path = written(tmp_path / "test.toml", EXPERIMENT, elsewhere, {"curve": CURVE})
    monkeypatch.delenv("PYBURGERS_DATA", raising=False)
    (tmp_path / "empty").mkdir()
    monkeypatch.chdir(tmp_path / "empty")
    assert "elsewhere" in refusal(path)
    monkeypatch.setenv("PYBURGERS_DATA", str(tmp_path))
    assert load_constant_rate(path).n_points == 4


def test_a_folder_and_bytes_that_are_no_text_are_refused(tmp_path: Path) -> None:
    assert "is a folder" in refusal(tmp_path)
    path = written(tmp_path / "test.toml", EXPERIMENT, (), {})
    (tmp_path / "curve.csv").write_bytes(b"\xff\xfe\x00strain")
    assert "not UTF-8" in refusal(path)


@pytest.mark.parametrize(
    ("changed", "words"),
    [
        ({"temperature": -10.0}, "temperature: found -10, expected kelvin"),
        ({"temperature": float("nan")}, "temperature: found nan"),
        ({"initial_grain_size": 230.0}, "grain size: found 230, expected metres"),
        ({"initial_grain_size": float("nan")}, "grain size: found nan"),
        ({"final_strain": 99.0}, "strain: found 99 as a fraction"),
        ({"stress": np.full(61, np.nan)}, "reading 1: found nan, expected a finite number"),
    ],
)
def test_constructors_refuse_numbers_that_no_test_has(
    curve: ConstantRateExperiment, changed: dict[str, Any], words: str
) -> None:
    measured = replace(curve, provenance=replace(curve.provenance, kind="measured"))
    with pytest.raises(InputError, match=f"PIL40: {words}"):
        replace(measured, **changed)


def test_stresses_that_no_material_bears_and_single_readings_are_doubted(
    curve: ConstantRateExperiment,
) -> None:
    assert doubts(curve) == []
    (doubt,) = doubts(replace(curve, stress=1e3 * curve.stress))
    assert "GPa is unlikely in ice (up to 200 MPa is plausible)" in doubt
    stress = curve.stress.copy()
    stress[3] = -99e6
    (doubt,) = doubts(replace(curve, stress=stress))
    assert "one stress (MPa) of -99 is more than 10 times as large as all others" in doubt


def test_a_start_that_is_stiffer_than_the_material_is_doubted(
    curve: ConstantRateExperiment,
) -> None:
    assert doubts(replace(curve, stress=curve.stress + 0.3e6)) == []
    (doubt,) = doubts(replace(curve, stress=curve.stress + 50e6))
    assert "while priors of ice expect a Maxwell modulus of" in doubt
    assert doubts(replace(curve, material="gypsum", stress=curve.stress + 50e6))[1:] == []


def test_creep_that_was_zeroed_behind_the_elastic_strain_is_doubted() -> None:
    strain = 3e-4 + 1e-3 * np.linspace(0.0, 1.0, 30)
    creep: dict[str, Any] = {"stress": 1.5, "time": np.linspace(5.0, 1e4, 30), "temperature_K": 263}
    creep |= {"time_unit": "s", "stress_unit": "MPa", "grain_size_um": 1000, "material": "ice"}
    creep |= {"strain_unit": "fraction", "kind": "measured", "source": "made up", "name": "creep"}
    good, zeroed = (
        pyburgers.CreepTest(strain=one, **creep) for one in (strain, strain - strain[0])
    )
    assert doubts(good) == []
    (doubt,) = doubts(zeroed)
    assert "the start of the load, and [strain_offset]" in doubt
    offset = Stated(-3e-4, 1e-5)
    assert doubts(replace(zeroed, strain_offset=offset)) == []


@pytest.mark.parametrize(("factor", "told"), [(1.0, False), (0.01, True), (100.0, True)])
def test_an_oscillation_in_a_wrong_unit_is_doubted(factor: float, told: bool) -> None:
    record = of_kind(
        load_experiment(ICE.parent / "olivine" / "olivine_twin.toml"), OscillationExperiment
    )
    prepared = record.prepared
    fit = prepared.stress_fit
    scaled = replace(fit, coefficients=factor * fit.coefficients)
    other = replace(record, prepared=replace(prepared, stress_fit=scaled))
    assert told == any("stress over strain of the oscillation" in one for one in doubts(other))


def test_a_test_shows_doubts_about_its_conditions(curve: ConstantRateExperiment) -> None:
    odd = replace(curve, initial_grain_size=2.3e-10, temperature=300.0, stress=1e3 * curve.stress)
    said = repr(odd)
    for told in ("grains of 2.3e-10 m are unlikely", "ice at 300 K is molten", "GPa is unlikely"):
        assert told in said
    assert said.count("\nnote: ") == 3 + len(curve.notices)
    assert list(unlikely_grain_size(np.array([np.nan, 1e-9, 0.1]))) == [
        f"grains of {size} m are unlikely; 230 um is 230e-6." for size in ("1e-09", "0.1")
    ]
    assert not list(unlikely_grain_size(np.array([np.nan, 5e-8, 1e-3])))
    (doubt,) = doubts(replace(curve, environment={"pressure": 300.0}))
    assert "a pressure of 300 Pa is unlikely; check its unit." in doubt
    assert list(unlikely_pressure(np.array([np.nan, 0.0, 3e14]))) == [
        "a pressure of 3e+14 Pa is unlikely; check its unit."
    ]
    assert len(list(unlikely_pressure(np.array([0.0, 300.0, 1e8])))) == 1
    assert not list(unlikely_pressure(np.array([1e5, 1.5e10])))
