"""Reference point and pins of the valley coordinates (`stan/charts/valley/`).

Everything comes from the posterior mode: it is the reference point, its solution the smooth curve
that the pins lie on, and its residual sets their weight. Digitising jitter, short records, rate
steps and curves without a peak need no special care then, and the speed of a run, not its result,
is all that depends on it.
"""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np
import numpy.typing as npt

from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.model.priors import PriorSet
from pyburgers.model.variants import variant_of
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment, strain_grid
from pyburgers.protocols.constant_rate.stan_data import ValleyReference, valley_block
from pyburgers.protocols.coordinates import Layout, PlainCoordinates
from pyburgers.protocols.protocol import AtMode, Chart, ChartUnsuited
from pyburgers.protocols.stan_data import StanData

FloatArray = npt.NDArray[np.float64]

N_PINS = 12
LEAST_RELATIVE_NOISE = (0.02, 0.006)
"""Of the stress: noise that the pins are taken to have at least, for epsilon_c1 and for the rest.

The conditional density of epsilon_c1 is known at a few places, from solutions that a few steps have
reached. Made narrower than that it is jagged: with noise of 0.6 % of the stress a draw took 800
steps. Those of the rest are closer to their solutions; too wide they leave draws correlated."""

MIN_FLOWING_POINTS = 4
FLOWING_SHARE = 0.5
"""Pins lie where the dashpot carries at least this share of the imposed rate."""

N_PRIOR_DRAWS = 1000

NEAR_BOUND = 0.05
"""A mode within this fraction of a parameter's range above its lower bound leans on the bound."""

SMALL_PART = 0.1

NOISE_SCALED = ("maxwell_modulus", "kelvin_viscosity")
"""Parameters fixed by stresses alone; the others' widths also come from priors of partners."""

SOLVED = ("steady_state_fabric_factor", "critical_strain_grain_size", "critical_strain_fabric")


class ValleyChart(Chart[ConstantRateExperiment]):
    """The valley coordinates, whose origin is at conditional medians given the mode."""

    name = "valley"
    solved = SOLVED

    def reference(self, test: AtMode[ConstantRateExperiment]) -> tuple[ValleyReference, FloatArray]:
        """Set the pins (`find_valley`); the mode lies at the origin."""
        return find_valley(test), np.zeros_like(test.mode.coordinate)

    def rescaled(
        self,
        reference: ValleyReference,
        test: AtMode[ConstantRateExperiment],
        covariance: FloatArray,
    ) -> ValleyReference:
        """Let widths grow with the noise (`noise_exponents`)."""
        exponents = noise_exponents(test.coordinates, test.priors, covariance)
        return replace(reference, noise_exponent=exponents)

    def block(self, references: Sequence[ValleyReference], layout: Layout) -> StanData:
        """Return the block `stan/data/valley.stan`."""
        return valley_block(references, layout)


def find_valley(test: AtMode[ConstantRateExperiment]) -> ValleyReference:
    """Set the pins along the solution at the posterior mode.

    Parameters
    ----------
    test : AtMode
        A test with data at its mode.

    Raises
    ------
    ChartUnsuited
        If the priors or the record do not fit the coordinates.
    """
    experiment, mode, coordinates = test.experiment, test.mode, test.coordinates
    variant = variant_of(test.priors, experiment)
    if variant.grain_size == "piezometric":
        raise ChartUnsuited("the grain size follows a piezometer")
    if variant.maxwell == "hyperbolic_sine":
        raise ChartUnsuited("the stress at a rate is no product of powers in a hyperbolic sine")
    _check_priors(test.priors, coordinates)
    observed = test.solution(np.unique(experiment.strain))
    flowing = np.isin(
        experiment.strain,
        observed["grid_strain"][observed["grid_dashpot_share"] >= FLOWING_SHARE],
    )
    n_flowing = int(flowing.sum())
    if n_flowing < MIN_FLOWING_POINTS:
        raise ChartUnsuited(
            f"only {n_flowing} points lie where the dashpot flows, {MIN_FLOWING_POINTS} are needed"
        )
    quantiles = (np.arange(N_PINS) + 0.5) / N_PINS
    pin_strain = np.unique(np.quantile(experiment.strain[flowing], quantiles))
    knots = test.solution(_knot_strain(experiment, pin_strain))
    pin_knot = np.searchsorted(knots["grid_strain"], pin_strain)
    segment = np.searchsorted(
        [s.start_strain for s in experiment.segments[1:]], pin_strain, side="left"
    )
    rate = np.array([s.strain_rate for s in experiment.segments])[segment]
    stress = knots["grid_stress"][pin_knot]
    relative_noise = mode.values["stress_noise"] / stress
    weights = [
        n_flowing / pin_strain.size / np.maximum(relative_noise, least) ** 2
        for least in LEAST_RELATIVE_NOISE
    ]
    time = experiment.time_at(knots["grid_strain"])
    is_pin = np.isin(np.arange(time.size), pin_knot)
    return ValleyReference(
        values=np.array([mode.values[p.name] for p in PROGRAM_PARAMETERS]),
        coordinate=mode.coordinate,
        linear_from=_linear_from(mode.coordinate, coordinates),
        knot=np.column_stack([np.diff(time, prepend=0.0), knots["grid_stress"], is_pin]),
        pin=np.column_stack(
            [
                pin_strain,
                knots["grid_stress_slope"][pin_knot],
                rate,
                np.log(experiment.segments[0].strain_rate / rate),
                *weights,
            ]
        ),
        noise_exponent=np.zeros(mode.coordinate.size),
    )


def noise_exponents(
    coordinates: PlainCoordinates, priors: PriorSet, covariance: FloatArray
) -> FloatArray:
    """Power of the stress noise with which the posterior width of each coordinate grows.

    Parameters
    ----------
    coordinates : PlainCoordinates
        What the coordinates stand for.
    priors : PriorSet
        Resolved priors.
    covariance : array, shape (n_coordinates, n_coordinates)
        Laplace approximation of the posterior in valley coordinates.

    Returns
    -------
    array, shape (n_coordinates,)
        1 - posterior variance/prior variance, between 0 and 1, for `NOISE_SCALED`; 0 for others.
    """
    rng = np.random.default_rng(0)
    exponents = np.zeros(len(coordinates.quantities))
    for name in NOISE_SCALED:
        if name not in coordinates.quantities:
            continue
        k = coordinates.quantities.index(name)
        values = priors[name].distribution().rvs(N_PRIOR_DRAWS, random_state=rng)
        prior_variance = float(np.var(coordinates.of_quantity(k, values)))
        exponents[k] = np.clip(1 - covariance[k, k] / prior_variance, 0.0, 1.0)
    return exponents


def _check_priors(priors: PriorSet, coordinates: PlainCoordinates) -> None:
    """Ask for solved parameters between finite bounds, and for ln S_0 as a coordinate."""
    for name in SOLVED:
        prior = priors[name]
        if prior.is_fixed or not np.isfinite([prior.lower, prior.upper]).all():
            raise ChartUnsuited(f"{name} is not free between two finite bounds")
    if priors["steady_state_fabric_factor"].upper > 1:
        raise ChartUnsuited("the fabric may harden")
    if coordinates.replaced_parameter is None:
        raise ChartUnsuited("neither Q_M nor beta leaves its place to the reference stress")


def _knot_strain(experiment: ConstantRateExperiment, pin_strain: FloatArray) -> FloatArray:
    """Strains of the piecewise linear reference curve: dense at each segment's start."""
    shape = np.union1d(np.geomspace(1e-3, 1.0, 25), np.linspace(0.0, 1.0, 16)[1:])
    strain: FloatArray = np.union1d(strain_grid(experiment, shape), pin_strain)
    return strain


def _linear_from(position: FloatArray, coordinates: PlainCoordinates) -> FloatArray:
    """Where coordinates turn from logarithmic to linear (below 0: linear in the inverse).

    Modes that lean on a lower bound, from their odds (value - lower)/(upper - value) on; and the
    inverse of the Maxwell modulus, from a small part of its value at the mode on.
    """
    odds = np.exp(position)
    bounded = np.isfinite(coordinates.lower) & np.isfinite(coordinates.upper)
    linear: FloatArray = np.where(bounded & (odds < NEAR_BOUND), odds, 0.0)
    if "maxwell_modulus" in coordinates.quantities:
        k = coordinates.quantities.index("maxwell_modulus")
        if np.isinf(coordinates.upper[k]) and coordinates.lower[k] == 0.0:
            linear[k] = -SMALL_PART / odds[k]
    return linear
