"""True stress and strain of readings that were taken over the first area or length."""

from dataclasses import replace
from pathlib import Path
from typing import Literal

import numpy as np
from scipy.special import lambertw

from pyburgers.common.errors import InputError
from pyburgers.protocols.experiment import FloatArray
from pyburgers.protocols.loading_history.readings import Readings

Measure = Literal["true", "engineering"]


def true_readings(
    path: Path,
    readings: Readings,
    stress: Measure,
    strain: Measure,
    zero: float = 0.0,
    compliance: float = 0.0,
) -> Readings:
    """Turn engineering measures into true ones.

    With e the shortening over the first length, positive in compression, the true strain is -ln(1 -
    e). The true stress is that of `true_stress`. Strain that is read of a sample at rest is no
    shortening: it is taken off before, and put back. Where it is uncertain, its error is one of e,
    not turned. `zero`: strain that is read of a sample at rest (fraction), as it is known
    beforehand. `compliance`: of the apparatus (1/Pa), whose share strains that are read include.
    Raise InputError if a sample is shortened by all its length, or a stress has no strain beside
    it.
    """
    true_strain = readings.strain - zero
    if strain == "engineering":
        if np.any(true_strain >= 1):
            raise InputError(
                f"{readings.source}: found an engineering strain of {np.nanmax(true_strain):g},"
                " expected less than 1 (fraction) in compression: check its unit."
            )
        true_strain = -np.log1p(-true_strain)
    stresses = readings.stress
    if stress == "engineering":
        if np.any(np.isfinite(readings.stress) & np.isnan(true_strain)):
            raise InputError(
                f"{path}: key 'stress_measure': found 'engineering' and a stress without a strain "
                f"in {readings.source}, expected the strain of every reading, which tells the area."
            )
        stresses = true_stress(readings.stress, true_strain, compliance, where=str(path))
    return replace(readings, stress=stresses, strain=true_strain + zero)


def true_stress(
    force: FloatArray, strain: FloatArray, compliance: float, *, where: str
) -> FloatArray:
    """Return the true stress σ = f exp(C σ - ε): at constant volume the sample's strain is ε - C σ.

    `force`: f, over the first area (Pa). `compliance`: C of the apparatus (1/Pa). Raise InputError
    if no stress goes with a force and such a compliance.
    """
    rigid = force * np.exp(-strain)
    if compliance == 0:
        return np.asarray(rigid)
    if np.any(compliance * rigid > np.exp(-1)):
        raise InputError(
            f"{where}: key 'compliance_per_Pa': found {compliance:g}, by which the apparatus takes "
            f"up a strain of more than {np.exp(-1):.2f} under {np.nanmax(rigid):.3g} Pa, expected "
            "a smaller compliance: check its unit."
        )
    return np.asarray(-lambertw(-compliance * rigid, 0).real / compliance)
