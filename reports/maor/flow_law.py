"""The power law beside the hyperbolic sine of the paper's Eq. 2 and its linear limit."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import pandas as pd
from common import Fitted, FloatArray, parameter_draws

from pyburgers import flow_rate

FLOW_LAW = ("stress_exponent", "grain_size_exponent", "activation_enthalpy", "beta")

STRESSES = np.geomspace(0.02, 2.0, 21)
"""Stresses of the figure, over the peak stress of the test."""

TABLED = (0.1, 0.25, 0.5, 1.0, 1.5)
"""Those of the table."""

STEEPEST = 20.0
"""Largest stress exponent for which a hyperbolic sine of the same slope is found."""


@dataclass(frozen=True, eq=False)
class FlowLaws:
    """Rates (1/s) of the undeformed material by three laws at stresses (Pa), (n_draws, n) each.

    The hyperbolic sine (Eq. 2) has rate and slope of the power law at the shared stress, and the
    breakdown stress σ_L (Pa), shape (n_draws,).
    """

    stress: FloatArray
    power_law: FloatArray
    sinh: FloatArray
    linear: FloatArray
    shared_stress: float
    breakdown_stress: FloatArray


def flow_laws(fit: Fitted, stress: FloatArray, *, shared_stress: float) -> FlowLaws:
    """Compare the power law of every draw with the hyperbolic sine of the same rate and slope.

    The slope of ln sinh(σ/σ_L) along ln σ is x coth x with x = σ/σ_L; where it is n decides σ_L.
    Stresses are in Pa, shape (n,).
    """
    table = np.linspace(1e-3, STEEPEST, 20_001)
    exponent = parameter_draws(fit, "stress_exponent")
    breakdown = shared_stress / np.interp(exponent, table / np.tanh(table), table)
    one = np.ones(exponent.size)
    power_law, sinh, linear = (
        rates_of_undeformed(fit, np.append(stress, shared_stress), law)
        for law in (
            {},
            {"breakdown_stress": breakdown, "stress_exponent": one},
            {"stress_exponent": one},
        )
    )
    scale = (power_law[:, -1] / sinh[:, -1])[:, np.newaxis]
    rates = (power_law[:, :-1], (scale * sinh)[:, :-1], (scale * linear)[:, :-1])
    return FlowLaws(stress, *rates, shared_stress, breakdown)


def rates_of_undeformed(
    fit: Fitted, stress: FloatArray, changed: Mapping[str, FloatArray]
) -> FloatArray:
    """Rates (1/s) at stresses (Pa) with some parameters changed, shape (n_draws, n)."""
    draws = {name: parameter_draws(fit, name) for name in FLOW_LAW} | dict(changed)
    return flow_rate(
        {name: values[:, np.newaxis] for name, values in draws.items()},
        stress,
        temperature=fit.experiment.temperature,
        grain_size=fit.experiment.initial_grain_size,
    )


def flow_laws_table(laws: FlowLaws) -> pd.DataFrame:
    """Return median rates of the three laws at a few stresses, interpolated along logarithms.

    Columns stress_Pa, power_law_per_s, hyperbolic_sine_per_s, linear_per_s.
    """
    stress = laws.shared_stress * np.array(TABLED)
    rates = {"power_law": laws.power_law, "hyperbolic_sine": laws.sinh, "linear": laws.linear}
    medians = {name: np.log(np.median(values, axis=0)) for name, values in rates.items()}
    return pd.DataFrame(
        {
            "stress_Pa": stress,
            **{
                f"{name}_per_s": np.exp(np.interp(np.log(stress), np.log(laws.stress), median))
                for name, median in medians.items()
            },
        }
    )
