"""Amplitude and phase lag of the stress in a forced oscillation test, observed and predicted."""

import math
from dataclasses import dataclass

import numpy as np
import pandas as pd
from markupsafe import Markup

from pyburgers.common.draws import FloatArray, all_draws, central_band
from pyburgers.common.units import rounded
from pyburgers.drawing.page_parts import PageTable
from pyburgers.drawing.panels import band_text
from pyburgers.drawing.view import predicted
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forced_oscillation.harmonics import fundamentals
from pyburgers.kinds.kind import FittedTest
from pyburgers.model.display import LENGTH_FACTOR, LENGTH_UNIT, STRESS_FACTOR, STRESS_UNIT


@dataclass(frozen=True)
class ObservedResponse:
    """Amplitude (Pa) of the stress; lag (rad, -pi to pi): its phase minus that of the strain."""

    amplitude: float
    amplitude_standard_error: float
    lag: float
    lag_standard_error: float


@dataclass(frozen=True, eq=False)
class PredictedResponse:
    """The same of curves of single draws, shape (n_curves,); lags within pi of the observed."""

    amplitude: FloatArray
    lag: FloatArray


def observed_response(experiment: OscillationExperiment) -> ObservedResponse:
    """Return amplitude and lag of the measured stress, with errors from those of its readings."""
    of_strain, of_stress = experiment.prepared.strain_fit, experiment.prepared.stress_fit
    strain_phase, strain_error = of_strain.phase()
    stress_phase, stress_error = of_stress.phase()
    return ObservedResponse(
        *of_stress.amplitude(),
        lag=math.remainder(stress_phase - strain_phase, 2.0 * math.pi),
        lag_standard_error=math.hypot(strain_error, stress_error),
    )


def predicted_response(fit: FittedTest) -> PredictedResponse:
    """Return amplitude and lag of the model's stress, without noise.

    Parameters
    ----------
    fit : Fit
        Of one forced oscillation test.

    Returns
    -------
    PredictedResponse
        Amplitudes (Pa) and lags (rad) of the draws that have a solution, shape (n_draws,).

    Examples
    --------
    >>> response = pyburgers.predicted_response(oscillation)
    """
    return _response(fit, "predictions")


def replicated_response(fit: FittedTest) -> PredictedResponse:
    """Return amplitude and lag of replicated data, as they would be found in a new record."""
    return _response(fit, "posterior_predictive")


def response_table(fit: FittedTest) -> pd.DataFrame:
    """Compare observed amplitude and lag with the central 90 % of replicated data, in SI units."""
    observed = observed_response(of_kind(fit.experiment, OscillationExperiment))
    replicated, table = replicated_response(fit), {}
    for name, unit in (("amplitude", "Pa"), ("lag", "rad")):
        value = getattr(observed, name)
        low, median, high = central_band(getattr(replicated, name))
        table[name] = {
            "unit": unit,
            "observed": value,
            "standard_error": getattr(observed, f"{name}_standard_error"),
            "median": median,
            "q5": low,
            "q95": high,
            "inside": low <= value <= high,
        }
    return pd.DataFrame.from_dict(table, orient="index").rename_axis("quantity")


def response_page_table(fit: FittedTest) -> PageTable:
    """Return `response_table` as what a page shows."""
    table = response_table(fit)
    verdict = (
        "Amplitude and phase lag of the record are inside the central 90 % of those of the "
        "replicated data."
        if table["inside"].all()
        else "<b>The record is outside the central 90 % of the replicated data where the table "
        "says so: look at the residuals.</b>"
    )
    return PageTable(
        "response",
        "Amplitude and phase lag of the stress",
        shown_response_table(table),
        table.reset_index(),
        text=Markup(
            "A fit of harmonics and a trend gives these numbers for the record and for replicated "
            "data, which are solutions for draws from the posterior with noise added. " + verdict
        ),
        words=("quantity", "unit"),
        bad={"in 90 % band": [not inside for inside in table["inside"]]},
    )


def shown_response_table(response: pd.DataFrame) -> pd.DataFrame:
    """Return a `response_table` as text in display units."""
    shown = {
        "amplitude": ("amplitude of the stress", STRESS_UNIT, STRESS_FACTOR),
        "lag": ("phase lag of the strain", "degrees", float(np.degrees(1.0))),
    }
    rows = []
    for name, row in response.iterrows():
        label, unit, factor = shown[str(name)]
        error = row["standard_error"] * factor
        numbers = {
            heading: rounded(row[key] * factor, error)
            for heading, key in (
                ("observed", "observed"),
                ("standard error", "standard_error"),
                ("replicated: median", "median"),
                ("5 %", "q5"),
                ("95 %", "q95"),
            )
        }
        inside = "yes" if row["inside"] else "NO"
        rows.append({"quantity": label, "unit": unit, **numbers, "in 90 % band": inside})
    return pd.DataFrame(rows)


def lag_result(fit: FittedTest) -> str:
    """Set the observed phase lag beside those of replicated data."""
    observed = np.degrees(observed_response(of_kind(fit.experiment, OscillationExperiment)).lag)
    replicated = band_text(np.degrees(replicated_response(fit).lag), "degrees")
    return f"the record lags by {observed:.3g} degrees, replicated data by {replicated}."


def grains_result(fit: FittedTest) -> str:
    """Say how large grains are at the end."""
    size = predicted(fit, "grain_size")[:, -1]
    return f"grains end at {band_text(size * LENGTH_FACTOR, LENGTH_UNIT)}."


def _response(fit: FittedTest, group: str) -> PredictedResponse:
    """Amplitude and lag of the stress of single draws in a group, with errors as readings have."""
    experiment = of_kind(fit.experiment, OscillationExperiment)
    prepared, stress = experiment.prepared, fit.posterior[group].to_dataset()["stress"]
    curves = all_draws(stress).astype(np.float64)
    is_read = "point" in stress.dims
    found = fundamentals(
        prepared.time if is_read else stress["time"].to_numpy(),
        curves[np.isfinite(curves).all(axis=1)],  # draws without solution have NaN
        period=prepared.period,
        degree=prepared.stress_fit.degree,
        uncertainty=prepared.uncertainty if is_read else None,
    )
    # Phases about the observed one do not wrap.
    observed_phase, _ = prepared.stress_fit.phase()
    lag = observed_response(experiment).lag + np.angle(found * np.exp(-1j * observed_phase))
    return PredictedResponse(np.abs(found), lag)
