"""What the paper states, beside what our posterior says about it, each with a computed verdict.

Every verdict follows from draws by a rule that stands beside it. A statement about several samples
or several treatments of the data has the verdict that all of them share, and is undecided where
they differ.
"""

from collections.abc import Callable, Iterable, Mapping
from dataclasses import dataclass
from typing import Literal

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from pyburgers.common.errors import InputError
from pyburgers.common.units import number, rounded
from pyburgers.model.display import STRESS_FACTOR, STRESS_UNIT, shown_quantity
from pyburgers.model.display import symbol_text as symbol
from pyburgers.predictions.attenuation import (
    falling_stretch,
    increasing_frequency,
    lowest_slope,
    regime_peaks,
)
from pyburgers.predictions.stress_cycles import PAPER_REGIMES
from pyburgers.protocols.protocol import FittedTest

FloatArray = npt.NDArray[np.float64]
BoolArray = npt.NDArray[np.bool_]
Verdict = Literal["agrees", "does not agree", "undecided"]

LIKELY, UNLIKELY = 0.9, 0.1
"""Posterior probabilities above and below which a statement is taken as right and as wrong."""

NARROW = 0.5
"""Share of the prior's standard deviation below which a posterior counts as narrow."""

MOST, FEW = 2 / 3, 1 / 3
"""Shares of parameters, and of a prior's standard deviation, for the rules that count them."""


DOMINANT = 2.0
"""Ratio from which one of two numbers is called much larger than the other."""

BACKGROUND_SLOPE = -0.5
"""Logarithmic slope of attenuation along frequency below which the dashpot's background rules."""

FALLING_FREQUENCY = 1e-3
"""Where the paper sees the falling stretch, Hz; near means within a factor `DOMINANT`."""

PIL40_VALUES: Mapping[str, float] = {
    "stress_exponent": 4.0,
    "critical_strain_grain_size": 0.03,
}
"""What the paper finds for PIL40."""

SYNTHETIC_SENTENCE = (
    "The data behind these posteriors are synthetic: a verdict tests the method, that is whether "
    "it would show what the paper saw, had the material been the one that made the data; it says "
    "nothing about nature."
)

MICROSTRUCTURE_SENTENCE = (
    "Spectra are those of the initial microstructure, that is the initial grain size and an "
    "isotropic fabric, held constant."
)

_STRESSES = (
    f"{', '.join(number(r.median_stress * STRESS_FACTOR) for r in PAPER_REGIMES)} {STRESS_UNIT}"
)
_PROBABILITY_RULE = (
    f"agrees above a posterior probability of {LIKELY:g} in every sample, does not agree below "
    f"{UNLIKELY:g} in every sample, else undecided"
)


@dataclass(frozen=True)
class Statement:
    """One statement of the paper and what became of it.

    Attributes
    ----------
    key : str
        Short name.
    source : str
        Where in the paper.
    text : str
        What the paper says, in our words.
    evidence : str
        A sentence with the numbers of our posterior.
    verdict : {"agrees", "does not agree", "undecided"}
        Computed from the draws.
    rule : str
        How the verdict follows from the numbers, a sentence.
    """

    key: str
    source: str
    text: str
    evidence: str
    verdict: Verdict
    rule: str


def ice_statements(fits: Mapping[str, FittedTest]) -> tuple[Statement, ...]:
    """Judge the paper's statements about ice by posteriors of its parameters.

    Parameters
    ----------
    fits : mapping of str to FittedTest
        Fits of constant rate tests by sample; statements about PIL40 need the key ``"PIL40"``.
    """
    values = [_value_of_pil40(fits["PIL40"], name) for name in PIL40_VALUES if "PIL40" in fits]
    return (*values, _narrow_posteriors(fits)) if fits else ()


def attenuation_statements(spectra: Mapping[str, xr.Dataset]) -> tuple[Statement, ...]:
    """Judge the paper's statements about attenuation.

    Parameters
    ----------
    spectra : mapping of str to Dataset
        Spectra of `pyburgers.predictions.attenuation.predict_attenuation` by sample, in the
        paper's regimes.

    Raises
    ------
    InputError
        If a spectrum has other regimes than the paper's.
    """
    for name, spectrum in spectra.items():
        _check_regimes(name, spectrum)
    judges = (_peak_and_background, _rise_with_stress, _one_falling_stretch, _larger_step)
    return tuple(judge(spectra) for judge in judges) if spectra else ()


def statements_table(statements: Iterable[Statement]) -> pd.DataFrame:
    """Return statements as text: columns paper, statement, verdict, our posterior, rule."""
    return pd.DataFrame(
        [
            {
                "paper": statement.source,
                "statement": statement.text,
                "verdict": statement.verdict,
                "our posterior": statement.evidence,
                "rule": statement.rule,
            }
            for statement in statements
        ],
        columns=["paper", "statement", "verdict", "our posterior", "rule"],
    )


def _value_of_pil40(fit: FittedTest, name: str) -> Statement:
    """Whether the paper's value of a parameter lies in the posterior, and the data had a say."""
    value = PIL40_VALUES[name]
    draws, share = posterior_draws(fit, name), prior_share(fit, name)
    low, high = np.quantile(draws, [0.05, 0.95])
    quantity = shown_quantity(name)
    verdict: Verdict = "undecided"
    if not low <= value <= high:
        verdict = "does not agree"
    elif share < NARROW:
        verdict = "agrees"
    sd = float(draws.std(ddof=1))
    interval = f"[{rounded(low, sd)}, {rounded(high, sd)}]"
    return Statement(
        key=f"{name}_of_PIL40",
        source="PIL40",
        text=f"The {quantity.label} {symbol(quantity)} of PIL40 is about {number(value)}.",
        evidence=f"The central 90 % of the draws are {interval}, with mean "
        f"{rounded(float(draws.mean()), sd)}; the standard deviation is {100 * share:.0f} % of "
        "the prior's.",
        verdict=verdict,
        rule="Agrees if the 90 % interval holds the paper's value and the standard deviation is "
        f"below {NARROW:g} of the prior's, undecided if it holds the value because it is wider "
        "than that, else does not agree.",
    )


def _narrow_posteriors(fits: Mapping[str, FittedTest]) -> Statement:
    """Count the parameters whose posterior is much narrower than the prior."""
    shares = {key: _prior_shares(fit) for key, fit in fits.items()}
    every = np.array([share for ratios in shares.values() for share in ratios.values()])
    narrow = int((every < NARROW).sum())
    by_fit = "; ".join(
        f"{key}: "
        + ", ".join(
            f"{symbol(shown_quantity(name))} {share:.2f}"
            for name, share in sorted(ratios.items(), key=lambda item: item[1])
        )
        for key, ratios in shares.items()
    )
    return Statement(
        key="narrow_posteriors",
        source="Ice, Table 1",
        text="For ice the posteriors are narrow although the priors are wide.",
        evidence=f"{narrow} of {every.size} posteriors have a standard deviation below "
        f"{NARROW:g} of the prior's (ratios for {by_fit}).",
        verdict=between(narrow / every.size, wrong_below=FEW, right_above=MOST),
        rule="Parameters of all samples, the noise aside: agrees if more than two thirds are "
        "narrow, does not agree if less than a third are, else undecided.",
    )


def _peak_and_background(spectra: Mapping[str, xr.Dataset]) -> Statement:
    """Whether a curve has both a Debye peak and, at low frequency, the dashpot's background."""

    def both(spectrum: xr.Dataset) -> BoolArray:
        in_regime = regime_peaks(spectrum) & (lowest_slope(spectrum) < BACKGROUND_SLOPE)
        return np.asarray(in_regime.any(axis=1))

    def slopes(spectrum: xr.Dataset) -> str:
        return ", ".join(f"{slope:.2f}" for slope in np.median(lowest_slope(spectrum), axis=0))

    return _judge_spectra(
        spectra,
        key="peak_and_background",
        text="Attenuation is a Debye peak on top of a background that rises towards low frequency "
        "as a power law.",
        event=both,
        lead="probability, and in brackets the median slope at the lowest frequencies at "
        f"{_STRESSES}",
        detail=slopes,
        rule="A draw counts if in one regime at least it has a peak and d ln tan δ/d ln f at the "
        f"two lowest frequencies is below {BACKGROUND_SLOPE:g} (the background alone has -1)",
    )


def _rise_with_stress(spectra: Mapping[str, xr.Dataset]) -> Statement:
    """Whether attenuation grows from each regime to the next at every frequency."""

    def growth(spectrum: xr.Dataset) -> FloatArray:
        tan_delta = increasing_frequency(spectrum)
        factors: FloatArray = tan_delta[:, 1:] / tan_delta[:, :-1]
        return factors

    def smallest(spectrum: xr.Dataset) -> str:
        medians = np.median(increasing_frequency(spectrum), axis=0)
        return f"{(medians[1:] / medians[:-1]).min():.3f}"

    return _judge_spectra(
        spectra,
        key="rise_with_stress",
        text="Attenuation rises with stress.",
        event=lambda spectrum: np.asarray((growth(spectrum) > 1).all(axis=(1, 2))),
        lead="probability, and in brackets the least factor by which the median curve grows from "
        "one regime to the next",
        detail=smallest,
        rule="A draw counts if attenuation grows from each of the four regimes to the next at "
        "every frequency; with a stress exponent above one the model cannot do otherwise",
    )


def _one_falling_stretch(spectra: Mapping[str, xr.Dataset]) -> Statement:
    """Whether only the lowest regime has a peak, with its falling stretch where the paper's is."""

    def only_lowest(spectrum: xr.Dataset) -> BoolArray:
        peak = regime_peaks(spectrum)
        low, high = falling_stretch(spectrum)
        near = (low <= FALLING_FREQUENCY * DOMINANT) & (high >= FALLING_FREQUENCY / DOMINANT)
        return np.asarray(peak[:, 0] & ~peak[:, 1:].any(axis=1) & near)

    def stretches(spectrum: xr.Dataset) -> str:
        shares = regime_peaks(spectrum).mean(axis=0)
        text = f"{', '.join(f'{100 * share:.0f}' for share in shares)} %"
        low, high = (end[np.isfinite(end)] for end in falling_stretch(spectrum))
        if low.size == 0:
            return text
        return f"{text}; {np.median(low):.1e} to {np.median(high):.1e} Hz"

    return _judge_spectra(
        spectra,
        key="one_falling_stretch",
        text="Towards low frequency attenuation rises throughout, except at 1 MPa, where it falls "
        "over a stretch near 1e-3 Hz.",
        event=only_lowest,
        lead="probability, and in brackets the share of draws with such a stretch at "
        f"{_STRESSES} and its median ends at 1 MPa",
        detail=stretches,
        rule="A draw counts if the curve at 1 MPa alone has such a stretch (the closed criterion "
        f"of a Debye peak that stands out) and it comes within a factor {DOMINANT:g} of 1e-3 Hz",
    )


def _larger_step(spectra: Mapping[str, xr.Dataset]) -> Statement:
    """Whether attenuation grows much more from 2 to 4 MPa than from 1 to 2 MPa."""

    def steps(spectrum: xr.Dataset) -> tuple[FloatArray, FloatArray]:
        one, two, four = (increasing_frequency(spectrum)[:, k] for k in (0, 2, 3))
        return two - one, four - two

    def larger(spectrum: xr.Dataset) -> BoolArray:
        lower, upper = steps(spectrum)
        return np.asarray((upper > DOMINANT * lower).all(axis=1))

    def interval(spectrum: xr.Dataset) -> str:
        # Frequency drops out of the ratio, up to rounding: only the dashpot depends on stress.
        lower, upper = (step[:, 0] for step in steps(spectrum))
        low, median, high = np.quantile(upper / lower, [0.05, 0.5, 0.95])
        return f"{median:.1f} [{low:.1f}, {high:.1f}]"

    return _judge_spectra(
        spectra,
        key="larger_step",
        text="The step from 2 to 4 MPa is much larger than that from 1 to 2 MPa.",
        event=larger,
        lead="probability, and in brackets the ratio of the steps, median and 90 % interval",
        detail=interval,
        rule="A step is the difference of tan δ; a draw counts if at every frequency the upper "
        f"step is more than {DOMINANT:g} times the lower",
    )


def _judge_spectra(
    spectra: Mapping[str, xr.Dataset],
    *,
    key: str,
    text: str,
    event: Callable[[xr.Dataset], BoolArray],
    lead: str,
    detail: Callable[[xr.Dataset], str],
    rule: str,
) -> Statement:
    """Judge a statement by the share of draws for which an event is true, sample by sample."""
    probabilities = {name: float(event(spectrum).mean()) for name, spectrum in spectra.items()}
    by_sample = ", ".join(
        f"{name} {probabilities[name]:.2f} ({detail(spectrum)})"
        for name, spectrum in spectra.items()
    )
    return Statement(
        key=key,
        source="Fig. 6",
        text=text,
        evidence=joined([f"{lead}: {by_sample}"]),
        verdict=common_verdict(
            [between(p, wrong_below=UNLIKELY, right_above=LIKELY) for p in probabilities.values()]
        ),
        rule=f"{rule}; {_PROBABILITY_RULE}.",
    )


def between(value: float, *, wrong_below: float, right_above: float) -> Verdict:
    """Verdict by a number with an undecided range between two limits."""
    if value > right_above:
        return "agrees"
    return "does not agree" if value < wrong_below else "undecided"


def common_verdict(verdicts: Iterable[Verdict]) -> Verdict:
    """Verdict that all share."""
    different = set(verdicts)
    return different.pop() if len(different) == 1 else "undecided"


def joined(parts: Iterable[str]) -> str:
    """Join parts into one sentence."""
    text = "; ".join(parts)
    return f"{text[0].upper()}{text[1:]}."


def posterior_draws(fit: FittedTest, name: str) -> FloatArray:
    """All draws of a parameter (SI), shape (n_draws,)."""
    draws: FloatArray = fit.posterior["posterior"].to_dataset()[name].to_numpy().ravel()
    return draws


def prior_share(fit: FittedTest, name: str) -> float:
    """Posterior over prior standard deviation."""
    return float(posterior_draws(fit, name).std(ddof=1) / fit.priors[name].distribution().std())


def _prior_shares(fit: FittedTest) -> dict[str, float]:
    """Posterior over prior standard deviation of the material's free parameters."""
    return {name: prior_share(fit, name) for name in fit.priors.free if name != "stress_noise"}


def _check_regimes(name: str, spectrum: xr.Dataset) -> None:
    """Check that a spectrum has the regimes that the statements are about, in their order."""
    wanted = [(regime.median_stress, regime.amplitude) for regime in PAPER_REGIMES]
    found = list(
        zip(*(spectrum[k].to_numpy() for k in ("median_stress", "amplitude")), strict=True)
    )
    if len(found) != len(wanted) or not np.allclose(found, wanted):
        raise InputError(
            f"spectra: {name!r} has the regimes {', '.join(map(str, spectrum['regime'].values))}, "
            f"expected the paper's, {', '.join(regime.label for regime in PAPER_REGIMES)}."
        )
