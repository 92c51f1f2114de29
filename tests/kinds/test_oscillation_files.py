"""Files of forced oscillation tests: what is chosen, and both backgrounds.

What files say otherwise is in tests/messages/forced_oscillation.toml.
"""

import io
import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import ICE
from refusals import refusal, written
from same_contents import assert_equal

from pyburgers.common.errors import InputError
from pyburgers.kinds.forced_oscillation.experiment import (
    ImposedCycles,
    OscillationExperiment,
    with_background,
)
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forced_oscillation.preparation import REMOVED_NOTICE
from pyburgers.kinds.kind import load_experiment

EXPERIMENT = """\
id = "sample-1"
material = "olivine"
protocol = "forced_oscillation"
temperature_K = 1423.0
initial_grain_size_m = 10e-6

[oscillation]
period_s = 300.0

[data]
strain_file = "strain.csv"
strain_time_column = "time"
strain_time_unit = "s"
strain_column = "strain"
strain_unit = "percent"
strain_uncertainty = 0.002
stress_file = "stress.csv"
stress_time_column = "time"
stress_time_unit = "min"
stress_column = "stress"
stress_unit = "MPa"
stress_uncertainty_column = "sd"

[provenance]
kind = "synthetic"
source = "Somebody (2020)"
"""

Write = Callable[..., Path]

REMOVED = ("period_s = 300.0", 'period_s = 300.0\nbackground = "removed"')


def strain_csv() -> str:
    time = np.arange(0.0, 1500.0, 10.0)
    percent = 0.2 * np.sin(2 * np.pi * time / 300) + 5e-4 * time
    return pd.DataFrame({"time": time, "strain": percent}).to_csv(index=False)


def stress_csv() -> str:
    time = np.arange(5.0, 1500.0, 25.0)
    stress = 150 + 50 * np.sin(2 * np.pi * time / 300 + 0.5) + 0.003 * time
    columns = {"time": time / 60, "stress": stress, "sd": 4 + 0.01 * np.arange(time.size)}
    return pd.DataFrame(columns).to_csv(index=False)


@pytest.fixture
def write(tmp_path: Path) -> Write:
    """Write an experiment with replaced text and its data files; return the TOML's path."""

    def write(*replacements: tuple[str, str], **files: str) -> Path:
        series = {"strain": strain_csv(), "stress": stress_csv(), **files}
        return written(tmp_path / "test.toml", EXPERIMENT, replacements, series)

    return write


class TestReading:
    def test_time_stamps_of_two_files_have_no_common_zero(self, write: Write) -> None:
        def stamped(text: str, unit: float) -> str:
            table = pd.read_csv(io.StringIO(text))
            since = pd.to_timedelta(unit * table["time"], unit="s")
            clock = (pd.Timestamp("2024-03-01 09:00") + since).dt.strftime("%H:%M:%S.%f")
            return table.assign(time=clock).to_csv(index=False)

        strain, stress = stamped(strain_csv(), 1.0), stamped(stress_csv(), 60.0)
        seconds = ('stress_time_unit = "min"', 'stress_time_unit = "s"')
        text = refusal(write(seconds, strain=strain, stress=stress))
        assert "holds time stamps, expected times in seconds, because another file counts" in text

    def test_the_stress_is_the_prepared_one(self, write: Write) -> None:
        experiment = load_forced_oscillation(write(REMOVED))
        assert experiment.stress is experiment.prepared.stress
        assert experiment.n_points == experiment.prepared.time.size == 60
        np.testing.assert_allclose(
            experiment.stress,
            50e6 * np.sin(2 * np.pi * experiment.prepared.time / 300 + 0.5),
            atol=0.2e6,
        )

    def test_what_is_left_open_is_chosen(self, write: Write) -> None:
        experiment = load_forced_oscillation(write(("period_s = 300.0\n", "")))
        settings = experiment.settings
        assert settings.period == pytest.approx(300, rel=1e-5)
        assert settings.strain_trend_degree == 1
        assert settings.stress_trend_degree is not None
        assert settings.background == "kept"
        assert experiment.spin_up_cycles == 2

    def test_what_is_given_is_used(self, write: Write) -> None:
        path = write(
            (
                "period_s = 300.0",
                "period_s = 301.0\nstrain_trend_degree = 3\nstress_trend_degree = 2\n"
                'background = "kept"\nspin_up_cycles = 8',
            )
        )
        experiment = load_forced_oscillation(path)
        settings = experiment.settings
        assert settings.period == experiment.prepared.strain_fit.period == 301.0
        assert (settings.strain_trend_degree, settings.stress_trend_degree) == (3, 2)
        assert experiment.prepared.strain_fit.degree == 3
        assert experiment.prepared.stress_fit.degree == 2
        assert experiment.spin_up_cycles == 8
        np.testing.assert_array_equal(experiment.stress, experiment.record.stress)

    def test_columns_by_number_of_a_file_between_spaces(self, write: Write) -> None:
        table = pd.read_csv(io.StringIO(stress_csv()))
        columns = table.assign(strain=1e-3 * table["time"], sd=4)[
            ["time", "strain", "stress", "sd"]
        ]
        both = columns.to_csv(index=False, header=False, sep=" ")
        path = write(
            ("[data]", '[data]\nseparator = "whitespace"\nheader = false'),
            ("strain.csv", "stress.csv"),
            ('strain_time_column = "time"\nstrain_time_unit = "s"', "strain_time_column = 1"),
            ('strain_column = "strain"', 'strain_time_unit = "min"\nstrain_column = 3'),
            ('stress_time_column = "time"', "stress_time_column = 1"),
            ('stress_column = "stress"', "stress_column = 3"),
            ('stress_uncertainty_column = "sd"', "stress_uncertainty_column = 4"),
            stress=both,
        )
        record = load_forced_oscillation(path).record
        np.testing.assert_allclose(record.strain_time, record.stress_time)
        np.testing.assert_allclose(record.stress_uncertainty, 4e6)
        np.testing.assert_allclose(record.strain_uncertainty, 2e-5)


class TestWithBackground:
    def test_there_and_back(self, write: Write) -> None:
        removed = load_forced_oscillation(write(REMOVED))
        assert removed.notices == (REMOVED_NOTICE,)
        kept = with_background(removed, "kept")
        assert kept.notices == ()
        assert kept.settings.background == kept.prepared.background == "kept"
        np.testing.assert_array_equal(kept.stress, kept.record.stress)
        assert kept.settings.period == removed.settings.period
        assert_equal(with_background(kept, "removed"), removed)

    def test_it_is_what_the_file_would_give(self, write: Write) -> None:
        changed = with_background(load_forced_oscillation(write()), "removed")
        read: OscillationExperiment = load_forced_oscillation(write(REMOVED))
        assert_equal(changed, read)

    def test_it_takes_a_record_and_one_of_two_words(self, write: Write) -> None:
        record = load_forced_oscillation(write())
        cases: list[tuple[Any, Any, str]] = [
            (record, "keep", "background: found 'keep', did you mean 'kept'?"),
            (load_experiment(ICE / "PIL40.toml"), "kept", "PIL40: found a test of protocol"),
            (
                replace(record, imposed=ImposedCycles(300.0, 1e-4, 2.0)),
                "kept",
                "sample-1: found imposed cycles, expected a record.",
            ),
        ]
        for test, word, refused in cases:
            with pytest.raises(InputError, match=re.escape(refused)):
                with_background(test, word)
