"""Technical words of a page and what they mean, shown where a reader points at one; rules."""

import re
from collections.abc import Mapping
from types import MappingProxyType

from markupsafe import Markup, escape

from pyburgers.checks.prior_influence import (
    AT_BOUND,
    CONFLICT_LEVEL,
    LEAST_SHARE,
    NEAR_BOUND,
    PRIOR_SHARE,
    Origin,
)
from pyburgers.model.laws import DASHPOT_LAWS

DEFINITIONS = {
    "posterior": "Knowledge of the parameters after the data: prior times likelihood.",
    "prior": "Knowledge of a parameter before the data.",
    "sd / prior sd": "Share of the prior's width that is left; near 1 the data did not narrow "
    "it. A small one may come from the prior of another quantity.",
    "decided by": "Who decides the number: data, a prior and of which quantity, both, or a bound.",
    "R-hat": "Compares chains with each other; 1 where they agree, at most 1.01 is wanted.",
    "effective sample size": "How many independent draws the correlated ones are worth.",
    "effective draws": "How many equally weighted draws the weighted ones are worth.",
    "divergences": "Trajectories of the sampler that failed where the posterior bends strongly.",
    "treedepth": "Limit on the length of a trajectory of the sampler.",
    "E-BFMI": "How well the sampler moves between energies; at least 0.3 is wanted.",
    "Pareto k": "Weight of the tail of importance weights; above 0.7 they are not reliable.",
    "elpd": "Expected log predictive density: how well unseen points are predicted, higher is "
    "better.",
    "log density": "Logarithm of the probability density that a fit gives to data.",
    "weight": "Share of a fit in the mixture of fits that predicts best.",
    "log predictive density": "Logarithm of the probability that a fit or prediction gives to "
    "readings; higher is better.",
    "predictive median": "Reading that half of the predicted ones lie below.",
    "replicated data": "Readings that draws of the posterior would have given.",
    "predictive band": "Where new readings are expected, noise included.",
    "retrodictions": "Solutions of the model for single draws, without noise.",
    "residual": "A reading less the response of the model.",
    "likelihood": "Probability of the data given the parameters.",
    "draws": "Samples of the posterior.",
    "chains": "Independent runs of the sampler.",
    "warm-up": "First part of a chain, in which the sampler adapts; not used.",
    "leapfrog steps": "Steps in which the sampler follows a trajectory, one gradient each.",
    "marginal likelihood": "Probability of the data under prior and model together.",
    "Monte Carlo error": "Error that comes from having finitely many draws.",
    "standard error": "Uncertainty of a number from how it scatters over the points.",
    "half-normal": "The positive half of a normal distribution.",
    "stress exponent": "n: power with which the steady strain rate grows with stress.",
    "grain size exponent": "p: power with which the strain rate falls with grain size.",
    "Maxwell modulus": "Stiffness of the spring in series: elastic strain.",
    "Kelvin modulus": "Stiffness of the delayed, recoverable part of the strain.",
    "Kelvin viscosity": "Viscosity that delays the recoverable part of the strain.",
    "dashpot": "Element that flows under stress and does not come back.",
    "piezometer": "Relation between stress and the grain size that it makes.",
    "activation enthalpy": "How strongly the strain rate grows with temperature.",
    "critical strain": "Strain over which grain size or fabric approach their steady state.",
    "fabric factor": "How the crystal fabric weakens the material; 1 where there is none.",
    "reference stress": "Stress at which undeformed material would flow at the imposed rate by "
    "its power law alone.",
    "reference flow rate": "Rate at which undeformed material would flow under a reference stress "
    "without threshold, backstress or further mechanism.",
    "tan δ": "Attenuation: tangent of the angle by which strain lags stress.",
    "Maxwell time": "Time in which flow makes as much strain as the elastic one.",
    "relaxation times": "Times after which strain that comes late has come.",
    **{law.name.replace("_", " "): law.words for law in DASHPOT_LAWS.values() if law.words},
    "backstress": "Stress that flow has stored, and that opposes the flow.",
    **dict.fromkeys(
        ("second mechanism", "third mechanism"),
        "Another way in which the dashpot flows at the same time.",
    ),
    "breakdown stress": "Stress at which a hyperbolic sine turns exponential.",
    "compliance": "Strain over stress.",
    "Debye peak": "Attenuation of a single relaxation time against the period.",
    "partially pooled": "A value in each test, scattered about a common centre.",
}
"""Definitions by term, which is looked for as it stands here or with a capital."""

_OPTION = r"(?P<option>--[a-z][a-z-]*(?: (?:\w+=\w+|\d[\d.]*\b))?)|"
"""An option of a command and its value."""

_TERM = re.compile(
    _OPTION
    + "|".join(
        rf"\b{re.escape(term)}(?!\w)" for term in sorted(DEFINITIONS, key=len, reverse=True)
    ),
    re.IGNORECASE,
)
_BY_LOWER = {term.lower(): text for term, text in DEFINITIONS.items()}


def with_definitions(text: str) -> Markup:
    """Escape a text, mark options, and give the first of each technical word its definition.

    Words of a text that is escaped already have none: it may hold names.
    """
    if isinstance(text, Markup):
        return text
    parts, seen, end = [], set(), 0
    for found in _TERM.finditer(text):
        term = found[0].lower()
        if term in seen:
            continue
        parts.append(escape(text[end : found.start()]))
        if found["option"]:
            parts.append(Markup('<code class="whole">{}</code>').format(found[0]))
        else:
            seen.add(term)
            parts.append(Markup('<abbr title="{}">{}</abbr>').format(_BY_LOWER[term], found[0]))
        end = found.end()
    return Markup().join([*parts, escape(text[end:])])


ORIGIN_RULES: Mapping[Origin, tuple[str, str]] = MappingProxyType(
    {
        Origin.DATA: (
            "The data decide the number.",
            f"The share of the priors is less than {LEAST_SHARE:g}.",
        ),
        Origin.BOTH: (
            "Data and priors decide it together.",
            f"The share of the priors is {LEAST_SHARE:g} to {PRIOR_SHARE:.2f}.",
        ),
        Origin.PRIOR: (
            "The priors decide it, its own or those in brackets.",
            f"The share of the priors is {PRIOR_SHARE:.2f} or more.",
        ),
        Origin.BOUND: (
            "The draws pile up at a bound of its prior.",
            f"At least {100 * AT_BOUND:.0f} % of the draws lie within {NEAR_BOUND:g} standard "
            "deviations of the bound, and the data took off half of the variance of the prior.",
        ),
        Origin.CONFLICT: (
            "Prior and data disagree; the number is a compromise.",
            "Given how much the data narrow the prior, the posterior mean lies further from its "
            "median than chance allows. A fit whose model and priors are right reports any "
            f"conflict with a probability of {CONFLICT_LEVEL:g}.",
        ),
        Origin.CANNOT_TELL: (
            "The draws are too few.",
            f"Chance alone gives the priors a share of {LEAST_SHARE:g} or more.",
        ),
    }
)
"""What it means that each of them decides a number, and by which rule."""

SHARE_TEXT = (
    "If the mean of a prior moves by one of its standard deviations, the number moves too. The "
    "share of the prior is the square of that move, in standard deviations of the posterior. "
    "Priors count on a scale on which they are normal. Brackets name the strongest priors, which "
    "have two thirds of the share of all."
)
