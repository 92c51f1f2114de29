"""The power law beside the hyperbolic sine of the paper's Eq. 2 and its linear limit."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.predictions.closed_forms import flow_rate
from pyburgers.predictions.stress_cycles import PARAMETER_NAMES
from pyburgers.protocols.protocol import FittedTest
from pyburgers.studies.maor.before_data import Knowledge, parameter_draws
from pyburgers.studies.maor.ice_curves import PEAK_STRESS
from pyburgers.studies.maor.statements import (
    BoolArray,
    Statement,
    joined,
    probability,
)

FloatArray = npt.NDArray[np.float64]

STRESSES = np.geomspace(0.02, 2.0, 21)
"""Stresses of the figure, over the peak stress of the test."""

TABLED = (0.1, 0.25, 0.5, 1.0, 1.5)
"""Those of the table."""

A_LITTLE, SENSITIVE = 0.01, 0.05
"""Relative change of a parameter, and that of the stress from which it is a large one."""

STEEPEST = 20.0
"""Largest stress exponent for which a hyperbolic sine of the same slope is found."""


@dataclass(frozen=True, eq=False)
class FlowLaws:
    """Rates of the undeformed material by three laws, two of which share a point and its slope.

    Attributes
    ----------
    stress : array, shape (n,)
        Pa.
    power_law, sinh, linear : array, shape (n_draws, n)
        Rates (1/s) of the power law, of the hyperbolic sine (Eq. 2), and of its linear limit.
    shared_stress : float
        Where power law and hyperbolic sine have the same rate and slope (Pa).
    breakdown_stress : array, shape (n_draws,)
        σ_L of the hyperbolic sine (Pa).
    """

    stress: FloatArray
    power_law: FloatArray
    sinh: FloatArray
    linear: FloatArray
    shared_stress: float
    breakdown_stress: FloatArray


def flow_laws(fit: FittedTest, stress: FloatArray, *, shared_stress: float) -> FlowLaws:
    """Compare the power law of every draw with the hyperbolic sine of the same rate and slope.

    The slope of ln sinh(σ/σ_L) along ln σ is x coth x with x = σ/σ_L; where it is n decides σ_L.

    Parameters
    ----------
    fit : FittedTest
        Draws, of a power law.
    stress : array, shape (n,)
        Where rates are wanted (Pa).
    shared_stress : float
        Pa.
    """
    draws = {name: parameter_draws(fit, name) for name in PARAMETER_NAMES}
    exponent = draws["stress_exponent"]
    table = np.linspace(1e-3, STEEPEST, 20_001)
    breakdown = shared_stress / np.interp(exponent, table / np.tanh(table), table)
    one = np.ones(exponent.size)
    power_law, sinh, linear = (
        _rates(fit, {**draws, **law}, np.append(stress, shared_stress))
        for law in (
            {},
            {"breakdown_stress": breakdown, "stress_exponent": one},
            {"stress_exponent": one},
        )
    )
    scale = (power_law[:, -1] / sinh[:, -1])[:, np.newaxis]
    rates = (power_law[:, :-1], (scale * sinh)[:, :-1], (scale * linear)[:, :-1])
    return FlowLaws(stress, *rates, shared_stress, breakdown)


def _rates(fit: FittedTest, draws: Mapping[str, FloatArray], stress: FloatArray) -> FloatArray:
    """Rates of the undeformed material, shape (n_draws, n)."""
    return flow_rate(
        {name: values[:, np.newaxis] for name, values in draws.items()},
        stress,
        temperature=fit.experiment.temperature,
        grain_size=fit.experiment.initial_grain_size,
    )


def flow_laws_table(laws: FlowLaws) -> pd.DataFrame:
    """Return median rates of the three laws at a few stresses, interpolated along logarithms.

    Returns
    -------
    DataFrame
        Columns stress_Pa, power_law_per_s, hyperbolic_sine_per_s, linear_per_s.
    """
    stress = laws.shared_stress * np.array(TABLED)

    def at(rates: FloatArray) -> FloatArray:
        medians = np.log(np.median(rates, axis=0))
        found: FloatArray = np.exp(np.interp(np.log(stress), np.log(laws.stress), medians))
        return found

    return pd.DataFrame(
        {
            "stress_Pa": stress,
            "power_law_per_s": at(laws.power_law),
            "hyperbolic_sine_per_s": at(laws.sinh),
            "linear_per_s": at(laws.linear),
        }
    )


def sensitivity_statement(known: Mapping[str, Knowledge]) -> Statement:
    """Judge how sensitive the strength of the undeformed material is to beta and Q_M.

    Parameters
    ----------
    known : mapping of str to Knowledge
        Tests at constant rate by sample, at least one.
    """

    def changes(fit: FittedTest, name: str) -> FloatArray:
        """Relative change of the stress at one rate when a parameter is `A_LITTLE` larger."""
        draws = {own: parameter_draws(fit, own) for own in PARAMETER_NAMES}
        stress = np.array([PEAK_STRESS.observed(fit)])
        before, after = (
            _rates(fit, {**draws, name: factor * draws[name]}, stress)[:, 0]
            for factor in (1.0, 1.0 + A_LITTLE)
        )
        change: FloatArray = np.abs((before / after) ** (1 / draws["stress_exponent"]) - 1)
        return change

    def sensitive(fit: FittedTest) -> BoolArray:
        both = [changes(fit, name) > SENSITIVE for name in ("beta", "activation_enthalpy")]
        return np.logical_and(*both)

    details = "; ".join(
        f"{name} {100 * np.median(changes(one.fit, 'beta')):.0f} % and "
        f"{100 * np.median(changes(one.fit, 'activation_enthalpy')):.0f} %"
        for name, one in known.items()
    )
    return Statement(
        key="sensitivity",
        source="Ice",
        text="The solution is highly sensitive to β and Q_M.",
        evidence=joined(
            [f"change of the stress by {100 * A_LITTLE:g} % of β and of Q_M, medians: {details}"]
        ),
        beliefs={name: probability(one, sensitive) for name, one in known.items()},
        rule=f"A draw counts if {100 * A_LITTLE:g} % more of either changes the stress at which "
        f"the undeformed material flows at one rate by more than {100 * SENSITIVE:g} %.",
    )
