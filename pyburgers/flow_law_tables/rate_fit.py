"""Fit a composite flow law to tables of steady rates, papers and laboratories as a level.

A run has the files of a fit of a curve (`pyburgers.sampling.run_directory`), with the table and
the law in ``inputs/``; a law of one mechanism leaves `FLOW_LAW_PRIOR_FILE` beside the draws.
"""

import json
from collections.abc import Collection, Mapping, Sequence
from dataclasses import asdict, dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Self

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from pyburgers.checks.fit_checks import CHAIN_CHECKS, Check
from pyburgers.checks.prior_influence import Influence, prior_influence
from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.atomic_files import write_json
from pyburgers.common.draws import TAIL, FloatArray, all_draws
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.fitting.continuation import sample_until_good
from pyburgers.fitting.sampled_fit import SampledFit, data_words, write_tables
from pyburgers.flow_law_tables.inputs import PeakStressData
from pyburgers.flow_law_tables.mechanism_maps import MechanismMap, local_power_law, mechanism_map
from pyburgers.flow_law_tables.rate_data import (
    first_metric,
    law_for,
    rate_data,
    start_of_chain,
    usable_rows,
)
from pyburgers.flow_law_tables.rate_description import RATE_CHECKS
from pyburgers.flow_law_tables.rate_laws import (
    RateLaw,
    load_rate_law,
    rate_law,
    save_rate_law,
)
from pyburgers.flow_law_tables.rate_posterior import FLOW_RATE_OF_TEST, build_posterior
from pyburgers.flow_law_tables.rate_tables import (
    RateTable,
    in_order_of_tests,
    joined,
    load_rate_table,
    save_rate_table,
)
from pyburgers.flow_law_tables.softening import SofteningPrior, softening_prior
from pyburgers.kinds.experiment import Provenance
from pyburgers.kinds.stan_data import REFERENCE_FLOW_RATE
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.flow_law_prior import FLOW_LAW_PRIOR_FILE, PRIOR_QUANTITIES, FlowLawPrior
from pyburgers.model.priors import PriorSet, note_other_material
from pyburgers.posterior.labelled_draws import (
    load_posterior,
    own_name,
    summary_table,
)
from pyburgers.sampling.manifest import RunManifest
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run import complete_chains, fingerprint, run_record
from pyburgers.sampling.run_directory import RunDirectory

TABLE_FILE, LAW_FILE, SOFTENING_FILE = "rates.toml", "law.toml", "softening.json"
"""Names of the inputs in a run directory."""

WARMUP, TARGET_ACCEPTANCE = 1000, 0.95
"""Defaults where the options leave them open."""

FIRST_WINDOW = 150
"""Draws to which the metric first adapts: fewer than twice the coordinates of sixteen sources make
a metric that is far too narrow across most of them."""


@dataclass(frozen=True, eq=False, repr=False)
class RateFit(SampledFit):
    """A finished fit of tables of steady rates.

    Attributes
    ----------
    directory, posterior, manifest
        As of every `SampledFit`. The groups log_likelihood, model_response and
        posterior_predictive are about the readings of fitted rows, in ln(1/s) or ln(Pa). The group
        held_out has the same of the other rows. The group predictions has the drawn lines, and
        driving_errors the biases of the sources.
    data : RateTable
        All rows, those of held-out sources among them.
    law : RateLaw
        The law with its priors.

    Examples
    --------
    >>> draws = creep.posterior["posterior"]["stress_exponent[creep]"]
    """

    data: RateTable
    law: RateLaw

    @property
    def used(self) -> RateTable:
        """The rows that were fitted.

        Examples
        --------
        >>> creep.used.n_rows
        14
        """
        return self.data.rows(~np.isin(self.data.source, self.manifest["held_out"]))

    @property
    def provenance(self) -> Provenance:
        """Origin of the tables."""
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
        >>> influences = creep.influences()
        """
        if not self.manifest["use_likelihood"]:
            return {}
        priors = self.law.priors
        read_off = priors.read_off([data_words(self.data.id, self.provenance)])
        found = prior_influence(self.posterior, priors, derived=derived, read_off=read_off)
        return {self.data.id: self._usable(found)}

    def rates_at(
        self,
        temperature: npt.ArrayLike,
        stress: npt.ArrayLike,
        grain_size: npt.ArrayLike,
    ) -> xr.Dataset:
        """Solve the law for its draws under given conditions.

        Parameters
        ----------
        temperature, stress, grain_size : array, shape (n,), or float
            K, axial equivalent in Pa, m; broadcast against each other.

        Returns
        -------
        Dataset
            ``log_strain_rate``, ln(1/s), and ``stress_exponent``, its slope by ln(stress), by draw
            and condition. They are of no source and of no specimen: neither bias nor scatter.

        Raises
        ------
        InputError
            If a value is not positive.

        Examples
        --------
        >>> rates = creep.rates_at([250.0, 260.0], 1e6, 1e-3)
        >>> rates.sizes["condition"]
        2
        """
        given = (np.asarray(one, dtype=np.float64) for one in (temperature, stress, grain_size))
        conditions = (np.atleast_1d(one) for one in np.broadcast_arrays(*given))
        return local_power_law(self.law, self.posterior, *conditions)

    def mechanism_map(
        self,
        *,
        temperature: FloatArray | float | None = None,
        stress: FloatArray | None = None,
        grain_size: FloatArray | float | None = None,
    ) -> MechanismMap:
        """Count in which draws of the law each mechanism leads.

        Parameters
        ----------
        temperature : float or array, shape (n,), optional
            K; default from 30 K below the coldest test to the warmest. A number if `grain_size` is
            an array.
        stress : array, shape (m,), optional
            Axial equivalent, Pa; default from a hundredth of the least stress of a test to the
            largest.
        grain_size : float or array, shape (n,), optional
            m; default the geometric mean of the tests.

        Returns
        -------
        MechanismMap

        Raises
        ------
        InputError
            If both temperature and grain size are arrays, or a value is not positive.

        Examples
        --------
        >>> found = creep.mechanism_map(temperature=np.array([250.0, 260.0]))
        >>> found.probability.shape[1]
        2
        """
        return mechanism_map(
            self.law,
            self.posterior,
            self.used,
            temperature=temperature,
            stress=stress,
            grain_size=grain_size,
        )

    def si_summary(self) -> pd.DataFrame:
        """Posterior table in SI units (`pyburgers.posterior.labelled_draws.summary_table`).

        Examples
        --------
        >>> creep.si_summary().loc["rate_scatter", "unit"]
        '1'
        """
        return summary_table(self.posterior, self.law.priors)

    def asked_checks(self) -> Sequence[Check]:
        """Return the checks that are made: there is no solver to check.

        Examples
        --------
        >>> names = [check.name for check in creep.asked_checks()]
        """
        fitted = self.manifest["use_likelihood"]
        return (*CHAIN_CHECKS, *RATE_CHECKS) if fitted else CHAIN_CHECKS

    def held_out_table(self) -> pd.DataFrame:
        """Return how well each held-out source was predicted, without a row of its own.

        Returns
        -------
        DataFrame
            Index source; columns rows, inside_90 (share of readings inside the 90 % band),
            mean_residual (in ln(rate) or ln(stress)), log_density (of all its readings together).

        Examples
        --------
        >>> creep.held_out_table().columns.tolist()
        ['rows', 'inside_90', 'mean_residual', 'log_density']
        """
        rows = {}
        held_out = self.manifest["held_out"]
        if held_out:
            group = self.posterior["held_out"].to_dataset()
            names = np.array(json.loads(group["source"].attrs["names"]))
            source = names[group["source"].to_numpy()]
            read, model, replicated, density = (
                all_draws(group[name]) if "chain" in group[name].dims else group[name].to_numpy()
                for name in ("read", "model", "replicated", "log_density")
            )
            low, high = np.quantile(replicated, (TAIL, 1 - TAIL), axis=0)
            inside = (read >= low) & (read <= high)
            for one in held_out:
                here = source == one
                together = density[:, here].sum(axis=1)
                rows[one] = {
                    "rows": int(here.sum()),
                    "inside_90": float(inside[here].mean()),
                    "mean_residual": float((read - model.mean(axis=0))[here].mean()),
                    "log_density": float(np.logaddexp.reduce(together) - np.log(together.size)),
                }
        columns = ["rows", "inside_90", "mean_residual", "log_density"]
        return pd.DataFrame.from_dict(rows, orient="index", columns=columns).rename_axis("source")

    @classmethod
    def load(cls, path: str | Path) -> Self:
        """Read a run directory.

        Parameters
        ----------
        path : path
            Run directory of `fit_rates`.

        Returns
        -------
        RateFit
            With the draws of the chains that have finished.

        Raises
        ------
        InputError
            If it is no run of this kind, has no finished chain, or a file was damaged or changed.

        Examples
        --------
        >>> creep.save("creep")
        >>> again = pyburgers.RateFit.load("creep")
        """
        run = RunDirectory(given_path(path))
        run.read_manifest()
        if not is_rate_run(path):
            raise InputError(
                f"{path}: is not a fit of tables of rates, expected a run of pyburgers fit-rates."
            )
        run.require_a_chain()
        manifest = run.read_manifest(RunManifest)
        with run.unchanged_copy(manifest) as copy:
            data = load_rate_table(copy.inputs / TABLE_FILE)
            law = load_rate_law(copy.inputs / LAW_FILE)
        law = law_for(data, law, manifest["held_out"])
        posterior = load_posterior(run, manifest)
        if posterior is None or "model_response" not in posterior.children:
            posterior = build_posterior(run, data, law, manifest)
        return cls(run, posterior, {**manifest, "chains": run.chain_records()}, data, law)


def fit_rates(
    tables: RateTable | Sequence[RateTable],
    law: RateLaw | None = None,
    *,
    out: str | Path,
    held_out: Collection[str] = (),
    curve: PriorSet | None = None,
    options: SamplerOptions | None = None,
    use_likelihood: bool = True,
    command: str = "pyburgers.fit_rates(...)",
) -> RateFit:
    """Fit a composite flow law to one table of steady rates or to several together.

    Parameters
    ----------
    tables : RateTable or sequence of RateTable
        Tables of one material.
    law : RateLaw, optional
        Mechanisms and priors; default the material's power law that comes with the package.
    out : path
        Run directory. An earlier run with the same inputs there is continued.
    held_out : collection of str
        Sources that are predicted in place of being fitted.
    curve : PriorSet, optional
        Priors of every parameter of a curve. They soften the tests
        (`pyburgers.flow_law_tables.softening`). The law is then that of undeformed material, a
        prior for curves. Only a law of one mechanism can have them.
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
    >>> result = pyburgers.fit_rates(rates, out="runs/fan_2020", options=options)
    """
    run = RunDirectory(given_path(out))
    data = joined([tables] if isinstance(tables, RateTable) else list(tables))
    law = rate_law(f"{data.material}_power_law") if law is None else law
    note_other_material(law.priors, data.material)
    unknown = [name for name in held_out if name not in data.sources]
    if unknown or len(held_out) == len(data.sources):
        raise InputError(
            f"{data.id}: found {', '.join(sorted(held_out))} to be held out, expected some but not "
            f"all of {', '.join(data.sources)}."
        )
    data = in_order_of_tests(usable_rows(data, law))
    softening = None if curve is None else _softening(data, law, curve, options)
    options = options or SamplerOptions()
    options = replace(
        options,
        warmup=options.warmup or WARMUP,
        adapt_delta=options.adapt_delta or TARGET_ACCEPTANCE,
        coordinates="plain",
    )
    known = law_for(data, law, held_out)
    stan_data = rate_data(
        data, known, held_out=held_out, softening=softening, use_likelihood=use_likelihood
    )
    model = load_program(stan_directory() / "rates.stan")
    identity = fingerprint(stan_data, options, model.recipe)

    def sample(more_draws: int | None) -> RateFit:
        with run.claimed(identity):
            save_rate_table(data, run.inputs)
            save_rate_law(law, run.inputs / LAW_FILE)
            if softening is not None:
                softening.save(run.inputs / SOFTENING_FILE)
            write_json(run.stan_data_file, stan_data)
            write_json(run.metric_file, {"inv_metric": first_metric(stan_data)})
            run.update_manifest(
                run_record(
                    run,
                    {
                        "sampler": asdict(options),
                        "use_likelihood": use_likelihood,
                        "held_out": sorted(held_out),
                        "first_window": FIRST_WINDOW,
                    },
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
                lambda chain: start_of_chain(stan_data, options.seed, chain),
                more_draws=more_draws,
            )
        return RateFit.load(run.path)

    result = sample_until_good(sample, options)
    if softening is not None:
        flow_law_of_rates(result).save(run.path / FLOW_LAW_PRIOR_FILE)
        run.note_hash(run.path / FLOW_LAW_PRIOR_FILE)
    write_tables(result)
    return replace(result, manifest=run.read_manifest())


def is_rate_run(path: str | Path) -> bool:
    """Whether a run directory holds a fit of tables of rates."""
    return (RunDirectory(given_path(path)).inputs / TABLE_FILE).is_file()


def flow_law_of_rates(fit: RateFit) -> FlowLawPrior:
    """Return the posterior flow law of another test (`FlowLawPrior`), of a law of one mechanism.

    Its ln(flow rate) scatters as specimens and sources do; beta follows from n, p and Q_M.
    """
    draws = fit.posterior["posterior"].to_dataset()
    name = fit.law.mechanisms[0].name
    n, p, enthalpy = (
        all_draws(draws[own_name(quantity, name)])
        for quantity in ("stress_exponent", "grain_size_exponent", "activation_enthalpy")
    )
    at = fit.used.mean_conditions
    log_rate = np.log(all_draws(draws[REFERENCE_FLOW_RATE]))
    log_factor = log_rate - n * np.log(at.stress) + p * np.log(at.grain_size)
    beta = log_factor / enthalpy + 1 / (GAS_CONSTANT * at.temperature)
    of_test = all_draws(fit.posterior["predictions"].to_dataset()[FLOW_RATE_OF_TEST])
    columns = [n, p, of_test, beta]
    return FlowLawPrior(
        quantities=PRIOR_QUANTITIES,
        mean=np.mean(columns, axis=1),
        covariance=np.cov(columns),
        conditions=at,
        material=fit.data.material,
        source=f"{fit.data.id}: {fit.provenance.source}; its law: {fit.law.priors.title}",
        tests=fit.used.tests,
    )


def _softening(
    data: RateTable, law: RateLaw, curve: PriorSet, options: SamplerOptions | None
) -> SofteningPrior:
    """Simulate the softening at the tests of a table, for a law of one mechanism."""
    first = law.mechanisms[0]
    exponent = law.priors[own_name("grain_size_exponent", first.name)]
    if len(law.mechanisms) > 1 or first.premelting_temperature > 0 or exponent.is_fixed:
        raise InputError(
            f"{law.priors.title!r} is no power law with a free grain size exponent, expected one "
            "for a flow law that a curve can take as its prior."
        )
    peaks = PeakStressData(
        data.id,
        data.material,
        *(data.temperature, data.stress, data.strain_rate, data.grain_size),
        relative_stress_uncertainty=np.zeros(data.n_rows),
        provenance=data.provenance,
    )
    return softening_prior(peaks, curve, seed=(options or SamplerOptions()).seed)
