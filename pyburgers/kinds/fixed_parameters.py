"""Fixed parameters that a fit depends on; the others only fill their place in a program."""

from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.model.parameters import PIEZOMETER, RESIDUAL_CORRELATION
from pyburgers.model.prior_families import Prior
from pyburgers.model.variants import variant_of


def fixed_in_effect(fit: FittedTest) -> tuple[Prior, ...]:
    """Return the fixed parameters that the solution or the likelihood of a test has in it.

    A law that a variant takes out leaves its parameters fixed, as does a kind of reading that the
    test does not have; their values say nothing about the material.
    """
    idle = _idle(fit)
    return tuple(
        prior for name, prior in fit.priors.priors.items() if prior.is_fixed and name not in idle
    )


def _idle(fit: FittedTest) -> frozenset[str]:
    """Name the parameters that nothing depends on."""
    variant = variant_of(fit.priors, fit.experiment)
    read = likelihood_of(fit.experiment).read
    without_readings = {*read} - {read[k] for k in fit.experiment.quantity}
    idle = {*fit.experiment.without_effect, *(one.noise for one in without_readings)}
    if variant.grain_size != "piezometric":
        idle |= {*PIEZOMETER}
    if variant.grain_size != "evolving":
        idle |= {"steady_state_grain_size"}
    if variant.grain_size == "constant":
        idle |= {"critical_strain_grain_size"}
    if variant.fabric == "constant":
        idle |= {"steady_state_fabric_factor", "critical_strain_fabric"}
    if not variant.residuals_correlate:
        idle |= {*RESIDUAL_CORRELATION}
    return frozenset(idle)
