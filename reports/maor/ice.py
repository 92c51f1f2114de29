"""What the paper states about the ice samples, judged by fits of tests at constant rate."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt
import xarray as xr

from pyburgers.checks.fit_checks import RHAT_LIMIT
from pyburgers.common.units import number, rounded
from pyburgers.model.display import shown_quantity
from pyburgers.model.display import symbol_text as symbol
from pyburgers.posterior.labelled_draws import convergence_table
from pyburgers.protocols.protocol import FittedTest
from pyburgers.studies.maor.before_data import (
    Knowledge,
    parameter_draws,
)
from pyburgers.studies.maor.flow_law import sensitivity_statement
from pyburgers.studies.maor.ice_curves import curve_statements
from pyburgers.studies.maor.statements import (
    Belief,
    BoolArray,
    Statement,
    joined,
    probability,
)

FloatArray = npt.NDArray[np.float64]

PIL40_VALUES: Mapping[str, tuple[float, float]] = {
    "stress_exponent": (4.0, 0.25),
    "critical_strain_grain_size": (0.03, 0.01),
}
"""What the paper finds for PIL40, and how far from it is still about it."""

LEAST_FIRST, FIRST_RHAT = 50, 1.2
"""Draws at least that count as the first of a chain, and their R-hat from which chains differ."""

KELVIN_ELEMENT = frozenset({"kelvin_modulus", "kelvin_viscosity"})


def ice_statements(known: Mapping[str, Knowledge]) -> tuple[Statement, ...]:
    """Judge the paper's statements about ice.

    Parameters
    ----------
    known : mapping of str to Knowledge
        Tests at constant rate by sample, known by their `PEAK_STRESS` ahead of their curves;
        statements about PIL40 need the key ``"PIL40"``.
    """
    if not known:
        return ()
    of_one = {name: one for name, one in known.items() if name == "PIL40"}
    return (
        *(_value(of_one, name) for name in PIL40_VALUES if of_one),
        _most_uncertain(known),
        *curve_statements(known),
        _softer_fabric(known),
        sensitivity_statement(known),
        burn_in_statement(known),
    )


def _value(known: Mapping[str, Knowledge], name: str) -> Statement:
    """Whether a parameter of PIL40 has about the paper's value, and by what."""
    value, tolerance = PIL40_VALUES[name]
    quantity = shown_quantity(name)

    def about(fit: FittedTest) -> BoolArray:
        near: BoolArray = np.abs(parameter_draws(fit, name) - value) <= tolerance
        return near

    def words(one: Knowledge) -> str:
        draws = parameter_draws(one.fit, name)
        low, high = np.quantile(draws, [0.05, 0.95])
        sd = float(draws.std(ddof=1))
        by_prior, by_peak = one.sd_before(name)
        return (
            f"the central 90 % of the draws are [{rounded(low, sd)}, {rounded(high, sd)}], with "
            f"mean {rounded(float(draws.mean()), sd)}; the standard deviation is {sd:.2g}, "
            f"{by_prior:.2g} under the prior and {by_peak:.2g} with the peak stress alone"
        )

    return Statement(
        key=f"{name}_of_PIL40",
        source="PIL40",
        text=f"The {quantity.label} {symbol(quantity)} of PIL40 is about {number(value)}.",
        evidence=joined(words(one) for one in known.values()),
        beliefs={key: probability(one, about) for key, one in known.items()},
        rule=f"A draw counts if it is within {number(tolerance)} of {number(value)}. What the "
        "peak stress narrows by itself, n through the priors of Q_M and β, is not credited to the "
        "curve.",
    )


def _most_uncertain(known: Mapping[str, Knowledge]) -> Statement:
    """Whether the Kelvin element is known least, relative to its size, and sampled well."""

    def leads(means: Mapping[str, float], sds: Mapping[str, float]) -> bool:
        relative = {name: sds[name] / abs(means[name]) for name in means}
        return set(sorted(relative, key=lambda name: -relative[name])[:2]) == KELVIN_ELEMENT

    def judge(one: Knowledge) -> tuple[Belief, str]:
        names = [name for name in one.fit.priors.free if name != "stress_noise"]
        draws = {name: parameter_draws(one.fit, name) for name in names}
        means, sds = ({name: float(f(x)) for name, x in draws.items()} for f in (np.mean, np.std))
        before = [
            leads(
                {name: one.mean_before(name)[k] for name in names},
                {name: one.sd_before(name)[k] for name in names},
            )
            for k in (0, 1)
        ]
        rhat = convergence_table(one.fit.posterior)["rhat"]
        largest = max(float(rhat[name]) for name in KELVIN_ELEMENT)
        order = sorted(names, key=lambda name: -sds[name] / abs(means[name]))
        words = ", ".join(
            f"{symbol(shown_quantity(name))} {sds[name] / abs(means[name]):.2f}"
            for name in order[:4]
        )
        holds = leads(means, sds) and largest <= RHAT_LIMIT
        belief = Belief(before[0], before[1], holds, one.effective_draws)
        return belief, f"{words} (R-hat of E_K and η_K up to {largest:.3f})"

    found = {key: judge(one) for key, one in known.items()}
    return Statement(
        key="most_uncertain",
        source="Ice",
        text="E_K and η_K of ice are the most uncertain parameters, yet they converge.",
        evidence=joined(
            [
                "standard deviation over mean, the four largest: "
                + "; ".join(f"{key} {words}" for key, (_, words) in found.items())
            ]
        ),
        beliefs={key: belief for key, (belief, _) in found.items()},
        rule="Holds if the two have the largest ratio of standard deviation to mean of all "
        f"parameters and R-hat is at most {RHAT_LIMIT:g}; before the data the order alone is "
        "looked at.",
    )


def burn_in_statement(known: Mapping[str, Knowledge]) -> Statement:
    """Judge whether chains agree from their first draws on.

    Parameters
    ----------
    known : mapping of str to Knowledge
        Tests at constant rate by sample, at least one.
    """

    def first(one: Knowledge) -> tuple[float, int]:
        draws = one.fit.posterior["posterior"].to_dataset()[list(one.fit.priors.free)]
        n_first = max(LEAST_FIRST, draws.sizes["draw"] // 10)
        table = convergence_table(
            xr.DataTree.from_dict({"posterior": draws.isel(draw=slice(n_first))})
        )
        return float(table["rhat"].max()), n_first

    def belief(one: Knowledge) -> Belief:
        apart = first(one)[0] > FIRST_RHAT
        return Belief(None, None, False if apart else None, one.effective_draws)

    details = ", ".join(
        f"{key} {rhat:.2f} of {n_first}"
        for key, (rhat, n_first) in ((key, first(one)) for key, one in known.items())
    )
    return Statement(
        key="burn_in",
        source="Ice, Fig. 4",
        text="The chains converge without burn-in.",
        evidence=joined([f"largest R-hat of the first draws of each chain: {details}"]),
        beliefs={key: belief(one) for key, one in known.items()},
        rule="Does not hold if the first tenth of the draws of the chains differs from chain to "
        f"chain (R-hat above {FIRST_RHAT:g}). Our chains begin at the posterior mode and warm up "
        "before their first draw, so that chains that agree cannot tell.",
    )


def _softer_fabric(known: Mapping[str, Knowledge]) -> Statement:
    """Whether the fabric softens."""
    name = "steady_state_fabric_factor"
    details = ", ".join(
        f"{key} up to {np.quantile(parameter_draws(one.fit, name), 0.95):.2f}"
        for key, one in known.items()
    )
    return Statement(
        key="softer_fabric",
        source="Ice, Table 1",
        text="The steady-state fabric factor F_ss of ice is below 1: fabric softens the ice.",
        evidence=joined([f"95 % of the draws: {details}"]),
        beliefs={
            key: probability(one, lambda fit: parameter_draws(fit, name) < 1)
            for key, one in known.items()
        },
        rule="A draw counts if its F_ss is below 1; where the prior ends below 1 the model cannot "
        "do otherwise.",
    )
