"""What the paper states about the curves of the ice samples, judged by solutions of every draw."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from pyburgers.common.errors import SamplingError
from pyburgers.model.display import STRAIN_FACTOR, STRESS_FACTOR, STRESS_UNIT
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
from pyburgers.protocols.experiment import of_kind
from pyburgers.protocols.forward import simulate
from pyburgers.protocols.protocol import FittedTest
from pyburgers.studies.maor.before_data import (
    Datum,
    Knowledge,
    parameter_draws,
    prediction_draws,
)
from pyburgers.studies.maor.statements import (
    Belief,
    BoolArray,
    Statement,
    joined,
    probability,
)

FloatArray = npt.NDArray[np.float64]

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


def peaks(fit: FittedTest) -> tuple[FloatArray, FloatArray]:
    """Strain and stress (Pa) of the largest stress of every draw's solution, by a cubic spline.

    Parameters
    ----------
    fit : FittedTest
        Draws with solutions; NaN where there is none.

    Returns
    -------
    strain, stress : array, shape (n_draws,)
    """
    grid = fit.posterior["predictions"]["strain"].to_numpy()
    solutions = prediction_draws(fit, "stress")
    solved = np.isfinite(solutions).all(axis=1)
    strain, stress = (np.full(len(solutions), np.nan) for _ in range(2))
    fine = np.linspace(grid[0], grid[-1], FINE_STRAINS)
    curves = CubicSpline(grid, solutions[solved], axis=1)(fine)
    strain[solved], stress[solved] = fine[curves.argmax(axis=1)], curves.max(axis=1)
    return strain, stress


def _largest_reading(test: FittedTest) -> float:
    return float(test.experiment.response.max())


PEAK_STRESS = Datum("peak stress", _largest_reading, lambda draws: peaks(draws)[1])


def curve_statements(known: Mapping[str, Knowledge]) -> tuple[Statement, ...]:
    """Judge the paper's statements about the curves of ice.

    Parameters
    ----------
    known : mapping of str to Knowledge
        As for `pyburgers.studies.maor.ice.ice_statements`.
    """
    return (
        _peak_strain(known),
        _time_of_peak(known),
        *([_error_at_peak(known)] if _by_rate(known) is not None else []),
        _mean_solution(known),
    )


def _peak_strain(known: Mapping[str, Knowledge]) -> Statement:
    """Whether the model's peaks are where the paper sees them."""

    def near(fit: FittedTest) -> BoolArray:
        inside: BoolArray = np.abs(peaks(fit)[0] - PEAK_STRAIN) <= NEAR_PEAK_STRAIN
        return inside

    def band(one: Knowledge) -> str:
        low, median, high = np.nanquantile(peaks(one.fit)[0] * STRAIN_FACTOR, [0.05, 0.5, 0.95])
        return f"{median:.2f} [{low:.2f}, {high:.2f}] %"

    details = ", ".join(f"{key} {band(one)}" for key, one in known.items())
    return Statement(
        key="peak_strain",
        source="Fig. 3",
        text="Stress peaks near 3 % strain and then weakens.",
        evidence=joined([f"strain of the peak of the solutions, median and 90 %: {details}"]),
        beliefs={key: probability(one, near) for key, one in known.items()},
        rule="A draw counts if the largest stress of its solution lies within "
        f"{NEAR_PEAK_STRAIN * STRAIN_FACTOR:g} % of {PEAK_STRAIN * STRAIN_FACTOR:g} % strain.",
    )


def _time_of_peak(known: Mapping[str, Knowledge]) -> Statement:
    """Whether stress peaks within a few minutes."""

    def minutes(fit: FittedTest) -> FloatArray:
        time: FloatArray = peaks(fit)[0] / _rate(fit) / 60
        return time

    def soon(fit: FittedTest) -> BoolArray:
        inside: BoolArray = minutes(fit) <= FEW_MINUTES
        return inside

    details = ", ".join(
        f"{key} {np.nanmedian(minutes(one.fit)):.1f} min" for key, one in known.items()
    )
    return Statement(
        key="time_of_peak",
        source="Fig. 3",
        text="Stress peaks “within a few minutes”.",
        evidence=joined([f"median time of the peak of the solutions: {details}"]),
        beliefs={key: probability(one, soon) for key, one in known.items()},
        rule="A draw counts if the largest stress of its solution comes within "
        f"{FEW_MINUTES:g} minutes; the strain of the peak over the rate that is imposed.",
    )


def _rate(fit: FittedTest) -> float:
    """Return the first strain rate that is imposed (1/s)."""
    return of_kind(fit.experiment, ConstantRateExperiment).segments[0].strain_rate


def _by_rate(known: Mapping[str, Knowledge]) -> tuple[str, str] | None:
    """Names of the slowest and the fastest test, if there are two rates."""
    slowest, fastest = (
        extreme(known, key=lambda key: _rate(known[key].fit)) for extreme in (min, max)
    )
    return None if _rate(known[slowest].fit) == _rate(known[fastest].fit) else (slowest, fastest)


def misfit_at_peak(fit: FittedTest) -> FloatArray:
    """How far the solutions are from the readings about the peak, on the mean (Pa).

    Parameters
    ----------
    fit : FittedTest
        Draws with solutions.

    Returns
    -------
    array, shape (n_draws,)
        Not negative.
    """
    strain, stress = fit.experiment.position, fit.experiment.response
    at_peak = strain[stress.argmax()]
    around = np.abs(strain - at_peak) <= AROUND_PEAK * at_peak
    grid = fit.posterior["predictions"]["strain"].to_numpy()
    solutions = prediction_draws(fit, "stress")
    misfit = np.full(len(solutions), np.nan)
    solved = np.isfinite(solutions).all(axis=1)
    model = CubicSpline(grid, solutions[solved], axis=1)(strain[around])
    misfit[solved] = np.abs((stress[around] - model).mean(axis=1))
    return misfit


def _error_at_peak(known: Mapping[str, Knowledge]) -> Statement:
    """Whether the faster test is missed by more at its peak than the slower one."""
    pair = _by_rate(known)
    assert pair is not None  # asked before

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
    slowest, fastest = pair
    prior, number, posterior = (
        float(np.mean(fast > slow)) for slow, fast in (by_prior, by_peak, by_fit)
    )
    effective = min(known[key].effective_draws for key in pair)
    details = ", ".join(
        f"{key} {np.median(after[key]) * STRESS_FACTOR:.2g} {STRESS_UNIT}" for key in pair
    )
    return Statement(
        key="error_at_peak",
        source="Fig. 3",
        text="The faster the test, the more the solution errs at the peak.",
        evidence=joined([f"median distance of the solutions from the readings there: {details}"]),
        beliefs={f"{fastest} against {slowest}": Belief(prior, number, posterior, effective)},
        rule="A pair of draws of the fastest and of the slowest test counts if the mean misfit of "
        f"the readings within {100 * AROUND_PEAK:g} % of the strain of the peak is larger in the "
        "fastest.",
    )


def _mean_solution(known: Mapping[str, Knowledge]) -> Statement:
    """Whether the solution at the mean of all parameters describes the curve."""

    def judge(one: Knowledge) -> tuple[Belief, str]:
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
        belief = Belief(prior, number, posterior, one.effective_draws)
        rms, largest, strain = after
        leaves = "leaves" if largest > FITTING_LARGEST else "stays within"
        text = (
            f"it misses the data by {rms:.1f} s (root mean square) and {leaves} the predictive "
            f"band, {largest:.1f} s from its median at {strain * STRAIN_FACTOR:.1f} % strain"
        )
        alone = ", ".join(
            "no solution" if distance is None else f"{distance[0]:.1f} s" for distance in before
        )
        return belief, f"{text} (at the mean of the prior, and of prior and peak stress: {alone})"

    found = {key: judge(one) for key, one in known.items()}
    return Statement(
        key="mean_solution",
        source="Fig. 3",
        text="The solution at the posterior mean of the parameters fits the curve.",
        evidence=joined(f"{key}: {words}" for key, (_, words) in found.items()),
        beliefs={key: belief for key, (belief, _) in found.items()},
        rule=f"Holds if its root mean square distance from the data is at most {FITTING_RMS:g} s "
        f"and its largest from the median of the predictions at most {FITTING_LARGEST:g} s, s "
        "being the posterior mean of the noise.",
    )


def _departure_at(one: Knowledge, mean: Mapping[str, float]) -> tuple[float, float, float] | None:
    """Departure of the solution at given means of the parameters; None without one."""
    try:
        curve = simulate(one.fit.experiment, mean)
    except SamplingError:
        return None
    return _departure(one, curve["strain"].to_numpy(), curve["stress_Pa"].to_numpy())


def _departure(
    one: Knowledge, strain: FloatArray, stress: FloatArray
) -> tuple[float, float, float]:
    """Distance of a curve from the data and the predictive median, in noise, and where most."""
    experiment = one.fit.experiment
    noise = float(parameter_draws(one.fit, "stress_noise").mean())
    residual = experiment.response - np.interp(experiment.position, strain, stress)
    grid = one.fit.posterior["predictions"]["strain"].to_numpy()
    median = np.nanmedian(prediction_draws(one.fit, "stress"), axis=0)
    away = np.abs(np.interp(grid, strain, stress) - median) / noise
    return (
        float(np.sqrt(np.mean(residual**2))) / noise,
        float(away.max()),
        float(grid[away.argmax()]),
    )
