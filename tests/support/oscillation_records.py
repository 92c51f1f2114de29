"""Records of oscillations in place of that of a test."""

from dataclasses import replace

from pyburgers.common.array_types import BoolArray
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forced_oscillation.preparation import (
    OscillationRecord,
    OscillationSettings,
    prepare,
)


def part_of(
    record: OscillationRecord, strains: BoolArray | slice, stresses: BoolArray | slice
) -> OscillationRecord:
    """Return some of the readings of a record."""
    return OscillationRecord(
        strain_time=record.strain_time[strains],
        strain=record.strain[strains],
        strain_uncertainty=record.strain_uncertainty[strains],
        stress_time=record.stress_time[stresses],
        stress=record.stress[stresses],
        stress_uncertainty=record.stress_uncertainty[stresses],
    )


def until(record: OscillationRecord, time: float) -> OscillationRecord:
    """Return the readings before a time (s)."""
    return part_of(record, record.strain_time < time, record.stress_time < time)


def with_record(
    test: OscillationExperiment,
    record: OscillationRecord,
    settings: OscillationSettings | None = None,
) -> OscillationExperiment:
    """Exchange the record of a test, and how it is prepared."""
    prepared = prepare(record, settings or test.settings, test.id)
    return replace(test, record=record, settings=prepared.settings, prepared=prepared)
