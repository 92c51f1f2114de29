"""The closed form of attenuation against simulations in time."""

import pandas as pd

from pyburgers.predictions.attenuation import attenuation_spectrum
from pyburgers.predictions.imposed_stress import simulated_phase_lag
from pyburgers.predictions.stress_cycles import PAPER_REGIMES, PARAMETER_NAMES
from pyburgers.protocols.protocol import FittedTest

CHECKED_FREQUENCIES = (1e-4, 1e-3, 1e-2)
"""Where the closed form is compared with simulations in time, Hz."""


def time_domain_table(fit: FittedTest) -> pd.DataFrame:
    """Compare the closed form of attenuation with phase lags of simulated records.

    Parameters
    ----------
    fit : FittedTest
        The median of each parameter is taken, with the initial microstructure.

    Returns
    -------
    DataFrame
        Columns regime, frequency_Hz, closed_form, simulated, relative_difference; a row for each
        of the paper's regimes and each of `CHECKED_FREQUENCIES`.

    Raises
    ------
    SamplingError
        If the solver finds no solution.
    """
    draws = fit.posterior["posterior"].to_dataset()
    median = {name: float(draws[name].median()) for name in PARAMETER_NAMES}
    temperature, grain_size = fit.experiment.temperature, fit.experiment.initial_grain_size
    closed = attenuation_spectrum(
        median, CHECKED_FREQUENCIES, PAPER_REGIMES, temperature=temperature, grain_size=grain_size
    )
    rows = []
    for regime, by_frequency in zip(PAPER_REGIMES, closed["tan_delta"].to_numpy(), strict=True):
        for frequency, expected in zip(CHECKED_FREQUENCIES, by_frequency, strict=True):
            lag = simulated_phase_lag(
                median, regime, frequency, temperature=temperature, grain_size=grain_size
            )
            rows.append(
                {
                    "regime": regime.label,
                    "frequency_Hz": frequency,
                    "closed_form": float(expected),
                    "simulated": lag.tan_delta,
                    "relative_difference": lag.tan_delta / float(expected) - 1,
                }
            )
    return pd.DataFrame(rows)


def shown_time_domain(check: pd.DataFrame) -> pd.DataFrame:
    """Return a `time_domain_table` as text."""
    return pd.DataFrame(
        {
            "regime": check["regime"],
            "frequency (Hz)": check["frequency_Hz"].map("{:.0e}".format),
            "tan δ, closed form": check["closed_form"].map("{:#.5g}".format),
            "tan δ, simulated": check["simulated"].map("{:#.5g}".format),
            "relative difference": check["relative_difference"].map("{:+.0e}".format),
        }
    )
