"""What a Stan program generated at points and on a grid -> groups of labelled draws."""

from collections.abc import Mapping, Sequence

import numpy as np
import xarray as xr

from pyburgers.cmdstan.draw_files import Draws
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.likelihood import likelihood_of, strains_of, times_of
from pyburgers.posterior.labelled_draws import CORRELATED

GIVEN_OTHERS = "log_lik_given_others"
"""Name in programs; empty where residuals are independent."""

PRIOR_DENSITY = "lprior"
"""Log density of the priors in programs; draws of a prediction have none."""

MICROSTRUCTURE_COLUMNS = ("grain_size", "fabric_factor")
"""What a row of `stan/statistics/measured_microstructure.stan` is about."""

MICROSTRUCTURE_LOG_LIKELIHOOD = "microstructure_log_lik"
"""Name in programs that take measured microstructure; not there where none was measured."""


def drawn_at_points(fit: Draws, chains: Mapping[str, list[int]]) -> xr.Dataset:
    """Return responses with and without noise and densities by chain, draw and point.

    If residuals are correlated, `GIVEN_OTHERS` is there too.
    """
    names = ["response_model", "response_replicated", "log_lik"]
    if GIVEN_OTHERS in fit:
        names.append(GIVEN_OTHERS)
    columns = {name: fit.dataset([name])[name].rename({f"{name}_dim_0": "point"}) for name in names}
    drawn = xr.Dataset(columns).assign_coords(chains)
    return drawn.assign_coords(point=np.arange(drawn.sizes["point"]))


def groups_at_points(at_points: xr.Dataset, experiment: Experiment) -> dict[str, xr.Dataset]:
    """Return the groups of one test that are about its points, from `drawn_at_points`."""
    likelihood = likelihood_of(experiment)
    response = likelihood.response.name
    return {
        **point_groups(at_points, [experiment]),
        "model_response": xr.Dataset({response: at_points["response_model"]}),
        "constant_data": xr.Dataset(
            {
                name: ("point", values, {"units": unit})
                for name, (values, unit) in likelihood.along(experiment).items()
            },
            {"point": np.arange(experiment.n_points)},
        ),
    }


def point_groups(at_points: xr.Dataset, experiments: Sequence[Experiment]) -> dict[str, xr.Dataset]:
    """Return the groups of points of a fit with `PRIOR_DENSITY`, tests one after the other."""
    response = likelihood_of(experiments[0]).response
    name = response.name
    observed = np.concatenate([experiment.response for experiment in experiments])
    points = {"point": np.arange(observed.size)}
    groups = {
        "log_likelihood": xr.Dataset({name: at_points["log_lik"]}),
        "posterior_predictive": xr.Dataset({name: at_points["response_replicated"]}),
        "observed_data": xr.Dataset(
            {name: ("point", observed, {"units": response.si_unit})}, points
        ),
    }
    if PRIOR_DENSITY in at_points:
        groups["log_prior"] = xr.Dataset({PRIOR_DENSITY: at_points[PRIOR_DENSITY]})
    if GIVEN_OTHERS in at_points:
        groups[CORRELATED] = xr.Dataset({name: at_points[GIVEN_OTHERS]})
    return groups


def grid_group(checked: xr.Dataset, experiment: Experiment) -> xr.Dataset:
    """Return solutions on the prediction grid of a test, its clock as coordinate."""
    likelihood = likelihood_of(experiment)
    clock = likelihood.clock.name
    variables = {}
    for column, (name, unit) in likelihood.grid_quantities.items():
        values = checked[column].rename({f"{column}_dim_0": clock})
        values.attrs = {"units": unit}
        variables[name] = values.astype(np.float32)  # drawn, not computed with
    return xr.Dataset(variables).assign_coords({clock: likelihood.grid(experiment)})


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
        "log_likelihood": MICROSTRUCTURE_LOG_LIKELIHOOD,
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
            "quantity": list(MICROSTRUCTURE_COLUMNS),
        },
    )


def microstructure_of_test(
    group: xr.Dataset, experiments: Sequence[Experiment], test: int
) -> xr.Dataset:
    """Return the part of `microstructure_group` that is about one test, counted from 0."""
    before = sum(len(experiment.microstructure) for experiment in experiments[:test])
    own = group.isel(section=slice(before, before + len(experiments[test].microstructure)))
    return own.assign_coords(section=np.arange(own.sizes["section"]))
