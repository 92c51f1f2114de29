"""Measured microstructure in labelled draws: a group of its own, apart from the response."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from pyburgers.cmdstan.draw_files import Draws
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.likelihood import strains_of, times_of

COLUMNS = ("grain_size", "fabric_factor")
"""What a row of `stan/statistics/measured_microstructure.stan` is about."""

LOG_LIKELIHOOD = "microstructure_log_lik"
"""Name in programs that take measured microstructure; not there where none was measured."""


def microstructure_group(
    fit: Draws, experiments: Sequence[Experiment], chains: Mapping[str, list[int]]
) -> xr.Dataset:
    """Gather measured microstructure of tests, and draws of it, by section and quantity.

    Variables are model, replicated and log_likelihood (0 if nothing was measured), and without
    draws measured and error, the standard deviation of the fabric factor and of the logarithm
    of the grain size (m). Path strain and time (s) of each section are coordinates; one of them
    is NaN.
    """
    drawn = {
        "model": "microstructure_model",
        "replicated": "microstructure_replicated",
        "log_likelihood": LOG_LIKELIHOOD,
    }
    dimensions = ("chain", "draw", "section", "quantity")
    sections = [one for experiment in experiments for one in experiment.microstructure]
    numbers = np.array([one.numbers for one in sections])
    measured, error = numbers[:, ::2], numbers[:, 1::2]
    was_measured = error > 0
    return xr.Dataset(
        {
            **{name: (dimensions, fit[column]) for name, column in drawn.items()},
            "measured": (dimensions[2:], np.where(was_measured, measured, np.nan)),
            "error": (dimensions[2:], np.where(was_measured, error, np.nan)),
        },
        {
            **chains,
            "section": np.arange(len(sections)),
            "strain": ("section", strains_of(sections)),
            "time": ("section", times_of(sections)),
            "quantity": list(COLUMNS),
        },
    )


def of_test(group: xr.Dataset, experiments: Sequence[Experiment], test: int) -> xr.Dataset:
    """Return the part of `microstructure_group` that is about one test, counted from 0."""
    before = sum(len(experiment.microstructure) for experiment in experiments[:test])
    own = group.isel(section=slice(before, before + len(experiments[test].microstructure)))
    return own.assign_coords(section=np.arange(own.sizes["section"]))
