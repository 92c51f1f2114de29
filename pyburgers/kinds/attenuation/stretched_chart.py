"""Set-up of the stretched coordinates (`stan/charts/stretched.stan`) near the posterior mode."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np
import numpy.typing as npt

from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.coordinates import Layout
from pyburgers.kinds.likelihood import AtMode, Chart, ChartUnsuited
from pyburgers.kinds.stan_data import CHART, StanData

FloatArray = npt.NDArray[np.float64]

POSITIVE = ("kelvin_modulus", "kelvin_viscosity")
"""Parameters whose logarithms are shifted."""

SMALL_SHARE = 0.03
"""Of the loss in some row: what data say of a dashpot is asked where it carries that much, or at
the mode where it carries more."""

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

    `log_seen_rate`: ln of the flow rate (1/s) that data can just tell from none.
    `rate_at_mode`: flow rate of the mode over that one.
    `log_width`: of ln(flow rate) where the dashpot is not seen, at least 1.
    `log_middle_time`: ln of a time (s) in the middle of what the periods see.
    `unit`: of each coordinate, shape (n_coordinates,).
    `slope`: shift of each coordinate by the flow rate over that one, shape (n_coordinates,).
    """

    log_seen_rate: float
    rate_at_mode: float
    log_width: float
    log_middle_time: float
    unit: FloatArray
    slope: FloatArray


class StretchedChart(Chart[AttenuationExperiment]):
    """The stretched coordinates."""

    name = "stretched"

    def reference(
        self, test: AtMode[AttenuationExperiment]
    ) -> tuple[StretchedReference, FloatArray]:
        """Find the flow rate that data can tell from none, and what other elements give for it.

        Raise ChartUnsuited if no flow rate is sampled, or a prior of the Kelvin element is not on
        all positive numbers.
        """
        coordinates = test.coordinates
        if coordinates.replaced_parameter is None:
            raise ChartUnsuited("neither Q_M nor beta leaves its place to the flow rate")
        for k, name in enumerate(coordinates.parameters):
            if name in POSITIVE and not (
                coordinates.lower[k] == 0 and np.isinf(coordinates.upper[k])
            ):
                raise ChartUnsuited(f"the prior of {name} is not on all positive numbers")
        reference = _with_units(test, _reference(test))
        return reference, _at_mode(test, reference)

    def block(self, references: Sequence[StretchedReference], layout: Layout) -> StanData:
        """Return the block `stan/data/stretched.stan`."""
        if not references:
            n = len(layout.names)
            references = [
                StretchedReference(0.0, 0.0, 1.0, 0.0, np.ones(n), np.zeros(n))
            ] * layout.n_tests
        return _block(references, layout.own)


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
            [one.log_seen_rate, one.rate_at_mode, one.log_width, one.log_middle_time]
            for one in references
        ],
    }


def _flow(test: AtMode[AttenuationExperiment]) -> int:
    """Return the place of the flow rate among the coordinates."""
    replaced = test.coordinates.replaced_parameter
    assert replaced is not None  # looked at by `StretchedChart.reference`
    return test.coordinates.parameters.index(replaced)


def _at_mode(test: AtMode[AttenuationExperiment], reference: StretchedReference) -> FloatArray:
    """Return the coordinates of the mode."""
    return np.atleast_1d(test.generated(**_block([reference]))["stretched_coordinate"])


def _precision(
    test: AtMode[AttenuationExperiment], reference: StretchedReference, position: FloatArray
) -> FloatArray:
    """Return the curvature of minus the log density in the chart."""
    block = {**_block([reference]), "coordinate_system": CHART}
    return np.asarray(np.linalg.inv(test.covariance(position, **block)))


def _reference(test: AtMode[AttenuationExperiment]) -> StretchedReference:
    """Set all but the units."""
    flow, n = _flow(test), len(test.coordinates.parameters)
    at_mode = test.generated()
    log_rate = float(at_mode["log_reference"][0])
    log_small = log_rate - float(at_mode["log_dashpot_share"][0]) + np.log(SMALL_SHARE)
    log_asked = max(log_rate, log_small)
    prior_width = float(np.sqrt(np.linalg.inv(test.curvature(use_likelihood=0))[flow, flow]))
    asked = StretchedReference(
        log_asked,
        float(np.exp(log_rate - log_asked)),
        max(1.0, prior_width * float(test.coordinates.scale[flow])),
        float(at_mode["log_middle_time"][0]),
        np.ones(n),
        np.zeros(n),
    )
    position = _at_mode(test, asked)
    position[flow] = 1.0  # of the rate that is asked about
    curvature = _precision(test, asked, position)
    others = [k for k, name in enumerate(test.coordinates.parameters) if name not in UNSHIFTED]
    across = curvature[others, flow] * (1.0 + 1.0 / asked.log_width)
    slope = np.zeros(n)
    slope[others] = -np.linalg.solve(curvature[np.ix_(others, others)], across)
    precision = float(_information(test, flow, log_asked - log_rate) + across @ slope[others])
    # One posterior standard deviation of the rate, where data have any say in it.
    seen = float(np.clip(1.0 / np.sqrt(max(precision, SEEN[1] ** -2)), *SEEN))
    return replace(
        asked,
        log_seen_rate=log_asked + np.log(seen),
        rate_at_mode=asked.rate_at_mode / seen,
        slope=slope * seen,
    )


def _information(test: AtMode[AttenuationExperiment], flow: int, log_distance: float) -> float:
    """Return the curvature of minus the log likelihood by the flow rate, over one off the mode."""

    def log_likelihood(rate: float) -> float:
        quantity = test.coordinates.quantity.copy()
        quantity[flow, 0] += log_distance + np.log(rate)
        return float(np.sum(test.generated(quantity=quantity.tolist())["log_lik"]))

    below, there, above = map(log_likelihood, (1.0 - STEP, 1.0, 1.0 + STEP))
    return (2.0 * there - below - above) / STEP**2


def _with_units(
    test: AtMode[AttenuationExperiment], reference: StretchedReference
) -> StretchedReference:
    """Take standard deviations at the mode, at its flow rate, for units."""
    others = np.delete(np.arange(reference.unit.size), _flow(test))
    precision = _precision(test, reference, _at_mode(test, reference))
    unit = reference.unit.copy()
    unit[others] = np.sqrt(np.diag(np.linalg.inv(precision[np.ix_(others, others)])))
    return replace(reference, unit=unit)
