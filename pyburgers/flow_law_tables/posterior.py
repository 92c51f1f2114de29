"""Chains of a fit of tables of rates -> labelled draws."""

import json
from collections.abc import Collection, Mapping, Sequence
from typing import Any

import numpy as np
import xarray as xr

from pyburgers.cmdstan.draw_files import Draws, read_draws
from pyburgers.common.array_types import IntArray
from pyburgers.flow_law_tables.description import LOG_READ
from pyburgers.flow_law_tables.laws import RateLaw
from pyburgers.flow_law_tables.program_data import GRID_STRESSES, Line, groups, lines
from pyburgers.flow_law_tables.tables import RateTable
from pyburgers.kinds.stan_data import REFERENCE_FLOW_RATE
from pyburgers.model.parameters import ENVIRONMENT
from pyburgers.model.reference_quantities import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.posterior.groups import keep_posterior
from pyburgers.posterior.labelled_draws import DRIVING_ERRORS, label_draws, own_name, sample_stats
from pyburgers.sampling.run_directory import RunDirectory

FLOW_RATE_OF_TEST = "log_flow_rate_of_test"
"""ln(flow rate s) of another test at the mean conditions, among the predictions."""

SOFTENING = "softening"
"""The softening at the mean conditions and its slopes (`stan/statistics/softening.stan`), among the
predictions."""


def build_posterior(
    run: RunDirectory, data: RateTable, law: RateLaw, manifest: Mapping[str, Any]
) -> xr.DataTree:
    """Gather the finished chains into labelled draws and save them."""
    with run.unchanged_copy(manifest, with_draws=True) as copy:
        chains = read_draws(copy.draws_files())
    identifiers = {"chain": list(run.finished_chains())}
    contents = {
        name: dataset.assign_coords(identifiers)
        for name, dataset in _drawn_groups(chains, data, law, manifest["held_out"]).items()
    }
    used = data.rows(~np.isin(data.source, manifest["held_out"]))
    point = {"point": np.arange(used.n_rows)}
    names, grouped = zip(*groups(used), strict=True)
    of_group = np.empty(used.n_rows, dtype=np.int64)
    for number, rows in enumerate(grouped):
        of_group[rows] = number
    contents["observed_data"] = xr.Dataset({LOG_READ: ("point", used.log_read)}, coords=point)
    contents["constant_data"] = xr.Dataset(
        {
            **{
                name: ("point", getattr(used, name))
                for name in ("temperature", "stress", "strain_rate", "grain_size", *ENVIRONMENT)
            },
            "stress_is_imposed": ("point", used.stress_is_imposed.astype(np.int64)),
            "source": ("point", *_numbered(used)),
            "group": ("point", of_group, {"names": json.dumps(names)}),
        },
        coords=point,
    )
    return keep_posterior(run, contents, experiment=data.id, data_kind=data.provenance.kind)


def _drawn_groups(
    chains: Draws, data: RateTable, law: RateLaw, held_out: Collection[str]
) -> dict[str, xr.Dataset]:
    """Return the groups with dimensions chain and draw."""
    dims = ("chain", "draw")
    parameters = chains["parameter"]
    draws = xr.Dataset(
        {p.name: (dims, parameters[..., k]) for k, p in enumerate(law.parameters)},
        coords=chains.dataset([]).coords,
    )
    draws[REFERENCE_FLOW_RATE] = (dims, np.exp(chains["mean_flow_log_rate"]))
    idle = [
        own_name(name, one.name)
        for one in law.mechanisms
        for name in {*one.parameters} - {*one.stated_parameters}
    ]
    draws = draws.drop_vars(idle)
    shown = [p for p in (*law.parameters, REFERENCE_FLOW_RATE_QUANTITY) if p.name in draws]
    label_draws(draws, shown, law.priors)
    is_held_out = np.isin(data.source, list(held_out))
    used, others = np.flatnonzero(~is_held_out), np.flatnonzero(is_held_out)

    def at_rows(name: str, rows: Any, dim: str = "point") -> xr.DataArray:
        return xr.DataArray(
            chains[name][..., rows],
            dims=(*dims, dim),
            coords={**draws.coords, dim: np.arange(len(rows))},
        )

    groups = {
        "posterior": draws,
        "sample_stats": sample_stats(chains),
        "log_prior": chains.dataset(["lprior"]),
        "log_likelihood": xr.Dataset({LOG_READ: at_rows("log_lik", used)}),
        "model_response": xr.Dataset({LOG_READ: at_rows("log_read_model", used)}),
        "posterior_predictive": xr.Dataset({LOG_READ: at_rows("log_read_replicated", used)}),
        "residuals": xr.Dataset(
            {name: at_rows(name, used) for name in ("residual", "residual_replicated", "deviation")}
        ),
        "predictions": _predictions(chains, lines(data.rows(used)), law),
    }
    if len(data.sources) > 1:
        groups[DRIVING_ERRORS] = xr.Dataset(
            {
                own_name(name, one): (dims, chains[name][..., k])
                for name in ("source_rate", "source_temperature", "source_scatter")
                for k, one in enumerate(data.sources)
            },
            coords=draws.coords,
        )
    if others.size:
        of_draws = {
            "model": "log_read_model",
            "replicated": "log_read_replicated",
            "log_density": "log_lik",
        }
        groups["held_out"] = xr.Dataset(
            {
                **{key: at_rows(name, others, "row") for key, name in of_draws.items()},
                "read": ("row", data.log_read[others]),
                "source": ("row", *_numbered(data.rows(others))),
            }
        )
    return groups


def _numbered(data: RateTable) -> tuple[IntArray, dict[str, str]]:
    """Return the number of the source of each row, and the names as the attribute ``names``."""
    numbers = np.array([data.sources.index(one) for one in data.source], dtype=np.int64)
    return numbers, {"names": json.dumps(data.sources)}


def _predictions(chains: Draws, drawn: Sequence[Line], law: RateLaw) -> xr.Dataset:
    """Return drawn rates (1/s), the flow rate of a test, beta (mol/J), and the law by mechanism."""
    dims = ("chain", "draw")
    names = {"log_strain_rate": "grid_log_rate", "log_test_rate": "grid_test_log_rate"}
    lines_of = {
        key: chains[name].reshape(*chains[name].shape[:2], len(drawn), GRID_STRESSES)
        for key, name in names.items()
        if name in chains
    }
    return xr.Dataset(
        {
            **{key: ((*dims, "line", "position"), rates) for key, rates in lines_of.items()},
            "stress": (("line", "position"), np.array([line.stress for line in drawn])),
            FLOW_RATE_OF_TEST: (dims, chains["mean_flow_log_rate_of_test"]),
            SOFTENING: ((*dims, "slope"), chains["softening"]),
            "law": ((*dims, "mechanism", "column"), chains["law"]),
            "beta": ((*dims, "mechanism"), chains["beta"]),
        },
        coords={"mechanism": [one.name for one in law.mechanisms]},
    )
