"""Tables of attenuation spectra: quantiles for files, an overview for people."""

import numpy as np
import pandas as pd
import xarray as xr

from pyburgers.common.draws import FloatArray
from pyburgers.predictions.assumptions import (
    cycle_fails,
    frozen_limit_texts,
    hold_fails,
    probability,
)
from pyburgers.predictions.attenuation import condition_columns, flat_draws, regime_peaks

QUANTILES = (5, 25, 50, 75, 95)
"""Percentages of `quantile_table`."""

OVERVIEW_FREQUENCIES = 5
"""Columns of `overview_table`."""


def quantile_table(spectrum: xr.Dataset) -> pd.DataFrame:
    """Return posterior quantiles of tan(delta), a row for each regime and frequency.

    Columns are median_stress_MPa, amplitude_MPa, frequency_Hz, mean, sd, q5, q25, q50, q75,
    q95; medians hold_strain and cycle_strain; p_hold_fails, p_cycle_fails, p_frozen_fails, the
    shares of draws in which the hold, a cycle, or one of them strains too much for frozen
    microstructure.
    """
    tan_delta = flat_draws(spectrum["tan_delta"])
    n_frequencies = tan_delta.shape[2]
    by_quantile = np.quantile(tan_delta, np.array(QUANTILES) / 100, axis=0)
    return pd.DataFrame(
        {
            **condition_columns(spectrum),
            "mean": tan_delta.mean(axis=0).ravel(),
            "sd": tan_delta.std(axis=0).ravel(),
            **{f"q{q}": values.ravel() for q, values in zip(QUANTILES, by_quantile, strict=True)},
            "hold_strain": np.repeat(_medians(spectrum["hold_strain"]), n_frequencies),
            "cycle_strain": _medians(spectrum["cycle_strain"]).ravel(),
            "p_hold_fails": np.repeat(probability(hold_fails(spectrum)), n_frequencies),
            "p_cycle_fails": probability(cycle_fails(spectrum)).ravel(),
            "p_frozen_fails": probability(spectrum["frozen_fails"]).ravel(),
        }
    )


def _medians(strain: xr.DataArray) -> FloatArray:
    """Medians over the draws, shape (n_regimes,) or (n_regimes, n_frequencies)."""
    draws = [name for name in strain.dims if name not in ("regime", "frequency")]
    values: FloatArray = strain.median(draws).transpose("regime", ...).to_numpy()
    return values


def overview_table(spectrum: xr.Dataset) -> pd.DataFrame:
    """Return attenuation at a few frequencies as text, a row for each regime.

    Columns are regime, frozen microstructure (where it fails), one for each of at most
    `OVERVIEW_FREQUENCIES` frequencies with median and 5 and 95 % of the draws, and Debye peak.
    """
    frequency = spectrum["frequency"].to_numpy()
    n_shown = min(OVERVIEW_FREQUENCIES, frequency.size)
    shown = np.linspace(0, frequency.size - 1, n_shown).round().astype(int)
    low, median, high = np.quantile(flat_draws(spectrum["tan_delta"]), (0.05, 0.5, 0.95), axis=0)
    share = regime_peaks(spectrum).mean(axis=0)
    frozen = frozen_limit_texts(spectrum)
    return pd.DataFrame(
        [
            {
                "regime": str(label),
                "frozen microstructure": frozen[k],
                **{
                    f"{frequency[i]:.3g} Hz": f"{median[k, i]:.3g} [{low[k, i]:.3g}, "
                    f"{high[k, i]:.3g}]"
                    for i in shown
                },
                "Debye peak": f"{100 * share[k]:.0f} % of draws",
            }
            for k, label in enumerate(spectrum["regime"].to_numpy())
        ]
    )
