"""How tests at an oscillating strain rate are sampled."""

from collections.abc import Mapping, Sequence
from types import MappingProxyType
from typing import Any

import numpy as np
import numpy.typing as npt
from scipy.integrate import trapezoid

from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forced_oscillation.harmonics import trend_projection
from pyburgers.kinds.forced_oscillation.sheared import ShearedChart
from pyburgers.kinds.likelihood import Likelihood
from pyburgers.kinds.stan_data import StanData, ends
from pyburgers.model.parameters import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.model.priors import PriorSet
from pyburgers.model.read_quantities import STRESS, Quantity

FloatArray = npt.NDArray[np.float64]

TYPICAL_FLOW_RATE = 0.1
"""Origin of the sampled flow rate over the root mean square of the driving strain rate."""

START_MARGIN = 1e-3
"""Periods by which a record starts ahead of its first reading, so that the solver can start."""

PATH_TIMES = 4001
"""Times at which the strain rate is read off for the path strain of a record."""

OUTPUTS_PER_CYCLE, PREDICTIONS_PER_CYCLE = 60, 30
"""Times in a cycle of a smooth curve, and of the predictive bands."""


class OscillationLikelihood(Likelihood[OscillationExperiment]):
    """Stresses are read along time."""

    name = "forced_oscillation"
    clock = Quantity("time", "time_s", "s", "s", 1.0)
    read = (STRESS,)
    response = STRESS
    reference = REFERENCE_FLOW_RATE_QUANTITY
    grid_quantities = MappingProxyType(
        {
            "grid_oscillating_stress": ("stress", "Pa"),
            "grid_stress_replicated": ("stress_replicated", "Pa"),
            "grid_kelvin_strain": ("kelvin_strain", "1"),
            "grid_grain_size": ("grain_size", "m"),
            "grid_dashpot_rate": ("dashpot_rate", "1/s"),
        }
    )
    warmup = 250
    target_acceptance = 0.95
    chart = ShearedChart()

    def reference_origin(self, experiment: OscillationExperiment) -> tuple[float, float]:
        """Origin and size of ln(flow rate s)."""
        prepared = experiment.prepared
        time = prepared.time if experiment.imposed is None else _path_times(experiment)
        rate = float(np.sqrt(np.mean(prepared.strain_rate(time) ** 2)))
        return float(np.log(TYPICAL_FLOW_RATE * rate)), 1.0

    def tests_block(
        self, experiments: Sequence[OscillationExperiment], priors: Sequence[PriorSet]
    ) -> StanData:
        """Return the block `stan/data/forced_oscillation.stan`, with records of `sheared.stan`."""
        records = [_record(experiment) for experiment in experiments]
        n_harmonics = max(record["strain_sine"].size for record in records)
        n_background = max(record["background"].size for record in records)
        n_trend = max(record["trend_shape"].shape[1] for record in records)
        return {
            **{
                name: [record[name] for record in records]
                for name in records[0]
                if np.isscalar(records[0][name])
            },
            "n_harmonics": n_harmonics,
            "strain_sine": _padded([record["strain_sine"] for record in records], n_harmonics),
            "strain_cosine": _padded([record["strain_cosine"] for record in records], n_harmonics),
            "n_background": n_background,
            "background": _padded([record["background"] for record in records], n_background),
            "background_range": [record["background_range"] for record in records],
            "error_end": ends(len(record["strain_error"]) for record in records),
            "strain_error": [
                row for record in records for row in _error_rows(record, n_harmonics, n_background)
            ],
            "stress_observed": np.concatenate([e.stress for e in experiments]).tolist(),
            "tau": np.concatenate([record["tau"] for record in records]).tolist(),
            "relative_noise": np.concatenate(
                [record["relative_noise"] for record in records]
            ).tolist(),
            "n_trend": [record["trend_shape"].shape[1] for record in records],
            **{
                name: _padded([row for record in records for row in record[name]], n_trend)
                for name in ("trend_shape", "trend_fit")
            },
        }

    def grid_block(
        self, experiments: Sequence[OscillationExperiment], grids: Sequence[FloatArray]
    ) -> StanData:
        """Return the times at which the solutions are reported apart from the observed ones."""
        shapes = []
        for experiment, grid in zip(experiments, grids, strict=True):
            prepared = experiment.prepared
            shape = prepared.stress_fit.trend_shape(grid)
            shapes.append(shape[:, : shape.shape[1] if prepared.background == "removed" else 0])
        n_trend = max(shape.shape[1] for shape in shapes)
        return {
            "grid_end": ends(grid.size for grid in grids),
            "grid_tau": np.concatenate(
                [grid / e.prepared.period for e, grid in zip(experiments, grids, strict=True)]
            ).tolist(),
            "grid_trend_shape": _padded([row for shape in shapes for row in shape], n_trend),
        }

    def grid(self, experiment: OscillationExperiment, *, fine: bool = False) -> FloatArray:
        """Return evenly spaced times (s) from the start of a record, or of imposed cycles."""
        (start, end), period = experiment.span, experiment.prepared.period
        per_cycle = OUTPUTS_PER_CYCLE if fine else PREDICTIONS_PER_CYCLE
        return np.linspace(start, end, round(per_cycle * (end - start) / period) + 1)

    def along(self, experiment: OscillationExperiment) -> dict[str, tuple[FloatArray, str]]:
        """Return driving strains, times, and stated errors of the stress readings."""
        prepared = experiment.prepared
        return {
            "strain": (prepared.strain(prepared.time), "1"),
            **super().along(experiment),
            "reading_error": (prepared.uncertainty, "Pa"),
        }

    def reading_noise(
        self, experiment: OscillationExperiment, values: Mapping[str, FloatArray]
    ) -> FloatArray:
        """Return the size of the noise for each reading, by its stated error."""
        return super().reading_noise(experiment, values) * experiment.prepared.relative_uncertainty


def _error_rows(record: dict[str, Any], n_harmonics: int, n_background: int) -> list[list[float]]:
    """Errors of sine, cosine and background, each with zeros behind it."""
    own = record["strain_sine"].size
    parts = np.split(record["strain_error"], [own, 2 * own], axis=1)
    sizes = (n_harmonics, n_harmonics, n_background)
    padded = [_padded(list(part), size) for part, size in zip(parts, sizes, strict=True)]
    return [[*sine, *cosine, *background] for sine, cosine, background in zip(*padded, strict=True)]


def _padded(rows: Sequence[FloatArray], size: int) -> list[list[float]]:
    """Rows with zeros behind them."""
    return [[*row.tolist(), *[0.0] * (size - row.size)] for row in rows]


def _record(experiment: OscillationExperiment) -> dict[str, Any]:
    """Entries of the blocks for one test; arrays differ in size between tests."""
    prepared = experiment.prepared
    period = prepared.period
    kept = prepared.background == "kept"
    first_tau = prepared.start / period - START_MARGIN
    sine, cosine = prepared.strain_sine[0], prepared.strain_cosine[0]
    # The oscillation passes upwards through zero where tau + phase is a whole number. A zero at the
    # first reading, whatever the rounding, is the last one: spin-up cycles are counted from there.
    phase = float(np.arctan2(cosine, sine)) / (2 * np.pi)
    last_zero = float(np.floor(prepared.start / period + START_MARGIN + phase))
    trend_shape = trend_fit = np.empty((prepared.time.size, 0))
    if not kept:
        trend_shape, trend_fit = trend_projection(
            prepared.time, degree=prepared.stress_fit.degree, uncertainty=prepared.uncertainty
        )
        trend_fit = trend_fit.T
    bias = float(prepared.stress_fit.trend(np.array([prepared.start]))[0])
    amplitude = float(prepared.stress_fit.amplitude()[0])
    lag = prepared.stress_fit.phase()[0] - prepared.strain_fit.phase()[0]
    compliance = float(np.hypot(sine, cosine)) / amplitude
    harmonics_error, background_error = np.split(
        prepared.strain_error, [2 * prepared.strain_sine.size], axis=1
    )
    return {
        "period": period,
        "strain_sine": prepared.strain_sine,
        "strain_cosine": prepared.strain_cosine,
        "background": prepared.background_rate * period if kept else np.empty(0),
        "background_range": [prepared.t_middle / period, prepared.t_half / period],
        "strain_error": np.hstack(
            [harmonics_error, background_error * period if kept else background_error[:, :0]]
        ),
        "start_tau": last_zero - phase - experiment.spin_up_cycles,
        "start_stress": prepared.start_stress,
        "first_tau": first_tau,
        "stress_scale": max(amplitude, abs(bias)) if kept else amplitude,
        "strain_scale": float(np.hypot(sine, cosine)),
        "storage_compliance": compliance * float(np.cos(lag)),
        "loss_compliance": compliance * float(np.sin(lag)),
        "typical_path_strain": 0.5 * _path_strain(experiment),
        "tau": prepared.time / period,
        "relative_noise": prepared.relative_uncertainty,
        "trend_shape": trend_shape,
        "trend_fit": trend_fit,
    }


def _path_strain(experiment: OscillationExperiment) -> float:
    """Integral of the absolute strain rate over the record."""
    time = _path_times(experiment)
    return float(trapezoid(np.abs(experiment.prepared.strain_rate(time)), time))


def _path_times(experiment: OscillationExperiment) -> FloatArray:
    return np.linspace(experiment.prepared.start, experiment.end, PATH_TIMES)


LIKELIHOOD = OscillationLikelihood()
