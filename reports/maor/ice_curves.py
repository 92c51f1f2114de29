"""What the paper states about the curves of the ice samples, judged by solutions of every draw."""

from collections.abc import Mapping
from typing import cast

import numpy as np
from common import BoolArray, Fitted, FloatArray, interval, parameter_draws, prediction_draws
from scipy.interpolate import CubicSpline

from maor.before_data import Datum, Knowledge
from maor.statements import Belief, Claim, Statement, event
from pyburgers import ConstantRateExperiment, SamplingError, simulate

PEAK_STRAIN, NEAR_PEAK_STRAIN = 0.03, 0.005
"""Where the paper sees the peaks, and how far from it is still near it."""

FEW_MINUTES = 10.0
"""Time (min) until which it is a few minutes."""

AROUND_PEAK = 0.25
"""Relative distance in strain from the peak within which readings tell the misfit there."""

MISFIT_PAIRS = 4000
"""Draws of two tests that are compared with each other."""

FINE_STRAINS = 400
"""Strains at which a peak is looked for."""

FITTING_RMS, FITTING_LARGEST = 1.5, 2.0
"""In standard deviations of the noise: root mean square distance from the data, and largest from
the predictive median, up to which a curve fits."""

Departure = tuple[float, float, float]
"""Root mean square distance of a curve from the data and largest from the predictive median, both
in standard deviations of the noise, and the strain of the largest."""


def grid_of(fit: Fitted) -> FloatArray:
    """Strains of the solutions, shape (n_grid,)."""
    return np.asarray(fit.posterior["predictions"]["strain"].to_numpy())


def peaks(fit: Fitted) -> tuple[FloatArray, FloatArray]:
    """Strain and stress (Pa) of the largest stress of every solution, by a cubic spline.

    Both have the shape (n_draws,), and NaN where there is no solution.
    """
    grid, solutions = grid_of(fit), prediction_draws(fit, "stress")
    solved = np.isfinite(solutions).all(axis=1)
    strain, stress = (np.full(len(solutions), np.nan) for _ in range(2))
    fine = np.linspace(grid[0], grid[-1], FINE_STRAINS)
    curves = CubicSpline(grid, solutions[solved], axis=1)(fine)
    strain[solved], stress[solved] = fine[curves.argmax(axis=1)], curves.max(axis=1)
    return strain, stress


PEAK_STRESS = Datum(
    lambda test: float(test.experiment.response.max()), lambda draws: peaks(draws)[1]
)


def _peaks_near(fit: Fitted) -> BoolArray:
    return np.asarray(np.abs(peaks(fit)[0] - PEAK_STRAIN) <= NEAR_PEAK_STRAIN)


def _minutes(fit: Fitted) -> FloatArray:
    """Time of the peak, shape (n_draws,)."""
    return np.asarray(peaks(fit)[0] / _rate(fit) / 60)


def _rate(fit: Fitted) -> float:
    """Return the first strain rate that is imposed (1/s)."""
    return cast(ConstantRateExperiment, fit.experiment).segments[0].strain_rate


def misfit_at_peak(fit: Fitted) -> FloatArray:
    """How far the solutions are from the readings about the peak, on the mean (Pa), (n_draws,)."""
    strain, stress = fit.experiment.position, fit.experiment.response
    at_peak = strain[stress.argmax()]
    around = np.abs(strain - at_peak) <= AROUND_PEAK * at_peak
    solutions = prediction_draws(fit, "stress")
    misfit = np.full(len(solutions), np.nan)
    solved = np.isfinite(solutions).all(axis=1)
    model = CubicSpline(grid_of(fit), solutions[solved], axis=1)(strain[around])
    misfit[solved] = np.abs((stress[around] - model).mean(axis=1))
    return misfit


def error_at_peak(known: Mapping[str, Knowledge]) -> tuple[Statement, ...]:
    """Judge whether the fastest test is missed by more at its peak than the slowest one.

    None of tests at one rate.
    """
    slowest, fastest = pair = tuple(
        extreme(known, key=lambda key: _rate(known[key].fit)) for extreme in (min, max)
    )
    if _rate(known[slowest].fit) == _rate(known[fastest].fit):
        return ()

    def at_random(values: FloatArray, seed: int) -> FloatArray:
        solved = values[np.isfinite(values)]
        drawn: FloatArray = np.random.default_rng(seed).choice(solved, MISFIT_PAIRS)
        return drawn

    before = {key: misfit_at_peak(known[key].prior) for key in pair}
    after = {key: misfit_at_peak(known[key].fit) for key in pair}
    by_prior, by_fit = (
        [at_random(misfits[key], seed) for seed, key in enumerate(pair)]
        for misfits in (before, after)
    )
    by_peak = [
        known[key].resampled(before[key], MISFIT_PAIRS, seed=seed) for seed, key in enumerate(pair)
    ]
    prior, number, posterior = (
        float(np.mean(fast > slow)) for slow, fast in (by_prior, by_peak, by_fit)
    )
    effective = min(known[key].effective_draws for key in pair)
    details = ", ".join(f"{key} {np.median(after[key]) * 1e-6:.2g} MPa" for key in pair)
    return (
        Statement(
            key="error_at_peak",
            source="Fig. 3",
            text="The faster the test, the more the solution errs at the peak.",
            evidence=f"Median distance of the solutions from the readings there: {details}.",
            beliefs={f"{fastest} against {slowest}": Belief(prior, number, posterior, effective)},
            rule="A pair of draws of the fastest and of the slowest test counts if the mean misfit "
            f"of the readings within {100 * AROUND_PEAK:g} % of the strain of the peak is larger "
            "in the fastest.",
        ),
    )


def _mean_solution(one: Knowledge) -> tuple[Belief, str]:
    """Judge whether the solution at the mean of all parameters describes the curve."""
    curve = one.fit.posterior["posterior_mean_solution"].to_dataset()["stress"]
    after = _departure(one, curve["strain"].to_numpy(), curve.to_numpy())
    before = [
        _departure_at(one, {name: one.mean_before(name)[k] for name in one.fit.priors.priors})
        for k in (0, 1)
    ]
    prior, number, posterior = (
        distance is not None and distance[0] <= FITTING_RMS and distance[1] <= FITTING_LARGEST
        for distance in (*before, after)
    )
    rms, largest, strain = after
    leaves = "leaves" if largest > FITTING_LARGEST else "stays within"
    alone = ", ".join(
        "no solution" if distance is None else f"{distance[0]:.1f} s" for distance in before
    )
    return Belief(prior, number, posterior, one.effective_draws), (
        f"it misses the data by {rms:.1f} s (root mean square) and {leaves} the predictive "
        f"band, {largest:.1f} s from its median at {100 * strain:.1f} % strain (at the mean of the "
        f"prior, and of prior and peak stress: {alone})"
    )


def _departure_at(one: Knowledge, mean: Mapping[str, float]) -> Departure | None:
    """Departure of the solution at given means of the parameters; None without one."""
    try:
        curve = simulate(one.fit.experiment, mean)
    except SamplingError:
        return None
    return _departure(one, curve["strain"].to_numpy(), curve["stress_Pa"].to_numpy())


def _departure(one: Knowledge, strain: FloatArray, stress: FloatArray) -> Departure:
    """Departure of a curve (strain, Pa)."""
    experiment, grid = one.fit.experiment, grid_of(one.fit)
    noise = float(parameter_draws(one.fit, "stress_noise").mean())
    residual = experiment.response - np.interp(experiment.position, strain, stress)
    median = np.nanmedian(prediction_draws(one.fit, "stress"), axis=0)
    away = np.abs(np.interp(grid, strain, stress) - median) / noise
    rms = float(np.sqrt(np.mean(residual**2))) / noise
    return rms, float(away.max()), float(grid[away.argmax()])


CURVE_CLAIMS = (
    Claim(
        "peak_strain",
        "Fig. 3",
        "Stress peaks near 3 % strain and then weakens.",
        event(_peaks_near, lambda one: interval(100 * peaks(one.fit)[0], ".2f", " %")),
        "A draw counts if the largest stress of its solution lies within "
        f"{100 * NEAR_PEAK_STRAIN:g} % of {100 * PEAK_STRAIN:g} % strain.",
        lead="strain of the peak of the solutions, median and 90 %: ",
    ),
    Claim(
        "time_of_peak",
        "Fig. 3",
        "Stress peaks “within a few minutes”.",
        event(
            lambda fit: np.asarray(_minutes(fit) <= FEW_MINUTES),
            lambda one: f"{np.nanmedian(_minutes(one.fit)):.1f} min",
        ),
        "A draw counts if the largest stress of its solution comes within "
        f"{FEW_MINUTES:g} minutes; the strain of the peak over the rate that is imposed.",
        lead="median time of the peak of the solutions: ",
    ),
)

MEAN_SOLUTION = Claim(
    "mean_solution",
    "Fig. 3",
    "The solution at the posterior mean of the parameters fits the curve.",
    _mean_solution,
    f"Holds if its root mean square distance from the data is at most {FITTING_RMS:g} s "
    f"and its largest from the median of the predictions at most {FITTING_LARGEST:g} s, s "
    "being the posterior mean of the noise.",
    each="{}: {}",
    separator="; ",
)
