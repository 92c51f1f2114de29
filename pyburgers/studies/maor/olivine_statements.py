"""What the paper states about olivine, judged by fits of a record with and without background."""

from collections.abc import Callable, Mapping
from functools import partial

import numpy as np
import numpy.typing as npt

from pyburgers.checks.fit_checks import RHAT_LIMIT
from pyburgers.common.units import number, with_error
from pyburgers.drawing.views.oscillation_response import predicted_oscillation
from pyburgers.model.display import LENGTH_FACTOR, LENGTH_UNIT, shown_quantity
from pyburgers.posterior.labelled_draws import convergence_table
from pyburgers.protocols.experiment import of_kind
from pyburgers.protocols.forced_oscillation.experiment import OscillationExperiment
from pyburgers.protocols.protocol import FittedTest
from pyburgers.studies.maor.before_data import Datum, Knowledge, parameter_draws, prediction_draws
from pyburgers.studies.maor.statements import (
    DOMINANT,
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

UNINFORMED = 0.8
"""Share of the prior's standard deviation above which the data have hardly spoken."""

STRESS_EXPONENT, ABOUT = 3.0, 0.25
"""What the paper finds for n, and how far from it is still about it."""

FLAT, BELL = -0.9, -0.6
"""Excess kurtosis up to which a distribution is flat, and from which it is a bell."""

LEAST_OFFSET = 1.0
"""Standard deviation of the mean stress of draws (Pa) below which none is off."""

NEGLIGIBLE_GROWTH = 0.1
"""Relative change of grain size over the record that is still negligible."""


def _observed_amplitude(test: FittedTest) -> float:
    return float(of_kind(test.experiment, OscillationExperiment).prepared.stress_fit.amplitude()[0])


STRESS_AMPLITUDE = Datum(
    "amplitude of the stress",
    _observed_amplitude,
    lambda draws: np.abs(predicted_oscillation(draws)),
)


def olivine_statements(known: Mapping[str, Knowledge]) -> tuple[Statement, ...]:
    """Judge the paper's statements about olivine.

    Parameters
    ----------
    known : mapping of str to Knowledge
        Forced oscillation tests by treatment of the background, ``"removed"``, ``"kept"``, known by
        their `STRESS_AMPLITUDE` ahead of their records; may be empty.
    """
    judges = (
        _constrained_kelvin_modulus,
        _shape_of_kelvin_modulus,
        _unconstrained_critical_strain,
        _stress_exponent,
        _cause_of_offset,
        _grain_growth,
        _spread_in_amplitude,
    )
    return tuple(judge(known) for judge in judges) if known else ()


def _constrained_kelvin_modulus(known: Mapping[str, Knowledge]) -> Statement:
    """Whether the data narrow the Kelvin modulus of olivine."""
    name = "kelvin_modulus"
    quantity = shown_quantity(name)

    def narrowed(sd: float, by_prior: float) -> bool | None:
        return between(-sd / by_prior, wrong_below=-MOST, right_above=-FEW)

    def judge(one: Knowledge) -> tuple[Belief, str]:
        draws = parameter_draws(one.fit, name)
        sd, (by_prior, by_amplitude) = float(draws.std(ddof=1)), one.sd_before(name)
        factor = quantity.display_factor
        shown = with_error(float(draws.mean()) * factor, sd * factor)
        belief = Belief(
            prior=False,
            number=narrowed(by_amplitude, by_prior),
            posterior=narrowed(sd, by_prior),
            effective_draws=one.effective_draws,
        )
        return belief, (
            f"{shown} {quantity.display_unit}, {sd / by_prior:.2f} of the prior's standard "
            f"deviation ({by_amplitude / by_prior:.2f} with the amplitude alone)"
        )

    return _judge(
        known,
        judge,
        key="kelvin_modulus_of_olivine",
        source="Olivine, Table 2",
        text="The Kelvin modulus E_K of olivine is constrained by the data.",
        rule="Holds if the standard deviation is below a third of the prior's, does not hold "
        "above two thirds.",
    )


def _shape_of_kelvin_modulus(known: Mapping[str, Knowledge]) -> Statement:
    """Whether the posterior of the Kelvin modulus is a bell, and not flat as its prior."""
    name = "kelvin_modulus"

    def judge(one: Knowledge) -> tuple[Belief, str]:
        before, after = (parameter_draws(fit, name) for fit in (one.prior, one.fit))
        flat = np.full(before.size, 1 / before.size)
        by_prior, by_number = _excess_kurtosis(before, flat), _excess_kurtosis(before, one.weights)
        by_data = _excess_kurtosis(after, np.full(after.size, 1 / after.size))
        shapes = (by_prior, by_number, by_data)
        prior, number, posterior = (
            between(shape, wrong_below=FLAT, right_above=BELL) for shape in shapes
        )
        return Belief(prior, number, posterior, one.effective_draws), (
            f"the excess kurtosis of E_K is {by_data:.1f} ({by_prior:.1f} under the prior, "
            f"{by_number:.1f} with the amplitude alone)"
        )

    return _judge(
        known,
        judge,
        key="shape_of_kelvin_modulus",
        source="Olivine, Table 2",
        text="The posterior of E_K has the shape of a bell, where its prior is flat.",
        rule="Its excess kurtosis, 0 of a normal and -1.2 of a uniform distribution: holds above "
        f"{BELL:g}, does not hold below {FLAT:g}.",
    )


def _excess_kurtosis(draws: FloatArray, weights: FloatArray) -> float:
    away = draws - weights @ draws
    return float(weights @ away**4 / (weights @ away**2) ** 2 - 3)


def _cause_of_offset(known: Mapping[str, Knowledge]) -> Statement:
    """Whether draws are off the mean stress of the record by their stress exponents."""

    def correlation(fit: FittedTest, weights: FloatArray) -> float:
        columns = (
            parameter_draws(fit, "stress_exponent"),
            prediction_draws(fit, "stress").mean(axis=1),
        )
        solved = np.isfinite(columns[1])
        weights = weights[solved] / weights[solved].sum()
        away = [column[solved] - weights @ column[solved] for column in columns]
        spreads = [np.sqrt(weights @ one**2) for one in away]
        if spreads[1] < LEAST_OFFSET:
            return np.nan
        return float(weights @ (away[0] * away[1]) / (spreads[0] * spreads[1]))

    def judge(one: Knowledge) -> tuple[Belief, str]:
        before, after = one.prior, one.fit
        n_before, n_after = (len(prediction_draws(fit, "stress")) for fit in (before, after))
        found = (
            correlation(before, np.full(n_before, 1 / n_before)),
            correlation(before, one.weights),
            correlation(after, np.full(n_after, 1 / n_after)),
        )
        prior, number, posterior = (
            between(abs(value), wrong_below=FEW, right_above=MOST) if np.isfinite(value) else None
            for value in found
        )
        words = (
            f"n and the mean stress correlate by {found[-1]:.2f}"
            if np.isfinite(found[-1])
            else "no draw has an offset"
        )
        return Belief(prior, number, posterior, one.effective_draws), words

    return _judge(
        known,
        judge,
        key="cause_of_offset",
        source="Olivine, Fig. 5",
        text="A stress exponent n near 3 causes the offset of the predicted stress.",
        rule="The correlation of n with the mean of the predicted stress over the draws, of either "
        f"sign: holds above {MOST:.2f}, does not hold below {FEW:.2f}. With the background removed "
        "no stress has an offset, and we cannot tell.",
    )


def _unconstrained_critical_strain(known: Mapping[str, Knowledge]) -> Statement:
    """Whether the critical strain of olivine is left to its prior, and whether chains agree."""
    name = "critical_strain_grain_size"
    left_open = partial(between, wrong_below=NARROW, right_above=UNINFORMED)

    def judge(one: Knowledge) -> tuple[Belief, str]:
        by_prior, by_amplitude = one.sd_before(name)
        share = float(parameter_draws(one.fit, name).std(ddof=1)) / by_prior
        rhat = float(convergence_table(one.fit.posterior)["rhat"][name])
        agreement = "the chains agree" if rhat <= RHAT_LIMIT else "the chains do not agree"
        if not np.isfinite(rhat):
            agreement = "it is not known whether chains agree"
        belief = Belief(
            prior=left_open(1.0),
            number=left_open(by_amplitude / by_prior),
            posterior=left_open(share),
            effective_draws=one.effective_draws,
        )
        return belief, (
            f"the standard deviation is {share:.2f} of the prior's and {agreement} (R-hat "
            f"{rhat:.3f})"
        )

    return _judge(
        known,
        judge,
        key="critical_strain_of_olivine",
        source="Olivine, Table 2",
        text="The critical strain ε_c1 of olivine does not converge: the data do not fix it.",
        rule=f"Holds if the standard deviation is above {UNINFORMED:g} of the prior's, does not "
        f"hold below {NARROW:g}; without the data it holds, so that what they leave open is "
        "granted by the prior. Chains that agree say that a parameter was sampled well, not that "
        "the data fix it.",
    )


def _stress_exponent(known: Mapping[str, Knowledge]) -> Statement:
    """Whether the stress exponent of olivine is about the paper's."""
    name = "stress_exponent"

    def about(fit: FittedTest) -> BoolArray:
        near: BoolArray = np.abs(parameter_draws(fit, name) - STRESS_EXPONENT) <= ABOUT
        return near

    def judge(one: Knowledge) -> tuple[Belief, str]:
        draws = parameter_draws(one.fit, name)
        sd, (by_prior, by_amplitude) = float(draws.std(ddof=1)), one.sd_before(name)
        return probability(one, about), (
            f"{with_error(float(draws.mean()), sd)} (standard deviation {by_prior:.2g} under the "
            f"prior, {by_amplitude:.2g} with the amplitude alone)"
        )

    return _judge(
        known,
        judge,
        key="stress_exponent_of_olivine",
        source="Olivine",
        text=f"The stress exponent n of olivine is about {number(STRESS_EXPONENT)}.",
        rule=f"A draw counts if it is within {ABOUT:g} of {number(STRESS_EXPONENT)}.",
    )


def _grain_growth(known: Mapping[str, Knowledge]) -> Statement:
    """Whether the grains of olivine keep their size over the record."""

    def growth(fit: FittedTest) -> FloatArray:
        size = prediction_draws(fit, "grain_size")
        relative: FloatArray = size[:, -1] / fit.experiment.initial_grain_size - 1
        return relative

    def negligible(fit: FittedTest) -> BoolArray:
        small: BoolArray = np.abs(growth(fit)) < NEGLIGIBLE_GROWTH
        return small

    def judge(one: Knowledge) -> tuple[Belief, str]:
        start = one.fit.experiment.initial_grain_size * LENGTH_FACTOR
        low, median, high = start * (1 + np.nanquantile(growth(one.fit), [0.05, 0.5, 0.95]))
        return probability(one, negligible), (
            f"from {start:.3g} to {median:.3g} [{low:.3g}, {high:.3g}] {LENGTH_UNIT}"
        )

    return _judge(
        known,
        judge,
        key="grain_growth_of_olivine",
        source="Olivine",
        text="Grain growth of olivine over the record is almost negligible.",
        rule="A draw counts if grain size at the end of the record differs by less than "
        f"{100 * NEGLIGIBLE_GROWTH:g} % from that at its start.",
    )


def _spread_in_amplitude(known: Mapping[str, Knowledge]) -> Statement:
    """Whether predicted stress curves of olivine differ in amplitude more than in phase."""

    def spread(oscillation: npt.NDArray[np.complex128], weights: FloatArray) -> tuple[float, float]:
        size, mean_phase = np.abs(oscillation), np.angle(weights @ oscillation)
        phase = np.angle(oscillation * np.exp(-1j * mean_phase))
        mean, of_phase = weights @ size, phase - weights @ phase
        return (
            float(np.sqrt(weights @ (size - mean) ** 2) / mean),
            float(np.sqrt(weights @ of_phase**2)),
        )

    def holds(amplitude: float, phase: float) -> bool | None:
        return between(amplitude / phase, wrong_below=1 / DOMINANT, right_above=DOMINANT)

    def judge(one: Knowledge) -> tuple[Belief, str]:
        before, after = predicted_oscillation(one.prior), predicted_oscillation(one.fit)
        amplitude, phase = spread(after, np.full(after.size, 1 / after.size))
        belief = Belief(
            prior=holds(*spread(before, np.full(before.size, 1 / before.size))),
            number=holds(*spread(before, one.weights)),
            posterior=holds(amplitude, phase),
            effective_draws=one.effective_draws,
        )
        return belief, (
            f"the amplitude varies by {100 * amplitude:.2g} % and the phase by {phase:.2g} rad "
            f"(standard deviations), a ratio of {amplitude / phase:.2g}"
        )

    return _judge(
        known,
        judge,
        key="spread_in_amplitude",
        source="Olivine",
        text="The predicted stress of olivine varies over the posterior in amplitude rather than "
        "in phase.",
        rule="A shift of the phase by x rad changes an oscillation as much as a relative change x "
        f"of its amplitude: holds if amplitude varies more than {DOMINANT:g} times as much as "
        f"phase, does not hold if less than 1/{DOMINANT:g} times.",
    )


def _judge(
    known: Mapping[str, Knowledge],
    judge: Callable[[Knowledge], tuple[Belief, str]],
    *,
    key: str,
    source: str,
    text: str,
    rule: str,
) -> Statement:
    """Judge a statement by the fit of each treatment of the background."""
    found = {treatment: judge(one) for treatment, one in known.items()}
    return Statement(
        key=key,
        source=source,
        text=text,
        evidence=joined(
            f"with the background {name} {words}" for name, (_, words) in found.items()
        ),
        beliefs={name: belief for name, (belief, _) in found.items()},
        rule=rule,
    )
