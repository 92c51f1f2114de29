"""Two synthetic records of one material: another amplitude, another temperature, one truth."""

from dataclasses import replace

import numpy as np
from conftest import ICE

from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment, with_background
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forced_oscillation.preparation import prepare
from pyburgers.kinds.forward import simulate_data

TWIN_FILE = ICE.parent / "olivine" / "olivine_twin.toml"
SMALLER, WARMER = 0.8, 40.0
"""Strains of the second record over those of the first, and its temperature less that (K)."""


def oscillation_pair(until: float = np.inf) -> list[OscillationExperiment]:
    """Solutions at the truth of the olivine twin, with noise, up to a time (s)."""
    twin = with_background(load_forced_oscillation(TWIN_FILE), "removed")
    assert twin.true_parameters is not None
    record, made = twin.record, []
    for number, (factor, warmer) in enumerate([(1.0, 0.0), (SMALLER, WARMER)]):
        strains, stresses = record.strain_time < until, record.stress_time < until
        driven = replace(
            record,
            strain_time=record.strain_time[strains],
            strain=factor * record.strain[strains],
            strain_uncertainty=factor * record.strain_uncertainty[strains],
            stress_time=record.stress_time[stresses],
            stress=record.stress[stresses],
            stress_uncertainty=record.stress_uncertainty[stresses],
        )
        test = replace(
            twin,
            id=f"record_{number + 1}",
            temperature=twin.temperature + warmer,
            record=driven,
            prepared=prepare(driven, twin.settings, twin.id),
        )
        rng = np.random.default_rng([20261122, number])
        made.append(simulate_data(test, twin.true_parameters, rng, source="the olivine twin"))
    return made
