"""What `pyburgers new` writes for a test at constant strain rate."""

import re
from collections.abc import Collection, Mapping, Sequence
from typing import Any

from pyburgers.protocols.column_facts import read_together
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
from pyburgers.protocols.limits import slope_of
from pyburgers.protocols.new_file import (
    STRAIN_RATE,
    STRESS_ERROR,
    Columns,
    Description,
    NewFile,
    column_lines,
    compression_of,
    layout_lines,
    line,
    optional,
    with_comment,
)
from pyburgers.protocols.quantities import ENGINEERING

BESIDE = "compared with the rates"


class ConstantRateFile(NewFile):
    """One segment, whose rate is asked for; curves against strain or time."""

    experiment = ConstantRateExperiment
    needed = (("strain", "time"), ("stress",))
    quantities = frozenset({"strain", "time", "stress"})
    questions = (STRAIN_RATE, STRESS_ERROR)

    def suits(self, columns: Columns) -> str | None:
        """Return that there is a curve; one that oscillates or creeps is asked about before."""
        return f"there are {'strain' if 'strain' in columns else 'time'} and stress"

    def read(self, columns: Columns) -> Columns:
        """Return strain and stress, or time and stress; times beside strains show the rate."""
        found = dict(super().read(columns))
        if "strain" in found and "time" in found:
            is_usable = found["time"].is_decided and not found["time"].is_foreign
            found = found if is_usable else {k: one for k, one in found.items() if k != "time"}
        return found

    def proposed(self, columns: Columns, given: Mapping[str, Any]) -> Mapping[str, Any]:
        """Return the slope of strain over time as the rate."""
        if not {"strain", "time"} <= columns.keys():
            return {}
        slope = slope_of(*read_together(columns["time"].si, columns["strain"].si))
        return {STRAIN_RATE.name: float(f"{abs(slope):.3g}")} if slope else {}

    def asked(self, columns: Columns, given: Mapping[str, Any]) -> Collection[str]:
        """Return the rate: a fit infers the error of a stress where none is stated."""
        return {STRAIN_RATE.name}

    def decided(self, test: Description) -> Sequence[str]:
        """Say that columns of engineering measures are taken as they are."""
        return [
            f"column {one.column!r} is taken as true {one.quantity}, though its name says "
            "engineering; --protocol loading_history turns it"
            for one in test.columns.values()
            if re.search(ENGINEERING, one.name.lower())
        ]

    def lines(self, test: Description) -> list[str]:
        """Return the segment and the columns of the curve."""
        position = "strain" if "strain" in test.columns else "time"
        late_strain = 20.0 if test.columns[position].unit == "percent" else 0.2
        error, of_what = test.values[STRESS_ERROR.name], "of a reading, in the unit of the stress"
        compression = compression_of(test)
        return [
            *(
                [line("compression", compression, "as in the text file; else positive"), ""]
                if compression == "negative"
                else []
            ),
            with_comment("[[segments]]", "one for each imposed strain rate"),
            line("start_strain", 0.0, "a fraction, where this rate starts"),
            line("strain_rate_per_s", test.values["strain_rate_per_s"]),
            "",
            "[data]",
            line("file", test.file),
            *layout_lines(test),
            *column_lines(test, position),
            *(column_lines(test, "time", comment=BESIDE) if position == "strain" else ()),
            *column_lines(test, "stress", comment="differential stress"),
            optional("stress_uncertainty = 0.05", of_what)
            if error is None
            else line("stress_uncertainty", error, of_what),
            optional("[[microstructure]]", "measured in the sample, at one strain or more"),
            optional(f"strain = {late_strain}", "in strain_unit of [data], else a fraction"),
            "# grain_size_m = 165e-6",
            "# grain_size_sd_m = 8e-6",
        ]


NEW_FILE = ConstantRateFile()
