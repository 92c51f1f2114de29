"""Numbers of parameters that are unlikely in a material, such as those in a wrong unit."""

from collections.abc import Mapping

from pyburgers.common.paths import shipped_folder
from pyburgers.common.units import span_text
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import FLOW_LAW, PriorSet, load_priors, shipped_prior_files

FAR, FAR_ENTHALPY = 10.0, 3.0
"""Factor by which numbers lie beyond all priors that come with the package, to be doubted; that of
enthalpies, of which those of one material differ less than kcal from kJ."""

MOST_BEYOND = 3.0
"""Standard deviations by which a normal prior may lie outside its bounds."""


def unlikely_numbers(material: str, ranges: Mapping[str, tuple[float, float]]) -> list[str]:
    """Say which ranges (SI) of parameters are far from what the shipped priors of a material have.

    Parameters that can have either sign have no scale to be far from. Shipped values that are
    known count for single numbers alone: some are those of parameters without effect.
    """
    if material not in shipped_prior_files():
        return []
    files = (shipped_folder("data") / "priors").rglob(f"{material}.toml")
    shipped = [load_priors(file) for file in files]
    found = []
    for name, (low, high) in ranges.items():
        priors = [one.priors[name] for one in shipped if name in one.priors]
        free = [one for one in priors if not one.is_fixed]
        usual = map(range_of, free if free and low < high else priors)
        ends = [end for one in usual if one is not None for end in one]
        if not ends or min(high, *ends) * max(low, *ends) <= 0:
            continue
        far = FAR_ENTHALPY if name.endswith("activation_enthalpy") else FAR
        least, most = sorted((abs(low), abs(high)))
        usual_sizes = [abs(end) for end in ends]
        if most * far < min(usual_sizes) or least > far * max(usual_sizes):
            unit = PARAMETER_BY_NAME[name].si_unit
            found.append(
                f"{name}: {span_text((low, high), 3)} {unit} is far from the "
                f"{span_text((min(ends), max(ends)), 3)} {unit} that priors of {material} have; "
                "check its unit."
            )
    return found


def unlikely_priors(priors: PriorSet) -> list[str]:
    """Say which priors are far from those that come with the package, or outside their bounds."""
    own = {
        name: prior
        for name, prior in priors.priors.items()
        if priors.flow_law is None or name not in FLOW_LAW
    }
    ranges = {name: found for name, prior in own.items() if (found := range_of(prior)) is not None}
    outside = [
        f"{name}: its normal prior lies more than {MOST_BEYOND:g} standard deviations outside its "
        "own bounds; check both."
        for name, prior in own.items()
        if prior.family == "normal" and _beyond_bounds(prior) > MOST_BEYOND
    ]
    return [*unlikely_numbers(priors.material, ranges), *outside]


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
