"""What the paper states about the ice samples, judged by fits of tests at constant rate."""

from collections.abc import Callable, Mapping

import numpy as np
from common import BoolArray, Fitted, FloatArray, moments, parameter_draws, rhat

from maor.before_data import Knowledge
from maor.flow_law import rates_of_undeformed
from maor.ice_curves import CURVE_CLAIMS, MEAN_SOLUTION, PEAK_STRESS, error_at_peak
from maor.statements import Belief, Claim, Statement, event
from pyburgers import rounded, shown_quantity, symbol_text

PIL40_VALUES: Mapping[str, tuple[float, float]] = {
    "stress_exponent": (4.0, 0.25),
    "critical_strain_grain_size": (0.03, 0.01),
}
"""What the paper finds for PIL40, and how far from it is still about it."""

RHAT_LIMIT = 1.01
"""R-hat up to which chains agree, as in the checks of a fit."""

LEAST_FIRST, FIRST_RHAT = 50, 1.2
"""Draws at least that count as the first of a chain, and their R-hat from which chains differ."""

KELVIN_ELEMENT = frozenset({"kelvin_modulus", "kelvin_viscosity"})

FABRIC = "steady_state_fabric_factor"

A_LITTLE, SENSITIVE = 0.01, 0.05
"""Relative change of a parameter, and that of the stress from which it is a large one."""


def ice_statements(known: Mapping[str, Knowledge]) -> tuple[Statement, ...]:
    """Judge the paper's statements about ice by sample, which may be none.

    Samples are known by their `PEAK_STRESS` ahead of their curves; statements about PIL40 need the
    key ``"PIL40"``.
    """
    if not known:
        return ()
    of_one = {name: one for name, one in known.items() if name == "PIL40"}
    return (
        *(_value(name).judged(of_one) for name in PIL40_VALUES if of_one),
        MOST_UNCERTAIN.judged(known),
        *(claim.judged(known) for claim in CURVE_CLAIMS),
        *error_at_peak(known),
        MEAN_SOLUTION.judged(known),
        *(claim.judged(known) for claim in LAST_CLAIMS),
    )


def near(name: str, value: float, tolerance: float) -> Callable[[Fitted], BoolArray]:
    """Return what tells the draws in which a parameter (SI) is within a distance of a value."""
    return lambda fit: np.asarray(np.abs(parameter_draws(fit, name) - value) <= tolerance)


def _value(name: str) -> Claim[Knowledge]:
    """Return the claim that a parameter of PIL40 has about the paper's value."""
    value, tolerance = PIL40_VALUES[name]
    quantity = shown_quantity(name)

    def words(one: Knowledge) -> str:
        draws = parameter_draws(one.fit, name)
        low, high = np.quantile(draws, [0.05, 0.95])
        mean, sd = moments(draws)
        by_prior, by_peak = one.sd_before(name)
        return (
            f"the central 90 % of the draws are [{rounded(low, sd)}, {rounded(high, sd)}], with "
            f"mean {rounded(mean, sd)}; the standard deviation is {sd:.2g}, "
            f"{by_prior:.2g} under the prior and {by_peak:.2g} with the peak stress alone"
        )

    return Claim(
        f"{name}_of_PIL40",
        "PIL40",
        f"The {quantity.label} {symbol_text(quantity)} of PIL40 is about {value:g}.",
        event(near(name, value, tolerance), words),
        f"A draw counts if it is within {tolerance:g} of {value:g}. What the "
        "peak stress narrows by itself, n through the priors of Q_M and β, is not credited to the "
        "curve.",
        each="{1}",
    )


def _most_uncertain(one: Knowledge) -> tuple[Belief, str]:
    """Judge whether the Kelvin element is known least, relative to its size, and sampled well."""

    def order(relative: Mapping[str, float]) -> list[str]:
        return sorted(relative, key=lambda name: -relative[name])

    names = [name for name in one.fit.priors.free if name != "stress_noise"]
    draws = {name: parameter_draws(one.fit, name) for name in names}
    relative = {name: float(np.std(x)) / abs(float(np.mean(x))) for name, x in draws.items()}
    before = [
        {name: one.sd_before(name)[k] / abs(one.mean_before(name)[k]) for name in names}
        for k in (0, 1)
    ]
    prior, number, posterior = (
        set(order(found)[:2]) == KELVIN_ELEMENT for found in (*before, relative)
    )
    of_chains = rhat(one.fit.posterior["posterior"].to_dataset()[sorted(KELVIN_ELEMENT)])
    largest = max(of_chains.values())
    words = ", ".join(
        f"{symbol_text(shown_quantity(name))} {relative[name]:.2f}" for name in order(relative)[:4]
    )
    holds = posterior and largest <= RHAT_LIMIT
    belief = Belief(prior, number, holds, one.effective_draws)
    return belief, f"{words} (R-hat of E_K and η_K up to {largest:.3f})"


def _sensitive(fit: Fitted) -> BoolArray:
    both = [change_of_stress(fit, name) > SENSITIVE for name in ("beta", "activation_enthalpy")]
    return np.logical_and(*both)


def change_of_stress(fit: Fitted, name: str) -> FloatArray:
    """Relative change of the stress at one rate when a parameter is `A_LITTLE` larger."""
    stress = np.array([PEAK_STRESS.observed(fit)])
    before, after = (
        rates_of_undeformed(fit, stress, {name: factor * parameter_draws(fit, name)})[:, 0]
        for factor in (1.0, 1.0 + A_LITTLE)
    )
    exponent = parameter_draws(fit, "stress_exponent")
    return np.asarray(np.abs((before / after) ** (1 / exponent) - 1))


def _sensitivity_text(one: Knowledge) -> str:
    beta, enthalpy = (
        f"{100 * np.median(change_of_stress(one.fit, name)):.0f} %"
        for name in ("beta", "activation_enthalpy")
    )
    return f"{beta} and {enthalpy}"


def _burn_in(one: Knowledge) -> tuple[Belief, str]:
    """Judge whether chains agree from their first draws on."""
    draws = one.fit.posterior["posterior"].to_dataset()[list(one.fit.priors.free)]
    n_first = max(LEAST_FIRST, draws.sizes["draw"] // 10)
    largest = max(rhat(draws.isel(draw=slice(n_first))).values())
    belief = Belief(None, None, False if largest > FIRST_RHAT else None, one.effective_draws)
    return belief, f"{largest:.2f} of {n_first}"


MOST_UNCERTAIN = Claim(
    "most_uncertain",
    "Ice",
    "E_K and η_K of ice are the most uncertain parameters, yet they converge.",
    _most_uncertain,
    "Holds if the two have the largest ratio of standard deviation to mean of all "
    f"parameters and R-hat is at most {RHAT_LIMIT:g}; before the data the order alone is "
    "looked at.",
    lead="standard deviation over mean, the four largest: ",
    separator="; ",
)

LAST_CLAIMS = (
    Claim(
        "softer_fabric",
        "Ice, Table 1",
        "The steady-state fabric factor F_ss of ice is below 1: fabric softens the ice.",
        event(
            lambda fit: np.asarray(parameter_draws(fit, FABRIC) < 1),
            lambda one: f"up to {np.quantile(parameter_draws(one.fit, FABRIC), 0.95):.2f}",
        ),
        "A draw counts if its F_ss is below 1; where the prior ends below 1 the model cannot "
        "do otherwise.",
        lead="95 % of the draws: ",
    ),
    Claim(
        "sensitivity",
        "Ice",
        "The solution is highly sensitive to β and Q_M.",
        event(_sensitive, _sensitivity_text),
        f"A draw counts if {100 * A_LITTLE:g} % more of either changes the stress at which "
        f"the undeformed material flows at one rate by more than {100 * SENSITIVE:g} %.",
        lead=f"change of the stress by {100 * A_LITTLE:g} % of β and of Q_M, medians: ",
        separator="; ",
    ),
    Claim(
        "burn_in",
        "Ice, Fig. 4",
        "The chains converge without burn-in.",
        _burn_in,
        "Does not hold if the first tenth of the draws of the chains differs from chain to "
        f"chain (R-hat above {FIRST_RHAT:g}). Our chains begin at the posterior mode and warm up "
        "before their first draw, so that chains that agree cannot tell.",
        lead="largest R-hat of the first draws of each chain: ",
    ),
)
