"""What the paper states about olivine, judged by fits of a record with and without background."""

from collections.abc import Callable, Mapping
from functools import partial
from typing import Any, cast

import numpy as np
import numpy.typing as npt
from common import (
    BoolArray,
    Fitted,
    FloatArray,
    interval,
    moments,
    parameter_draws,
    prediction_draws,
    rhat,
    with_error,
)

from maor.before_data import Datum, Knowledge
from maor.ice import RHAT_LIMIT, near
from maor.statements import (
    DOMINANT,
    FEW,
    MOST,
    NARROW,
    Belief,
    Claim,
    Statement,
    between,
    probability,
)
from pyburgers import OscillationExperiment, predicted_response, shown_quantity

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


def oscillation_of(fit: Fitted) -> OscillationExperiment:
    """Return the test of a fit; all that olivine is judged by are forced oscillations."""
    return cast(OscillationExperiment, fit.experiment)


STRESS_AMPLITUDE = Datum(
    lambda test: float(oscillation_of(test).prepared.stress_fit.amplitude()[0]),
    lambda draws: predicted_response(draws).amplitude,
)


def olivine_statements(known: Mapping[str, Knowledge]) -> tuple[Statement, ...]:
    """Judge the paper's statements about olivine by treatment of the background; may be none.

    Treatments, ``"removed"`` and ``"kept"``, are known by their `STRESS_AMPLITUDE` ahead of their
    records.
    """
    return tuple(claim.judged(known) for claim in CLAIMS) if known else ()


def _constrained_kelvin_modulus(one: Knowledge) -> tuple[Belief, str]:
    """Judge whether the data narrow the Kelvin modulus."""
    quantity = shown_quantity("kelvin_modulus")
    factor, unit = quantity.display_factor, quantity.display_unit
    mean, sd = moments(parameter_draws(one.fit, "kelvin_modulus"))
    by_prior, by_amplitude = one.sd_before("kelvin_modulus")
    number, posterior = (
        between(-width / by_prior, wrong_below=-MOST, right_above=-FEW)
        for width in (by_amplitude, sd)
    )
    return Belief(False, number, posterior, one.effective_draws), (
        f"{with_error(mean * factor, sd * factor)} {unit}, {sd / by_prior:.2f} of the prior's "
        f"standard deviation ({by_amplitude / by_prior:.2f} with the amplitude alone)"
    )


def _shape_of_kelvin_modulus(one: Knowledge) -> tuple[Belief, str]:
    """Judge whether the posterior of the Kelvin modulus is a bell, and not flat as its prior."""
    draws = (parameter_draws(fit, "kelvin_modulus") for fit in (one.prior, one.fit))
    shapes = [_excess_kurtosis(*weighed) for weighed in one.three(*draws)]
    beliefs = (between(shape, wrong_below=FLAT, right_above=BELL) for shape in shapes)
    by_prior, by_number, by_data = shapes
    return Belief.of(beliefs, one), (
        f"the excess kurtosis of E_K is {by_data:.1f} ({by_prior:.1f} under the prior, "
        f"{by_number:.1f} with the amplitude alone)"
    )


def _excess_kurtosis(draws: FloatArray, weights: FloatArray) -> float:
    away = draws - weights @ draws
    return float(weights @ away**4 / (weights @ away**2) ** 2 - 3)


def _cause_of_offset(one: Knowledge) -> tuple[Belief, str]:
    """Judge whether draws are off the mean stress of the record by their stress exponents."""
    columns = (
        np.column_stack(
            [
                parameter_draws(fit, "stress_exponent"),
                prediction_draws(fit, "stress").mean(axis=1),
            ]
        )
        for fit in (one.prior, one.fit)
    )
    found = [_correlation(*weighed) for weighed in one.three(*columns)]
    beliefs = (
        between(abs(value), wrong_below=FEW, right_above=MOST) if np.isfinite(value) else None
        for value in found
    )
    words = (
        f"n and the mean stress correlate by {found[-1]:.2f}"
        if np.isfinite(found[-1])
        else "no draw has an offset"
    )
    return Belief.of(beliefs, one), words


def _correlation(columns: FloatArray, weights: FloatArray) -> float:
    """Correlation of n and a mean stress (Pa), shape (n_draws, 2); NaN if no stress is off."""
    solved = np.isfinite(columns[:, 1])
    weights = weights[solved] / weights[solved].sum()
    away = [column[solved] - weights @ column[solved] for column in columns.T]
    spreads = [np.sqrt(weights @ one**2) for one in away]
    if spreads[1] < LEAST_OFFSET:
        return np.nan
    return float(weights @ (away[0] * away[1]) / (spreads[0] * spreads[1]))


def _unconstrained_critical_strain(one: Knowledge) -> tuple[Belief, str]:
    """Judge whether the critical strain is left to its prior, and say whether chains agree."""
    name = "critical_strain_grain_size"
    by_prior, by_amplitude = one.sd_before(name)
    share = moments(parameter_draws(one.fit, name))[1] / by_prior
    found = rhat(one.fit.posterior["posterior"].to_dataset()[[name]])[name]
    agreement = "the chains agree" if found <= RHAT_LIMIT else "the chains do not agree"
    if not np.isfinite(found):
        agreement = "it is not known whether chains agree"
    left_open = partial(between, wrong_below=NARROW, right_above=UNINFORMED)
    beliefs = map(left_open, (1.0, by_amplitude / by_prior, share))
    return Belief.of(beliefs, one), (
        f"the standard deviation is {share:.2f} of the prior's and {agreement} (R-hat {found:.3f})"
    )


def _stress_exponent(one: Knowledge) -> tuple[Belief, str]:
    """Judge whether the stress exponent is about the paper's."""
    name = "stress_exponent"
    by_prior, by_amplitude = one.sd_before(name)
    return probability(one, near(name, STRESS_EXPONENT, ABOUT)), (
        f"{with_error(*moments(parameter_draws(one.fit, name)))} (standard deviation "
        f"{by_prior:.2g} under the prior, {by_amplitude:.2g} with the amplitude alone)"
    )


def _grain_growth(one: Knowledge) -> tuple[Belief, str]:
    """Judge whether the grains keep their size over the record."""

    def growth(fit: Fitted) -> FloatArray:
        size = prediction_draws(fit, "grain_size")
        return np.asarray(size[:, -1] / fit.experiment.initial_grain_size - 1)

    def negligible(fit: Fitted) -> BoolArray:
        return np.asarray(np.abs(growth(fit)) < NEGLIGIBLE_GROWTH)

    start = one.fit.experiment.initial_grain_size * 1e6
    sizes = interval(start * (1 + growth(one.fit)), ".3g", " µm")
    return probability(one, negligible), f"from {start:.3g} to {sizes}"


def _spread_in_amplitude(one: Knowledge) -> tuple[Belief, str]:
    """Judge whether predicted stress curves differ in amplitude more than in phase."""

    def oscillation(fit: Fitted) -> npt.NDArray[np.complex128]:
        found = predicted_response(fit)
        return np.asarray(found.amplitude * np.exp(1j * found.lag))

    weighed = one.three(*map(oscillation, (one.prior, one.fit)))
    spreads = [_spread(draws, weights) for draws, weights in weighed]
    beliefs = (
        between(amplitude / phase, wrong_below=1 / DOMINANT, right_above=DOMINANT)
        for amplitude, phase in spreads
    )
    amplitude, phase = spreads[-1]
    return Belief.of(beliefs, one), (
        f"the amplitude varies by {100 * amplitude:.2g} % and the phase by {phase:.2g} rad "
        f"(standard deviations), a ratio of {amplitude / phase:.2g}"
    )


def _spread(oscillation: npt.NDArray[Any], weights: FloatArray) -> tuple[float, float]:
    """Relative spread of the amplitude of oscillations, and that of their phase (rad)."""
    size, mean_phase = np.abs(oscillation), np.angle(weights @ oscillation)
    phase = np.angle(oscillation * np.exp(-1j * mean_phase))
    mean, of_phase = weights @ size, phase - weights @ phase
    return (
        float(np.sqrt(weights @ (size - mean) ** 2) / mean),
        float(np.sqrt(weights @ of_phase**2)),
    )


def _claim(
    key: str,
    source: str,
    text: str,
    judge: Callable[[Knowledge], tuple[Belief, str]],
    rule: str,
) -> Claim[Knowledge]:
    """Return a claim about each treatment of the background."""
    each = "with the background {} {}"
    return Claim(key, source, text, judge, rule, each=each, separator="; ")


CLAIMS = (
    _claim(
        "kelvin_modulus_of_olivine",
        "Olivine, Table 2",
        "The Kelvin modulus E_K of olivine is constrained by the data.",
        _constrained_kelvin_modulus,
        "Holds if the standard deviation is below a third of the prior's, does not hold "
        "above two thirds.",
    ),
    _claim(
        "shape_of_kelvin_modulus",
        "Olivine, Table 2",
        "The posterior of E_K has the shape of a bell, where its prior is flat.",
        _shape_of_kelvin_modulus,
        "Its excess kurtosis, 0 of a normal and -1.2 of a uniform distribution: holds above "
        f"{BELL:g}, does not hold below {FLAT:g}.",
    ),
    _claim(
        "critical_strain_of_olivine",
        "Olivine, Table 2",
        "The critical strain ε_c1 of olivine does not converge: the data do not fix it.",
        _unconstrained_critical_strain,
        f"Holds if the standard deviation is above {UNINFORMED:g} of the prior's, does not "
        f"hold below {NARROW:g}; without the data it holds, so that what they leave open is "
        "granted by the prior. Chains that agree say that a parameter was sampled well, not that "
        "the data fix it.",
    ),
    _claim(
        "stress_exponent_of_olivine",
        "Olivine",
        f"The stress exponent n of olivine is about {STRESS_EXPONENT:g}.",
        _stress_exponent,
        f"A draw counts if it is within {ABOUT:g} of {STRESS_EXPONENT:g}.",
    ),
    _claim(
        "cause_of_offset",
        "Olivine, Fig. 5",
        "A stress exponent n near 3 causes the offset of the predicted stress.",
        _cause_of_offset,
        "The correlation of n with the mean of the predicted stress over the draws, of either "
        f"sign: holds above {MOST:.2f}, does not hold below {FEW:.2f}. With the background removed "
        "no stress has an offset, and we cannot tell.",
    ),
    _claim(
        "grain_growth_of_olivine",
        "Olivine",
        "Grain growth of olivine over the record is almost negligible.",
        _grain_growth,
        "A draw counts if grain size at the end of the record differs by less than "
        f"{100 * NEGLIGIBLE_GROWTH:g} % from that at its start.",
    ),
    _claim(
        "spread_in_amplitude",
        "Olivine",
        "The predicted stress of olivine varies over the posterior in amplitude rather than "
        "in phase.",
        _spread_in_amplitude,
        "A shift of the phase by x rad changes an oscillation as much as a relative change x "
        f"of its amplitude: holds if amplitude varies more than {DOMINANT:g} times as much as "
        f"phase, does not hold if less than 1/{DOMINANT:g} times.",
    ),
)
