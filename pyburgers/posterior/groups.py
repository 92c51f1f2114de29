"""What a Stan program generated -> groups of labelled draws, and the file that holds them."""

import json
from collections.abc import Mapping, Sequence
from hashlib import sha256
from typing import Any

import numpy as np
import xarray as xr

from pyburgers.cmdstan.draw_files import Draws
from pyburgers.common.atomic_files import sha256_of_file
from pyburgers.common.errors import InputError
from pyburgers.common.netcdf_files import read_netcdf, write_netcdf
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.likelihood import likelihood_of, strains_of, times_of
from pyburgers.posterior.labelled_draws import CORRELATED, TESTS
from pyburgers.sampling.run_directory import REMEDY, RunDirectory

GIVEN_OTHERS = "log_lik_given_others"
"""Name in programs; empty where residuals are independent."""

PRIOR_DENSITY = "lprior"
"""Log density of the priors in programs; draws of a prediction have none."""

MICROSTRUCTURE_COLUMNS = ("grain_size", "fabric_factor")
"""What a row of `stan/statistics/measured_microstructure.stan` is about."""

MICROSTRUCTURE_LOG_LIKELIHOOD = "microstructure_log_lik"
"""Name in programs that take measured microstructure; not there where none was measured."""


def drawn_at_points(fit: Draws) -> xr.Dataset:
    """Return responses with and without noise and densities by chain, draw and point."""
    names = ["response_model", "response_replicated", "log_lik"]
    if GIVEN_OTHERS in fit:
        names.append(GIVEN_OTHERS)
    columns = {name: fit.dataset([name])[name].rename({f"{name}_dim_0": "point"}) for name in names}
    drawn = xr.Dataset(columns)
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


def microstructure_group(fit: Draws, experiments: Sequence[Experiment]) -> xr.Dataset:
    """Gather measured microstructure of tests, and draws of it, by section and quantity.

    The log likelihood is 0 if nothing was measured. The error is that of the fabric factor and of
    the logarithm of the grain size (m). Each section has either a path strain or a time (s).
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
            "section": np.arange(len(sections)),
            "strain": ("section", strains_of(sections)),
            "time": ("section", times_of(sections)),
            "quantity": list(MICROSTRUCTURE_COLUMNS),
        },
    )


def keep_posterior(
    run: RunDirectory,
    groups: Mapping[str, xr.Dataset],
    *,
    experiment: str,
    data_kind: str,
    protocols: Mapping[str, str] | None = None,
) -> xr.DataTree:
    """Save groups of draws, by ArviZ's names, as the posterior of a run with finished chains."""
    tree: xr.DataTree = xr.DataTree.from_dict(
        {name: dataset.drop_attrs(deep=False) for name, dataset in groups.items()}
    )
    tree.attrs = {
        "experiment": experiment,
        "data_kind": data_kind,
        "fingerprint": run.read_manifest()["fingerprint"],
        "chains": json.dumps(list(run.finished_chains())),
        "extensions": run.n_extensions(),
    }
    for test, protocol in (protocols or {}).items():
        part = tree[TESTS][test] if TESTS in tree.children else tree
        part.attrs["protocol"] = protocol
    run.update_manifest({"posterior_sha256": None})
    write_netcdf(run.posterior_file, tree)
    run.update_manifest({"posterior_sha256": sha256_of_file(run.posterior_file)})
    return tree


def load_posterior(run: RunDirectory, manifest: Mapping[str, Any]) -> xr.DataTree | None:
    """Return labelled draws of a run, or None if they are not those of its finished chains.

    None too after a correction of the kind of data in the file. Raises `InputError` if the bytes
    that are read have another hash than `manifest` notes.
    """
    noted = manifest.get("posterior_sha256")
    if not run.posterior_file.is_file() or noted is None:
        return None
    if sha256(content := run.posterior_file.read_bytes()).hexdigest() != noted:
        raise InputError(
            f"{run.posterior_file} has changed since the run, as its hash says; {REMEDY}."
        )
    tree = read_netcdf(content)
    is_current = (
        json.loads(tree.attrs["chains"]) == list(run.finished_chains())
        and tree.attrs.get("extensions") == run.n_extensions()
        and tree.attrs.get("data_kind") == manifest.get("data_kind")
    )
    return tree if is_current else None
