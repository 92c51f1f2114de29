"""Numbers of parameters that are unlikely in a material, such as those in a wrong unit."""

from collections.abc import Iterator, Mapping
from functools import cache

from pyburgers.common.paths import shipped_folder
from pyburgers.common.units import span_text
from pyburgers.model.display import shown_quantity
from pyburgers.model.prior_families import Prior, is_fixed_at
from pyburgers.model.priors import PriorSet, load_priors, shipped_prior_files

FAR, FAR_ENTHALPY, FAR_STRAIN = 10.0, 3.0, 3.0
"""Factor by which numbers lie beyond all priors that come with the package, to be doubted; that of
enthalpies, of which those of one material differ less than kcal from kJ; and that by which critical
strains lie above, which may be in percent."""

MOST_BEYOND = 3.0
"""Standard deviations by which a normal prior may lie outside its bounds."""

MOST_AGAINST = 0.05
"""Mass that a prior may give to a sign that stands against the model's meaning."""

MOST_NOISE = 0.5
"""Median of a prior of noise over the largest stress beyond which a unit may be wrong."""


@cache
def _shipped(material: str) -> tuple[PriorSet, ...]:
    """Return all priors of a material that come with the package."""
    if material not in shipped_prior_files():
        return ()
    files = (shipped_folder("data") / "priors").rglob(f"{material}.toml")
    return tuple(map(load_priors, files))


def unlikely_numbers(material: str, ranges: Mapping[str, tuple[float, float]]) -> list[str]:
    """Say which ranges (SI) of parameters are far from what the shipped priors of a material have.

    Parameters that can have either sign have no scale to be far from. Shipped values that are
    known count for single numbers alone: some are those of parameters without effect. A mechanism
    in brackets behind a name is left aside.
    """
    found = []
    for name, (low, high) in ranges.items():
        own = name.partition("[")[0]
        priors = [one.priors[own] for one in _shipped(material) if own in one.priors]
        free = [one for one in priors if not one.is_fixed]
        usual = map(range_of, free if free and low < high else priors)
        ends = [end for one in usual if one is not None for end in one]
        if not ends or min(high, *ends) * max(low, *ends) <= 0:
            continue
        far = FAR_ENTHALPY if own.endswith("activation_enthalpy") else FAR
        far_above = FAR_STRAIN if own.startswith("critical_strain") else far
        least, most = sorted((abs(low), abs(high)))
        least = 0.0 if low < 0 < high else least
        usual_sizes = [abs(end) for end in ends]
        if most * far < min(usual_sizes) or least > far_above * max(usual_sizes):
            unit = shown_quantity(name).si_unit
            found.append(
                f"{name}: {span_text((low, high), 3)} {unit} is far from the "
                f"{span_text((min(ends), max(ends)), 3)} {unit} that priors of {material} have; "
                "check its unit."
            )
    return found


def unlikely_priors(priors: PriorSet, material: str | None = None) -> list[str]:
    """Say which priors are of another material than a test, unlikely, or outside their bounds."""
    ranges = {
        name: found
        for name, prior in priors.priors.items()
        if (found := range_of(prior)) is not None
    }
    other = []
    if material not in (None, priors.material):
        other = [f"{priors.title!r} are priors of {priors.material}, the data are of {material}."]
    return [*other, *unlikely_numbers(priors.material, ranges), *_against_the_model(priors)]


def _against_the_model(priors: PriorSet) -> Iterator[str]:
    """Say which priors lie outside their bounds, have a wrong sign, or expect noise alone."""
    for name, prior in priors.priors.items():
        own = name.partition("[")[0]
        if prior.family == "normal" and _beyond_bounds(prior) > MOST_BEYOND:
            yield (
                f"{name}: its normal prior lies more than {MOST_BEYOND:g} standard deviations "
                "outside its own bounds; check both."
            )
        if own == "beta" and (above := 1.0 - _mass_below_zero(prior)) > MOST_AGAINST:
            exponent = priors[name.replace(own, "stress_exponent")]
            if not is_fixed_at(exponent, 1.0):
                yield (
                    f"{name}: its prior gives {above:.0%} to positive values, with which A would "
                    "exceed 1 in SI units; check its spread."
                )
        if own == "activation_enthalpy" and (below := _mass_below_zero(prior)) > MOST_AGAINST:
            yield (
                f"{name}: its prior gives {below:.0%} to values that are not positive, with which "
                "heat would slow the flow; check its numbers."
            )
        if prior.relative_to_max_stress:
            ratio = prior.resolved(1.0)
            median = ratio.location if ratio.is_fixed else float(ratio.distribution().median())
            if median > MOST_NOISE:
                yield (
                    f"{name}: its prior expects noise of {median:.2g} times the largest stress, "
                    "where 0.01 is one percent; check its unit."
                )


def _mass_below_zero(prior: Prior) -> float:
    """Share of a prior that is not positive."""
    if prior.is_fixed:
        return float(prior.location <= 0)
    return float(prior.distribution().cdf(0.0))


def range_of(prior: Prior) -> tuple[float, float] | None:
    """Central 90 % of a prior, SI; None where it is relative to the stress of a test."""
    if prior.relative_to_max_stress:
        return None
    if prior.is_fixed:
        return prior.location, prior.location
    low, high = prior.distribution().ppf([0.05, 0.95])
    return float(low), float(high)


def _beyond_bounds(prior: Prior) -> float:
    """Return by how many standard deviations a normal prior lies outside its bounds, 0 inside."""
    return max(prior.lower - prior.location, prior.location - prior.upper, 0.0) / prior.scale
