"""Keys of the files of tests at constant rate, and which of them go together."""

import itertools
from collections.abc import Sequence
from pathlib import Path
from typing import Literal

from pydantic import Field

from pyburgers.common.columns import Cell, Column, DataFile, TextFilesTable
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table
from pyburgers.common.units import units_text
from pyburgers.kinds.experiment_file import Compression, ExperimentFile, MicrostructureTable


class SegmentTable(Table):
    """One of [[segments]]."""

    strain_rate_per_s: float = Field(gt=0, description="the imposed strain rate in 1/s")
    start_strain: float = Field(ge=0, description="the strain (fraction) at which the rate starts")
    file: DataFile | None = Field(None, description="the data file of this segment")
    rows: dict[str, Cell] | None = Field(
        None, description="the rows of the data file of the whole test that are of this segment"
    )


class DataTable(TextFilesTable):
    """The table [data]."""

    file: DataFile | None = Field(None, description="the data file of the whole test")
    strain_column: Column | None = None
    strain_unit: str | None = Field(None, description=units_text("strain"))
    time_column: Column | None = Field(
        None,
        description="the time, in place of the strain; beside it, to compare with the stated rates",
    )
    time_unit: str | None = Field(None, description=units_text("time"))
    stress_column: Column
    stress_unit: str = Field(description=units_text("stress"))
    stress_uncertainty: float | None = Field(
        None, gt=0, description="the standard deviation of a reading in the unit of the stress"
    )


class ConstantRateFile(ExperimentFile):
    """The keys of a file."""

    protocol: Literal["constant_rate"] = Field(description="the kind of test")
    compression: Compression = Field("positive", description="its sign in the data files")
    final_strain: float | None = Field(
        None, gt=0, description="the strain (fraction) at the end of the test"
    )
    segments: list[SegmentTable] = Field(min_length=1, description="one table for each rate")
    data: DataTable | None = Field(None, description="the table that names the data files")
    microstructure: list[MicrostructureTable] = Field(
        default_factory=list, description="one table for each strain; in the unit of [data]"
    )


def check_segments(path: Path, segments: Sequence[SegmentTable]) -> None:
    """Check that segments start at 0 and follow each other."""
    starts = [segment.start_strain for segment in segments]
    if starts[0] != 0:
        raise InputError(
            f"{path}: key 'start_strain' in [[segments]] number 1: found {starts[0]:g}, expected "
            "0, the start of the test."
        )
    for number, (before, after) in enumerate(itertools.pairwise(starts), start=2):
        if after <= before:
            raise InputError(
                f"{path}: key 'start_strain' in [[segments]] number {number}: found {after:g}, "
                f"expected more than {before:g}, where the segment before starts."
            )


def check_data_keys(path: Path, file: ConstantRateFile) -> None:
    """Check that keys about data files fit together."""
    with_file = [segment.file is not None for segment in file.segments]
    data = file.data
    if data is None:
        if any(with_file) or any(segment.rows for segment in file.segments):
            raise InputError(
                f"{path}: table [data] is missing, expected it because a segment names its data."
            )
        if file.final_strain is None:
            raise InputError(
                f"{path}: key 'final_strain' is missing, expected the strain (fraction) at the "
                "end of the test because there is no [data]."
            )
        return
    if data.file is not None and any(with_file):
        raise InputError(
            f"{path}: key 'file': found it in [data] and in [[segments]], expected one of the two."
        )
    with_rows = [segment.rows is not None for segment in file.segments]
    if any(with_rows) and (data.file is None or not all(with_rows)):
        raise InputError(
            f"{path}: key 'rows' in [[segments]]: expected it in every one of them or in none, and "
            "with it one 'file' in [data]."
        )
    if data.file is None and not all(with_file):
        raise InputError(
            f"{path}: key 'file' is missing, expected it in [data] or in every one of [[segments]]."
        )
    if data.strain_column is None and data.time_column is None:
        raise InputError(f"{path}: [data] needs a key 'strain_column' or 'time_column'.")
    data.check_pairs(path, "strain", "time")
