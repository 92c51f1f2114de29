"""The part of a page about attenuation that fits predict: figures, tables, and what they assume."""

from collections.abc import Mapping, Sequence
from functools import partial

from pyburgers.drawing.page_parts import PageFigure, PageSection, PageTable
from pyburgers.kinds.kind import FittedTest
from pyburgers.predictions import figures
from pyburgers.predictions.attenuation import overview_table, predict_attenuation, quantile_table
from pyburgers.predictions.evolving import (
    evolving_attenuation,
    evolving_overview,
    evolving_sentence,
    evolving_table,
)
from pyburgers.predictions.material import (
    elastic_modulus_sentence,
    fitted_material,
    frozen_sentence,
    pale_sentence,
)
from pyburgers.predictions.measured_attenuation import MeasuredAttenuation
from pyburgers.predictions.stress_cycles import Regime


def attenuation_section(
    fits: Mapping[str, FittedTest],
    amplitudes: Sequence[Regime] = (),
    measured: MeasuredAttenuation | None = None,
) -> PageSection:
    """Return figures and tables of the attenuation that fits predict, as a part of a page.

    The first fit is shown in more detail: single draws, and the effect of an evolving
    microstructure.

    Parameters
    ----------
    fits : mapping of str to Fit
        Fits of one test each, at least one, by the names that the page gives them.
    amplitudes : sequence of Regime
        Cycles about one median stress; with them a figure shows the effect of the amplitude.
    measured : MeasuredAttenuation, optional
        Points to draw over the spectra.

    Raises
    ------
    InputError
        If the Kelvin part of a fit is not linear, or a fit is a joint one.
    SamplingError
        If the solver finds no solution.

    Examples
    --------
    >>> section = pyburgers.attenuation_section({"ice": fit})
    """
    spectra = {name: predict_attenuation(fit) for name, fit in fits.items()}
    first, fit = next(iter(fits.items()))
    evolving = evolving_attenuation(fitted_material(fit))
    drawn = [
        PageFigure(
            f"{name}_spectrum",
            f"Attenuation of {name}",
            figures.ATTENUATION_CAPTION,
            partial(figures.attenuation, spectrum, evolving if name == first else None, measured),
            frozen_sentence(spectrum),
        )
        for name, spectrum in spectra.items()
    ]
    drawn.append(
        PageFigure(
            f"{first}_draws",
            f"Attenuation of {first}, draw by draw",
            figures.DRAWS_CAPTION,
            partial(figures.attenuation_draws, spectra[first]),
        )
    )
    if amplitudes:
        by_amplitude = predict_attenuation(fit, regimes=amplitudes)
        drawn.append(
            PageFigure(
                f"{first}_amplitude",
                f"Attenuation of {first} and the amplitude of the cycles",
                figures.AMPLITUDE_CAPTION,
                partial(figures.amplitude_dependence, by_amplitude),
            )
        )
    return PageSection(
        key="attenuation",
        title="Attenuation",
        paragraphs=(
            f"{first}: {pale_sentence(spectra[first])}",
            elastic_modulus_sentence(spectra[first]),
        ),
        details=(
            "These spectra are predictions for another load: stress cycles about a constant median "
            "stress. Strain lags stress by the angle δ, and tan δ is the attenuation 1/Q; "
            "every draw of the posterior gives a spectrum in closed form. Tables give the median "
            "and 5 and 95 % of the draws; the CSV files hold all frequencies.",
            f"{first}: {frozen_sentence(spectra[first])}",
            f"{first}, frozen and evolving side by side. {evolving_sentence(evolving)}",
        ),
        tables=(
            *(
                PageTable(
                    f"{name}_quantiles",
                    f"tan δ of {name}",
                    overview_table(spectrum),
                    quantile_table(spectrum),
                    words=("regime",),
                    sentences=("frozen microstructure",),
                    in_files=name != first,
                    folded=True,
                )
                for name, spectrum in spectra.items()
            ),
            PageTable(
                "evolving",
                f"Frozen and evolving microstructure, {first}",
                evolving_overview(evolving),
                evolving_table(evolving),
                words=("regime",),
            ),
        ),
        figures=tuple(drawn),
        after_fits=True,
    )
