"""Valley coordinates (`stan/charts/valley/`) of tests whose dashpot softens along strain.

Everything comes from the posterior mode: it is the reference point, its solution the smooth curve
that the pins lie on, and its residual sets their weight. Digitising jitter, short records, rate
steps and curves without a peak need no special care then, and the speed of a run, not its result,
is all that depends on it.
"""

from abc import abstractmethod
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.kinds.experiment import E, Experiment
from pyburgers.kinds.likelihood import AtMode, Chart, ChartUnsuited
from pyburgers.kinds.stan_data import Layout, PlainCoordinates, StanData, ends
from pyburgers.model.laws import DASHPOT_LAWS
from pyburgers.model.parameters import PLACE, PROGRAM_PARAMETERS
from pyburgers.model.priors import PriorSet
from pyburgers.model.variants import variant_of

N_PINS = 12
LEAST_RELATIVE_NOISE = (0.02, 0.006)
"""Of the stress: noise that the pins are taken to have at least, for epsilon_c1 and for the rest.

The conditional density of epsilon_c1 is known at a few places, from solutions that a few steps have
reached. Made narrower than that it is jagged: with noise of 0.6 % of the stress a draw took 800
steps. Those of the rest are closer to their solutions; too wide they leave draws correlated."""

MIN_FLOWING_POINTS = 4
FLOWING_SHARE = 0.5
"""Pins lie where the dashpot carries at least this share of the strain rate."""

N_PRIOR_DRAWS = 1000

NEAR_BOUND = 0.05
"""A mode within this fraction of a parameter's range above its lower bound leans on the bound."""

SMALL_PART = 0.02
"""Of the spring's compliance at the mode: the coordinate is linear in the compliance above it.

Where the Kelvin element is a second spring, a sixth is left of the compliance. With a tenth for
this part chains stayed there for tens of draws."""

NOISE_SCALED = ("maxwell_modulus", "kelvin_viscosity")
"""Parameters fixed by the response alone; the others' widths also come from priors of partners."""

FIXED_BY_STRAIN = "kelvin_modulus"
"""Fixed by the response where strain is read: in creep the Kelvin strain is stress over it.

Bounds of this modulus are bounds of the compliance, and log odds between them the same but for sign
and a constant: the plain coordinate is near linear in what strain fixes."""

SOLVED = {
    ("evolving", "evolving"): (
        "steady_state_fabric_factor",
        "critical_strain_grain_size",
        "critical_strain_fabric",
    ),
    ("constant", "evolving"): ("steady_state_fabric_factor", "critical_strain_fabric"),
    ("evolving", "constant"): ("steady_state_grain_size", "critical_strain_grain_size"),
}
"""What is solved for besides ln S_0, by the laws of grain size and fabric."""


@dataclass(frozen=True, eq=False)
class Pins:
    """What a test's response fixes, along its solution at the posterior mode; pins have (n_pins,).

    `knot_time`, `knot_stress` (n_knots,): the solution (s, Pa); equal times are the start of
        a leg.
    `knot`: knots at which the pins are.
    `unit`: unit of rates (1/s) of each pin.
    `path_strain`, `strain_rate`, `stress_rate`, `grain_size`: the solution there, rates (1, Pa) in
        the unit, grain size in m.
    `relative_noise`: of a reading near each pin, as a share of the stress; infinite where the pin
        counts by its time alone.
    `time_spent`: time (s) of the dashpot near each pin if ln S_0 is solved from times, else 0.
    `since_start`: time (s) from the start of the load over which the rates of a pin are averages;
        0: they are those at the pin.
    `readings`: number of readings for each pin that has noise.
    `reference_rate`: rate (1/s) that ln S_0 belongs to.
    `loading_time`: time (s) of the elastic rise, in which spring and Kelvin element give together.
    `noise`: parameter that widths follow.
    `seen_flow`, `replaced_deviation`: if ln S_0 is solved from times, the flow strain that data can
        just tell from none, over that at the mode, and the prior standard deviation (SI) of the
        parameter that ln S_0 replaces; else 0.
    """

    knot_time: FloatArray
    knot_stress: FloatArray
    knot: IntArray
    unit: FloatArray
    path_strain: FloatArray
    strain_rate: FloatArray
    stress_rate: FloatArray
    grain_size: FloatArray
    relative_noise: FloatArray
    time_spent: FloatArray
    since_start: FloatArray
    readings: FloatArray
    reference_rate: float
    loading_time: float
    noise: str
    seen_flow: float = 0.0
    replaced_deviation: float = 0.0

    @property
    def strain_is_read(self) -> bool:
        """Whether most of the readings where the dashpot flows are of the strain."""
        return self.noise == "strain_noise"


PINS_NUMBERS = ("reference_rate", "loading_time", "seen_flow", "replaced_deviation")
"""Of `Pins`, one of each test in the Stan data."""


@dataclass(frozen=True, eq=False)
class ValleyReference:
    """Reference point and pins of the valley coordinates of a test; `values` (n_parameters,).

    `coordinate`, `linear_from` (n_coordinates,): plain coordinates of the mode, and where each
        turns from logarithmic to linear, below 0 in the inverse; 0 keeps the plain one.
    `noise_exponent` (n_coordinates,): power of the noise with which each width grows.
    """

    values: FloatArray
    coordinate: FloatArray
    linear_from: FloatArray
    pins: Pins
    noise_exponent: FloatArray

    @property
    def knot(self) -> FloatArray:
        """Rows of knots as in `stan/charts/valley/pins.stan`, shape (n_knots, 3)."""
        pins = self.pins
        is_pin = np.isin(np.arange(pins.knot_time.size), pins.knot)
        times = np.diff(pins.knot_time, prepend=0.0)
        return np.column_stack([times, pins.knot_stress, is_pin])

    @property
    def pin(self) -> FloatArray:
        """Rows of pins as in `stan/charts/valley/pins.stan`, shape (n_pins, 10)."""
        pins = self.pins
        noises = np.maximum.outer(LEAST_RELATIVE_NOISE, pins.relative_noise)
        weights = pins.readings / noises**2
        return np.column_stack(
            [
                pins.path_strain,
                pins.stress_rate,
                pins.unit,
                np.log(pins.reference_rate / pins.unit),
                *weights,
                pins.strain_rate,
                pins.time_spent,
                pins.since_start,
                pins.grain_size,
            ]
        )


class ValleyChart(Chart[E]):
    """The valley coordinates, whose origin is at conditional medians given the mode."""

    name = "valley"

    def solved(self, priors: PriorSet, experiment: E) -> tuple[str, ...]:
        """Return the parameters that follow from the softening, none where nothing softens."""
        variant = variant_of(priors, experiment)
        return SOLVED.get((variant.grain_size, variant.fabric), ())

    @abstractmethod
    def pins(self, test: AtMode[E]) -> Pins:
        """Set the pins along the solution at the mode, or raise ChartUnsuited."""

    def reference(self, test: AtMode[E]) -> tuple[ValleyReference, FloatArray]:
        """Set the pins where priors suit; the mode lies at the origin."""
        solved = self.solved(test.priors, test.experiment)
        _check_priors(solved, test.priors, test.coordinates, test.experiment)
        mode, pins = test.mode, self.pins(test)
        reference = ValleyReference(
            values=np.array([mode.values[p.name] for p in PROGRAM_PARAMETERS]),
            coordinate=mode.coordinate,
            linear_from=_linear_from(mode.coordinate, test.coordinates, pins),
            pins=pins,
            noise_exponent=np.zeros(mode.coordinate.size),
        )
        return reference, np.zeros_like(mode.coordinate)

    def rescaled(
        self, reference: ValleyReference, test: AtMode[E], covariance: FloatArray
    ) -> ValleyReference:
        """Let widths grow with the noise (`noise_exponents`)."""
        fixed = (*NOISE_SCALED, *([FIXED_BY_STRAIN] if reference.pins.strain_is_read else []))
        slope = _slope_of_plain(reference.coordinate, reference.linear_from)
        exponents = noise_exponents(
            test.coordinates, test.priors, covariance * np.outer(slope, slope), fixed
        )
        return replace(reference, noise_exponent=exponents)

    def block(self, references: Sequence[ValleyReference | None], layout: Layout) -> StanData:
        """Return the block `stan/data/valley.stan`; None keeps the plain coordinates of a test."""
        # The width of a shared parameter follows the noise of no test.
        follows = [name not in layout.shared for name in layout.names]
        guides = [
            np.zeros((len(layout.own[test]), 3))
            if own is None
            else np.column_stack(
                [own.coordinate, own.linear_from, np.where(follows, own.noise_exponent, 0)]
            )[layout.own[test]]
            for test, own in enumerate(references)
        ]
        tests = [*references, *[None] * (layout.n_tests - len(references))]
        knots = [np.empty((0, 3)) if own is None else own.knot for own in tests]
        pins = [np.empty((0, 10)) if own is None else own.pin for own in tests]
        return {
            "knot_end": ends(len(knot) for knot in knots),
            "knot": np.concatenate(knots).tolist(),
            "pin_end": ends(len(pin) for pin in pins),
            "pin": np.concatenate(pins).tolist(),
            "guide": np.concatenate([np.empty((0, 3)), *guides]).tolist(),
            "reference_parameter": [
                [0.0] * len(PROGRAM_PARAMETERS) if own is None else own.values.tolist()
                for own in references
            ],
            **{
                name: [0.0 if own is None else getattr(own.pins, name) for own in references]
                for name in PINS_NUMBERS
            },
            "noise_parameter": [1 if own is None else PLACE[own.pins.noise] for own in references],
            "stretched_flow_slope": [] if references else [[0.0, 0.0]] * sum(map(len, layout.own)),
            "stretched_flow_reference": [] if references else [[0.0] * 4] * layout.n_tests,
        }


def quantile_places(path_strain: FloatArray, number: int) -> IntArray:
    """Places of pins: quantiles of path strains, not decreasing, where the dashpot flows."""
    n_flowing = path_strain.size
    if n_flowing < MIN_FLOWING_POINTS:
        raise ChartUnsuited(
            f"only {n_flowing} points lie where the dashpot flows, {MIN_FLOWING_POINTS} are needed"
        )
    quantiles = (np.arange(number) + 0.5) / number
    places = np.rint(quantiles * (n_flowing - 1)).astype(np.int64)
    _, first = np.unique(path_strain[places], return_index=True)
    return np.asarray(places[first])


def middle_of_rise(time: FloatArray, stress: FloatArray, elastic_rate: float) -> float:
    """Half of the time (s) up to which the spring takes half of the imposed rate (Pa/s) or more.

    If an element that relaxes at once takes more than the spring, it is that of the first step.
    """
    slow = np.diff(stress) <= 0.5 * elastic_rate * np.diff(time)
    end = int(np.argmax(slow)) if slow.any() else time.size - 1
    return 0.5 * float(time[max(end, 1)])


def noise_exponents(
    coordinates: PlainCoordinates, priors: PriorSet, covariance: FloatArray, names: Iterable[str]
) -> FloatArray:
    """Power of the noise by which widths grow: for some names 1 - posterior/prior variance."""
    rng = np.random.default_rng(0)
    exponents = np.zeros(len(coordinates.quantities))
    for name in (one for one in names if one in coordinates.quantities):
        k = coordinates.quantities.index(name)
        values = priors[name].distribution().rvs(N_PRIOR_DRAWS, random_state=rng)
        prior_variance = float(np.var(coordinates.of_quantity(k, values)))
        exponents[k] = np.clip(1 - covariance[k, k] / prior_variance, 0.0, 1.0)
    return exponents


def _check_priors(
    solved: Sequence[str], priors: PriorSet, coordinates: PlainCoordinates, experiment: Experiment
) -> None:
    """Ask for solved parameters between finite bounds, and for ln S_0 as a coordinate."""
    variant = variant_of(priors, experiment)
    if variant.grain_size == "piezometric":
        raise ChartUnsuited("the grain size follows a piezometer")
    if DASHPOT_LAWS[variant.maxwell].own_stress:
        law = variant.maxwell.replace("_", " ")
        raise ChartUnsuited(f"the stress at a rate is no product of powers with maxwell = {law}")
    if variant.hardening != "none":
        raise ChartUnsuited("the stress at a rate depends on the backstress")
    if not solved:
        raise ChartUnsuited("neither grain size nor fabric evolves")
    for name in solved:
        prior = priors[name]
        if prior.is_fixed or not np.isfinite([prior.lower, prior.upper]).all():
            raise ChartUnsuited(f"{name} is not free between two finite bounds")
    fabric = "steady_state_fabric_factor"
    if fabric in solved and priors[fabric].upper > 1:
        raise ChartUnsuited("the fabric may harden")
    if coordinates.replaced_parameter is None:
        raise ChartUnsuited("neither Q_M nor beta leaves its place to the reference stress")


def _linear_from(position: FloatArray, coordinates: PlainCoordinates, pins: Pins) -> FloatArray:
    """Where coordinates turn from logarithmic to linear (below 0: linear in the inverse).

    Modes that lean on a lower bound do from their odds on, the Maxwell modulus from a part of
    itself.
    """
    odds = np.exp(position)
    bounded = np.isfinite(coordinates.lower) & np.isfinite(coordinates.upper)
    linear: FloatArray = np.where(bounded & (odds < NEAR_BOUND), odds, 0.0)
    if "maxwell_modulus" in coordinates.quantities:
        k = coordinates.quantities.index("maxwell_modulus")
        if np.isinf(coordinates.upper[k]) and coordinates.lower[k] == 0.0:
            linear[k] = -SMALL_PART / odds[k]
    if pins.strain_is_read and FIXED_BY_STRAIN in coordinates.quantities:
        linear[coordinates.quantities.index(FIXED_BY_STRAIN)] = 0.0
    return linear


def _slope_of_plain(position: FloatArray, linear_from: FloatArray) -> FloatArray:
    """Return derivatives of the plain coordinates by the straightened ones (`valley.stan`)."""
    slope = np.ones_like(position)
    bent = linear_from != 0
    ratio = np.exp(np.sign(linear_from[bent]) * position[bent]) / np.abs(linear_from[bent])
    slope[bent] = -np.expm1(-ratio) / ratio
    return slope
