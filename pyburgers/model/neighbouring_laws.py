"""Which other laws data may hardly tell from that of a fit."""

from pyburgers.model.fitted_test import Test
from pyburgers.model.laws import DASHPOT_LAWS, HARDENING_LAWS, KELVIN_LAWS
from pyburgers.model.read_quantities import STRAIN, STRESS
from pyburgers.model.residual_laws import DISCREPANCY
from pyburgers.model.variants import ModelVariant

MOST_OF_A_PART = 2


def neighbouring_laws(variant: ModelVariant, *tests: Test) -> tuple[str, ...]:
    """Return choices such as ``kelvin=power_law`` that all tests can have next to their fit's.

    Laws of the Kelvin part are neighbours where one has all parameters of the other; those with
    the fewest parameters between them come first.
    """
    own = {*KELVIN_LAWS[variant.kelvin].parameters}
    apart = {
        name: len(own ^ {*law.parameters})
        for name, law in KELVIN_LAWS.items()
        if name != variant.kelvin and (own <= {*law.parameters} or own >= {*law.parameters})
    }
    nearest = {
        "kelvin": sorted(apart, key=apart.__getitem__),
        "maxwell": DASHPOT_LAWS[variant.maxwell].neighbours,
    }
    return tuple(
        f"{part}={law}"
        for part, laws in nearest.items()
        for law in [
            one for one in laws if all(one in test.laws.get(part, (one,)) for test in tests)
        ][:MOST_OF_A_PART]
    )


def redefined(one: ModelVariant, other: ModelVariant) -> frozenset[str]:
    """Return the quantities that do not mean the same under the laws of two variants."""
    has_discrepancy = {law.residuals == DISCREPANCY for law in (one, other)}
    parts = (
        (KELVIN_LAWS, one.kelvin, other.kelvin),
        (DASHPOT_LAWS, one.maxwell, other.maxwell),
        (HARDENING_LAWS, one.hardening, other.hardening),
    )
    # With a discrepancy of the law a noise is the reading error alone.
    noises = (STRESS.noise, STRAIN.noise) if has_discrepancy == {True, False} else ()
    return frozenset(noises) | frozenset(
        name
        for laws, *pair in parts
        if len({*pair}) > 1
        for law in pair
        for name in laws[law].redefines
    )
