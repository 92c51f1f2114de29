"""Files of loading histories: what a file says, read and written (docs/loading_history.md)."""

import itertools
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path
from typing import Annotated, Any, Literal

import numpy as np
from pydantic import Field, PlainValidator
from pydantic_core import PydanticCustomError

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import Table, all_of, factor_to_si, read_toml
from pyburgers.common.units import units_text
from pyburgers.kinds.experiment import MeasuredMicrostructure, Stated
from pyburgers.kinds.experiment_file import (
    PATH_STRAIN_ROUNDING,
    SIGNS_WERE_TURNED,
    Compression,
    ExperimentFile,
    Kind,
    MeasuredTable,
    check_increasing,
    measured_row,
    row_text,
    shared_values,
    sign_of,
    strain_factor,
)
from pyburgers.kinds.loading_history.driver import thinned, thinning_told
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.readings import (
    NO_READINGS,
    HistoryDataTable,
    Response,
    read_readings,
    responses,
)
from pyburgers.kinds.loading_history.stage_tables import (
    StageSource,
    check_given_strains,
    read_stages,
    stage_bounds,
)
from pyburgers.kinds.loading_history.stages import (
    Driven,
    Leg,
    Measure,
    Stage,
    StageTable,
    imposed_strains,
    legs_of,
)
from pyburgers.kinds.loading_history.true_readings import (
    check_loaded,
    true_readings,
    unlike_imposed,
    without_start,
    without_states_before,
)
from pyburgers.kinds.odd_readings import opposed_stresses, repeated

END: Literal["end"] = "end"
"""Of the test, in the place of a time: the sample was sectioned after it."""


def _checked_time(found: object) -> float | Literal["end"]:
    if found == END:
        return END
    if isinstance(found, bool) or not isinstance(found, int | float) or not np.isfinite(found):
        raise PydanticCustomError("time", 'a number or "end"')
    return float(found)


SectionTime = Annotated[float | Literal["end"], PlainValidator(_checked_time)]
"""A time in the unit of the stages, or the end of the test."""


class _PlaceTable(Table):
    """Where it was measured: at a time or a path strain."""

    time: SectionTime | None = Field(
        None, description='the time in the unit stage_time_unit, or "end" of the test'
    )
    strain: float | None = Field(
        None, gt=0, description="the path strain, in the place of the time"
    )


class SectionTable(MeasuredTable, _PlaceTable):
    """One of the tables [[microstructure]] of a loading history."""


class _ApparatusTable(Table):
    compliance_per_Pa: float = Field(  # noqa: N815 - a key with its unit
        ge=0, description="strain over the first length for each Pa, of the apparatus alone"
    )
    compliance_sd_per_Pa: float = Field(0.0, ge=0, description="its standard deviation")  # noqa: N815


class _OffsetTable(Table):
    value: float = Field(description="the strain that is read from the sample at rest")
    sd: float = Field(0.0, ge=0, description="its standard deviation")
    unit: str = Field(description=units_text("strain"))


class LoadingHistoryFile(ExperimentFile):
    """The keys of the file of a loading history."""

    protocol: Literal["loading_history"] = Field(description="the kind of test")
    stage_time_unit: str = Field("s", description=units_text("time"))
    stage_stress_unit: str = Field("Pa", description=units_text("stress"))
    compression: Compression = Field("positive", description="its sign in stages and data")
    stress_measure: Measure = Field("true", description="of the stress, of stages and data")
    strain_measure: Measure = Field("true", description="of the strain, of stages and data")
    stages: list[StageTable] = Field(min_length=1, description="one table for each stage")
    apparatus: _ApparatusTable | None = Field(None, description="how compliant the apparatus is")
    strain_offset: _OffsetTable | None = Field(None, description="the zero of the strain readings")
    data: HistoryDataTable | None = Field(
        None, description="the table that names the data file; an empty cell is no reading"
    )
    microstructure: list[SectionTable] = Field(
        default_factory=list,
        description="one table for each section; path strains in the unit of [data]",
    )


def load_loading_history(path: Path, tables: Mapping[str, Any] | None = None) -> HistoryExperiment:
    """Read and check the file of a loading history; time counts from the start of its stages."""
    file = read_toml(path, LoadingHistoryFile, tables)
    values, (test, offset) = all_of(lambda: shared_values(path, file), lambda: _test(path, file))
    stages, changes = read_stages(test, file.stages)
    if file.data is None or not file.data.is_copy:
        check_given_strains(test, file.stages, stages)
    changes = [
        *test.readings.notes,
        *_turned(file, test),
        *_expanded(file),
        *changes,
        *unlike_imposed(test.readings, stages),
    ]
    found = responses(path, test.readings, stages)
    used, more = _used(test, found, stages, file.data)
    time, reading_stage, reading = used
    more += _of_other_sign(used, legs_of(stages))
    n_in_file = None if file.data is None else file.data.readings_in_file
    return HistoryExperiment(
        **values,
        stages=stages,
        time=time,
        reading_stage=reading_stage,
        reading=reading,
        stress_uncertainty=test.stress_error,
        strain_uncertainty=test.strain_error,
        apparatus_compliance=_apparatus(file),
        strain_offset=offset,
        n_readings_in_file=found[0].size if n_in_file is None else n_in_file,
        microstructure=_sections(test, file, legs_of(stages)),
        notices=tuple(dict.fromkeys([*file.notices, *changes, *more])),
    )


def _test(path: Path, file: LoadingHistoryFile) -> tuple[StageSource, Stated | None]:
    """Return what stages are read with, and the zero of strain."""
    second = factor_to_si(file.stage_time_unit, "time", f"{path}: key 'stage_time_unit'")
    pascal = factor_to_si(file.stage_stress_unit, "stress", f"{path}: key 'stage_stress_unit'")
    bounds, sign = stage_bounds(path, file.stages, second), sign_of(file.compression)
    offset = _strain_offset(path, file, sign)
    readings, apparatus = NO_READINGS, _apparatus(file)
    compliance = apparatus.value if apparatus else 0.0
    first = (offset.value, offset.sd) if offset else (0.0, 0.0)
    if file.data is not None:
        raw = read_readings(path, file.data, bounds, sign, sign * _held(file.stages, second))
        measures = file.stress_measure, file.strain_measure
        readings = true_readings(path, raw, *measures, first[0], compliance)
    test = StageSource(
        path=path,
        temperature=file.temperature_K,
        time_unit=file.stage_time_unit,
        second=second,
        pascal=pascal,
        sign=sign,
        stress_measure=file.stress_measure,
        strain_measure=file.strain_measure,
        bounds=bounds,
        readings=readings,
        stress_error=_uncertainty(path, file, "stress", readings.strain - first[0]),
        strain_error=_uncertainty(path, file, "strain", readings.strain - first[0]),
        first_strain=first,
        compliance=compliance,
    )
    return test, offset


def _held(tables: Sequence[StageTable], second: float) -> float:
    """Return the strain, with its sign in the file, imposed before the first hold; 0 if unknown."""
    held = 0.0
    for table in itertools.takewhile(lambda table: table.control != "hold_strain", tables):
        strains = [strain for knot in table.knots or () for strain in knot[1:2]]
        if table.control == "strain_rate":
            held += (table.strain_rate_per_s or 0.0) * second * (table.end_time - table.start_time)
        elif table.control == "strain_series" and strains:
            held += strains[-1] - strains[0]
        else:
            return 0.0
    return held


def _strain_offset(path: Path, file: LoadingHistoryFile, sign: int) -> Stated | None:
    table = file.strain_offset
    if table is None:
        return None
    unit = factor_to_si(table.unit, "strain", f"{path}: key 'unit' in [strain_offset]")
    return Stated(sign * unit * table.value, unit * table.sd)


def _apparatus(file: LoadingHistoryFile) -> Stated | None:
    table = file.apparatus
    return Stated(table.compliance_per_Pa, table.compliance_sd_per_Pa) if table else None


def _uncertainty(
    path: Path, file: LoadingHistoryFile, quantity: Driven, strain: FloatArray
) -> float | None:
    """Return the stated standard deviation of a true reading (SI), at the median true strain."""
    data = file.data
    if data is None:
        return None
    stated = data.in_si(f"{quantity}_uncertainty", f"{quantity}_unit", quantity, path)
    if stated is None:
        return None
    strain = strain[np.isfinite(strain)]
    if strain.size and getattr(file, f"{quantity}_measure") == "engineering":
        # The derivative of -ln(1 - e) is 1/(1 - e); a true stress is one of the first area (1 - e).
        stated *= float(np.median(np.exp(strain if quantity == "strain" else -strain)))
    return stated * (data.relaxation_strain or 1.0) if quantity == "stress" else stated


def _turned(file: LoadingHistoryFile, test: StageSource) -> list[str]:
    """Sentences about measures and signs."""
    notices = []
    if file.compression == "negative":
        notices.append(SIGNS_WERE_TURNED)
    measures = {"stress": file.stress_measure, "strain": file.strain_measure}
    turned = [name for name, measure in measures.items() if measure == "engineering"]
    if turned and file.data is not None:
        became = f"Engineering {' and '.join(turned)} became true by the measured length"
        _, strain = test.readings.of("strain")
        if strain.size:
            strain = strain - test.first_strain[0]
            length = np.exp(-strain[np.argmax(np.abs(strain))])
            became += (
                f": {file.compression} numbers are shortening, and the length goes to "
                f"{100 * length:.4g} % of the first one"
            )
        notices.append(f"{became}.")
    return notices


def _expanded(file: LoadingHistoryFile) -> list[str]:
    """Say that a change of the temperature is one of the length."""
    temperatures = [stage.temperature_K or file.temperature_K for stage in file.stages]
    step = max(temperatures) - min(temperatures)
    if file.data is None or file.data.is_copy or step == 0:
        return []
    return [
        f"Temperatures of stages differ by up to {step:.4g} K: thermal expansion is not in the "
        "model; subtract it from strains (its coefficient times the step of temperature)."
    ]


def _used(
    test: StageSource, found: Response, stages: tuple[Stage, ...], data: HistoryDataTable | None
) -> tuple[Response, list[str]]:
    """Return the readings of the response that are used, and sentences about the others."""
    if data is None:
        check_loaded(test.path, found, stages)
        return found, []
    used, notices = without_start(found, stages)
    if not data.is_copy:
        check_loaded(test.path, found, stages)
        is_said = data.stage_column is not None
        rest, stated = test.first_strain, test.strain_error
        used, more = without_states_before(used, stages, rest, stated, side_is_said=is_said)
        notices += [*more, *_repeated(used)]
    time, stage, value = used
    if time.size == 0:
        raise InputError(
            f"{test.readings.source}: found no reading but that at the start, before anything is "
            "imposed, expected readings after it."
        )
    legs = legs_of(stages)

    def changes(number: int) -> FloatArray:
        return np.array([leg.start_time for leg in legs if leg.stage == number])

    chosen = thinned(time, stage, value, changes, data.max_readings)
    return (time[chosen], stage[chosen], value[chosen]), [*notices, *thinning_told(chosen)]


def _repeated(used: Response) -> Iterator[str]:
    """Say where readings of one stage share times."""
    time, stage, value = used
    for number in np.unique(stage):
        own = stage == number
        yield from repeated(time[own], value[own], "time", f" of stage {number + 1}")


def _of_other_sign(used: Response, legs: Sequence[Leg]) -> list[str]:
    """Say where most stresses of the first loading oppose the strain that is imposed in it."""
    loading = [*itertools.takewhile(lambda leg: leg.driven == "strain", legs)]
    strains = imposed_strains(loading)
    if not strains.any():
        return []
    # No slack or noise ahead of the loading reaches half of the largest imposed strain.
    first = int(np.argmax(np.abs(strains) >= 0.5 * np.abs(strains).max()))
    back = (leg.start_time for leg in loading[first:] if leg.rate * strains[first] < 0)
    time, _, stress = used
    read = stress[time < next(back, loading[-1].end_time)]
    return opposed_stresses(read, compressed=bool(strains[first] > 0))


def _sections(
    test: StageSource, file: LoadingHistoryFile, legs: Sequence[Leg]
) -> tuple[MeasuredMicrostructure, ...]:
    """Check the tables [[microstructure]], whose path strains have the unit of [data]."""
    tables, is_rigid = file.microstructure, file.apparatus is None
    factor = strain_factor(test.path, None if file.data is None else file.data.strain_unit)
    start, end = file.stages[0].start_time, file.stages[-1].end_time
    times = [end if table.time == END else table.time for table in tables]
    for number, (table, time) in enumerate(zip(tables, times, strict=True), start=1):
        where = row_text(test.path, number)
        if (table.time is None) == (table.strain is None):
            found = "neither" if table.time is None else "both"
            raise InputError(
                f"{where}: found {found} of the keys 'time' and 'strain', expected one of them "
                '(time = "end" for a sample that was sectioned after the test).'
            )
        if time is not None and not start < time <= end:
            raise InputError(
                f"{where}: key 'time': found {time:g}, expected more than {start:g} and at most "
                f"{end:g} {test.time_unit}, where the test starts and ends."
            )
        if table.strain is not None:
            _check_strain(where, table.strain, factor, test, legs, is_rigid=is_rigid)
    check_increasing(test.path, "time", times)
    check_increasing(test.path, "strain", [table.strain for table in tables])
    return tuple(
        measured_row(
            test.path,
            number,
            table,
            strain=None if table.strain is None else table.strain * factor,
            time=None if time is None else time * test.second - float(test.bounds[0]),
        )
        for number, (table, time) in enumerate(zip(tables, times, strict=True), start=1)
    )


def _check_strain(
    where: str,
    strain: float,
    factor: float,
    test: StageSource,
    legs: Sequence[Leg],
    *,
    is_rigid: bool,
) -> None:
    """Check a path strain, which adds up whatever its sign, and is a true one."""
    if test.strain_measure == "engineering":
        raise InputError(
            f"{where}: key 'strain': found {strain:g} with engineering strains, expected the key "
            "'time' because a path strain is a true one."
        )
    imposed = [abs(leg.end_value) for leg in legs if leg.driven == "strain"]
    is_known = is_rigid and len(imposed) == len(legs)
    if is_known and strain * factor > (1 + PATH_STRAIN_ROUNDING) * sum(imposed):
        raise InputError(
            f"{where}: key 'strain': found {strain:g}, expected at most {sum(imposed) / factor:g}, "
            "the path strain at the end of the test."
        )


KIND = Kind(LoadingHistoryFile, load_loading_history)
