"""The file of a run that holds its labelled draws."""

import json
import logging
from collections.abc import Mapping
from hashlib import sha256
from typing import Any

import xarray as xr

from pyburgers.common.atomic_files import sha256_of_file
from pyburgers.common.errors import InputError
from pyburgers.common.netcdf_files import read_netcdf, write_netcdf
from pyburgers.posterior.labelled_draws import TESTS
from pyburgers.sampling.run_directory import REMEDY, RunDirectory

logger = logging.getLogger(__name__)


def keep_posterior(
    run: RunDirectory,
    groups: Mapping[str, xr.Dataset],
    *,
    experiment: str,
    data_kind: str,
    protocols: Mapping[str, str] | None = None,
) -> xr.DataTree:
    """Save groups of draws, by ArviZ's names, as the posterior of a run with finished chains.

    Experiment (or table) and the kind of its data become attributes of the tree. Its part about a
    test has the test's protocol.
    """
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
    """Return labelled draws of a run, or None if they are not complete or lack finished draws.

    Raises `InputError` if the bytes that are read have another hash than `manifest` notes.
    """
    noted = manifest.get("posterior_sha256")
    if not run.posterior_file.is_file() or noted is None:
        return None
    if sha256(content := run.posterior_file.read_bytes()).hexdigest() != noted:
        raise InputError(
            f"{run.posterior_file} has changed since the run, as its hash says; {REMEDY}."
        )
    tree = read_netcdf(content)
    if json.loads(tree.attrs["chains"]) != list(run.finished_chains()):
        return None
    if tree.attrs.get("extensions") != run.n_extensions():
        return None
    return tree
