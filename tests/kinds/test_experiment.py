"""Experiment files: what is read, what is put right with a notice, what is refused."""

from collections.abc import Callable, Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from refusals import refusal, written

from pyburgers.common.errors import InputError
from pyburgers.kinds.constant_rate.experiment import load_constant_rate
from pyburgers.kinds.doubts import doubts

EXPERIMENT = """\
id = "sample-1"
material = "ice"
protocol = "constant_rate"
temperature_K = 263.0
initial_grain_size_m = 230e-6

[[segments]]
start_strain = 0.0
strain_rate_per_s = 1e-4

[[segments]]
start_strain = 0.05
strain_rate_per_s = 1e-5

[data]
file = "curve.csv"
strain_column = "strain"
strain_unit = "percent"
stress_column = "stress"
stress_unit = "MPa"

[provenance]
kind = "measured"
source = "Somebody (2020)"

[metadata]
operator = "somebody"
confined = true
pressure_MPa = 300
"""
STRAINS_PERCENT = (1, 2, 3, 4, 5, 6, 7, 8, 9, 10, 10.5, 11)

Write = Callable[..., Path]


def curve(strains: Sequence[float] = STRAINS_PERCENT) -> str:
    rows = [f"{strain},{1 + 0.1 * k:.1f}" for k, strain in enumerate(strains)]
    return "\n".join(["strain,stress", *rows]) + "\n"


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write an experiment with replaced text and its data files; return the TOML's path."""

    def write(*replacements: tuple[str, str], text: str = EXPERIMENT, **files: str | None) -> Path:
        return written(tmp_path / "test.toml", text, replacements, {"curve": curve(), **files})

    return write


class TestReading:
    def test_everything_is_converted_to_si(self, write: Write) -> None:
        experiment = load_constant_rate(write())
        np.testing.assert_allclose(experiment.strain, np.array(STRAINS_PERCENT) / 100, rtol=1e-15)
        np.testing.assert_allclose(experiment.stress[:2], [1.0e6, 1.1e6], rtol=1e-15)
        assert experiment.n_points == 12
        assert experiment.final_strain == pytest.approx(0.11)
        assert experiment.notices == ()
        assert experiment.metadata == {
            "operator": "somebody",
            "confined": True,
            "pressure_MPa": 300,
        }

    def test_time_follows_from_the_rates(self, write: Write) -> None:
        times = load_constant_rate(write()).time_at(np.array([0.0, 0.02, 0.05, 0.06]))
        np.testing.assert_allclose(times, [0, 200, 500, 1500], rtol=1e-12)

    def test_strain_follows_from_time_and_the_rates(self, write: Write) -> None:
        path = write(
            ('strain_column = "strain"', 'time_column = "time"'),
            ('strain_unit = "percent"', 'time_unit = "min"'),
            curve="time,stress\n5,1\n10,2\n20,3\n",
        )
        experiment = load_constant_rate(path)
        np.testing.assert_allclose(experiment.strain, [0.03, 0.051, 0.057], rtol=1e-12)
        np.testing.assert_allclose(
            experiment.time_at(experiment.strain), [300, 600, 1200], rtol=1e-12
        )

    def test_the_environment_takes_the_place_of_data_root(
        self, write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        path = write(("[data]", '[data]\ndata_root = "elsewhere"'))
        monkeypatch.delenv("PYBURGERS_DATA", raising=False)
        assert "elsewhere" in refusal(path)
        monkeypatch.setenv("PYBURGERS_DATA", str(tmp_path))
        assert load_constant_rate(path).n_points == 12

    def test_nothing_depends_on_the_current_directory(
        self, write: Write, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
    ) -> None:
        path = write()
        (tmp_path / "empty").mkdir()
        monkeypatch.chdir(tmp_path / "empty")
        assert load_constant_rate(path).n_points == 12


class TestNumbersThatNoTestHas:
    """Constructors refuse them as files do."""

    @pytest.mark.parametrize(
        ("changed", "words"),
        [
            ({"temperature": -10.0}, "temperature: found -10, expected kelvin"),
            ({"temperature": float("nan")}, "temperature: found nan"),
            ({"initial_grain_size": 230.0}, "grain size: found 230, expected metres"),
            ({"initial_grain_size": float("nan")}, "grain size: found nan"),
            ({"final_strain": 99.0}, "strain: found 99 as a fraction"),
            ({"stress": np.full(12, np.nan)}, "reading 1: found nan, expected a finite number"),
        ],
    )
    def test_they_are_refused(self, write: Write, changed: dict[str, Any], words: str) -> None:
        experiment = load_constant_rate(write())
        with pytest.raises(InputError, match=f"sample-1: {words}"):
            replace(experiment, **changed)

    def test_a_stress_that_a_material_does_not_bear_is_doubted(self, write: Write) -> None:
        experiment = load_constant_rate(write())
        assert doubts(experiment) == []
        (doubt,) = doubts(replace(experiment, stress=1e3 * experiment.stress))
        assert "GPa is unlikely in ice (up to 200 MPa is plausible)" in doubt

    def test_a_reading_that_is_far_from_all_others_is_doubted(self, write: Write) -> None:
        experiment = load_constant_rate(write())
        stress = experiment.stress.copy()
        stress[3] = -99e6
        (doubt,) = doubts(replace(experiment, stress=stress))
        assert "one stress (MPa) of -99 is more than 10 times as large as all others" in doubt
