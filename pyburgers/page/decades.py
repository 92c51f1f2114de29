"""What panels show of a quantity: one that spans decades by its logarithm."""

from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import ClassVar

import numpy as np
import numpy.typing as npt
import xarray as xr

from pyburgers.common.draws import FloatArray
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.stan_data import REFERENCE_FLOW_RATE
from pyburgers.model.display import shown_quantity
from pyburgers.model.parameters import Parameter
from pyburgers.model.prior_families import Prior
from pyburgers.posterior.labelled_draws import free_parameters, width_beside_prior

DECADES = 1.0
"""Decades between the ends of the central 90 % of draws from which the logarithm may be shown."""

_QUANTILES = np.linspace(0.0005, 0.9995, 1000)


def spans_decades(draws: FloatArray) -> bool:
    """Tell whether draws of a quantity, of any shape, go over decades and lie evenly in them."""
    ends = np.quantile(draws, [0.05, 0.5, 0.95])
    if not 0 < ends[0] * 10**DECADES <= ends[2]:
        return False
    return _unevenness(np.log(ends)) < _unevenness(ends)


def _unevenness(ends: FloatArray) -> float:
    """Distance of the median from the middle of the outer quantiles, 0 to 1."""
    low, median, high = ends
    return float(abs(low + high - 2 * median) / (high - low))


def logarithm_of(quantity: Parameter) -> Parameter:
    """Return how log10 of a quantity in its SI unit is called."""
    unit = rf"\mathrm{{{quantity.si_unit.replace(' ', chr(92) + ',')}}}"
    over = r"\,\mathrm{s}" if quantity.si_unit == "1/s" else f"/{unit}"
    return replace(
        quantity,
        symbol=rf"\log_{{10}}({quantity.symbol}{'' if quantity.si_unit == '1' else over})",
        quantity="dimensionless",
        display_unit="1",
    )


@dataclass(frozen=True)
class PriorOfLogarithm:
    """Prior of log10 of a parameter, with what panels ask of a prior."""

    family: ClassVar[str] = "of a logarithm"

    prior: Prior

    @property
    def lower(self) -> float:
        """Lower bound."""
        return float(np.log10(self.prior.lower)) if self.prior.lower > 0 else -np.inf

    @property
    def upper(self) -> float:
        """Upper bound."""
        return float(np.log10(self.prior.upper))

    def distribution(self) -> "PriorOfLogarithm":
        """Return the distribution of the logarithm."""
        return self

    def pdf(self, x: FloatArray) -> FloatArray:
        """Return the density for each decade."""
        value = 10.0 ** np.asarray(x)
        return np.asarray(self.prior.distribution().pdf(value) * value * np.log(10.0))

    def ppf(self, probability: npt.ArrayLike) -> FloatArray:
        """Return quantiles."""
        quantiles = np.maximum(
            self.prior.distribution().ppf(np.asarray(probability, dtype=np.float64)), 1e-300
        )
        return np.asarray(np.log10(quantiles))

    def std(self) -> float:
        """Return the standard deviation."""
        return float(np.std(self.ppf(_QUANTILES)))


@dataclass(frozen=True)
class ShownDraws:
    """What panels show of a quantity: `draws` (dimensions chain and draw) and `truth` in SI units.

    What follows from other parameters has no prior.
    """

    quantity: Parameter
    draws: xr.DataArray
    prior: Prior | PriorOfLogarithm | None
    truth: float | None

    @property
    def width_beside_prior(self) -> float:
        """Standard deviation of the draws over that of their prior, which there has to be."""
        assert self.prior is not None
        if isinstance(self.prior, PriorOfLogarithm):
            return float(self.draws.std(ddof=1)) / self.prior.std()
        return width_beside_prior(self.draws.to_numpy(), self.prior)


def shown_draws(fit: FittedTest, name: str) -> ShownDraws:
    """Return what panels show of a sampled quantity."""
    quantity, prior = shown_quantity(name), fit.priors.priors.get(name)
    truth = (fit.experiment.true_parameters or {}).get(name)
    draws: xr.DataArray = fit.posterior["posterior"].to_dataset()[name].transpose("chain", "draw")
    # Where the data hardly see the dashpot, its rate spans decades.
    if name != REFERENCE_FLOW_RATE and not spans_decades(draws.to_numpy()):
        return ShownDraws(quantity, draws, prior, truth)
    return ShownDraws(
        logarithm_of(quantity),
        draws.copy(data=np.log10(draws.to_numpy())),
        None if prior is None else PriorOfLogarithm(prior),
        float(np.log10(truth)) if truth else None,  # 0 lies beyond any panel
    )


@dataclass(frozen=True)
class Panels:
    """Quantities `names` that figures show below a title; those `beside` are in trade-offs only."""

    title: str
    names: tuple[str, ...]
    beside: tuple[str, ...] = ()


def panels_of(fit: FittedTest, elsewhere: Sequence[str] = ()) -> Panels:
    """Return the panels of a fit whose quantities `elsewhere` have figures of their own."""
    sampled = free_parameters(fit.posterior)
    own = tuple(name for name in sampled if name not in elsewhere)
    return Panels(fit.experiment.title, own, tuple(name for name in sampled if name in elsewhere))
