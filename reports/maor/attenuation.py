"""What the paper states about attenuation, judged by spectra of every draw."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import xarray as xr
from common import BoolArray, Fitted, FloatArray

from maor.before_data import Knowledge
from maor.statements import DOMINANT, Belief, Claim, Statement, probability_of
from pyburgers import Regime, predict_attenuation

BACKGROUND_SLOPE = -0.5
"""Logarithmic slope of attenuation along frequency below which the dashpot's background rules."""

FALLING_FREQUENCY = 1e-3
"""Where the paper sees the falling stretch, Hz; near means within a factor `DOMINANT`."""

LITTLE_VARIATION = 0.25
"""Difference of two logarithmic slopes that is still minimal: a quarter of the background's."""

CLEAR_CHANGE = 0.1
"""Relative change of attenuation from which the amplitude of the cycles matters."""

AMPLITUDE_REGIMES = tuple(Regime(2e6, amplitude) for amplitude in (0.1e6, 0.5e6, 1e6, 1.9e6))
"""Stress cycles (Pa) of the test of amplitudes: our choice, the paper's Fig. S3 is not public."""

MICROSTRUCTURE_SENTENCE = (
    "Spectra are those of the initial microstructure, that is the initial grain size and an "
    "isotropic fabric, held constant."
)

_STRESSES = "1, 1.5, 2, 4 MPa"
"""Median stresses of the regimes of the paper."""


@dataclass(frozen=True, eq=False)
class Spectra:
    """What is known of a sample, and attenuation of the draws of its prior and of its fit."""

    known: Knowledge
    before: xr.Dataset
    after: xr.Dataset


def spectra_of(known: Knowledge) -> Spectra:
    """Predict the attenuation of a sample."""
    before, after = (
        predict_attenuation(fit, with_strains=False) for fit in (known.prior, known.fit)
    )
    return Spectra(known, before, after)


def attenuation_statements(spectra: Mapping[str, Spectra]) -> tuple[Statement, ...]:
    """Judge the paper's statements about attenuation, by sample, which may be none."""
    return tuple(claim.judged(spectra) for claim in CLAIMS) if spectra else ()


def tan_delta(spectrum: xr.Dataset) -> FloatArray:
    """Attenuation along increasing frequency, shape (n_draws, n_regimes, n_frequencies)."""
    ordered = spectrum.sortby("frequency")["tan_delta"].transpose(..., "regime", "frequency")
    return ordered.to_numpy().reshape(-1, *ordered.shape[-2:])


def peaks(spectrum: xr.Dataset) -> BoolArray:
    """Whether the peak stands out, shape (n_draws, n_regimes)."""
    ordered = spectrum["debye_peak"].transpose(..., "regime")
    return ordered.to_numpy().reshape(-1, ordered.shape[-1])


def lowest_slope(spectrum: xr.Dataset) -> FloatArray:
    """Logarithmic slope between the two lowest frequencies, shape (n_draws, n_regimes)."""
    return slopes(spectrum)[..., 0]


def slopes(spectrum: xr.Dataset) -> FloatArray:
    """Logarithmic slopes between neighbours, shape (n_draws, n_regimes, n_frequencies - 1)."""
    frequency = np.log(np.sort(spectrum["frequency"].to_numpy()))
    found: FloatArray = np.diff(np.log(tan_delta(spectrum)), axis=-1) / np.diff(frequency)
    return found


def falling_stretch(spectrum: xr.Dataset) -> tuple[FloatArray, FloatArray]:
    """Return the ends (Hz) of where the first regime falls towards low frequency, (n_draws,) each.

    NaN where a draw has no such stretch among the frequencies.
    """
    frequency = np.sort(spectrum["frequency"].to_numpy())
    falls = np.diff(tan_delta(spectrum)[:, 0], axis=-1) > 0
    some = falls.any(axis=1)
    low = np.where(some, frequency[:-1][falls.argmax(axis=1)], np.nan)
    high = np.where(some, frequency[1:][::-1][falls[:, ::-1].argmax(axis=1)], np.nan)
    return low, high


def _has_peak_and_background(spectrum: xr.Dataset) -> BoolArray:
    """Whether a curve has both a Debye peak and, at low frequency, the dashpot's background."""
    in_regime = peaks(spectrum) & (lowest_slope(spectrum) < BACKGROUND_SLOPE)
    return np.asarray(in_regime.any(axis=1))


def _rises_with_stress(spectrum: xr.Dataset) -> BoolArray:
    """Whether attenuation grows from each regime to the next at every frequency."""
    return np.asarray((np.diff(tan_delta(spectrum), axis=1) > 0).all(axis=(1, 2)))


def _least_growth(spectrum: xr.Dataset) -> str:
    medians = np.median(tan_delta(spectrum), axis=0)
    return f"{(medians[1:] / medians[:-1]).min():.3f}"


def _only_lowest_falls(spectrum: xr.Dataset) -> BoolArray:
    """Whether only the lowest regime has a peak, with its falling stretch where the paper's is."""
    peak = peaks(spectrum)
    low, high = falling_stretch(spectrum)
    near = (low <= FALLING_FREQUENCY * DOMINANT) & (high >= FALLING_FREQUENCY / DOMINANT)
    return np.asarray(peak[:, 0] & ~peak[:, 1:].any(axis=1) & near)


def _stretches(spectrum: xr.Dataset) -> str:
    shares = peaks(spectrum).mean(axis=0)
    text = f"{', '.join(f'{100 * share:.0f}' for share in shares)} %"
    low, high = (end[np.isfinite(end)] for end in falling_stretch(spectrum))
    if low.size == 0:
        return text
    return f"{text}; {np.median(low):.1e} to {np.median(high):.1e} Hz"


def _variation(spectrum: xr.Dataset) -> FloatArray:
    """Largest less smallest slope at the highest stress, shape (n_draws,)."""
    return np.asarray(np.ptp(slopes(spectrum)[:, -1], axis=1))


def _slopes_text(spectrum: xr.Dataset) -> str:
    return ", ".join(f"{slope:.2f}" for slope in np.median(lowest_slope(spectrum), axis=0))


def _steps(spectrum: xr.Dataset) -> tuple[FloatArray, FloatArray]:
    """Growth of attenuation from 1 to 2 and from 2 to 4 MPa, shape (n_draws, n_frequencies)."""
    one, two, four = (tan_delta(spectrum)[:, k] for k in (0, 2, 3))
    return two - one, four - two


def _upper_step_is_larger(spectrum: xr.Dataset) -> BoolArray:
    lower, upper = _steps(spectrum)
    return np.asarray((upper > DOMINANT * lower).all(axis=1))


def _ratio_of_steps(spectrum: xr.Dataset) -> str:
    # Frequency drops out of the ratio, up to rounding: only the dashpot depends on stress.
    lower, upper = (step[:, 0] for step in _steps(spectrum))
    low, median, high = np.quantile(upper / lower, [0.05, 0.5, 0.95])
    return f"{median:.1f} [{low:.1f}, {high:.1f}]"


def _by_amplitude(spectra: Spectra) -> tuple[Belief, str]:
    """Judge whether attenuation depends on the amplitude of the cycles."""

    def growth(fit: Fitted) -> FloatArray:
        spectrum = predict_attenuation(fit, regimes=AMPLITUDE_REGIMES, with_strains=False)
        found = tan_delta(spectrum)
        return np.asarray((found[:, -1] / found[:, 0]).max(axis=1))

    before, after = growth(spectra.known.prior), growth(spectra.known.fit)
    limit = 1 + CLEAR_CHANGE
    belief = probability_of(before > limit, after > limit, spectra.known)
    return belief, f"{np.median(after):.2f}"


def _share_of_draws(
    key: str,
    text: str,
    happens: Callable[[xr.Dataset], BoolArray],
    lead: str,
    words: Callable[[xr.Dataset], str],
    rule: str,
) -> Claim[Spectra]:
    """Return a claim that is judged by the share of draws whose spectra have something."""

    def judge(one: Spectra) -> tuple[Belief, str]:
        belief = probability_of(happens(one.before), happens(one.after), one.known)
        return belief, words(one.after)

    return Claim(key, "Fig. 6", text, judge, rule, lead=f"{lead}: ", separator="; ")


CLAIMS: tuple[Claim[Spectra], ...] = (
    _share_of_draws(
        "peak_and_background",
        "Attenuation is a Debye peak on top of a background that rises towards low frequency "
        "as a power law.",
        _has_peak_and_background,
        f"median slope at the lowest frequencies at {_STRESSES}",
        _slopes_text,
        "A draw counts if in one regime at least it has a peak and d ln tan δ/d ln f at the "
        f"two lowest frequencies is below {BACKGROUND_SLOPE:g} (the background alone has -1).",
    ),
    _share_of_draws(
        "rise_with_stress",
        "Attenuation rises with stress.",
        _rises_with_stress,
        "least factor by which the median curve grows from one regime to the next",
        _least_growth,
        "A draw counts if attenuation grows from each of the four regimes to the next at "
        "every frequency; with a stress exponent above one the model cannot do otherwise.",
    ),
    _share_of_draws(
        "one_falling_stretch",
        "Only the curve at 1 MPa has a “negative slope”, near 1e-3 Hz; read towards low "
        "frequency, where the others rise throughout.",
        _only_lowest_falls,
        f"share of draws with such a stretch at {_STRESSES} and its median ends at 1 MPa",
        _stretches,
        "A draw counts if the curve at 1 MPa alone has such a stretch (the closed criterion "
        f"of a Debye peak that stands out) and it comes within a factor {DOMINANT:g} of 1e-3 Hz. "
        "We read the slope along falling frequency; along rising frequency "
        "the others have a negative one.",
    ),
    _share_of_draws(
        "buried_peak",
        "At 4 MPa the Debye peak cannot be discerned.",
        lambda spectrum: ~peaks(spectrum)[:, -1],
        "share of draws whose peak stands out there",
        lambda spectrum: f"{100 * peaks(spectrum)[:, -1].mean():.0f} %",
        "A draw counts if tan δ at 4 MPa falls with frequency everywhere (closed criterion). "
        "With E_K at most an eighth of E_M a peak stands out at every stress.",
    ),
    _share_of_draws(
        "larger_step",
        "The step from 2 to 4 MPa is much larger than that from 1 to 2 MPa.",
        _upper_step_is_larger,
        "ratio of the steps, median and 90 % interval",
        _ratio_of_steps,
        "A step is the difference of tan δ; a draw counts if at every frequency the upper "
        f"step is more than {DOMINANT:g} times the lower.",
    ),
    _share_of_draws(
        "slope_at_4_MPa",
        "At 4 MPa the slope of attenuation along frequency has “minimal variation”.",
        lambda spectrum: _variation(spectrum) < LITTLE_VARIATION,
        "largest less smallest d ln tan δ/d ln f there, median",
        lambda spectrum: f"{np.median(_variation(spectrum)):.2f}",
        "A draw counts if d ln tan δ/d ln f between neighbouring frequencies differs by less "
        f"than {LITTLE_VARIATION:g} over the frequencies at 4 MPa.",
    ),
    _share_of_draws(
        "background",
        "The background at low frequency intensifies with stress.",
        lambda spectrum: np.asarray((np.diff(lowest_slope(spectrum), axis=1) < 0).all(axis=1)),
        f"median slope at the lowest frequencies at {_STRESSES}",
        _slopes_text,
        "A draw counts if d ln tan δ/d ln f at the two lowest frequencies falls from each of "
        "the four regimes to the next, towards the -1 of the background alone.",
    ),
    Claim(
        "amplitude",
        "Fig. S3",
        "At one median stress attenuation depends on the amplitude of the cycles.",
        _by_amplitude,
        f"A draw counts if tan δ grows by more than {100 * CLEAR_CHANGE:g} % at one frequency "
        "at least.",
        lead="largest factor by which tan δ grows from 0.1 to 1.9 MPa about 2 MPa, median: ",
    ),
)
