"""Complex compliance in shear as tables for tidal and seismic codes (docs/export.md).

With exp(+iωt), J* = J1 - i J2 and G* = 1/J* = G1 + i G2; losses are positive J2 and G2.
"""

from collections.abc import Callable, Sequence
from dataclasses import dataclass

import numpy as np
import pandas as pd

from pyburgers.common.array_types import FloatArray
from pyburgers.common.csv_tables import comment_lines, csv_text
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import SampledFit
from pyburgers.kinds.attenuation.table import Elasticity
from pyburgers.predictions.assumptions import (
    elastic_modulus_sentence,
    frozen_limit_texts,
    frozen_sentence,
)
from pyburgers.predictions.attenuation import DEFAULT_FREQUENCIES, material_spectrum
from pyburgers.predictions.creep_laws import Stated, stated_material
from pyburgers.predictions.stress_cycles import Regime

ANY_REGIME = Regime(0.0, 1.0)
"""Stress cycles of a linear dashpot, whose fluidity no stress changes."""


@dataclass(frozen=True, eq=False)
class ShearCompliances:
    """Storage and loss of all draws in shear (n_draws, n), 1/Pa, at frequencies (n,), Hz."""

    frequency: FloatArray
    storage: FloatArray
    loss: FloatArray
    notes: tuple[str, ...]


LINEAR = {"none", "diffusion"}
"""Further mechanisms that leave a linear dashpot linear."""


OTHER_RATIO = (
    "The fitted table states another Poisson's ratio or a bulk modulus, so that shear moduli here "
    "are not those that were read."
)
"""Note of compliances that another elasticity converts than that of the table."""


@dataclass(frozen=True)
class ComplianceFormat:
    """How a code takes compliances: `columns` of a CSV table by frequency, J1 and J2."""

    code: str
    columns: Callable[[FloatArray, FloatArray, FloatArray], dict[str, FloatArray]]

    def text(
        self, frequency: FloatArray, storage: FloatArray, loss: FloatArray, notes: Sequence[str]
    ) -> str:
        """Return the table of one draw or of the mean, with notes as comments above it."""
        table = pd.DataFrame(self.columns(frequency, storage, loss))
        return comment_lines(notes) + csv_text(table)


def shear_compliances(fit: SampledFit, stated: Stated, code: str) -> ShearCompliances:
    """Return the compliances in shear under a stated regime of axial stress."""
    if not isinstance(fit, Fit):
        raise InputError(f"{code}: found a fit of a table, expected one of tests with elements.")
    if stated.poisson_ratio is None:
        raise InputError(
            f"{code}: found no Poisson's ratio, expected --poisson-ratio: E_M is Young's modulus."
        )
    regime = stated.regime
    further = {fit.variant.second_mechanism, fit.variant.third_mechanism}
    linear = fit.variant.maxwell == "linear" and further <= LINEAR
    if regime is None and not linear:
        raise InputError(
            f"{code}: found no stress, expected --median-stress-MPa and --amplitude-MPa: "
            "the compliance of this dashpot depends on the stress."
        )
    frequency = stated.frequencies or DEFAULT_FREQUENCIES
    material = stated_material(fit, stated, code)
    spectrum = material_spectrum(material, frequency, [regime or ANY_REGIME])
    storage, loss, elastic = (
        all_draws(spectrum[name])
        for name in ("storage_compliance", "loss_compliance", "elastic_compliance")
    )
    read = fit.experiment.poisson_ratio_in_shear
    of_spring, less, of_creep = Elasticity("shear", stated.poisson_ratio).conversion
    spring = elastic[:, np.newaxis]
    notes = [
        f"{spectrum.attrs['title']}, Poisson's ratio {stated.poisson_ratio:g}",
        "Shear: 1/G = 2 (1 + nu)/E_M; the compliance of creep is 3 times the axial one.",
        "Sign: exp(+i omega t), J* = J1 - i J2, G* = 1/J* = G1 + i G2; losses are positive.",
        *([OTHER_RATIO] if read not in (None, stated.poisson_ratio) else []),
        *([f"Axial stress {regime.label}; in shear over sqrt(3)."] if regime else []),
        f"{frozen_sentence(spectrum)} In the draws: {frozen_limit_texts(spectrum)[0]}.",
        elastic_modulus_sentence(spectrum),
    ]
    return ShearCompliances(
        frequency=np.asarray(frequency, dtype=np.float64),
        storage=of_spring * spring - less + of_creep * (storage[:, 0] - spring),
        loss=of_creep * loss[:, 0],
        notes=tuple(notes),
    )


def _tidal(frequency: FloatArray, storage: FloatArray, loss: FloatArray) -> dict[str, FloatArray]:
    modulus = 1 / (storage - 1j * loss)
    return {
        "frequency_Hz": frequency,
        "J1_per_Pa": storage,
        "J2_per_Pa": loss,
        "G1_Pa": modulus.real,
        "G2_Pa": modulus.imag,
    }


def _seismic(frequency: FloatArray, storage: FloatArray, loss: FloatArray) -> dict[str, FloatArray]:
    return {
        "frequency_Hz": frequency,
        "Q_mu": storage / loss,
        "shear_modulus_Pa": (1 / (storage - 1j * loss)).real,
    }


COMPLIANCE_FORMATS = {
    "specfem": ComplianceFormat("SPECFEM", _seismic),
    "tidalpy": ComplianceFormat("TidalPy", _tidal),
}
"""Compliances by the name of the format."""
