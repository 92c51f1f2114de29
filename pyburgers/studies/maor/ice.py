"""What the paper states about the ice samples, judged by fits of tests at constant rate."""

from collections.abc import Callable, Mapping

import numpy as np
import numpy.typing as npt
from scipy.interpolate import CubicSpline

from pyburgers.checks.fit_checks import RHAT_LIMIT
from pyburgers.common.errors import SamplingError
from pyburgers.common.units import number, rounded
from pyburgers.model.display import STRAIN_FACTOR, STRESS_FACTOR, STRESS_UNIT, shown_quantity
from pyburgers.model.display import symbol_text as symbol
from pyburgers.posterior.labelled_draws import convergence_table, grain_size_share
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.forward import simulate
from pyburgers.protocols.protocol import FittedTest
from pyburgers.studies.maor.before_data import (
    Datum,
    Knowledge,
    parameter_draws,
    prediction_draws,
)
from pyburgers.studies.maor.statements import (
    FEW,
    MOST,
    NARROW,
    Belief,
    BoolArray,
    Statement,
    between,
    joined,
    probability,
)

FloatArray = npt.NDArray[np.float64]

PIL40_VALUES: Mapping[str, tuple[float, float]] = {
    "stress_exponent": (4.0, 0.25),
    "critical_strain_grain_size": (0.03, 0.01),
}
"""What the paper finds for PIL40, and how far from it is still about it."""

PEAK_STRAIN, NEAR_PEAK_STRAIN = 0.03, 0.005
"""Where the paper sees the peaks, and how far from it is still near it."""

AROUND_PEAK = 0.25
"""Relative distance in strain from the peak within which readings tell the misfit there."""

MISFIT_PAIRS = 4000
"""Draws of two tests that are compared with each other."""

FINE_STRAINS = 400
"""Strains at which a peak is looked for."""

FITTING_RMS, FITTING_LARGEST = 1.5, 2.0
"""In standard deviations of the noise: root mean square distance from the data, and largest from
the predictive median, up to which a curve fits."""

KELVIN_ELEMENT = frozenset({"kelvin_modulus", "kelvin_viscosity"})


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


def _largest_reading(experiment: Experiment) -> float:
    return float(experiment.response.max())


PEAK_STRESS = Datum("peak stress", _largest_reading, lambda draws: peaks(draws)[1])


def ice_statements(known: Mapping[str, Knowledge]) -> tuple[Statement, ...]:
    """Judge the paper's statements about ice.

    Parameters
    ----------
    known : mapping of str to Knowledge
        Tests at constant rate by sample, known by their `PEAK_STRESS` ahead of their curves;
        statements about PIL40 need the key ``"PIL40"``.
    """
    if not known:
        return ()
    of_one = {name: one for name, one in known.items() if name == "PIL40"}
    return (
        *(_value(of_one, name) for name in PIL40_VALUES if of_one),
        _narrow_posteriors(known),
        _most_uncertain(known),
        _peak_strain(known),
        *([_error_at_peak(known)] if _by_rate(known) is not None else []),
        _mean_solution(known),
        _softer_fabric(known),
        _mechanism(known),
    )


def _value(known: Mapping[str, Knowledge], name: str) -> Statement:
    """Whether a parameter of PIL40 has about the paper's value, and by what."""
    value, tolerance = PIL40_VALUES[name]
    quantity = shown_quantity(name)

    def about(fit: FittedTest) -> BoolArray:
        near: BoolArray = np.abs(parameter_draws(fit, name) - value) <= tolerance
        return near

    def words(one: Knowledge) -> str:
        draws = parameter_draws(one.fit, name)
        low, high = np.quantile(draws, [0.05, 0.95])
        sd = float(draws.std(ddof=1))
        by_prior, by_peak = one.sd_before(name)
        return (
            f"the central 90 % of the draws are [{rounded(low, sd)}, {rounded(high, sd)}], with "
            f"mean {rounded(float(draws.mean()), sd)}; the standard deviation is {sd:.2g}, "
            f"{by_prior:.2g} under the prior and {by_peak:.2g} with the peak stress alone, which "
            "has it from the priors of the rest of the flow law"
        )

    return Statement(
        key=f"{name}_of_PIL40",
        source="PIL40",
        text=f"The {quantity.label} {symbol(quantity)} of PIL40 is about {number(value)}.",
        evidence=joined(words(one) for one in known.values()),
        beliefs={key: probability(one, about) for key, one in known.items()},
        rule=f"A draw counts if it is within {number(tolerance)} of {number(value)}. What the "
        "peak stress and the priors of the other parameters of the flow law narrow is in the "
        "middle probability and not credited to the curve.",
    )


def _narrow_posteriors(known: Mapping[str, Knowledge]) -> Statement:
    """Count the parameters that the curve narrows much beyond prior and peak stress."""

    def shares(one: Knowledge) -> dict[str, tuple[float, float]]:
        found = {}
        for name in one.fit.priors.free:
            if name != "stress_noise":
                sd = parameter_draws(one.fit, name).std(ddof=1)
                by_prior, by_peak = one.sd_before(name)
                found[name] = float(sd / by_prior), float(sd / by_peak)
        return found

    by_test = {key: shares(one) for key, one in known.items()}

    def belief(key: str) -> Belief:
        of_curve = np.array([share for _, share in by_test[key].values()])
        narrow = float((of_curve < NARROW).mean())
        of_peak = np.array([by_peak / alone for by_peak, alone in map(known[key].sd_before, by_test[key])])
        return Belief(
            prior=False,
            number=between(float((of_peak < NARROW).mean()), wrong_below=FEW, right_above=MOST),
            posterior=between(narrow, wrong_below=FEW, right_above=MOST),
            effective_draws=known[key].effective_draws,
        )

    every = [pair for ratios in by_test.values() for pair in ratios.values()]
    of_prior, of_curve = (sum(pair[k] < NARROW for pair in every) for k in (0, 1))
    details = "; ".join(
        f"{key}: "
        + ", ".join(
            f"{symbol(shown_quantity(name))} {share[1]:.2f}"
            for name, share in sorted(ratios.items(), key=lambda item: item[1][1])
        )
        for key, ratios in by_test.items()
    )
    return Statement(
        key="narrow_posteriors",
        source="Ice, Table 1",
        text="For ice the posteriors are narrow although the priors are wide.",
        evidence=f"{of_prior} of {len(every)} posteriors have a standard deviation below "
        f"{NARROW:g} of the prior's, {of_curve} below {NARROW:g} of that with the peak stress alone "
        f"(ratios to the latter for {details}).",
        beliefs={key: belief(key) for key in known},
        rule="Parameters, the noise aside: holds if more than two thirds are narrower than half of "
        "what prior and peak stress leave, does not hold if less than a third are.",
    )


def _most_uncertain(known: Mapping[str, Knowledge]) -> Statement:
    """Whether the Kelvin element is known least, relative to its size, and sampled well."""

    def leads(means: Mapping[str, float], sds: Mapping[str, float]) -> bool:
        relative = {name: sds[name] / abs(means[name]) for name in means}
        return set(sorted(relative, key=lambda name: -relative[name])[:2]) == KELVIN_ELEMENT

    def judge(one: Knowledge) -> tuple[Belief, str]:
        names = [name for name in one.fit.priors.free if name != "stress_noise"]
        draws = {name: parameter_draws(one.fit, name) for name in names}
        means, sds = ({name: float(f(x)) for name, x in draws.items()} for f in (np.mean, np.std))
        before = [
            leads(
                {name: one.mean_before(name)[k] for name in names},
                {name: one.sd_before(name)[k] for name in names},
            )
            for k in (0, 1)
        ]
        rhat = convergence_table(one.fit.posterior)["rhat"]
        largest = max(float(rhat[name]) for name in KELVIN_ELEMENT)
        order = sorted(names, key=lambda name: -sds[name] / abs(means[name]))
        words = ", ".join(
            f"{symbol(shown_quantity(name))} {sds[name] / abs(means[name]):.2f}" for name in order[:4]
        )
        holds = leads(means, sds) and largest <= RHAT_LIMIT
        belief = Belief(before[0], before[1], holds, one.effective_draws)
        return belief, f"{words} (R-hat of E_K and η_K up to {largest:.3f})"

    found = {key: judge(one) for key, one in known.items()}
    return Statement(
        key="most_uncertain",
        source="Ice",
        text="E_K and η_K of ice are the most uncertain parameters, yet they converge.",
        evidence=joined(
            [
                "standard deviation over mean, the four largest: "
                + "; ".join(f"{key} {words}" for key, (_, words) in found.items())
            ]
        ),
        beliefs={key: belief for key, (belief, _) in found.items()},
        rule="Holds if the two have the largest ratio of standard deviation to mean of all "
        f"parameters and R-hat is at most {RHAT_LIMIT:g}; before the data the order alone is "
        "looked at.",
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


def _rate(one: Knowledge) -> float:
    experiment = one.fit.experiment
    assert isinstance(experiment, ConstantRateExperiment)  # ice
    return experiment.segments[0].strain_rate


def _by_rate(known: Mapping[str, Knowledge]) -> tuple[str, str] | None:
    """Names of the slowest and the fastest test, if there are two rates."""
    slowest, fastest = (extreme(known, key=lambda key: _rate(known[key])) for extreme in (min, max))
    return None if _rate(known[slowest]) == _rate(known[fastest]) else (slowest, fastest)


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
        [at_random(misfits[key], seed) for seed, key in enumerate(pair)] for misfits in (before, after)
    )
    by_peak = [
        known[key].resampled(before[key], MISFIT_PAIRS, seed=seed) for seed, key in enumerate(pair)
    ]
    slowest, fastest = pair
    belief = Belief(
        *(float(np.mean(fast > slow)) for slow, fast in (by_prior, by_peak, by_fit)),
        effective_draws=min(known[key].effective_draws for key in pair),
    )
    details = ", ".join(
        f"{key} {np.median(after[key]) * STRESS_FACTOR:.2g} {STRESS_UNIT}" for key in pair
    )
    return Statement(
        key="error_at_peak",
        source="Fig. 3",
        text="The faster the test, the more the solution errs at the peak.",
        evidence=joined([f"median distance of the solutions from the readings there: {details}"]),
        beliefs={f"{fastest} against {slowest}": belief},
        rule="A pair of draws of the fastest and of the slowest test counts if the mean misfit of "
        f"the readings within {100 * AROUND_PEAK:g} % of the strain of the peak is larger in the "
        "fastest.",
    )


def _mean_solution(known: Mapping[str, Knowledge]) -> Statement:
    """Whether the solution at the mean of all parameters describes the curve."""

    def judge(one: Knowledge) -> tuple[Belief, str]:
        curve = one.fit.posterior["posterior_mean_solution"].to_dataset()["stress"]
        after = _departure(one, curve["strain"].to_numpy(), curve.to_numpy())
        before = [_departure_at(one, lambda name, k=k: one.mean_before(name)[k]) for k in (0, 1)]
        belief = Belief(
            *(
                distance is not None
                and distance[0] <= FITTING_RMS
                and distance[1] <= FITTING_LARGEST
                for distance in (*before, after)
            ),
            effective_draws=one.effective_draws,
        )
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


def _departure_at(
    one: Knowledge, mean: Callable[[str], float]
) -> tuple[float, float, float] | None:
    """Departure of the solution at given means of the parameters; None without one."""
    try:
        curve = simulate(one.fit.experiment, {name: mean(name) for name in one.fit.priors.priors})
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
    return float(np.sqrt(np.mean(residual**2))) / noise, float(away.max()), float(grid[away.argmax()])


def _softer_fabric(known: Mapping[str, Knowledge]) -> Statement:
    """Whether the fabric softens."""
    name = "steady_state_fabric_factor"
    details = ", ".join(
        f"{key} up to {np.quantile(parameter_draws(one.fit, name), 0.95):.2f}"
        for key, one in known.items()
    )
    return Statement(
        key="softer_fabric",
        source="Ice, Table 1",
        text="The steady-state fabric factor F_ss of ice is below 1: fabric softens the ice.",
        evidence=joined([f"95 % of the draws: {details}"]),
        beliefs={
            key: probability(one, lambda fit: parameter_draws(fit, name) < 1)
            for key, one in known.items()
        },
        rule="A draw counts if its F_ss is below 1; where the prior ends below 1 the model cannot "
        "do otherwise.",
    )


def _mechanism(known: Mapping[str, Knowledge]) -> Statement:
    """Whether convergence of the critical strains tells what softens the ice."""
    names = ("critical_strain_grain_size", "critical_strain_fabric")

    def by_grains(fit: FittedTest) -> BoolArray:
        share: BoolArray = grain_size_share(fit.posterior).to_numpy().ravel() > 1 / 2
        return share

    def words(one: Knowledge) -> str:
        rhat = convergence_table(one.fit.posterior)["rhat"]
        return ", ".join(
            f"{symbol(shown_quantity(name))} "
            f"{parameter_draws(one.fit, name).std(ddof=1) / one.sd_before(name)[0]:.2f} (R-hat "
            f"{float(rhat[name]):.3f})"
            for name in names
        )

    details = "; ".join(f"{key} {words(one)}" for key, one in known.items())
    return Statement(
        key="mechanism",
        source="Ice",
        text="Which of ε_c1 and ε_c2 converges tells the mechanism: ε_c1 does, so that smaller "
        "grains soften the ice more than fabric does.",
        evidence=joined(
            [
                f"standard deviation over the prior's: {details}; chains that agree say that a "
                "parameter was sampled well, not that the data fix it"
            ]
        ),
        beliefs={key: probability(one, by_grains) for key, one in known.items()},
        rule="A draw counts if grain size does more than half of the softening beyond the peak "
        "(of its logarithm), which is the mechanism itself rather than a sign of it.",
    )
