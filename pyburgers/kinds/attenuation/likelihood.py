"""How tables of attenuation are sampled, and their stretched coordinates near the mode."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np

from pyburgers.common.array_types import BoolArray, FloatArray, IntArray
from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.table import ATTENUATION, MODULUS, CycleConditions, Readings
from pyburgers.kinds.likelihood import AtMode, Chart, ChartUnsuited, Likelihood, grid_quantities
from pyburgers.kinds.stan_data import CHART, Layout, StanData, ends, joined
from pyburgers.model.hardening import check_median_stress
from pyburgers.model.parameters import STRESS_EXPONENTS
from pyburgers.model.prior_families import is_fixed_at
from pyburgers.model.priors import PriorSet
from pyburgers.model.read_quantities import LOG_MODULUS, LOG_TAN_DELTA, Quantity
from pyburgers.model.reference_quantities import REFERENCE_FLOW_RATE_QUANTITY

POSITIVE = ("kelvin_modulus", "kelvin_viscosity")
"""Parameters whose logarithms are shifted."""

SMALL_SHARE = 0.03
"""Of the loss in some row: what data say of a dashpot is asked where it carries that much, or at
the mode where it carries more."""

STEP = 0.2
"""Of the differences, in units of that flow rate."""

SEEN = (1e-3, 1.0 / SMALL_SHARE)
"""Least and largest flow rate, in the same units, from which on it may count by itself."""


WIDE = 20.0
"""Width of ln(flow rate) where the prior density curves upwards at the mode, as a uniform may."""

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
    `unit`, `slope` (n_coordinates,): of each coordinate, and its shift by rate over seen rate.
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
        """Find the flow rate that data can tell from none, and what other elements give for it."""
        coordinates = test.coordinates
        if coordinates.replaced_parameter is None:
            raise ChartUnsuited("neither Q_M nor beta leaves its place to the flow rate")
        is_positive = (coordinates.lower == 0) & np.isinf(coordinates.upper)
        for name, is_suited in zip(coordinates.parameters, is_positive, strict=True):
            if name in POSITIVE and not is_suited:
                raise ChartUnsuited(f"the prior of {name} is not on all positive numbers")
        reference = _with_units(test, _reference(test))
        return reference, _at_mode(test, reference)

    def block(self, references: Sequence[StretchedReference], layout: Layout) -> StanData:
        """Return the block `stan/data/stretched.stan`."""
        n = len(layout.names)
        plain = StretchedReference(0.0, 0.0, 1.0, 0.0, np.ones(n), np.zeros(n))
        return _block(references or [plain] * layout.n_tests, layout.own)


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
    variance = np.linalg.inv(test.curvature(use_likelihood=0))[flow, flow]
    prior_width = float(test.coordinates.scale[flow] * np.sqrt(variance)) if variance > 0 else WIDE
    rate, width = float(np.exp(log_rate - log_asked)), max(1.0, prior_width)
    middle = float(at_mode["log_middle_time"][0])
    asked = StretchedReference(log_asked, rate, width, middle, np.ones(n), np.zeros(n))
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


FLOW_RATE_ORIGIN = 1e-7
"""Origin of the sampled flow rate (1/s): in cycles of a minute to an hour it is seen from there."""


QUADRATURE_HALF_WIDTH, QUADRATURE_STEPS = 3.2, 32
"""Of the double exponential rule on each part of half a period: good to 1e-12, kink or none."""

NO_ERROR = 1e-12
"""Stated error of a solution, which may have no scatter either: a normal law needs some width."""

NO_NODES = np.empty((0, 2))

NO_CONVERSION = (1.0, 0.0, 1.0)
"""Of a test that is no table, where it has no effect (`Elasticity.conversion`)."""

OF_ROWS = ("frequency", "row_temperature", "regime", "median_stress", "amplitude")
OF_READINGS = (
    *("reading", "quantity_of_point", "stated_error", "is_limit", "log_limit"),
    "log_reading_observed",
)
NO_TABLE: StanData = dict.fromkeys((*OF_ROWS, *OF_READINGS), ())
"""Entries of a test that is no table: of rows and of stresses that they share, and of readings."""


OF_GRID = ("grid_frequency", "grid_temperature", "grid_regime", "grid_quantity")
NO_GRID: StanData = dict.fromkeys((*OF_GRID, "grid_stated_error"), ())
"""Entries of its grid."""


NO_LIMIT = -1e3
"""ln(tan delta) that no reading is below."""


TYPICAL_SPREAD = (0.1, 0.01)
"""Of ln(tan delta) and ln(modulus): with stated errors, what residuals are weighed by where not all
errors are stated."""


OUTPUTS_PER_SPECTRUM, PREDICTIONS_PER_SPECTRUM = 60, 25
"""Places in a spectrum of a smooth curve, and of the predictive bands."""


class AttenuationLikelihood(Likelihood[AttenuationExperiment]):
    """Logarithms of tan delta and modulus are read.

    The clock is the place in the table: spectra, each along the logarithm of the period, stand one
    after the other, those of attenuation first.
    """

    name = "attenuation"
    clock = Quantity("place", "place", "1", "spectra", 1.0)
    read = (LOG_TAN_DELTA, LOG_MODULUS)
    response = Quantity("log_reading", "log_reading", "1", "in ln", 1.0)
    reference = REFERENCE_FLOW_RATE_QUANTITY
    grid_quantities = grid_quantities(
        "log_reading", "log_reading_replicated", "log_relaxation_time", "log_maxwell_time"
    )
    warmup = 500
    target_acceptance = 0.98
    chart = StretchedChart()

    def reference_origin(self, experiment: AttenuationExperiment) -> tuple[float, float]:
        """Origin and size of ln(flow rate s)."""
        return float(np.log(FLOW_RATE_ORIGIN)), 1.0

    def tests_block(
        self, experiments: Sequence[AttenuationExperiment], priors: Sequence[PriorSet]
    ) -> StanData:
        """Return the data of `stan/attenuation.stan` about its tables."""
        stresses = [experiment.largest_stress for experiment in experiments]
        return {"stress_scale": stresses, **tables_block(experiments)}

    def grid_block(
        self, experiments: Sequence[AttenuationExperiment | None], grids: Sequence[FloatArray]
    ) -> StanData:
        """Return the readings that are reported apart from the observed; None: no table."""
        entries = [
            NO_GRID if experiment is None else _grid_entries(experiment, grid)
            for experiment, grid in zip(experiments, grids, strict=True)
        ]
        sizes = (len(own["grid_frequency"]) for own in entries)
        return {"reading_grid_end": ends(sizes), **joined(entries)}

    def check_priors(self, experiment: AttenuationExperiment, priors: PriorSet) -> None:
        """Refuse readings without errors, and dashpots that need other stresses than are stated."""
        for name, stated in experiment.noises.items():
            if stated is None and is_fixed_at(priors[name], 0.0):
                raise InputError(
                    f"{experiment.id}: found readings without a stated error and no {name} in the "
                    f"priors {priors.title!r}, expected a prior of it in them."
                )
        linear = all(is_fixed_at(priors[name], 1.0) for name in STRESS_EXPONENTS)
        if not (experiment.amplitude_is_stated or linear):
            raise InputError(
                f"{experiment.id}: the amplitude of the stress is not stated, so that only a "
                "linear dashpot is known to answer it, found a stress exponent other than 1 in "
                f"the priors {priors.title!r}, expected amplitudes or the variant maxwell=linear, "
                "alone or with second_mechanism=diffusion."
            )
        check_median_stress(priors.priors, experiment.conditions.median_stress, experiment.id)

    def as_history(self, experiment: AttenuationExperiment) -> AttenuationExperiment:
        """Return the table: the program of loading histories takes it as it is."""
        return experiment

    def grid(self, experiment: AttenuationExperiment, *, fine: bool = False) -> FloatArray:
        """Return evenly spaced places in spectra of both quantities; fine ones with the rows."""
        per_spectrum = OUTPUTS_PER_SPECTRUM if fine else PREDICTIONS_PER_SPECTRUM
        conditions, shares = experiment.conditions, (np.arange(per_spectrum) + 0.5) / per_spectrum
        even = np.add.outer(np.arange(2 * conditions.n_spectra), shares).ravel()
        rows = [conditions.place, conditions.place + conditions.n_spectra] if fine else []
        return np.unique(np.concatenate([even, *rows]))

    def is_read(self, experiment: AttenuationExperiment, at: FloatArray) -> BoolArray:
        """Return which places are in spectra of attenuation, and which in those of moduli."""
        _, _, quantity = experiment.conditions.at(at)
        return np.stack([quantity == ATTENUATION, quantity == MODULUS])

    def along(self, experiment: AttenuationExperiment) -> dict[str, tuple[FloatArray, str]]:
        """Return places, periods, temperatures, spectra, limits, and errors if all are stated."""
        conditions, stated = experiment.conditions, experiment.stated_errors
        period, spectrum, quantity = conditions.at(experiment.position)
        is_stated = stated.size > 0 and bool(np.all(stated > 0))
        typical = np.hypot(np.array(TYPICAL_SPREAD)[quantity], stated)
        name, error = ("reading_error", stated) if is_stated else ("typical_error", typical)
        is_limit = experiment.response <= experiment.response_limit
        return {
            **super().along(experiment),
            "period": (period, "s"),
            "temperature": (conditions.temperature[conditions.first_rows[spectrum]], "K"),
            "segment": (np.floor(experiment.position), "1"),
            name: (error, "1"),
            **({"is_limit": (is_limit.astype(np.float64), "1")} if is_limit.any() else {}),
        }

    def reading_noise(
        self,
        experiment: AttenuationExperiment,
        values: Mapping[str, FloatArray],
        solved: FloatArray,
    ) -> FloatArray:
        """Return scatter and stated error of the logarithm of every reading together.

        An error of tan delta is over the solution, as in `stan/kinds/attenuation_response.stan`.
        """
        scatter = super().reading_noise(experiment, values, solved)
        over = np.where(experiment.quantity == ATTENUATION, experiment.response - solved, 0.0)
        return np.asarray(np.hypot(scatter, experiment.stated_errors * np.exp(over)))


def stress_nodes(median_stress: float, amplitude: float) -> FloatArray:
    """Return sin(omega t) and weights times 2/pi of the dashpot's fluidity, shape (n_nodes, 2).

    Half a period is split where the stress changes sign. Each part takes the double exponential
    rule (Takahasi and Mori 1974, Publ. RIMS 9, 721-741), which does not mind the kink of a power
    law.
    """
    ratio = median_stress / amplitude
    change = [-np.arcsin(ratio)] if ratio < 1 else []
    edges = np.array([-np.pi / 2, *change, np.pi / 2])
    t = QUADRATURE_HALF_WIDTH * np.linspace(-1.0, 1.0, 2 * QUADRATURE_STEPS + 1)
    inner = 0.5 * np.pi * np.sinh(t)
    x = np.tanh(inner)
    weight = 0.5 * np.pi * np.cosh(t) / np.cosh(inner) ** 2 * (t[1] - t[0])
    middle, half = 0.5 * (edges[1:] + edges[:-1]), 0.5 * np.diff(edges)
    angle = middle[:, np.newaxis] + np.multiply.outer(half, x)
    weights = 2 / np.pi * np.multiply.outer(half, weight)
    return np.column_stack([np.sin(angle).ravel(), weights.ravel()])


def tables_block(tests: Sequence[AttenuationExperiment | None]) -> StanData:
    """Return the block `stan/data/attenuation.stan` without its grid; None: the test is none."""
    entries = [NO_TABLE if test is None else _entries(test) for test in tests]
    block = joined(entries)
    nodes = [
        stress_nodes(median, amplitude) if amplitude > 0 else NO_NODES
        for median, amplitude in zip(block["median_stress"], block["amplitude"], strict=True)
    ]
    return {
        **block,
        "row_end": ends(len(own["frequency"]) for own in entries),
        "regime_end": ends(len(own["amplitude"]) for own in entries),
        "reading_end": ends(len(own["reading"]) for own in entries),
        "node_end": ends(map(len, nodes)),
        "node": np.concatenate([NO_NODES, *nodes]).tolist(),
        "conversion": [
            list(NO_CONVERSION if e is None else e.elasticity.conversion) for e in tests
        ],
    }


def _regimes(conditions: CycleConditions) -> tuple[FloatArray, IntArray]:
    """Stresses that rows have in common, shape (n, 2), and which each row has, from 0."""
    both = np.column_stack([conditions.median_stress, conditions.amplitude])
    found, places = np.unique(both, axis=0, return_inverse=True)
    return found, np.asarray(places).ravel()


def _entries(test: AttenuationExperiment) -> StanData:
    """Return what a table adds to lists of the data; its attenuations stand before its moduli."""
    conditions, readings = test.conditions, test.readings
    stresses, regime = _regimes(conditions)
    stresses = test.elasticity.stress_factor * stresses
    of_attenuations = 1 + np.arange(readings.tan_delta.size)
    of_moduli = 1 + conditions.n_rows + np.arange(readings.modulus.size)
    return {
        "frequency": (2 * np.pi / conditions.period).tolist(),
        "row_temperature": conditions.temperature.tolist(),
        "regime": (regime + 1).tolist(),
        "median_stress": stresses[:, 0].tolist(),
        "amplitude": stresses[:, 1].tolist(),
        "reading": [*of_attenuations.tolist(), *of_moduli.tolist()],
        "quantity_of_point": (test.quantity + 1).tolist(),
        "stated_error": np.concatenate(_errors(readings)).tolist(),
        "is_limit": (test.response <= test.response_limit).astype(int).tolist(),
        "log_limit": np.maximum(test.response_limit, NO_LIMIT).tolist(),
        "log_reading_observed": test.response.tolist(),
    }


def _grid_entries(test: AttenuationExperiment, grid: FloatArray) -> StanData:
    """Return what a table adds to lists of the grid; errors are medians of the stated ones."""
    conditions, errors = test.conditions, _errors(test.readings)
    period, spectrum, quantity = conditions.at(grid)
    row = conditions.first_rows[spectrum]
    typical = [max(float(np.median(one)) if one.size else 0.0, NO_ERROR) for one in errors]
    return {
        "grid_frequency": (2 * np.pi / period).tolist(),
        "grid_temperature": conditions.temperature[row].tolist(),
        "grid_regime": (_regimes(conditions)[1][row] + 1).tolist(),
        "grid_quantity": (quantity + 1).tolist(),
        "grid_stated_error": np.array(typical)[quantity].tolist(),
    }


def _errors(readings: Readings) -> tuple[FloatArray, FloatArray]:
    """Return the stated errors of tan delta, and those of ln(modulus)."""
    return readings.tan_delta_error, readings.modulus_error / readings.modulus


LIKELIHOOD = AttenuationLikelihood()
