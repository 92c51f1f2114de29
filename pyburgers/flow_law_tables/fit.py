"""Fit a flow law to a table of peak stresses, and hand it on as a prior.

A run has the files of a fit of a curve (`pyburgers.sampling.run_directory`), with the table and
its priors in ``inputs/`` and `FLOW_LAW_PRIOR_FILE` beside the draws.
"""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any, Self

import numpy as np
import pandas as pd
import xarray as xr

from pyburgers.checks.fit_checks import CHAIN_CHECKS, Check
from pyburgers.checks.prior_influence import Influence, prior_influence
from pyburgers.cmdstan.draw_files import Draws, read_draws
from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.atomic_files import write_json
from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.fitting.continuation import sample_until_good
from pyburgers.fitting.sampled_fit import (
    SampledFit,
    data_words,
    write_tables,
)
from pyburgers.flow_law_tables.description import GRID_STRESSES, LOG_STRESS, TABLE_CHECKS, groups
from pyburgers.flow_law_tables.inputs import (
    FLOW_LAW_PARAMETERS,
    SI_UNITS,
    UNCERTAINTY,
    PeakStressData,
    load_peak_stress,
    load_peak_stress_priors,
    save_peak_stress,
)
from pyburgers.flow_law_tables.softening import N_SOFTENING, SofteningPrior, softening_prior
from pyburgers.kinds.experiment import Provenance
from pyburgers.kinds.problem import coordinates_through
from pyburgers.kinds.program_data import prior_block
from pyburgers.kinds.stan_data import REFERENCE_FLOW_RATE, PlainCoordinates, StanData
from pyburgers.model.flow_law_prior import FLOW_LAW_PRIOR_FILE, PRIOR_QUANTITIES, FlowLawPrior
from pyburgers.model.parameters import REFERENCE_FLOW_RATE_QUANTITY
from pyburgers.model.priors import PriorSet, default_priors, note_other_material, save_priors
from pyburgers.posterior.labelled_draws import (
    keep_posterior,
    label_draws,
    load_posterior,
    sample_stats,
    summary_table,
)
from pyburgers.sampling.manifest import RunManifest
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run import complete_chains, fingerprint, run_record
from pyburgers.sampling.run_directory import RunDirectory

AT_POINTS = {
    **{name: SI_UNITS[name] for name in ("temperature", "strain_rate", "grain_size")},
    UNCERTAINTY: "1",
}
"""What draws keep of the rows of a table, with its units."""

TABLE_FILE = "peak_stress.toml"
"""Name of the saved table in a run directory."""

SOFTENING_FILE = "softening.json"
"""Name of the saved prior of the softening in a run directory."""

PEAK_SOFTENING = "peak_softening"
"""ln(S_0/peak stress) at the mean conditions, among the predictions."""

FLOW_RATE_OF_TEST = "log_flow_rate_of_test"
"""ln(flow rate s) of another test at the mean conditions, among the predictions."""


def peak_stress_coordinates(data: PeakStressData, priors: PriorSet) -> PlainCoordinates:
    """Choose origin and size of every free parameter and what the flow rate replaces.

    The flow rate at the mean conditions replaces Q_M, or beta, unless both are fixed or have two
    finite bounds (`pyburgers.kinds.problem.coordinates_through`).
    """
    origin = float(np.mean(np.log(data.strain_rate)))
    return coordinates_through(priors, REFERENCE_FLOW_RATE_QUANTITY, origin, 1.0)


def peak_stress_data(
    data: PeakStressData,
    priors: PriorSet,
    softening: SofteningPrior,
    *,
    use_likelihood: bool = True,
) -> StanData:
    """Return all data of `stan/peak_stress.stan`, priors in SI; without likelihood, the prior's."""
    coordinates = peak_stress_coordinates(data, priors)
    place = {p.name: k for k, p in enumerate(FLOW_LAW_PARAMETERS, start=1)}
    mean = data.mean_conditions
    lines = groups(data)
    return {
        "n_points": data.n_points,
        "temperature": data.temperature.tolist(),
        "stress": data.stress.tolist(),
        "strain_rate": data.strain_rate.tolist(),
        "grain_size": data.grain_size.tolist(),
        "relative_stress_uncertainty": data.relative_stress_uncertainty.tolist(),
        "mean_temperature": mean.temperature,
        "mean_stress": mean.stress,
        "mean_strain_rate": data.mean_strain_rate,
        "mean_grain_size": mean.grain_size,
        "use_likelihood": int(use_likelihood),
        **prior_block(priors, FLOW_LAW_PARAMETERS),
        **softening.block,
        "n_coordinates": len(coordinates.quantities),
        "own_parameter": [place[name] for name in coordinates.parameters],
        "quantity": coordinates.quantity.tolist(),
        "replaced_parameter": place.get(coordinates.replaced_parameter or "", 0),
        "n_grid": len(lines) * GRID_STRESSES,
        "grid_temperature": np.repeat([g.temperature for g in lines], GRID_STRESSES).tolist(),
        "grid_stress": np.concatenate([g.stress for g in lines]).tolist(),
        "grid_grain_size": np.repeat([g.grain_size for g in lines], GRID_STRESSES).tolist(),
    }


WARMUP, TARGET_ACCEPTANCE = 1000, 0.99
"""Defaults where the options leave them open; a gradient costs microseconds."""


@dataclass(frozen=True, eq=False, repr=False)
class PeakStressFit(SampledFit):
    """A finished fit of a table of peak stresses.

    Attributes
    ----------
    directory, posterior, manifest
        As of every `SampledFit`. The group log_likelihood is of each ln(peak stress). The group
        predictions has strain rates by group and stress (of undeformed material and of peaks),
        softening, and the flow rate of another test.
    data : PeakStressData
        The fitted table.
    priors : PriorSet
        Priors of `pyburgers.flow_law_tables.inputs.FLOW_LAW_PARAMETERS` in SI.
    softening : SofteningPrior
        Prior of the softening at the peaks.

    Examples
    --------
    >>> draws = peaks.posterior["posterior"]["stress_exponent"]
    """

    data: PeakStressData
    priors: PriorSet
    softening: SofteningPrior

    @property
    def provenance(self) -> Provenance:
        """Origin of the table."""
        return self.data.provenance

    def influences(
        self, derived: Mapping[str, FloatArray] = MappingProxyType({})
    ) -> dict[str, dict[str, Influence]]:
        """Return who decides each quantity; empty without likelihood.

        Parameters
        ----------
        derived : mapping of str to array, shape (n,)
            Draws of further quantities, chains one after the other.

        Returns
        -------
        dict of str to dict of str to Influence
            By name of the table, then of the quantity.

        Examples
        --------
        >>> influences = peaks.influences()
        """
        if not self.manifest["use_likelihood"]:
            return {}
        read_off = self.priors.read_off([data_words(self.data.id, self.provenance)])
        found = prior_influence(self.posterior, self.priors, derived=derived, read_off=read_off)
        return {self.data.id: self._usable(found)}

    def si_summary(self) -> pd.DataFrame:
        """Posterior table in SI units (`pyburgers.posterior.labelled_draws.summary_table`).

        Examples
        --------
        >>> peaks.si_summary().loc["stress_exponent", "unit"]
        '1'
        """
        return summary_table(self.posterior, self.priors)

    def asked_checks(self) -> Sequence[Check]:
        """Return the checks that are made: there is no solver to check.

        Examples
        --------
        >>> names = [check.name for check in peaks.asked_checks()]
        """
        fitted = self.manifest["use_likelihood"]
        return (*CHAIN_CHECKS, *TABLE_CHECKS) if fitted else CHAIN_CHECKS

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a run directory.

        Parameters
        ----------
        path : path
            Run directory of `fit_peak_stress`.

        Returns
        -------
        PeakStressFit
            With the draws of the chains that have finished.

        Raises
        ------
        InputError
            If it is no run of this kind, has no finished chain, or a file was damaged or changed.

        Examples
        --------
        >>> peaks.save("peaks")
        >>> again = pyburgers.PeakStressFit.load("peaks")
        """
        run = RunDirectory(given_path(path))
        run.read_manifest()
        if not is_peak_stress_run(path):
            raise InputError(
                f"{path}: is not a fit of a table of peak stresses, expected a run of pyburgers "
                "fit-peak-stress."
            )
        run.require_a_chain()
        manifest = run.read_manifest(RunManifest)
        with run.unchanged_copy(manifest) as copy:
            data = load_peak_stress(copy.inputs / TABLE_FILE)
            priors = load_peak_stress_priors(copy.priors_file)
            softening = SofteningPrior.load(copy.inputs / SOFTENING_FILE)
        posterior = load_posterior(run, manifest)
        if posterior is None or "model_response" not in posterior.children:
            posterior = _build_posterior(run, data, priors, manifest)
        manifest = {**manifest, "chains": run.chain_records()}
        return cls(run, posterior, manifest, data, priors, softening)


def fit_peak_stress(
    data: PeakStressData,
    priors: PriorSet,
    *,
    out: str | Path,
    curve: PriorSet | None = None,
    options: SamplerOptions | None = None,
    use_likelihood: bool = True,
    command: str = "pyburgers.fit_peak_stress(...)",
) -> PeakStressFit:
    """Fit a flow law and its scatter to peak stresses, softened as a curve's priors have it.

    Parameters
    ----------
    data : PeakStressData
        The table.
    priors : PriorSet
        Priors of `pyburgers.flow_law_tables.inputs.FLOW_LAW_PARAMETERS`.
    out : path
        Run directory. An earlier run with the same inputs there is continued.
    curve : PriorSet, optional
        Priors of every parameter of a curve, for the softening at the peaks
        (`pyburgers.flow_law_tables.softening.softening_prior`); default those of the material.
    options : SamplerOptions, optional
        Chains, iterations, seed; the coordinates are always the plain ones.
    use_likelihood : bool
        False samples the prior.
    command : str
        Command that repeats the run, for the manifest.

    Raises
    ------
    InputError
        If an input is wrong or `out` holds something else.
    SamplingError
        If no chain finished.

    Examples
    --------
    >>> table = pyburgers.load_peak_stress(data / "ice" / "peak_stress_qi_goldsby_2021.toml")
    >>> priors = pyburgers.default_peak_stress_priors("ice")
    >>> result = pyburgers.fit_peak_stress(table, priors, out="runs/peaks", options=options)
    """
    run = RunDirectory(given_path(out))
    options = options or SamplerOptions()
    options = replace(
        options,
        warmup=options.warmup or WARMUP,
        adapt_delta=options.adapt_delta or TARGET_ACCEPTANCE,
        coordinates="plain",
    )
    curve = default_priors(data.material) if curve is None else curve
    for given in (priors, curve):
        note_other_material(given, data.material)
    softening = softening_prior(data, curve, seed=options.seed)
    stan_data = peak_stress_data(data, priors, softening, use_likelihood=use_likelihood)
    model = load_program(stan_directory() / "peak_stress.stan")
    identity = fingerprint(stan_data, options, model.recipe)

    def sample(more_draws: int | None) -> PeakStressFit:
        with run.claimed(identity):
            save_peak_stress(data, run.inputs)
            save_priors(priors, run.priors_file, FLOW_LAW_PARAMETERS)
            softening.save(run.inputs / SOFTENING_FILE)
            write_json(run.stan_data_file, stan_data)
            run.update_manifest(
                run_record(
                    run,
                    {"sampler": asdict(options), "use_likelihood": use_likelihood},
                    name=data.id,
                    data_kind=data.provenance.kind,
                    identity=identity,
                    command=command,
                )
            )
            complete_chains(
                model,
                run,
                options,
                lambda chain: _draw_start(data, priors, options.seed, chain),
                more_draws=more_draws,
            )
        return PeakStressFit.load(run.path)

    result = sample_until_good(sample, options)
    if not any(priors[p.name].is_fixed for p in FLOW_LAW_PARAMETERS):
        flow_law_prior(result).save(run.path / FLOW_LAW_PRIOR_FILE)
        run.note_hash(run.path / FLOW_LAW_PRIOR_FILE)
    write_tables(result)
    return replace(result, manifest=run.read_manifest())


def is_peak_stress_run(path: str | Path) -> bool:
    """Whether a run directory holds a fit of a table of peak stresses."""
    return (RunDirectory(given_path(path)).inputs / TABLE_FILE).is_file()


def flow_law_prior(fit: PeakStressFit) -> FlowLawPrior:
    """Return the posterior flow law of another test (see `FlowLawPrior`).

    Its ln(S_0) scatters like ln(peak stress) of the tests. If that scatter is one of readings, not
    of samples, the prior is too wide.

    Parameters
    ----------
    fit : PeakStressFit
        Finished fit in which the whole flow law is free.

    Returns
    -------
    FlowLawPrior
        Joint normal prior for `with_flow_law`.

    Raises
    ------
    InputError
        If a parameter of the flow law was fixed, so that there is no density to hand on.

    Examples
    --------
    >>> prior = pyburgers.flow_law_prior(peaks)
    """
    fixed = [p.name for p in FLOW_LAW_PARAMETERS if fit.priors[p.name].is_fixed]
    if fixed:
        raise InputError(
            f"{fit.directory.path}: {fixed[0]} is fixed, expected a fit in which the whole flow "
            "law is free."
        )
    draws = fit.posterior["posterior"].to_dataset()
    of_test = fit.posterior["predictions"].to_dataset()[FLOW_RATE_OF_TEST]
    columns = [
        all_draws(of_test if name == f"log_{REFERENCE_FLOW_RATE}" else draws[name])
        for name in PRIOR_QUANTITIES
    ]
    return FlowLawPrior(
        quantities=PRIOR_QUANTITIES,
        mean=np.mean(columns, axis=1),
        covariance=np.cov(columns),
        conditions=fit.data.mean_conditions,
        material=fit.data.material,
        source=f"{fit.data.id}: {fit.data.provenance.source}; its priors: {fit.priors.title}",
        tests=fit.data.tests,
    )


def _draw_start(
    data: PeakStressData, priors: PriorSet, seed: int, chain: int
) -> dict[str, list[float]]:
    """Draw a start of one chain: prior draws, and a flow rate near the measured ones."""
    rng = np.random.default_rng([seed, chain])
    coordinates = peak_stress_coordinates(data, priors)
    rate = float(np.exp(rng.normal(np.mean(np.log(data.strain_rate)), 1.0)))
    return {
        "coordinate": coordinates.at({**priors.sample(rng), REFERENCE_FLOW_RATE: rate}).tolist(),
        "softening_coordinate": rng.standard_normal(N_SOFTENING).tolist(),
    }


def _build_posterior(
    run: RunDirectory, data: PeakStressData, priors: PriorSet, manifest: Mapping[str, Any]
) -> xr.DataTree:
    """Gather the finished chains into labelled draws and save them."""
    with run.unchanged_copy(manifest, with_draws=True) as copy:
        chains = read_draws(copy.draws_files())
    identifiers = {"chain": list(run.finished_chains())}
    contents = {
        name: dataset.assign_coords(identifiers)
        for name, dataset in _drawn_groups(chains, data, priors).items()
    }
    point = {"point": np.arange(data.n_points)}
    contents["observed_data"] = xr.Dataset(
        {LOG_STRESS: ("point", np.log(data.stress))}, coords=point
    )
    of_group = np.empty(data.n_points, dtype=np.int64)
    for number, group in enumerate(groups(data)):
        of_group[group.points] = number
    contents["constant_data"] = xr.Dataset(
        {
            **{name: ("point", getattr(data, name), {"units": u}) for name, u in AT_POINTS.items()},
            "group": ("point", of_group),
        },
        coords=point,
    )
    return keep_posterior(run, contents, experiment=data.id, data_kind=data.provenance.kind)


def _drawn_groups(chains: Draws, data: PeakStressData, priors: PriorSet) -> dict[str, xr.Dataset]:
    """Return the groups with dimensions chain and draw."""
    shown = (*FLOW_LAW_PARAMETERS, REFERENCE_FLOW_RATE_QUANTITY)
    draws = chains.dataset([quantity.name for quantity in shown])
    label_draws(draws, shown, priors)
    point = {"point": np.arange(data.n_points)}
    at_points = {
        name: chains.dataset([name])[name].rename({f"{name}_dim_0": "point"}).assign_coords(point)
        for name in ("log_lik", "log_stress_model", "log_stress_replicated")
    }
    lines = groups(data)
    predictions = xr.Dataset(
        {
            **{
                name: (
                    ("chain", "draw", "group", "position"),
                    rates.reshape(*rates.shape[:2], len(lines), GRID_STRESSES),
                    {"units": "1/s"},
                )
                for name in ("strain_rate", "peak_strain_rate")
                for rates in (chains[f"grid_{name}"],)
            },
            **{
                name: (("chain", "draw"), chains[name])
                for name in (PEAK_SOFTENING, FLOW_RATE_OF_TEST)
            },
            "softening": (("chain", "draw", "slope"), chains["softening"]),
            "stress": (("group", "position"), np.array([g.stress for g in lines]), {"units": "Pa"}),
        }
    )
    return {
        "posterior": draws,
        "sample_stats": sample_stats(chains),
        "log_likelihood": xr.Dataset({LOG_STRESS: at_points["log_lik"]}),
        "log_prior": chains.dataset(["lprior"]),
        "model_response": xr.Dataset({LOG_STRESS: at_points["log_stress_model"]}),
        "posterior_predictive": xr.Dataset({LOG_STRESS: at_points["log_stress_replicated"]}),
        "predictions": predictions,
    }
