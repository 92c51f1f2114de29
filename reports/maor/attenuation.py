"""What the paper states about attenuation, judged by spectra of every draw."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import xarray as xr

from pyburgers.common.units import number
from pyburgers.model.display import STRESS_FACTOR, STRESS_UNIT
from pyburgers.predictions.attenuation import (
    falling_stretch,
    increasing_frequency,
    lowest_slope,
    predict_attenuation,
    regime_peaks,
)
from pyburgers.predictions.stress_cycles import PAPER_REGIMES, amplitude_regimes
from pyburgers.protocols.protocol import FittedTest
from pyburgers.studies.maor.before_data import Knowledge
from pyburgers.studies.maor.statements import (
    DOMINANT,
    BoolArray,
    Statement,
    joined,
    probability_of,
)

FloatArray = npt.NDArray[np.float64]

BACKGROUND_SLOPE = -0.5
"""Logarithmic slope of attenuation along frequency below which the dashpot's background rules."""

FALLING_FREQUENCY = 1e-3
"""Where the paper sees the falling stretch, Hz; near means within a factor `DOMINANT`."""

LITTLE_VARIATION = 0.25
"""Difference of two logarithmic slopes that is still minimal: a quarter of the background's."""

CLEAR_CHANGE = 0.1
"""Relative change of attenuation from which the amplitude of the cycles matters."""

AMPLITUDE_REGIMES = amplitude_regimes(2e6, (0.1e6, 0.5e6, 1e6, 1.9e6))
"""Stress cycles (Pa) of the test of amplitudes: our choice, the paper's Fig. S3 is not public."""

MICROSTRUCTURE_SENTENCE = (
    "Spectra are those of the initial microstructure, that is the initial grain size and an "
    "isotropic fabric, held constant."
)

_STRESSES = (
    f"{', '.join(number(r.median_stress * STRESS_FACTOR) for r in PAPER_REGIMES)} {STRESS_UNIT}"
)


@dataclass(frozen=True, eq=False)
class Spectra:
    """Attenuation of a sample before and after its data, in the paper's regimes.

    Attributes
    ----------
    known : Knowledge
        The sample.
    before, after : Dataset
        Spectra of the draws of the prior and of the fit
        (`pyburgers.predictions.attenuation.predict_attenuation`).
    """

    known: Knowledge
    before: xr.Dataset
    after: xr.Dataset


def spectra_of(known: Knowledge) -> Spectra:
    """Predict the attenuation of a sample."""
    before = predict_attenuation(known.prior).drop_vars(["storage_compliance", "loss_compliance"])
    return Spectra(known, before, predict_attenuation(known.fit))


def attenuation_statements(spectra: Mapping[str, Spectra]) -> tuple[Statement, ...]:
    """Judge the paper's statements about attenuation.

    Parameters
    ----------
    spectra : mapping of str to Spectra
        By sample; may be empty.
    """
    judges = (
        _peak_and_background,
        _rise_with_stress,
        _one_falling_stretch,
        _buried_peak,
        _larger_step,
        _slope_at_the_highest,
        _background,
        _amplitude,
    )
    return tuple(judge(spectra) for judge in judges) if spectra else ()


def _peak_and_background(spectra: Mapping[str, Spectra]) -> Statement:
    """Whether a curve has both a Debye peak and, at low frequency, the dashpot's background."""

    def both(spectrum: xr.Dataset) -> BoolArray:
        in_regime = regime_peaks(spectrum) & (lowest_slope(spectrum) < BACKGROUND_SLOPE)
        return np.asarray(in_regime.any(axis=1))

    return _judge(
        spectra,
        key="peak_and_background",
        text="Attenuation is a Debye peak on top of a background that rises towards low frequency "
        "as a power law.",
        event=both,
        lead=f"median slope at the lowest frequencies at {_STRESSES}",
        detail=_slopes,
        rule="A draw counts if in one regime at least it has a peak and d ln tan δ/d ln f at the "
        f"two lowest frequencies is below {BACKGROUND_SLOPE:g} (the background alone has -1).",
    )


def _rise_with_stress(spectra: Mapping[str, Spectra]) -> Statement:
    """Whether attenuation grows from each regime to the next at every frequency."""

    def growth(spectrum: xr.Dataset) -> FloatArray:
        tan_delta = increasing_frequency(spectrum)
        factors: FloatArray = tan_delta[:, 1:] / tan_delta[:, :-1]
        return factors

    def smallest(spectrum: xr.Dataset) -> str:
        medians = np.median(increasing_frequency(spectrum), axis=0)
        return f"{(medians[1:] / medians[:-1]).min():.3f}"

    return _judge(
        spectra,
        key="rise_with_stress",
        text="Attenuation rises with stress.",
        event=lambda spectrum: np.asarray((growth(spectrum) > 1).all(axis=(1, 2))),
        lead="least factor by which the median curve grows from one regime to the next",
        detail=smallest,
        rule="A draw counts if attenuation grows from each of the four regimes to the next at "
        "every frequency; with a stress exponent above one the model cannot do otherwise.",
    )


def _one_falling_stretch(spectra: Mapping[str, Spectra]) -> Statement:
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

    return _judge(
        spectra,
        key="one_falling_stretch",
        text="Only the curve at 1 MPa has a “negative slope”, near 1e-3 Hz; read towards low "
        "frequency, where the others rise throughout.",
        event=only_lowest,
        lead=f"share of draws with such a stretch at {_STRESSES} and its median ends at 1 MPa",
        detail=stretches,
        rule="A draw counts if the curve at 1 MPa alone has such a stretch (the closed criterion "
        f"of a Debye peak that stands out) and it comes within a factor {DOMINANT:g} of 1e-3 Hz. "
        "We read the slope along falling frequency; along rising frequency "
        "the others have a negative one.",
    )


def _buried_peak(spectra: Mapping[str, Spectra]) -> Statement:
    """Whether the highest stress leaves no peak."""
    return _judge(
        spectra,
        key="buried_peak",
        text="At 4 MPa the Debye peak cannot be discerned.",
        event=lambda spectrum: ~regime_peaks(spectrum)[:, -1],
        lead="share of draws whose peak stands out there",
        detail=lambda spectrum: f"{100 * regime_peaks(spectrum)[:, -1].mean():.0f} %",
        rule="A draw counts if tan δ at 4 MPa falls with frequency everywhere (closed criterion). "
        "With E_K at most an eighth of E_M a peak stands out at every stress.",
    )


def _slope_at_the_highest(spectra: Mapping[str, Spectra]) -> Statement:
    """Whether the slope at the highest stress is nearly the same at all frequencies."""

    def variation(spectrum: xr.Dataset) -> FloatArray:
        frequency = np.log(np.sort(spectrum["frequency"].to_numpy()))
        curve = np.log(increasing_frequency(spectrum)[:, -1])
        spread: FloatArray = np.ptp(np.diff(curve, axis=1) / np.diff(frequency), axis=1)
        return spread

    return _judge(
        spectra,
        key="slope_at_4_MPa",
        text="At 4 MPa the slope of attenuation along frequency has “minimal variation”.",
        event=lambda spectrum: variation(spectrum) < LITTLE_VARIATION,
        lead="largest less smallest d ln tan δ/d ln f there, median",
        detail=lambda spectrum: f"{np.median(variation(spectrum)):.2f}",
        rule="A draw counts if d ln tan δ/d ln f between neighbouring frequencies differs by less "
        f"than {LITTLE_VARIATION:g} over the frequencies at 4 MPa.",
    )


def _background(spectra: Mapping[str, Spectra]) -> Statement:
    """Whether the background takes over more of the low frequencies from regime to regime."""
    return _judge(
        spectra,
        key="background",
        text="The background at low frequency intensifies with stress.",
        event=lambda spectrum: np.asarray((np.diff(lowest_slope(spectrum), axis=1) < 0).all(1)),
        lead=f"median slope at the lowest frequencies at {_STRESSES}",
        detail=_slopes,
        rule="A draw counts if d ln tan δ/d ln f at the two lowest frequencies falls from each of "
        "the four regimes to the next, towards the -1 of the background alone.",
    )


def _slopes(spectrum: xr.Dataset) -> str:
    return ", ".join(f"{slope:.2f}" for slope in np.median(lowest_slope(spectrum), axis=0))


def _larger_step(spectra: Mapping[str, Spectra]) -> Statement:
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

    return _judge(
        spectra,
        key="larger_step",
        text="The step from 2 to 4 MPa is much larger than that from 1 to 2 MPa.",
        event=larger,
        lead="ratio of the steps, median and 90 % interval",
        detail=interval,
        rule="A step is the difference of tan δ; a draw counts if at every frequency the upper "
        f"step is more than {DOMINANT:g} times the lower.",
    )


def _amplitude(spectra: Mapping[str, Spectra]) -> Statement:
    """Whether attenuation depends on the amplitude of the cycles."""

    def growth(fit: FittedTest) -> FloatArray:
        spectrum = predict_attenuation(fit, regimes=AMPLITUDE_REGIMES, with_strains=False)
        tan_delta = increasing_frequency(spectrum)
        largest: FloatArray = (tan_delta[:, -1] / tan_delta[:, 0]).max(axis=1)
        return largest

    found = {
        name: (growth(one.known.prior), growth(one.known.fit)) for name, one in spectra.items()
    }
    first, last = (number(AMPLITUDE_REGIMES[k].amplitude * STRESS_FACTOR) for k in (0, -1))
    details = ", ".join(f"{name} {np.median(after):.2f}" for name, (_, after) in found.items())
    return Statement(
        key="amplitude",
        source="Fig. S3",
        text="At one median stress attenuation depends on the amplitude of the cycles.",
        evidence=joined(
            [
                f"largest factor by which tan δ grows from {first} to {last} {STRESS_UNIT} about "
                f"{number(AMPLITUDE_REGIMES[0].median_stress * STRESS_FACTOR)} {STRESS_UNIT}, "
                f"median: {details}"
            ]
        ),
        beliefs={
            name: probability_of(
                before > 1 + CLEAR_CHANGE, after > 1 + CLEAR_CHANGE, spectra[name].known
            )
            for name, (before, after) in found.items()
        },
        rule=f"A draw counts if tan δ grows by more than {100 * CLEAR_CHANGE:g} % at one frequency "
        "at least.",
    )


def _judge(
    spectra: Mapping[str, Spectra],
    *,
    key: str,
    text: str,
    event: Callable[[xr.Dataset], BoolArray],
    lead: str,
    detail: Callable[[xr.Dataset], str],
    rule: str,
) -> Statement:
    """Judge a statement by the share of draws for which an event is true, sample by sample."""
    details = "; ".join(f"{name} {detail(one.after)}" for name, one in spectra.items())
    return Statement(
        key=key,
        source="Fig. 6",
        text=text,
        evidence=joined([f"{lead}: {details}"]),
        beliefs={
            name: probability_of(event(one.before), event(one.after), one.known)
            for name, one in spectra.items()
        },
        rule=rule,
    )
