"""Priors of loading histories: what their readings and files add to those of the material."""

from collections.abc import Sequence
from dataclasses import replace

import numpy as np

from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.stated_priors import stated_priors
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.prior_families import fixed_prior, is_fixed_at
from pyburgers.model.priors import PriorSet, priors_of_freed_parameters
from pyburgers.model.variants import with_variant

STRAIN_NOISE_SHARE = 0.01
"""Median of the strain noise, over the range of the strain readings."""


def own_priors(
    experiments: Sequence[HistoryExperiment | AttenuationExperiment], priors: PriorSet
) -> tuple[PriorSet, ...]:
    """Return priors of each of some histories, and tables behind them, that are fitted together.

    Where strain is read, its noise is free and residuals correlate in time, unless the priors say
    otherwise; they do so too where the priors only say what share of them correlates. Where no
    stress is read, it has no noise. The compliance of the apparatus and the offset of the strain
    are those of the test's file, where that states them. What histories have beside the material's
    has no effect in a table, whose priors are those of the first history. Raise InputError if
    residuals are to correlate along strain.
    """
    histories = [one for one in experiments if isinstance(one, HistoryExperiment)]
    for experiment in histories:
        if not is_fixed_at(priors["residual_correlation_strain"], 0.0):
            raise InputError(
                f"{experiment.id}: residuals of a loading history correlate in time, found a prior "
                "of residual_correlation_strain, expected one of residual_correlation_time."
            )
    reads_strain = any(e.response_is_strain.any() for e in histories)
    reads_stress = any((~e.response_is_strain).any() for e in histories)
    found = tuple(
        _of_readings(e, priors, reads_strain, reads_stress).exchanging(*stated_priors(e).values())
        for e in histories
    )
    return found + found[:1] * (len(experiments) - len(histories))


def _of_readings(
    experiment: HistoryExperiment, priors: PriorSet, reads_strain: bool, reads_stress: bool
) -> PriorSet:
    if not reads_stress:
        noise = fixed_prior(PARAMETER_BY_NAME["stress_noise"], 1.0, "no stress is read")
        priors = priors.exchanging(noise)
    if reads_strain and "strain_noise" not in priors.priors:
        strain = experiment.reading[experiment.response_is_strain]
        free = priors_of_freed_parameters()["strain_noise"]
        if strain.size > 0 and np.ptp(strain) > 0:
            median = float(f"{STRAIN_NOISE_SHARE * np.ptp(strain):.0e}")
            free = replace(free, location=median)
        priors = priors.exchanging(free)
    correlate = reads_strain or not is_fixed_at(priors["residual_correlated_share"], 1.0)
    if correlate and experiment.residual_correlation not in priors.priors:
        priors = with_variant(priors, experiment, {"residuals": "autocorrelated"})
    return priors
