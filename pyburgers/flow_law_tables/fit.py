"""A fit of a composite flow law to tables of steady rates, and its flow law as a prior."""

import json
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property
from pathlib import Path
from types import MappingProxyType
from typing import Self

import numpy as np
import numpy.typing as npt
import pandas as pd
import xarray as xr

from pyburgers.checks.fit_checks import CHAIN_CHECKS, Check
from pyburgers.checks.prior_influence import Influence, prior_influence
from pyburgers.common.draws import TAIL, FloatArray, all_draws
from pyburgers.common.errors import InputError
from pyburgers.common.paths import given_path
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import SampledFit, data_words
from pyburgers.flow_law_tables.description import LEAST_VALUES, MAY_BE_FEW, RATE_CHECKS
from pyburgers.flow_law_tables.laws import ENHANCEMENTS, RateLaw, load_rate_law
from pyburgers.flow_law_tables.mechanism_maps import (
    NEAR_KELVIN,
    MechanismMap,
    solve_under,
    solved_draws,
    within_factor,
)
from pyburgers.flow_law_tables.posterior import build_posterior
from pyburgers.flow_law_tables.program_data import law_for
from pyburgers.flow_law_tables.softening import SofteningPrior
from pyburgers.flow_law_tables.table_files import load_rate_table
from pyburgers.flow_law_tables.tables import RateTable
from pyburgers.kinds.experiment import Provenance
from pyburgers.model.priors import FLOW_LAW
from pyburgers.model.unlikely_numbers import unlikely_priors
from pyburgers.posterior.groups import load_posterior
from pyburgers.posterior.labelled_draws import own_name, summary_table
from pyburgers.sampling.manifest import RunManifest
from pyburgers.sampling.run_directory import RunDirectory

TABLE_FILE, LAW_FILE, SOFTENING_FILE = "rates.toml", "law.toml", "softening.json"
"""Names of the inputs in a run directory."""


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
    softening : SofteningPrior or None
        Prior of the softening up to the peaks, if the law is that of undeformed material.

    Examples
    --------
    >>> draws = creep.posterior["posterior"]["stress_exponent[creep]"]
    """

    data: RateTable
    law: RateLaw
    softening: SofteningPrior | None = None

    @property
    def used(self) -> RateTable:
        """The rows that were fitted."""
        return self.data.rows(~np.isin(self.data.source, self.manifest["held_out"]))

    @property
    def provenance(self) -> Provenance:
        """Origin of the tables."""
        return self.data.provenance

    @cached_property
    def prior_doubts(self) -> tuple[str, ...]:
        """What is unlikely about the priors.

        Examples
        --------
        >>> sentences = fit.prior_doubts
        """
        return tuple(unlikely_priors(self.law.priors, self.data.material))

    def _influences_on(self, derived: Mapping[str, FloatArray]) -> dict[str, dict[str, Influence]]:
        """Influences by the name of the table, and quantity."""
        priors = self.law.priors
        read_off = priors.read_off([data_words(self.data.id, self.provenance)])
        found = prior_influence(self.posterior, priors, derived=derived, read_off=read_off)
        return {self.data.id: self._usable(found)}

    def power_law(self) -> dict[str, FloatArray]:
        """Return draws of n, p, Q_M and beta of a power law.

        Returns
        -------
        dict of str to array, shape (n,)
            By the names of a curve's parameters, SI; draws of the chains one after the other.

        Raises
        ------
        InputError
            If the law has several mechanisms or a premelting temperature.

        Examples
        --------
        >>> sorted(creep.power_law())
        ['activation_enthalpy', 'beta', 'grain_size_exponent', 'stress_exponent']
        """
        mechanism = self.law.power_law.name
        draws = self.posterior["posterior"].to_dataset()
        beta = self.posterior["predictions"].to_dataset()["beta"].sel(mechanism=mechanism)
        return {
            name: all_draws(beta if name == "beta" else draws[own_name(name, mechanism)])
            for name in FLOW_LAW
        }

    def rates_at(
        self,
        temperature: npt.ArrayLike,
        stress: npt.ArrayLike,
        grain_size: npt.ArrayLike,
        environment: Mapping[str, npt.ArrayLike] = MappingProxyType({}),
    ) -> xr.Dataset:
        """Solve the law for its draws under given conditions.

        Parameters
        ----------
        temperature, stress, grain_size : array, shape (n,), or float
            K, axial equivalent in Pa, m; broadcast against each other.
        environment : mapping of str to array, shape (n,), or float
            ``pressure`` and ``water_fugacity`` in Pa, ``melt_fraction``. The mean of the tests is
            taken of those that are not given.

        Returns
        -------
        Dataset
            ``log_strain_rate``, ln(1/s), and ``stress_exponent``, its slope by ln(stress), by draw
            and condition. They are of no source and of no specimen: neither bias nor scatter. Of
            more than 400 draws, 400 evenly spaced ones are solved. The coordinate ``draw`` counts
            them through all chains, from 0.

        Raises
        ------
        InputError
            If a value is not positive, or a name is unknown.

        Examples
        --------
        >>> rates = creep.rates_at([250.0, 260.0], 1e6, 1e-3)
        >>> rates.sizes["condition"]
        2
        """
        given = (np.asarray(one, dtype=np.float64) for one in (temperature, stress, grain_size))
        warmth, load, size = (np.atleast_1d(one) for one in np.broadcast_arrays(*given))
        at = {"temperature": warmth, "stress": load, "grain_size": size}
        found = solve_under(
            self.law, self.posterior, self.used, environment, **at, keeps_draws=True
        )
        return xr.Dataset(
            {
                "log_strain_rate": (("draw", "condition"), found["log_rate"]),
                "stress_exponent": (("draw", "condition"), found["stress_exponent"]),
            },
            {
                "draw": solved_draws(self.posterior),
                **{name: ("condition", values) for name, values in at.items()},
            },
        )

    def mechanism_map(
        self,
        *,
        temperature: FloatArray | float | None = None,
        stress: FloatArray | None = None,
        grain_size: FloatArray | float | None = None,
        environment: Mapping[str, npt.ArrayLike] = MappingProxyType({}),
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
        environment : mapping of str to float
            As for `rates_at`.

        Returns
        -------
        MechanismMap

        Raises
        ------
        InputError
            If both temperature and grain size are arrays, a value is not positive, or a name is
            unknown.

        Examples
        --------
        >>> found = creep.mechanism_map(temperature=np.array([250.0, 260.0]))
        >>> found.probability.shape[1]
        2
        """
        used = self.used
        if temperature is None:
            low, high = used.temperature.min() - 30.0, used.temperature.max()
            temperature = np.linspace(low, high, 45) if np.ndim(grain_size or 0) == 0 else high
        if stress is None:
            stress = np.geomspace(used.stress.min() / 100.0, used.stress.max(), 45)
        if grain_size is None:
            mean = used.mean_conditions.grain_size
            grain_size = self.law.reference.grain_size if np.isnan(mean) else mean
        warmth, size, load = (
            np.atleast_1d(np.asarray(one, dtype=np.float64))
            for one in (temperature, grain_size, stress)
        )
        if warmth.size > 1 and size.size > 1:
            raise InputError(
                "temperature and grain_size: found arrays of both, expected one number."
            )
        shape = (load.size, max(warmth.size, size.size))
        every_warmth, every_size, every_load = (
            np.broadcast_to(one, shape).ravel() for one in (warmth, size, load[:, np.newaxis])
        )
        found = solve_under(
            self.law,
            self.posterior,
            used,
            environment,
            temperature=every_warmth,
            stress=every_load,
            grain_size=every_size,
            keeps_draws=False,
        )
        near = (
            (np.abs(every_warmth[:, np.newaxis] - used.temperature) <= NEAR_KELVIN)
            & within_factor(every_load, used.stress)
            & (within_factor(every_size, used.grain_size) | np.isnan(used.grain_size))
        )
        return MechanismMap(
            temperature=warmth,
            grain_size=size,
            stress=load,
            mechanisms=tuple(one.name for one in self.law.mechanisms),
            probability=found["probability"].reshape(*shape, -1),
            log_rate=found["mean_log_rate"].reshape(shape),
            log_rate_sd=found["sd_log_rate"].reshape(shape),
            is_supported=near.any(axis=1).reshape(shape),
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

        Along a condition with fewer than three values a number of the law fits any of them.

        Examples
        --------
        >>> names = [check.name for check in creep.asked_checks()]
        """
        if not self.manifest["use_likelihood"]:
            return CHAIN_CHECKS
        may_vary = {name: getattr(self.used, name.replace(" ", "_")) for name in MAY_BE_FEW}
        few = {
            f"along {name}"
            for name, values in may_vary.items()
            if np.unique(values[np.isfinite(values)]).size < LEAST_VALUES
        }
        return (*CHAIN_CHECKS, *(check for check in RATE_CHECKS if check.name not in few))

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
            file = copy.inputs / SOFTENING_FILE
            softening = SofteningPrior.load(file) if file.is_file() else None
        law = law_for(data, law)
        posterior = load_posterior(run, manifest)
        if posterior is None:
            posterior = build_posterior(run, data, law, manifest)
        draws = posterior["posterior"].to_dataset()
        if any(draws[name].attrs["fixed"] for name in {*ENHANCEMENTS} & {*law.priors.free}):
            raise InputError(
                f"{path}: takes steady rates that are held out as least rates, expected a run that "
                "infers their excess; fit again with --overwrite."
            )
        manifest = {**manifest, "chains": run.chain_records()}
        return cls(run, posterior, manifest, data, law, softening)


def is_rate_run(path: str | Path) -> bool:
    """Whether a run directory holds a fit of tables of rates."""
    return (RunDirectory(given_path(path)).inputs / TABLE_FILE).is_file()


def fit_of_run(path: str | Path) -> Fit | RateFit:
    """Read a run directory of a fit of tests or of tables; raise InputError if it is neither."""
    return RateFit.load(path) if is_rate_run(path) else Fit.load(path)
