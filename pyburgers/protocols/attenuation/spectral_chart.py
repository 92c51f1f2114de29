"""Set-up of the spectral coordinates (`stan/charts/spectral.stan`) at the posterior mode."""

from collections.abc import Sequence

import numpy as np
import numpy.typing as npt

from pyburgers.protocols.attenuation.experiment import AttenuationExperiment
from pyburgers.protocols.coordinates import Layout
from pyburgers.protocols.protocol import AtMode, Chart, ChartUnsuited
from pyburgers.protocols.stan_data import StanData

FloatArray = npt.NDArray[np.float64]

SEEN_SHARE = 0.03
"""Of the loss in any row, from which on the dashpot is seen: less is lost in the scatter."""

POSITIVE = ("kelvin_modulus", "kelvin_viscosity", "peak_strength")
"""Parameters that are shifted or stretched by their logarithms."""


class SpectralChart(Chart[AttenuationExperiment]):
    """The spectral coordinates."""

    name = "spectral"

    def reference(self, test: AtMode[AttenuationExperiment]) -> tuple[FloatArray, FloatArray]:
        """Set the stretch of the flow rate and the middle of the band.

        Returns
        -------
        array, shape (2,)
            ln of the flow rate (1/s) at which the dashpot begins to be seen, and ln of a time (s)
            in the middle of the periods.
        array, shape (n_coordinates,)
            Spectral coordinates of the mode.

        Raises
        ------
        ChartUnsuited
            If the priors do not fit the coordinates.
        """
        coordinates = test.coordinates
        if coordinates.replaced_parameter is None:
            raise ChartUnsuited("neither Q_M nor beta leaves its place to the flow rate")
        for k, name in enumerate(coordinates.parameters):
            if name in POSITIVE and not (
                coordinates.lower[k] == 0 and np.isinf(coordinates.upper[k])
            ):
                raise ChartUnsuited(f"the prior of {name} is not on all positive numbers")
        at_mode = test.generated()
        seen = at_mode["log_reference"][0] - at_mode["log_dashpot_share"][0] + np.log(SEEN_SHARE)
        reference = np.array([seen, at_mode["log_middle_time"][0]])
        found = test.generated(spectral_reference=[reference.tolist()])
        return reference, np.atleast_1d(found["spectral_coordinate"])

    def block(self, references: Sequence[FloatArray], layout: Layout) -> StanData:
        """Return the block `stan/data/spectral.stan`."""
        plain = [np.zeros(2)] * layout.n_tests
        return {"spectral_reference": [one.tolist() for one in references or plain]}
