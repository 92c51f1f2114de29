"""Where do the numbers come from: how far prior and data each move a posterior.

Prior or likelihood is raised to a power slightly above and below 1 by weighting the draws; how far
the marginal distribution of a parameter moves is its sensitivity (Kallioinen, Paananen, Bürkner
and Vehtari 2024, Statistics and Computing 34, 57). ArviZ has it too, but under another name and
signature in each of its major versions, and not for the priors of single parameters.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass
from enum import StrEnum

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr
from scipy.special import ndtri, xlogy

from pyburgers.common.draws import all_draws
from pyburgers.model.display import shown_quantity
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import FLOW_LAW, PriorSet
from pyburgers.posterior.labelled_draws import (
    free_parameters,
    on_scale_of_prior,
    smooth_weights,
    total_log_likelihood,
    width_beside_prior,
)

FloatArray = npt.NDArray[np.float64]

POWER_STEP = 0.01
"""Powers are 1 / (1 + step) and 1 + step: a finite difference around 1."""

SENSITIVE = 0.05
"""Sensitivity from which a part of the model matters: the threshold of Kallioinen et al. 2024."""

CHANCE_SHIFTS = 8
"""Shifts of the weights of draws against the draws that say what chance alone moves."""

CHANCE_FACTOR = 2.0
"""Times what they move on the mean, which some 1 of 100 quantities exceed that a component of the
model says nothing of."""

PULL = 0.05
"""Shift of the mean, in standard deviations for a doubled weight, that counts as a pull."""

CLOSE = 1.0
"""Prior standard deviations from the prior's median within which nothing disagrees with it."""

FAR_OUT = 2.0
"""Prior standard deviations from the prior's median at which a posterior counts as far out."""

AS_WIDE = 0.75
"""Share of the prior's standard deviation from which a posterior counts as the prior itself."""

JOINT_PRIOR = "flow_law"
"""Stands for the joint prior of the flow law among the priors of single parameters."""


class Origin(StrEnum):
    """What decides a number, by the thresholds of `THRESHOLDS_TEXT`."""

    PRIOR = "this number is your prior"
    DATA = "the data decide"
    AGREEMENT = "prior and data agree"
    DISAGREEMENT = "prior and data disagree"
    BOTH = "prior and data both decide"
    CANNOT_TELL = "cannot tell from these draws"


THRESHOLDS_TEXT = (
    "Sensitivity: cumulative Jensen-Shannon distance by which the posterior of a quantity moves, "
    f"per doubling of the weight of prior or data; from {SENSITIVE:g} on, that part matters. Only "
    "the prior matters: this number is your prior, but of what has no prior of its own (flow rate "
    "and stress at the reference) both decide where its sensitivity to the data is more than "
    "chance may give. Only the data: the data decide, but where the "
    f"posterior is at least {AS_WIDE:g} times as wide as the prior, which then holds it, both do. "
    "Both matter: "
    "prior and data disagree where they pull the mean in opposite directions by at least "
    f"{PULL:g} standard deviations each and the posterior is not close to the prior's median, that "
    f"is within {CLOSE:g} of its standard deviations, else both decide. Neither: this number is "
    f"your prior where the posterior is at least {AS_WIDE:g} times as wide as it, else prior and "
    "data agree. "
    f"A sensitivity of {SENSITIVE:g} or more that chance may give (at most {CHANCE_FACTOR:g} times "
    "the mean of what it is where the weights are shifted against the draws) decides nothing: then "
    "it cannot be told from these draws. "
    "A uniform prior has no slope, so that it counts as not mattering; its bounds are not scaled, "
    "and a posterior that leans on one is held there by the prior whatever the table says. All "
    "priors count together: along a trade-off that the data leave open, a quantity can be set by "
    "the prior of another one; the last column names the prior that alone moves the quantity "
    f"furthest, by at least {SENSITIVE:g}. Of a quantity with a lognormal prior all numbers are "
    "about its logarithm. The distance is how far the posterior median is from "
    "that of a normal or lognormal prior, in its standard deviations (of the logarithm for the "
    "latter), counted by the probability beyond, so that what its bounds cut off has none; from "
    f"{FAR_OUT:g} on, prior and data count as disagreeing whatever they pull."
)


@dataclass(frozen=True)
class Influence:
    """What one quantity owes to prior and data.

    Attributes
    ----------
    prior_sensitivity, likelihood_sensitivity : float
        Distance per doubling of the weight (dimensionless, 0 to about 1).
    prior_chance, likelihood_chance : float
        Largest sensitivity that may be chance (`chance_sensitivity`).
    prior_pull, likelihood_pull : float
        Shift of the mean in posterior standard deviations per doubling of the weight.
    strongest_prior : str or None
        Parameter whose prior (or `JOINT_PRIOR`, which alone) moves the quantity furthest; None
        where none moves it by `SENSITIVE`.
    width : float or None
        Posterior over prior standard deviation; None for a quantity without a prior of its own.
    distance : float or None
        How far the posterior median is from the prior's, in standard deviations of a normal
        distribution with the same probability; None without a normal or lognormal prior.
    """

    prior_sensitivity: float
    likelihood_sensitivity: float
    prior_chance: float
    likelihood_chance: float
    prior_pull: float
    likelihood_pull: float
    strongest_prior: str | None
    width: float | None
    distance: float | None

    @property
    def is_conflict(self) -> bool:
        """Whether prior and data disagree: they pull apart, or the posterior is far out."""
        far_out = self.distance is not None and abs(self.distance) >= FAR_OUT
        return far_out or self.origin is Origin.DISAGREEMENT

    @property
    def origin(self) -> Origin:
        """What decides it."""
        prior_matters = self.prior_sensitivity >= SENSITIVE
        data_matter = self.likelihood_sensitivity >= SENSITIVE
        if (prior_matters and self.prior_sensitivity <= self.prior_chance) or (
            data_matter and self.likelihood_sensitivity <= self.likelihood_chance
        ):
            return Origin.CANNOT_TELL
        if prior_matters and not data_matter:
            # What has no prior of its own is no prior's number where the data move it at all.
            moved = self.width is None and self.likelihood_sensitivity > self.likelihood_chance
            return Origin.BOTH if moved else Origin.PRIOR
        as_wide = self.width is not None and self.width >= AS_WIDE
        if data_matter and not prior_matters:
            return Origin.BOTH if as_wide else Origin.DATA
        if not data_matter:
            return Origin.PRIOR if as_wide else Origin.AGREEMENT
        close = self.distance is not None and abs(self.distance) < CLOSE
        opposed = self.prior_pull * self.likelihood_pull < 0 and not close
        if opposed and min(abs(self.prior_pull), abs(self.likelihood_pull)) >= PULL:
            return Origin.DISAGREEMENT
        return Origin.BOTH


def prior_influence(
    posterior: xr.DataTree, priors: PriorSet, pooled: Collection[str] = ()
) -> dict[str, Influence]:
    """Tell for every sampled quantity what prior and data do to it.

    Parameters
    ----------
    posterior : DataTree
        Labelled draws with the groups posterior, log_prior (variable lprior) and log_likelihood
        (one variable, by point). In a test of a joint fit the data are those of all tests.
    priors : PriorSet
        Priors of the fit, resolved.
    pooled : collection of str
        Parameters of a test whose prior is a normal distribution about a centre of several tests,
        so that they have none of their own.
    """
    draws = posterior["posterior"].to_dataset()
    log_prior = all_draws(posterior["log_prior"].to_dataset()["lprior"])
    log_likelihood = all_draws(total_log_likelihood(posterior))
    alone = [name for name in priors.free if priors.flow_law is None or name not in FLOW_LAW]
    single = {
        name: priors[name].distribution().logpdf(all_draws(draws[name]))
        for name in alone
        if name not in pooled
    }
    if priors.flow_law is not None:
        single[JOINT_PRIOR] = priors.flow_law.log_density(
            {name: all_draws(draws[name]) for name in FLOW_LAW}
        )
    found = {}
    for name in free_parameters(posterior):
        values = all_draws(draws[name])
        if name in priors.free:
            values = on_scale_of_prior(values, priors[name])
        by_prior = {key: power_scaling_sensitivity(values, part) for key, part in single.items()}
        strongest = max(by_prior, key=by_prior.__getitem__)
        found[name] = Influence(
            prior_sensitivity=power_scaling_sensitivity(values, log_prior),
            likelihood_sensitivity=power_scaling_sensitivity(values, log_likelihood),
            prior_chance=chance_sensitivity(values, log_prior),
            likelihood_chance=chance_sensitivity(values, log_likelihood),
            prior_pull=mean_pull(values, log_prior),
            likelihood_pull=mean_pull(values, log_likelihood),
            strongest_prior=(
                strongest
                if by_prior[strongest]
                >= max(SENSITIVE, chance_sensitivity(values, single[strongest]))
                else None
            ),
            width=(
                width_beside_prior(all_draws(draws[name]), priors[name])
                if name in priors.free
                else None
            ),
            distance=_distance(all_draws(draws[name]), priors[name]) if name in alone else None,
        )
    return found


def _distance(values: FloatArray, prior: Prior) -> float | None:
    """Probability that a bell-shaped prior puts below the median of draws, as a normal score."""
    if prior.family not in ("normal", "lognormal"):
        return None
    law, median = prior.distribution(), np.median(values)
    # The smaller tail: the other one is 1 to machine precision where the median is far out.
    below = law.cdf(median) < law.sf(median)
    return float(ndtri(law.cdf(median)) if below else -ndtri(law.sf(median)))


def influence_table(influences: Mapping[str, Influence]) -> pd.DataFrame:
    """Sensitivities as text for people, a row for each quantity.

    Returns
    -------
    DataFrame
        Text. Columns quantity, prior, data (sensitivities), sd / prior sd, distance (prior sd),
        where it comes from, mostly the prior of.
    """
    return pd.DataFrame(
        [
            {
                "quantity": shown_quantity(name).label,
                "prior": f"{influence.prior_sensitivity:.2f}",
                "data": f"{influence.likelihood_sensitivity:.2f}",
                "sd / prior sd": "" if influence.width is None else f"{influence.width:.2f}",
                "distance (prior sd)": ""
                if influence.distance is None
                else f"{influence.distance:+.1f}",
                "where it comes from": influence.origin,
                "mostly the prior of": ""
                if influence.strongest_prior is None
                else _prior_label(influence.strongest_prior),
            }
            for name, influence in influences.items()
        ]
    )


def influence_numbers(influences: Mapping[str, Influence]) -> pd.DataFrame:
    """Return every number of `Influence`, and its origin, a row for each quantity."""
    rows = {name: {**asdict(one), "origin": one.origin} for name, one in influences.items()}
    return pd.DataFrame.from_dict(rows, orient="index").rename_axis("parameter")


def _prior_label(name: str) -> str:
    return "the flow law, jointly" if name == JOINT_PRIOR else shown_quantity(name).label


def conflicts(influences: Mapping[str, Influence]) -> list[str]:
    """Return the quantities about which prior and data disagree, those furthest out first."""
    found = [name for name, influence in influences.items() if influence.is_conflict]
    return sorted(found, key=lambda name: -abs(influences[name].distance or 0.0))


def conflict_text(label: str, influence: Influence) -> str:
    """Say how far what a label names is from its prior's median where that has a bell."""
    if influence.distance is None:
        return label
    return f"{label} ({influence.distance:+.1f} prior sd)"


CONFLICT_MEANING = (
    "what comes out is a compromise of the two, so check the prior's source, and whether the model "
    "describes the data"
)


def disagreement(influences: Mapping[str, Influence]) -> str | None:
    """Name what prior and data disagree about; None where they do not."""
    names = conflicts(influences)
    listed = ", ".join(
        conflict_text(shown_quantity(name).label, influences[name]) for name in names
    )
    return f"Prior and data disagree about {listed}" if names else None


def conflict_sentence(influences: Mapping[str, Influence]) -> str | None:
    """Say what prior and data disagree about, and what that means; None where they do not."""
    named = disagreement(influences)
    return named and f"{named}: {CONFLICT_MEANING}."


def power_scaling_sensitivity(draws: FloatArray, log_component: FloatArray) -> float:
    """Distance by which a marginal distribution moves per doubling of a component's weight.

    Parameters
    ----------
    draws : array, shape (n,)
        Draws of one quantity; its unit does not matter.
    log_component : array, shape (n,)
        Log prior or log likelihood of each draw.

    Returns
    -------
    float
        Mean of the cumulative Jensen-Shannon distances to the posteriors with the component
        raised to the powers 1 + `POWER_STEP` and its inverse, over log2(1 + `POWER_STEP`).
    """
    return _moved(draws, _weights_of_powers(log_component))


def chance_sensitivity(draws: FloatArray, log_component: FloatArray) -> float:
    """Sensitivity that a quantity may have by chance, which falls with the number of draws.

    Shifts of a component against the draws, around the end, keep how draws follow one another and
    nothing else.

    Parameters
    ----------
    draws, log_component
        As for `power_scaling_sensitivity`.
    """
    weights = _weights_of_powers(log_component)
    shifts = [k * draws.size // (CHANCE_SHIFTS + 1) for k in range(1, CHANCE_SHIFTS + 1)]
    by_shift = [_moved(draws, [np.roll(one, shift) for one in weights]) for shift in shifts]
    return float(CHANCE_FACTOR * np.mean(by_shift))


def _weights_of_powers(log_component: FloatArray) -> list[FloatArray]:
    """Weights of draws by which a component has a power a step below and above 1."""
    powers = (1.0 / (1.0 + POWER_STEP), 1.0 + POWER_STEP)
    return [np.exp(smooth_weights((power - 1.0) * log_component)[0]) for power in powers]


def _moved(draws: FloatArray, weights: Sequence[FloatArray]) -> float:
    """Mean distance by which weights move draws, per doubling of a component's weight."""
    moved = [max(cumulative_distance(draws, w), cumulative_distance(-draws, w)) for w in weights]
    return float(np.mean(moved) / np.log2(1.0 + POWER_STEP))


def mean_pull(draws: FloatArray, log_component: FloatArray) -> float:
    """Shift of a mean, in standard deviations, per doubling of a component's weight.

    The derivative of the mean by the power of a component is their covariance.

    Parameters
    ----------
    draws, log_component
        As for `power_scaling_sensitivity`.
    """
    if np.ptp(draws) == 0:  # a derived quantity of known parameters
        return 0.0
    covariance = float(np.cov(draws, log_component)[0, 1])
    return float(np.log(2.0) * covariance / np.std(draws, ddof=1))


def cumulative_distance(draws: FloatArray, weights: FloatArray) -> float:
    """Cumulative Jensen-Shannon distance between draws with equal and with given weights.

    The Jensen-Shannon divergence of two cumulative distribution functions instead of two
    densities, over its upper bound, and its square root (Nguyen and Vreeken 2015, ECML PKDD).

    Parameters
    ----------
    draws : array, shape (n,)
        Not all the same.
    weights : array, shape (n,)
        Positive, adding up to 1.

    Returns
    -------
    float
        0 where the distributions are the same, at most 1.
    """
    order = np.argsort(draws)
    width = np.diff(draws[order])
    p = np.arange(1, draws.size) / draws.size
    q = np.cumsum(weights[order])[:-1]
    middle = 0.5 * (p + q)
    # The terms (q - p) / (2 ln 2) of the two directed divergences cancel in their sum.
    divergence = width @ (xlogy(p, p / middle) + xlogy(q, q / middle)) / np.log(2.0)
    bound = width @ (p + q)
    # Draws that never vary, such as a reference stress of a known flow law, are the same.
    return float(np.sqrt(max(0.0, divergence) / bound)) if bound > 0 else 0.0
