"""What `pyburgers new` writes for a test at constant strain rate."""

from collections.abc import Collection, Mapping, Sequence
from functools import lru_cache
from typing import Any

from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.experiment_file import slope_of
from pyburgers.kinds.guessed_columns import GuessedColumn
from pyburgers.kinds.loading_history.driver import rate_steps
from pyburgers.kinds.new_file import (
    LAYOUT,
    STRAIN_RATE,
    STRESS_ERROR,
    Columns,
    Description,
    NewFile,
    compression_of,
    line,
    read_together,
    with_comment,
)

TEMPLATE = f"""
compression = {{compression}}  # as in the text file; else positive

{{segments}}

[data]
file = {{file}}
{LAYOUT}\
strain_column = {{strain_column}}
strain_unit = {{strain_unit}}
time_column = {{time_column}}  # {{time_is}}
time_unit = {{time_unit}}
stress_column = {{stress_column}}  # differential stress
stress_unit = {{stress_unit}}
stress_uncertainty = {{stress_uncertainty}}  # of a reading, in the unit of the stress
#? stress_uncertainty = 0.05  # of a reading, in the unit of the stress
# [[microstructure]]  # measured in the sample, at one strain or more
# strain = {{late_strain}}  # in strain_unit of [data], else a fraction
# grain_size_m = 165e-6
# grain_size_sd_m = 8e-6
"""


class ConstantRateFile(NewFile):
    """Curves against strain or time. The rate is asked for, unless times show that it steps."""

    experiment = ConstantRateExperiment
    needed = (("strain", "time"), ("stress",))
    quantities = frozenset({"strain", "time", "stress"})
    questions = (STRAIN_RATE, STRESS_ERROR)
    template = TEMPLATE

    def recognise(self, columns: Columns) -> str | None:
        """Return that there is a curve; one that oscillates or creeps is asked about before."""
        return f"there are {'strain' if 'strain' in columns else 'time'} and stress"

    def select_columns(self, columns: Columns) -> Columns:
        """Return strain and stress, or time and stress; times beside strains show the rate."""
        found = dict(super().select_columns(columns))
        time = found.get("time")
        if "strain" in found and time is not None and (time.is_foreign or not time.is_decided):
            del found["time"]
        return found

    def propose_answers(self, columns: Columns, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the slope of strain over time as the rate."""
        if not {"strain", "time"} <= columns.keys():
            return {}
        slope = slope_of(*read_together(columns["time"].si, columns["strain"].si))
        return {STRAIN_RATE.name: float(f"{abs(slope):.3g}")} if slope else {}

    def required_answers(self, columns: Columns, given: Mapping[str, Any]) -> Collection[str]:
        """Return the rate, unless steps of it are seen; a fit infers the error of a stress."""
        return () if _steps(columns, given) else {STRAIN_RATE.name}

    def describe_decisions(self, test: Description) -> Sequence[str]:
        """Say where the rate steps."""
        steps = _steps(test.columns, test.values)
        by_strain = ", ".join(f"{rate:g} from {start:g}" for start, rate in steps)
        return [f"the strain rate (1/s) steps over the strain: {by_strain}"] * bool(steps)

    def filling(self, test: Description) -> Mapping[str, object]:
        """Return the sign of a compression that is negative, and what tells strain from time."""
        has_strain = "strain" in test.columns
        in_percent = test.columns["strain" if has_strain else "time"].unit == "percent"
        rates = _steps(test.columns, test.values) or ((0.0, test.values[STRAIN_RATE.name]),)
        return {
            "segments": _segment_lines(rates),
            "compression": "negative" if compression_of(test) == "negative" else None,
            "time_is": "compared with the rates" if has_strain else "",
            "late_strain": 20.0 if in_percent else 0.2,
        }


def _steps(columns: Columns, given: Mapping[str, Any]) -> tuple[tuple[float, float], ...]:
    """Return strains (fraction) and the rates (1/s) from there on; none if one rate is enough."""
    if given[STRAIN_RATE.name] is not None or not {"strain", "time"} <= columns.keys():
        return ()
    return _seen_steps(columns["time"], columns["strain"])


@lru_cache(maxsize=1)
def _seen_steps(time: GuessedColumn, strain: GuessedColumn) -> tuple[tuple[float, float], ...]:
    """Return steps that readings show: once for all questions about a file."""
    readings = read_together(time.si, strain.si)
    return () if slope_of(*readings) is None else rate_steps(*readings)


def _segment_lines(rates: Sequence[tuple[float, float]]) -> list[str]:
    """Return the segments of a file, with comments on the first."""
    (start, rate), *later = rates
    lines = [
        with_comment("[[segments]]", "one for each imposed strain rate"),
        line("start_strain", start, "a fraction, where this rate starts"),
        line("strain_rate_per_s", rate),
    ]
    for start, rate in later:
        lines += ["[[segments]]", line("start_strain", start), line("strain_rate_per_s", rate)]
    return lines


NEW_FILE = ConstantRateFile()
