"""What `pyburgers new` writes for a loading history: creep, or a test driven by its readings."""

from collections.abc import Collection, Mapping
from typing import Any

import numpy as np

from pyburgers.common.text_tables import TextTable
from pyburgers.protocols.guessed_columns import GuessedColumn, goes_back_and_forth, numbers_of
from pyburgers.protocols.loading_history.experiment import LoadingHistory
from pyburgers.protocols.new_file import (
    STRAIN_RATE,
    Description,
    NewFile,
    Question,
    column_lines,
    layout_lines,
    line,
    optional,
    with_comment,
)

STEADY_STRESS = 0.05
"""Relative range of a stress that counts as constant."""

STRESS = Question("stress_MPa", "imposed stress in MPa", float)


class LoadingHistoryFile(NewFile):
    """One stage, driven by a stress or a rate that is given, or by the readings of the stress."""

    experiment = LoadingHistory
    needed = (("time",), ("strain", "stress"))
    questions = (STRAIN_RATE, STRESS)

    def suits(self, table: TextTable, columns: Mapping[str, GuessedColumn]) -> str | None:
        """Return that strain grows in time under a constant stress, or one that is not read."""
        if not {"time", "strain"} <= columns.keys():
            return None
        if "stress" not in columns:
            return "there are time and strain but no stress"
        stress = numbers_of(table, columns, "stress")
        level = np.median(stress)
        if (
            level
            and np.ptp(stress[stress.size // 10 :]) < STEADY_STRESS * abs(level)
            and not goes_back_and_forth(numbers_of(table, columns, "strain"))
        ):
            return "the stress stays the same while strain grows"
        return None

    def asked(self, columns: Collection[str], given: Mapping[str, Any]) -> Collection[str]:
        """Return the stress, unless a rate is given or there are readings to drive the test.

        Without a column of the strain a rate drives it: the stress is what was read.
        """
        if given[STRAIN_RATE.name] is not None:
            return ()
        if "strain" not in columns:
            return (STRAIN_RATE.name,)
        read = {"stress", "strain"} <= set(columns)
        return () if read and given[STRESS.name] is None else (STRESS.name,)

    def lines(self, test: Description) -> list[str]:
        """Return the stage and the columns."""
        times = numbers_of(test.table, test.columns, "time")
        values = test.values
        stage = [
            line("start_time", min(0.0, float(times.min()))),
            line("end_time", float(times.max())),
        ]
        if values.get("stress_MPa") is not None:
            control, own = "stress", [line("stress", values["stress_MPa"], "in stage_stress_unit")]
        elif values.get("strain_rate_per_s") is not None:
            own = [line("strain_rate_per_s", values["strain_rate_per_s"])]
            control = "strain_rate"
        else:
            control, own = "stress_series", []
        comment = {"stress_series": "the readings of the stress drive the test"}.get(
            control, "what is imposed; others: docs/loading_history.md"
        )
        return [
            line("stage_time_unit", test.columns["time"].unit, "of the stages; s, min or h"),
            line("stage_stress_unit", "MPa", "of the stages; Pa, MPa or GPa"),
            line("compression", "positive", "or negative: of stages and data"),
            line("strain_measure", "true", "or engineering; stress_measure likewise"),
            "",
            with_comment("[[stages]]", "one after the other, without gaps"),
            line("control", control, comment),
            *stage,
            *own,
            "",
            "[data]",
            line("file", test.file),
            *layout_lines(test),
            *column_lines(test, "time", comment="on the clock of the stages"),
            *column_lines(test, "strain"),
            *column_lines(test, "stress"),
            optional("strain_uncertainty = 0.002", "of a reading, in its unit"),
            optional("[[microstructure]]", "measured in the sample, at one time or more"),
            optional('time = "end"', "of the test; else in stage_time_unit"),
            "# grain_size_m = 165e-6",
            "# grain_size_sd_m = 8e-6",
        ]


NEW_FILE = LoadingHistoryFile()
