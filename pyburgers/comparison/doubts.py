"""What speaks against the draws that a comparison stands on."""

from pyburgers.checks.fit_checks import CheckKind
from pyburgers.fitting.sampled_fit import SampledFit


def sampling_doubts(one: SampledFit, name: str, consequence: str) -> tuple[str, ...]:
    """Say which checks of its draws a fit of something failed, and what that means here."""
    failed = [
        result.name
        for result in one.checks()
        if not result.passed and result.check.kind is CheckKind.SAMPLING
    ]
    if not failed:
        return ()
    return (f"The fit of {name} failed its check of {' and '.join(failed)}: {consequence}.",)
