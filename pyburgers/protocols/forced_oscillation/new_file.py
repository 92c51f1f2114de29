"""What `pyburgers new` writes for a forced oscillation."""

from collections.abc import Collection, Mapping
from typing import Any

from pyburgers.protocols.column_facts import facts_of
from pyburgers.protocols.forced_oscillation.experiment import OscillationExperiment
from pyburgers.protocols.new_file import (
    STRESS_ERROR,
    Columns,
    Description,
    NewFile,
    Question,
    column_lines,
    layout_lines,
    line,
    optional,
    with_comment,
)


class ForcedOscillationFile(NewFile):
    """Strain and stress against one time, with errors that are asked for where none are read."""

    experiment = OscillationExperiment
    needed = (("time",), ("strain",), ("stress",))
    quantities = frozenset({"time", "strain", "strain_uncertainty", "stress", "stress_uncertainty"})
    questions = (
        Question(
            "strain_uncertainty", "standard deviation of a strain, in its unit", float, example=1.0
        ),
        STRESS_ERROR,
    )

    def suits(self, columns: Columns) -> str | None:
        """Return that the strain oscillates."""
        if {"time", "strain", "stress"} <= columns.keys() and facts_of(
            columns["strain"]
        ).oscillates:
            return "the strain goes back and forth"
        return None

    def taken(self, columns: Columns, given: Mapping[str, Any]) -> Collection[str]:
        """Return the errors that are not read."""
        return {question.name for question in self.questions} - set(columns)

    def lines(self, test: Description) -> list[str]:
        """Return the oscillation and the columns of both series."""
        lines = [
            with_comment("[oscillation]", "all optional"),
            optional("period_s = 300.0", "else estimated from the strain"),
            line("background", "kept", "or removed: docs/model.md"),
            "",
            "[data]",
            *layout_lines(test),
        ]
        for quantity in ("strain", "stress"):
            lines += [
                line(f"{quantity}_file", test.file),
                *column_lines(test, "time", f"{quantity}_time"),
                *column_lines(test, quantity),
            ]
            error = f"{quantity}_uncertainty"
            if error in test.columns:
                lines += column_lines(test, error)
            else:
                lines.append(line(error, test.values[error], f"of every {quantity}, in its unit"))
        return lines


NEW_FILE = ForcedOscillationFile()
