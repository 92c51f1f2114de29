"""Files of tests at an oscillating strain rate, and such tests simulated."""

from collections.abc import Mapping
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.forced_oscillation.experiment import (
    OscillationExperiment,
    load_forced_oscillation,
    with_known_strain,
)
from pyburgers.kinds.forced_oscillation.preparation import prepare
from pyburgers.kinds.kind import Kind

FloatArray = npt.NDArray[np.float64]

FABRIC_OF_OLIVINE = 1.0
"""Oscillating tests have no fabric evolution (Eq. 5 of the paper)."""


class ForcedOscillation(Kind[OscillationExperiment]):
    """Strain oscillates; the response is the stress along time."""

    name = "forced_oscillation"
    load = staticmethod(load_forced_oscillation)

    def without_data(self, experiment: OscillationExperiment) -> OscillationExperiment:
        """Return the test driven by the strain as it was fitted.

        What drives it and what it starts from come from its record.
        """
        return with_known_strain(experiment)

    def known_columns(
        self, experiment: OscillationExperiment, at: FloatArray
    ) -> Mapping[str, FloatArray]:
        """Return the strain, without its trend where that is removed, and the fabric."""
        return {
            "strain": experiment.prepared.strain(at),
            "fabric_factor": np.full_like(at, FABRIC_OF_OLIVINE),
        }

    def with_noise(
        self,
        experiment: OscillationExperiment,
        response: FloatArray,
        values: Mapping[str, float],
        rng: np.random.Generator,
    ) -> OscillationExperiment:
        """Put stresses and strains with noise in the place of others, prepared as measured ones.

        Period, degrees and the stress where the model starts are those of the test, and its fitted
        strain is the true one.
        """
        template, strain_time = experiment.prepared, experiment.record.strain_time
        noise = values["stress_noise"] * template.relative_uncertainty
        strain = template.strain_fit.periodic(strain_time) + template.strain_fit.trend(strain_time)
        strain_noise = experiment.record.strain_uncertainty
        record = replace(
            experiment.record,
            strain=strain + strain_noise * rng.standard_normal(strain.size),
            stress_time=template.time,
            stress=response + noise * rng.standard_normal(response.size),
            stress_uncertainty=template.uncertainty,
        )
        # Where the model starts, too: simulated data have no bias before they are there.
        settings = template.settings
        prepared = prepare(record, settings, experiment.id)
        return replace(experiment, record=record, settings=settings, prepared=prepared)


KIND = ForcedOscillation()
