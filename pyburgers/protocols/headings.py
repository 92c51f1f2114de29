"""What is written above the figures of a test."""

from pyburgers.model.display import STRAIN_FACTOR, STRAIN_UNIT
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.forced_oscillation.experiment import OscillationExperiment


def title(experiment: Experiment) -> str:
    """Sample, material, conditions and kind of data; two lines for an oscillation."""
    kind = f"{experiment.provenance.kind} data"
    sample = f"{experiment.id}: {experiment.material}, {experiment.temperature:g} K"
    if isinstance(experiment, OscillationExperiment):
        prepared = experiment.prepared
        amplitude, _ = prepared.strain_fit.amplitude()
        return (
            f"{sample}, {kind}\nperiod {prepared.period:g} s, strain amplitude "
            f"{amplitude * STRAIN_FACTOR:.2g} {STRAIN_UNIT}, background {prepared.background}"
        )
    assert isinstance(experiment, ConstantRateExperiment)  # the only other protocol
    rate = rate_text(experiment.segments[0].strain_rate)
    return f"{sample}, {'first ' if len(experiment.segments) > 1 else ''}{rate}, {kind}"


def rate_text(rate: float) -> str:
    """Strain rate as matplotlib text."""
    mantissa, exponent = f"{rate:.2e}".split("e")
    return rf"${mantissa}\times10^{{{int(exponent)}}}$ s$^{{-1}}$"
