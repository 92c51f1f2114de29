"""What the paper states about the ice samples, judged by fits of tests at constant rate."""

from collections.abc import Mapping

import numpy as np
import numpy.typing as npt

from pyburgers.checks.fit_checks import RHAT_LIMIT
from pyburgers.common.units import number, rounded
from pyburgers.model.display import shown_quantity
from pyburgers.model.display import symbol_text as symbol
from pyburgers.posterior.labelled_draws import convergence_table, grain_size_share
from pyburgers.protocols.protocol import FittedTest
from pyburgers.studies.maor.before_data import (
    Knowledge,
    parameter_draws,
)
from pyburgers.studies.maor.ice_curves import curve_statements
from pyburgers.studies.maor.statements import (
    FEW,
    MOST,
    NARROW,
    Belief,
    BoolArray,
    Statement,
    between,
    joined,
    probability,
)

FloatArray = npt.NDArray[np.float64]

PIL40_VALUES: Mapping[str, tuple[float, float]] = {
    "stress_exponent": (4.0, 0.25),
    "critical_strain_grain_size": (0.03, 0.01),
}
"""What the paper finds for PIL40, and how far from it is still about it."""

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
        _narrow_posteriors(known),
        _most_uncertain(known),
        *curve_statements(known),
        _softer_fabric(known),
        _mechanism(known),
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


def _narrow_posteriors(known: Mapping[str, Knowledge]) -> Statement:
    """Count the parameters that the curve narrows much beyond prior and peak stress."""

    def shares(one: Knowledge) -> dict[str, tuple[float, float]]:
        found = {}
        for name in one.fit.priors.free:
            if name != "stress_noise":
                sd = parameter_draws(one.fit, name).std(ddof=1)
                by_prior, by_peak = one.sd_before(name)
                found[name] = float(sd / by_prior), float(sd / by_peak)
        return found

    by_test = {key: shares(one) for key, one in known.items()}

    def belief(key: str) -> Belief:
        of_curve = np.array([share for _, share in by_test[key].values()])
        narrow = float((of_curve < NARROW).mean())
        of_peak = np.array(
            [by_peak / alone for by_peak, alone in map(known[key].sd_before, by_test[key])]
        )
        return Belief(
            prior=False,
            number=between(float((of_peak < NARROW).mean()), wrong_below=FEW, right_above=MOST),
            posterior=between(narrow, wrong_below=FEW, right_above=MOST),
            effective_draws=known[key].effective_draws,
        )

    every = [pair for ratios in by_test.values() for pair in ratios.values()]
    of_prior, of_curve = (sum(pair[k] < NARROW for pair in every) for k in (0, 1))
    details = "; ".join(
        f"{key}: "
        + ", ".join(
            f"{symbol(shown_quantity(name))} {share[1]:.2f}"
            for name, share in sorted(ratios.items(), key=lambda item: item[1][1])
        )
        for key, ratios in by_test.items()
    )
    return Statement(
        key="narrow_posteriors",
        source="Ice, Table 1",
        text="For ice the posteriors are narrow although the priors are wide.",
        evidence=f"{of_prior} of {len(every)} posteriors have a standard deviation below "
        f"{NARROW:g} of the prior's, {of_curve} below {NARROW:g} of that with the peak stress "
        f"alone (ratios to the latter for {details}).",
        beliefs={key: belief(key) for key in known},
        rule="Parameters, the noise aside: holds if more than two thirds are narrower than half of "
        "what prior and peak stress leave, does not hold if less than a third are.",
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


def _mechanism(known: Mapping[str, Knowledge]) -> Statement:
    """Whether convergence of the critical strains tells what softens the ice."""
    names = ("critical_strain_grain_size", "critical_strain_fabric")

    def by_grains(fit: FittedTest) -> BoolArray:
        share: BoolArray = grain_size_share(fit.posterior).to_numpy().ravel() > 1 / 2
        return share

    def words(one: Knowledge) -> str:
        rhat = convergence_table(one.fit.posterior)["rhat"]
        return ", ".join(
            f"{symbol(shown_quantity(name))} "
            f"{parameter_draws(one.fit, name).std(ddof=1) / one.sd_before(name)[0]:.2f} (R-hat "
            f"{float(rhat[name]):.3f})"
            for name in names
        )

    details = "; ".join(f"{key} {words(one)}" for key, one in known.items())
    return Statement(
        key="mechanism",
        source="Ice",
        text="Which of ε_c1 and ε_c2 converges tells the mechanism: ε_c1 does, so that smaller "
        "grains soften the ice more than fabric does.",
        evidence=joined(
            [
                f"standard deviation over the prior's: {details}; chains that agree say that a "
                "parameter was sampled well, not that the data fix it"
            ]
        ),
        beliefs={key: probability(one, by_grains) for key, one in known.items()},
        rule="A draw counts if grain size does more than half of the softening beyond the peak "
        "(of its logarithm), which is the mechanism itself rather than a sign of it.",
    )
