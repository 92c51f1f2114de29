"""What `pyburgers new` writes for a forced oscillation."""

from collections.abc import Collection, Mapping
from typing import Any

from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.new_file import LAYOUT, STRESS_ERROR, Columns, NewFile, Question, facts_of

TEMPLATE = f"""
[oscillation]  # all optional
# period_s = 300.0  # else estimated from the strain
background = "kept"  # or removed: docs/model.md

[data]
{LAYOUT}\
strain_file = {{file}}
strain_time_column = {{time_column}}
strain_time_unit = {{time_unit}}
strain_column = {{strain_column}}
strain_unit = {{strain_unit}}
strain_uncertainty_column = {{strain_uncertainty_column}}
strain_uncertainty = {{strain_uncertainty}}  # of every strain, in its unit
stress_file = {{file}}
stress_time_column = {{time_column}}
stress_time_unit = {{time_unit}}
stress_column = {{stress_column}}
stress_unit = {{stress_unit}}
stress_uncertainty_column = {{stress_uncertainty_column}}
stress_uncertainty = {{stress_uncertainty}}  # of every stress, in its unit
"""


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
    template = TEMPLATE

    def recognise(self, columns: Columns) -> str | None:
        """Return that the strain oscillates."""
        is_complete = {"time", "strain", "stress"} <= columns.keys()
        oscillates = is_complete and facts_of(columns["strain"]).oscillates
        return "the strain goes back and forth" if oscillates else None

    def allowed_answers(self, columns: Columns, given: Mapping[str, Any]) -> Collection[str]:
        """Return the errors that are not read."""
        return {question.name for question in self.questions} - set(columns)


NEW_FILE = ForcedOscillationFile()
