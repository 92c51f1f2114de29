"""What the elastic modulus does to attenuation: E_M of each fit, and one modulus of ice for all."""

from collections.abc import Mapping

import numpy as np
import pandas as pd

from pyburgers.common.units import UNITS
from pyburgers.predictions.attenuation import flat_draws, predict_attenuation
from pyburgers.predictions.stress_cycles import PAPER_REGIMES
from pyburgers.protocols.protocol import FittedTest

ICE_MODULUS = 9.3e9
"""Young's modulus of polycrystalline ice, Pa: 9.33 GPa at -16 °C (Gammon, Kiefte, Clouter and
Denner 1983, Journal of Glaciology 29, 433)."""

FREQUENCIES = (1e-2, 1.0)
"""Hz."""

ELASTIC_MODULUS_SENTENCE = (
    f"With {ICE_MODULUS / UNITS['stress']['GPa']:g} GPa, Young's modulus of ice, in place of each "
    "fit's own E_M the samples differ by what the tests say of Kelvin element and dashpot; what "
    "they differ by beyond that is mostly the apparatus."
)


def elastic_modulus_table(fits: Mapping[str, FittedTest]) -> pd.DataFrame:
    """Attenuation at 1 MPa with E_M of each fit and with the modulus of ice.

    Parameters
    ----------
    fits : mapping of str to FittedTest
        Fits of ice by sample.

    Returns
    -------
    DataFrame
        A row for each sample and frequency. Columns sample, maxwell_modulus_GPa (median),
        frequency_Hz, own_q5, own_q50, own_q95, ice_q5, ice_q50, ice_q95.
    """
    rows = []
    for name, fit in fits.items():
        own, ice = (
            np.quantile(
                flat_draws(
                    predict_attenuation(
                        fit, FREQUENCIES, PAPER_REGIMES[:1], elastic_modulus=modulus
                    )["tan_delta"]
                )[:, 0],
                (0.05, 0.5, 0.95),
                axis=0,
            )
            for modulus in (None, ICE_MODULUS)
        )
        modulus = float(fit.posterior["posterior"]["maxwell_modulus"].median())
        rows += [
            {
                "sample": name,
                "maxwell_modulus_GPa": modulus / UNITS["stress"]["GPa"],
                "frequency_Hz": frequency,
                **{
                    f"{whose}_q{percent}": float(values[i, k])
                    for whose, values in (("own", own), ("ice", ice))
                    for i, percent in enumerate((5, 50, 95))
                },
            }
            for k, frequency in enumerate(FREQUENCIES)
        ]
    return pd.DataFrame(rows)


def shown_elastic_modulus(table: pd.DataFrame) -> pd.DataFrame:
    """Return an `elastic_modulus_table` as text, with how far the samples are apart."""
    rows = [
        {
            "sample": row["sample"],
            "E_M (GPa)": f"{row['maxwell_modulus_GPa']:.3g}",
            "frequency (Hz)": f"{row['frequency_Hz']:.3g}",
            **{
                f"tan δ, {words}": f"{row[f'{whose}_q50']:.3g} "
                f"[{row[f'{whose}_q5']:.3g}, {row[f'{whose}_q95']:.3g}]"
                for whose, words in (("own", "E_M of the fit"), ("ice", "modulus of ice"))
            },
        }
        for row in table.to_dict("records")
    ]
    for frequency, of_samples in table.groupby("frequency_Hz"):
        if len(of_samples) == 1:
            continue
        own, ice = (
            of_samples[f"{whose}_q50"].max() / of_samples[f"{whose}_q50"].min()
            for whose in ("own", "ice")
        )
        rows.append(
            {
                "sample": "largest over smallest",
                "E_M (GPa)": "",
                "frequency (Hz)": f"{frequency:.3g}",
                "tan δ, E_M of the fit": f"{own:.3g}",
                "tan δ, modulus of ice": f"{ice:.3g}",
            }
        )
    return pd.DataFrame(rows)
