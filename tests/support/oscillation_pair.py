"""Two synthetic records of one material: another amplitude, another temperature, one truth."""

from dataclasses import replace

import numpy as np
from conftest import ICE
from oscillation_records import until, with_record

from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment, with_background
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forward import simulate_data

TWIN_FILE = ICE.parent / "olivine" / "olivine_twin.toml"
SMALLER, WARMER = 0.8, 40.0
"""Strains of the second record over those of the first, and its temperature less that (K)."""


def oscillation_pair(end: float = np.inf) -> list[OscillationExperiment]:
    """Solutions at the truth of the olivine twin, with noise, up to a time (s)."""
    twin = with_background(load_forced_oscillation(TWIN_FILE), "removed")
    assert twin.true_parameters is not None
    record, made = until(twin.record, end), []
    for number, (factor, warmer) in enumerate([(1.0, 0.0), (SMALLER, WARMER)]):
        driven = replace(
            record,
            strain=factor * record.strain,
            strain_uncertainty=factor * record.strain_uncertainty,
        )
        test = replace(
            with_record(twin, driven),
            id=f"record_{number + 1}",
            temperature=twin.temperature + warmer,
        )
        rng = np.random.default_rng([20261122, number])
        made.append(simulate_data(test, twin.true_parameters, rng, source="the olivine twin"))
    return made
