"""Set-up of the stretched coordinates (`stan/charts/stretched.stan`) near the posterior mode."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt

from pyburgers.protocols.attenuation.experiment import AttenuationExperiment
from pyburgers.protocols.coordinates import Layout
from pyburgers.protocols.protocol import AtMode, Chart, ChartUnsuited
from pyburgers.protocols.stan_data import StanData

FloatArray = npt.NDArray[np.float64]

SMALL_SHARE = 0.03
"""Of the loss in some row: what data say of a dashpot is asked where it carries that much, or at the
mode where it carries more."""

STEP = 0.2
"""Of the differences, in units of that flow rate."""

SEEN = (1e-3, 1.0 / SMALL_SHARE)
"""Least and largest flow rate, in the same units, from which on it may count by itself."""


UNSHIFTED = (
    "stress_exponent",
    "grain_size_exponent",
    "activation_enthalpy",
    "beta",
    "attenuation_scatter",
    "modulus_scatter",
)
"""Parameters that give nothing for the dashpot: its own, and what a misfit would only add to."""


@dataclass(frozen=True, eq=False)
class StretchedReference:
    """What sets the stretched coordinates of a test up, as in `stan/data/stretched.stan`.

    Attributes
    ----------
    log_seen_rate : float
        ln of the flow rate (1/s) that data can just tell from none.
    rate_at_mode : float
        Flow rate of the mode over that one.
    log_width : float
        Of ln(flow rate) where the dashpot is not seen, at least 1.
    unit : array, shape (n_coordinates,)
        Of each coordinate, in plain ones.
    slope : array, shape (n_coordinates,)
        Shift of each plain coordinate by the flow rate over that one.
    """

    log_seen_rate: float
    rate_at_mode: float
    log_width: float
    unit: FloatArray
    slope: FloatArray


class StretchedChart(Chart[AttenuationExperiment]):
    """The stretched coordinates."""

    name = "stretched"

    def reference(
        self, test: AtMode[AttenuationExperiment]
    ) -> tuple[StretchedReference, FloatArray]:
        """Find the flow rate that data can tell from none, and what other elements give for it.

        Raises
        ------
        ChartUnsuited
            If no flow rate is sampled.
        """
        replaced = test.coordinates.replaced_parameter
        if replaced is None:
            raise ChartUnsuited("neither Q_M nor beta leaves its place to the flow rate")
        reference = _reference(test, test.coordinates.parameters.index(replaced))
        found = test.generated(**_block([reference]))
        return reference, np.atleast_1d(found["stretched_coordinate"])

    def block(self, references: Sequence[StretchedReference], layout: Layout) -> StanData:
        """Return the block `stan/data/stretched.stan`."""
        if not references:
            n = len(layout.names)
            references = [StretchedReference(0.0, 0.0, 1.0, np.ones(n), np.zeros(n))] * layout.n_tests
        return _block(references, [layout.own(e) for e in range(layout.n_tests)])


def _block(
    references: Sequence[StretchedReference], own: Sequence[Sequence[int]] | None = None
) -> StanData:
    """Return references with units and slopes of each test's own coordinates, all by default."""
    places = own or [range(one.unit.size) for one in references]
    by_test = list(zip(references, map(list, places), strict=True))
    return {
        "stretched_unit": np.concatenate([one.unit[k] for one, k in by_test]).tolist(),
        "stretched_slope": np.concatenate([one.slope[k] for one, k in by_test]).tolist(),
        "stretched_reference": [
            [one.log_seen_rate, one.rate_at_mode, one.log_width] for one in references
        ],
    }


def _reference(test: AtMode[AttenuationExperiment], flow: int) -> StretchedReference:
    """Set the chart up; `flow` is the place of the flow rate among the coordinates."""
    at_mode = test.generated()
    log_rate = float(at_mode["log_reference"][0])
    log_small = log_rate - float(at_mode["log_dashpot_share"][0]) + np.log(SMALL_SHARE)
    log_asked = max(log_rate, log_small)

    def moved_to(rate: float) -> StanData:
        """Put the mode's flow rate at one over the rate that is asked about."""
        quantity = test.coordinates.quantity.copy()
        quantity[flow, 0] += log_asked + np.log(rate) - log_rate
        return {"quantity": quantity.tolist()}

    below, there, above = (
        float(np.sum(test.generated(**moved_to(rate))["log_lik"]))
        for rate in (1.0 - STEP, 1.0, 1.0 + STEP)
    )
    curvature = test.curvature(**moved_to(1.0))
    others = [
        k for k, name in enumerate(test.coordinates.parameters) if name not in UNSHIFTED
    ]
    across = curvature[others, flow] / test.coordinates.scale[flow]
    slope = np.zeros(curvature.shape[0])
    slope[others] = -np.linalg.solve(curvature[np.ix_(others, others)], across)
    precision = (2.0 * there - below - above) / STEP**2 + across @ slope[others]
    # One posterior standard deviation of the rate, where data have any say in it.
    seen = float(np.clip(1.0 / np.sqrt(max(precision, SEEN[1] ** -2)), *SEEN))
    log_seen = log_asked + np.log(seen)
    unit = np.ones(curvature.shape[0])
    given_flow = np.delete(np.arange(unit.size), flow)
    variance = np.diag(np.linalg.inv(test.curvature()[np.ix_(given_flow, given_flow)]))
    unit[given_flow] = np.where(variance > 0, np.sqrt(np.abs(variance)), 1.0)
    prior_width = float(np.sqrt(np.linalg.inv(test.curvature(use_likelihood=0))[flow, flow]))
    return StretchedReference(
        log_seen,
        float(np.exp(log_rate - log_seen)),
        max(1.0, prior_width * float(test.coordinates.scale[flow])),
        unit,
        slope * seen,
    )
