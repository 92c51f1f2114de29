"""Plain coordinates in which flow rates that data hardly see are stretched.

See `stan/charts/stretched_flow.stan`.
"""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np

from pyburgers.cmdstan.program import Density
from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.kinds.problem import Problem
from pyburgers.kinds.stan_data import Mode, StanData
from pyburgers.model.reference_quantities import REFERENCE_STRESS_QUANTITY

OFFSETS = np.arange(0.0, 16.0, 0.5)
"""Of ln(flow rate) from that of the mode: there the likelihood is looked at."""

MIN_CHANGE = 0.5
"""Of the log likelihood, from which on data see a rate while all else stays as it is."""

STEP = 0.1
"""Of differences, over the rate at which the curvature is asked."""

MAX_SEEN, MIN_PRECISION = 2.0, 1e-3
"""Standard deviations from none to the mode's rate above which data fix ln(rate) itself; least
precision of the rate over that at which it is asked."""

MIN_CURVATURE = 1e-9
"""Of a prior, which may bend the wrong way at the mode."""


def stretch_flows(
    problem: Problem, density: Density, modes: Sequence[Mode], mode: FloatArray
) -> tuple[StanData, FloatArray]:
    """Return data that stretch flow rates, and the mode in these coordinates, (n_coordinates,).

    The density and the mode are in plain coordinates, and stay so if data see the flow of each
    test, or the program stretches none. `modes`: that of each test.
    """
    if "stretched_flow_reference" not in density.data:
        return {}, mode
    layout, centre = problem.layout, mode.copy()
    slope = [np.zeros((len(own), 2)) for own in layout.own]
    reference = np.zeros((layout.n_tests, 4))
    for e, coordinates in enumerate(problem.coordinates):
        if coordinates.replaced_parameter is None:
            continue
        place = coordinates.parameters.index(coordinates.replaced_parameter)
        if place not in layout.own[e]:
            continue
        # Of a reference stress the rate at a stress goes by its inverse, to the stress exponent.
        exponent = 1.0
        if coordinates.quantities[place] == REFERENCE_STRESS_QUANTITY.name:
            exponent = -modes[e].values["stress_exponent"]
        scale = exponent * float(coordinates.scale[place])
        places, flow = layout.position[e, layout.own[e]], layout.own[e].index(place)
        found = _Flow(density, mode, places, flow, scale).stretched()
        if found is not None:
            log_seen, width, slope[e] = found
            own_log_rate = exponent * coordinates.shift[place] + scale * mode[places[flow]]
            at_mode = float(np.exp(-log_seen))
            reference[e] = own_log_rate + log_seen, at_mode, width, exponent
            centre[places] += slope[e][:, 1] * log_seen
            centre[places[flow]] = at_mode - log_seen / width
    if not reference.any():
        return {}, mode
    block = {
        "stretched_flow_slope": np.concatenate(slope).tolist(),
        "stretched_flow_reference": reference.tolist(),
    }
    return block, centre


@dataclass(frozen=True, eq=False)
class _Flow:
    """The flow rate of a test near the mode of a density.

    `places` (n_own,): the test's own coordinates; `flow`: which of them is ln(flow rate)/`scale`.
    """

    density: Density
    mode: FloatArray
    places: IntArray
    flow: int
    scale: float

    @property
    def by_prior(self) -> Density:
        """The density of the prior alone."""
        return self.density.with_data({"use_likelihood": 0})

    def stretched(self) -> tuple[float, float, FloatArray] | None:
        """Return ln of the rate that data can just tell from none, over the mode's, and the rest.

        The rest is the width of ln(rate) where it is not seen, and slopes (n_own, 2) of the other
        coordinates by the rate over that one and by ln(rate). None if data fix the rate.
        """
        change = self._log_likelihood(OFFSETS)
        seen_alone = np.flatnonzero(np.abs(change - change[0]) > MIN_CHANGE)
        if seen_alone.size == 0:
            return None
        asked = float(OFFSETS[max(0, seen_alone[0] - 1)])
        whole = np.linalg.inv(self.density.laplace(self._at(asked)))
        precision = np.asarray(whole[np.ix_(self.places, self.places)], dtype=np.float64)
        slope = self._given(precision)
        near = self._log_likelihood(asked + np.log([1 - STEP, 1.0, 1 + STEP]))
        if not np.isfinite(near).all():
            return None
        alone = near @ [-1.0, 2.0, -1.0] / STEP**2
        # One posterior standard deviation of the rate while all others give way.
        left = float(alone + precision[self.flow] @ slope / self.scale)
        if left > (MAX_SEEN * np.exp(asked)) ** 2:
            return None
        seen = 1.0 / np.sqrt(max(left, MIN_PRECISION))
        curvature, axes = np.linalg.eigh(
            self.by_prior.curvature(self.mode)[np.ix_(self.places, self.places)]
        )
        curvature = np.maximum(curvature, MIN_CURVATURE)
        prior: FloatArray = (axes * curvature) @ axes.T
        by_log_rate = self._given(prior)
        variance = float(axes[self.flow] ** 2 @ (1.0 / curvature))
        width = max(1.0, abs(self.scale) * float(np.sqrt(variance)))
        by_rate = (slope - by_log_rate) * seen
        return asked + float(np.log(seen)), width, np.column_stack([by_rate, by_log_rate])

    def _log_likelihood(self, log_rates: FloatArray) -> FloatArray:
        """Return it at ln(rates) over the mode's, all else being equal, minus infinity beyond."""
        points = np.array([self._at(one) for one in log_rates])
        posterior, prior = self.density.at(points), self.by_prior.at(points)
        solved = np.isfinite(posterior) & np.isfinite(prior)
        found = np.full(len(points), -np.inf)
        found[solved] = posterior[solved] - prior[solved]
        return found

    def _at(self, log_rate: float) -> FloatArray:
        """Return the mode with another rate, (n_coordinates,)."""
        place = self.mode.copy()
        place[self.places[self.flow]] += log_rate / self.scale
        return place

    def _given(self, precision: FloatArray) -> FloatArray:
        """Return slopes (n_own,) of others' conditional modes by ln(rate), its own 0."""
        others = np.delete(np.arange(len(precision)), self.flow)
        slope = np.zeros(len(precision))
        slope[others] = -np.linalg.solve(
            precision[np.ix_(others, others)], precision[others, self.flow]
        )
        return slope / self.scale
