"""Fit a flow law to a table of peak stresses, and hand it on as a prior.

A run has the files of a fit of a curve (`pyburgers.sampling.run_directory`), with the table and
its priors in ``inputs/`` and `FLOW_LAW_PRIOR_FILE` beside the draws.
"""

from dataclasses import dataclass, replace
from pathlib import Path
from typing import Self

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from pyburgers.checks.fit_checks import CHAIN_CHECKS, CheckResult, run_checks
from pyburgers.cmdstan.draws import Draws, read_draws
from pyburgers.cmdstan.program import load_program, stan_directory
from pyburgers.common.atomic_files import write_json
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError
from pyburgers.fitting.sampled_fit import SampledFit, write_tables
from pyburgers.flow_law_tables.inputs import (
    FLOW_LAW_PARAMETERS,
    PeakStressData,
    load_peak_stress,
    load_peak_stress_priors,
    save_peak_stress,
    save_peak_stress_priors,
)
from pyburgers.flow_law_tables.stan_data import (
    GRID_STRESSES,
    groups,
    peak_stress_coordinates,
    peak_stress_data,
)
from pyburgers.model.flow_law_prior import FLOW_LAW_PRIOR_FILE, PRIOR_QUANTITIES, FlowLawPrior
from pyburgers.model.parameters import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.model.priors import PriorSet
from pyburgers.posterior.labelled_draws import (
    keep_posterior,
    label_draws,
    load_posterior,
    sample_stats,
    summary_table,
)
from pyburgers.protocols.stan_data import REFERENCE_FLOW_RATE
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run import complete_chains, fingerprint, run_record
from pyburgers.sampling.run_directory import RunDirectory

FloatArray = npt.NDArray[np.float64]

WARMUP, TARGET_ACCEPTANCE = 500, 0.9
"""Defaults where the options leave them open; a gradient costs microseconds."""


@dataclass(frozen=True, eq=False)
class PeakStressFit(SampledFit):
    """A finished fit of a table of peak stresses.

    Attributes
    ----------
    directory, posterior, manifest
        As of every `SampledFit`; groups of the draws: posterior, sample_stats, log_likelihood (of
        each ln(strain rate)), log_prior, posterior_predictive, predictions (strain rates by group
        and stress), observed_data, constant_data.
    data : PeakStressData
        What was fitted.
    priors : PriorSet
        Priors of `pyburgers.flow_law_tables.inputs.FLOW_LAW_PARAMETERS` in SI.
    """

    data: PeakStressData
    priors: PriorSet

    def summary(self) -> pd.DataFrame:
        """Posterior table in SI units (`pyburgers.posterior.labelled_draws.summary_table`)."""
        return summary_table(self.posterior, self.priors)

    def checks(self) -> tuple[CheckResult, ...]:
        """Return the checks with their verdicts; there is no solver and no band to check."""
        return run_checks(self.checked_draws, CHAIN_CHECKS)

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a run directory.

        Raises
        ------
        InputError
            If it is not a run of this kind or has no finished chain.
        """
        run = RunDirectory(Path(path))
        manifest = run.read_manifest()
        if not (run.inputs / "peak_stress.toml").is_file():
            raise InputError(
                f"{path}: is not a fit of a table of peak stresses, expected a run of pyburgers "
                "fit-peak-stress."
            )
        run.require_a_chain()
        data = load_peak_stress(run.inputs / "peak_stress.toml")
        priors = load_peak_stress_priors(run.priors_file)
        posterior = load_posterior(run)
        if posterior is None:
            posterior = _build_posterior(run, data, priors)
        return cls(run, posterior, {**manifest, "chains": run.chain_records()}, data, priors)


def fit_peak_stress(
    data: PeakStressData,
    priors: PriorSet,
    *,
    out: str | Path,
    options: SamplerOptions | None = None,
    use_likelihood: bool = True,
    command: str = "pyburgers.fit_peak_stress(...)",
) -> PeakStressFit:
    """Fit ln(rate) = n ln(stress) - p ln(grain size) + Q_M (beta - 1/(R T)) with scatter.

    Parameters
    ----------
    data : PeakStressData
        The table.
    priors : PriorSet
        Priors of `pyburgers.flow_law_tables.inputs.FLOW_LAW_PARAMETERS`.
    out : path
        Run directory. An earlier run with the same inputs there is continued.
    options : SamplerOptions, optional
        Chains, iterations, seed; the coordinates are always the plain ones.
    use_likelihood : bool
        False samples the prior.
    command : str
        What regenerates the run, for the manifest.

    Raises
    ------
    InputError
        If an input is wrong or `out` holds something else.
    SamplingError
        If no chain finished.
    """
    run = RunDirectory(Path(out))
    options = options or SamplerOptions()
    options = replace(
        options,
        warmup=options.warmup or WARMUP,
        adapt_delta=options.adapt_delta or TARGET_ACCEPTANCE,
        coordinates="plain",
    )
    stan_data = peak_stress_data(data, priors, use_likelihood=use_likelihood)
    model = load_program(stan_directory() / "peak_stress.stan")
    identity = fingerprint(stan_data, options, model.key)
    with run.claimed(identity):
        save_peak_stress(data, run.inputs)
        save_peak_stress_priors(priors, run.priors_file)
        write_json(run.stan_data_file, stan_data)
        run.update_manifest(
            run_record(
                run,
                name=data.id,
                data_kind=data.provenance.kind,
                options=options,
                identity=identity,
                use_likelihood=use_likelihood,
                command=command,
            )
        )
        complete_chains(
            model, run, options, lambda chain: _draw_start(data, priors, options.seed, chain)
        )
    result = PeakStressFit.load(run.path)
    if not any(priors[p.name].is_fixed for p in FLOW_LAW_PARAMETERS):
        flow_law_prior(result).save(run.path / FLOW_LAW_PRIOR_FILE)
    write_tables(result)
    return replace(result, manifest=run.read_manifest())


def flow_law_prior(fit: PeakStressFit) -> FlowLawPrior:
    """Return mean and covariance of the flow law's posterior (see `FlowLawPrior`).

    Raises
    ------
    InputError
        If a parameter of the flow law was fixed, so that there is no density to hand on.
    """
    fixed = [p.name for p in FLOW_LAW_PARAMETERS if fit.priors[p.name].is_fixed]
    if fixed:
        raise InputError(
            f"{fit.directory.path}: {fixed[0]} is fixed, expected a fit in which the whole flow "
            "law is free."
        )
    draws = fit.posterior["posterior"].to_dataset()
    columns = [
        np.log(all_draws(draws[REFERENCE_FLOW_RATE]))
        if name == f"log_{REFERENCE_FLOW_RATE}"
        else all_draws(draws[name])
        for name in PRIOR_QUANTITIES
    ]
    return FlowLawPrior(
        quantities=PRIOR_QUANTITIES,
        mean=np.mean(columns, axis=1),
        covariance=np.cov(columns),
        conditions=fit.data.mean_conditions,
        material=fit.data.material,
        source=f"{fit.data.id}: {fit.data.provenance.source}; its priors: {fit.priors.title}",
    )


def _draw_start(
    data: PeakStressData, priors: PriorSet, seed: int, chain: int
) -> dict[str, list[float]]:
    """Draw a start of one chain: prior draws, and a flow rate near the measured ones."""
    rng = np.random.default_rng([seed, chain])
    coordinates = peak_stress_coordinates(data, priors)
    rate = float(np.exp(rng.normal(np.mean(np.log(data.strain_rate)), 1.0)))
    return {
        "coordinate": coordinates.at({**priors.sample(rng), REFERENCE_FLOW_RATE: rate}).tolist()
    }


def _build_posterior(run: RunDirectory, data: PeakStressData, priors: PriorSet) -> xr.DataTree:
    """Gather the finished chains into labelled draws and save them."""
    chains = read_draws(run.draws_files())
    identifiers = {"chain": list(run.finished_chains())}
    contents = {
        name: dataset.assign_coords(identifiers)
        for name, dataset in _drawn_groups(chains, data, priors).items()
    }
    point = {"point": np.arange(data.n_points)}
    contents["observed_data"] = xr.Dataset(
        {"log_strain_rate": ("point", np.log(data.strain_rate))}, coords=point
    )
    contents["constant_data"] = xr.Dataset(
        {
            name: ("point", getattr(data, name), {"units": unit})
            for name, unit in (("temperature", "K"), ("stress", "Pa"), ("grain_size", "m"))
        },
        coords=point,
    )
    return keep_posterior(run, contents, experiment=data.id, data_kind=data.provenance.kind)


def _drawn_groups(chains: Draws, data: PeakStressData, priors: PriorSet) -> dict[str, xr.Dataset]:
    """Return the groups with dimensions chain and draw."""
    draws = chains.dataset([p.name for p in FLOW_LAW_PARAMETERS] + [REFERENCE_FLOW_RATE])
    label_draws(draws, (*FLOW_LAW_PARAMETERS, REFERENCE_FLOW_RATE_QUANTITY), priors)
    point = {"point": np.arange(data.n_points)}
    at_points = {
        name: chains.dataset([name])[name].rename({f"{name}_dim_0": "point"}).assign_coords(point)
        for name in ("log_lik", "log_rate_replicated")
    }
    rates = chains.dataset(["grid_strain_rate"])["grid_strain_rate"]
    lines = groups(data)
    shape = (*rates.shape[:2], len(lines), GRID_STRESSES)
    predictions = xr.Dataset(
        {
            "strain_rate": (
                ("chain", "draw", "group", "position"),
                rates.to_numpy().reshape(shape),
                {"units": "1/s"},
            ),
            "stress": (("group", "position"), np.array([g.stress for g in lines]), {"units": "Pa"}),
        }
    )
    return {
        "posterior": draws,
        "sample_stats": sample_stats(chains),
        "log_likelihood": xr.Dataset({"log_strain_rate": at_points["log_lik"]}),
        "log_prior": chains.dataset(["lprior"]),
        "posterior_predictive": xr.Dataset({"log_strain_rate": at_points["log_rate_replicated"]}),
        "predictions": predictions,
    }
