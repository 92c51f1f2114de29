"""Which other laws data may hardly tell from that of a fit."""

from pyburgers.model.kelvin_laws import PARAMETERS_OF_LAW
from pyburgers.model.variants import ModelVariant, Test

MOST_OF_A_PART = 2

_MAXWELL = {
    "power_law": ("hyperbolic_sine",),
    "hyperbolic_sine": ("power_law",),
    "linear": ("power_law",),
}


def neighbouring_laws(variant: ModelVariant, test: Test) -> tuple[str, ...]:
    """Return choices such as ``kelvin=power_law`` that are next to those of a fit.

    Laws of the Kelvin part are neighbours where one has all parameters of the other; those with
    the fewest parameters between them come first.

    Parameters
    ----------
    variant : ModelVariant
        Laws of the fit.
    test : Test
        What is fitted, which says what laws it can have.
    """
    own = {*PARAMETERS_OF_LAW[variant.kelvin]}
    apart = {
        law: len(own ^ {*names})
        for law, names in PARAMETERS_OF_LAW.items()
        if law != variant.kelvin and (own <= {*names} or own >= {*names})
    }
    nearest = {"kelvin": sorted(apart, key=apart.__getitem__), "maxwell": _MAXWELL[variant.maxwell]}
    return tuple(
        f"{part}={law}"
        for part, laws in nearest.items()
        for law in [one for one in laws if one in test.laws.get(part, (one,))][:MOST_OF_A_PART]
    )
