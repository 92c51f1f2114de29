"""Fit a composite flow law to tables of steady rates, and hand it over as priors of other fits.

A run has the files of a fit of a curve (`pyburgers.sampling.run_directory`), with the table and
the law in ``inputs/``; with the softening of a curve, `FLOW_LAW_PRIOR_FILE` is beside the draws.
"""

from collections.abc import Collection, Sequence
from dataclasses import asdict, replace
from pathlib import Path

import numpy as np

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.atomic_files import write_json
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError, nearest, require_type
from pyburgers.common.paths import given_path
from pyburgers.fitting.problem_run import sample_until_good
from pyburgers.fitting.sampled_fit import write_tables
from pyburgers.flow_law_tables.fit import LAW_FILE, SOFTENING_FILE, RateFit, is_rate_run
from pyburgers.flow_law_tables.laws import (
    MECHANISM_PARAMETERS,
    Mechanism,
    RateLaw,
    rate_law,
    save_rate_law,
)
from pyburgers.flow_law_tables.posterior import FLOW_RATE_OF_TEST
from pyburgers.flow_law_tables.program_data import (
    first_metric,
    law_for,
    rate_data,
    start_of_chain,
    usable_rows,
)
from pyburgers.flow_law_tables.softening import softening_prior
from pyburgers.flow_law_tables.table_files import save_rate_table
from pyburgers.flow_law_tables.tables import RateTable, in_order_of_tests, joined
from pyburgers.kinds.stan_data import REFERENCE_FLOW_RATE
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.flow_law_prior import FLOW_LAW_PRIOR_FILE, PRIOR_QUANTITIES, FlowLawPrior
from pyburgers.model.parameters import FURTHER_MECHANISMS, MECHANISM_REFERENCES, PARAMETER_BY_NAME
from pyburgers.model.prior_families import LOWER_LIMITS, PriorTable
from pyburgers.model.priors import PriorSet, note_other_material, shipped_prior_files
from pyburgers.model.stated_priors import fixed, lognormal, normal
from pyburgers.posterior.labelled_draws import own_name
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run import complete_chains, fingerprint, require_extendable, run_record
from pyburgers.sampling.run_directory import RunDirectory

WARMUP, TARGET_ACCEPTANCE = 1000, 0.95
"""Defaults where the options leave them open."""

FIRST_WINDOW = 150
"""Draws to which the metric first adapts: fewer than twice the coordinates of sixteen sources make
a metric that is far too narrow across most of them."""


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
    more_draws: int | None = None,
    overwrite: bool = False,
) -> RateFit:
    """Fit a composite flow law to one table of steady rates or to several together.

    Parameters
    ----------
    tables : RateTable or sequence of RateTable
        Tables of one material.
    law : RateLaw, optional
        Mechanisms and priors; default those that come with the package: the material's power law,
        or with `curve` its flow law with beta.
    out : path
        Run directory. An earlier run with the same inputs there is continued.
    held_out : collection of str
        Sources that are predicted in place of being fitted.
    curve : PriorSet, optional
        Priors of every parameter of a curve. They soften the tests
        (`pyburgers.flow_law_tables.softening`). The law is then that of undeformed material, a
        prior for curves. The law has one mechanism, and beta as a parameter.
    options : SamplerOptions, optional
        Chains, iterations, seed; the coordinates are always the plain ones.
    use_likelihood : bool
        False samples the prior.
    command : str
        Command that repeats the run, for the manifest.
    more_draws, overwrite
        As for `pyburgers.fit`.

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
    if more_draws is not None:
        require_extendable(run, more_draws, overwrite=overwrite)
    tables = [tables] if isinstance(tables, RateTable) else list(tables)
    if not tables:
        raise InputError("tables: found none, expected a table or several.")
    for table in tables:
        require_type("tables", table, RateTable, "a table, as of pyburgers.load_rate_table")
    data = joined(tables, held_out, softened=curve is not None)
    kind = "power_law" if curve is None else "flow_law"
    law = _default_law(data.material, kind) if law is None else law
    note_other_material(law.priors, data.material)
    unknown = [name for name in held_out if name not in data.sources]
    if unknown or len(held_out) == len(data.sources):
        raise InputError(
            f"{data.id}: found {', '.join(sorted(held_out))} to be held out, expected some but not "
            f"all of {', '.join(data.sources)}."
        )
    data = in_order_of_tests(usable_rows(data, law))
    options = options or SamplerOptions()
    require_type("options", options, SamplerOptions, "options, as of pyburgers.SamplerOptions")
    softening = None
    if curve is not None:
        note_other_material(curve, data.material)
        _refuse_softening(law)
        used = data.rows(~np.isin(data.source, list(held_out)))
        softening = softening_prior(used, curve, seed=options.seed)
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
    there = run.read_manifest() if run.manifest_file.is_file() else {"fingerprint": identity}
    if there.get("fingerprint") != identity and is_rate_run(run.path):
        if not overwrite:
            raise InputError(
                f"{run.path}: holds a run of other inputs; choose another --out, or --overwrite to "
                "replace it."
            )
        run.clear(identity)

    def sample(more: int | None) -> RateFit:
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
                more_draws=more,
            )
        return RateFit.load(run.path)

    result = sample_until_good(sample, options, more_draws)
    if softening is not None and not law.fixed_flow_law:
        flow_law_prior(result).save(run.path / FLOW_LAW_PRIOR_FILE)
        run.note_hash(run.path / FLOW_LAW_PRIOR_FILE)
    write_tables(result)
    read = replace(result.data, notices=data.notices)
    return replace(result, manifest=run.read_manifest(), data=read)


def _default_law(material: str, kind: str) -> RateLaw:
    """Return the law of a kind that comes with the package; raise InputError if there is none."""
    shipped = shipped_prior_files("rates")
    if f"{material}_{kind}" not in shipped:
        of_material = [one for one in shipped if one.startswith(f"{material}_")]
        laws = of_material if kind == "power_law" else []
        raise InputError(
            f"there is no default {kind.replace('_', ' ')} of {material}, expected --law with "
            f"{' or '.join([*laws, 'a file of your own'])}."
        )
    return rate_law(f"{material}_{kind}")


def _refuse_softening(law: RateLaw) -> None:
    """Refuse a law that is not the flow law of a curve: beta and p are part of it."""
    one = law.power_law
    exponent = law.priors[own_name("grain_size_exponent", one.name)]
    if not one.has_beta or (exponent.is_fixed and exponent.location == 0):
        raise InputError(
            f"{law.priors.title!r} is not the flow law of a curve, expected a law with beta and a "
            "grain size exponent, such as ice_flow_law."
        )


def flow_law_prior(fit: RateFit) -> FlowLawPrior:
    """Return the posterior flow law of another test (see `FlowLawPrior`).

    Its ln(flow rate) scatters as specimens and sources do. If that scatter is one of readings, not
    of samples, the prior is too wide.

    Parameters
    ----------
    fit : RateFit
        Finished fit with the softening of a curve, in which the whole flow law is free.

    Returns
    -------
    FlowLawPrior
        Joint normal prior for `with_flow_law`.

    Raises
    ------
    InputError
        If the law is not that of undeformed material, or a part of it was fixed.

    Examples
    --------
    >>> prior = pyburgers.flow_law_prior(peaks)
    """
    if fit.softening is None:
        raise InputError(
            f"{fit.directory.path}: its tests are not softened, expected a fit with the priors of "
            "a curve (--curve-priors), whose law is that of undeformed material."
        )
    if fixed := fit.law.fixed_flow_law:
        raise InputError(
            f"{fit.directory.path}: {fixed[0]} is fixed, expected a fit in which the whole flow "
            "law is free."
        )
    of_test = all_draws(fit.posterior["predictions"].to_dataset()[FLOW_RATE_OF_TEST])
    draws = {**fit.power_law(), f"log_{REFERENCE_FLOW_RATE}": of_test}
    columns = [draws[name] for name in PRIOR_QUANTITIES]
    return FlowLawPrior(
        quantities=PRIOR_QUANTITIES,
        mean=np.mean(columns, axis=1),
        covariance=np.cov(columns),
        conditions=fit.used.mean_conditions,
        material=fit.data.material,
        source=f"{fit.data.id}: {fit.provenance.source}; its law: {fit.law.priors.title}",
        tests=fit.used.tests,
    )


def mechanism_priors(
    fit: RateFit, second: str, third: str = "", *, temperature: float | None = None
) -> dict[str, PriorTable]:
    """Return mechanisms of a fitted law as priors of further mechanisms of a dashpot.

    Their numbers are independent of each other in these priors, and of the first mechanism: their
    correlations are dropped. ln(rate) scatters as specimens and sources do. A test that the table
    contains should be left out of it (`without_test`).

    Parameters
    ----------
    fit : RateFit
        Finished fit.
    second : str
        Name of the mechanism that becomes the second one of the dashpot. If it shares its process
        with another one than the third, it is in series with the first.
    third : str, optional
        Name of one that becomes the third. If it shares the process of the second, it is in series
        with it.
    temperature : float, optional
        K, of the tests. If the activation enthalpy of a mechanism changes at a temperature, its
        law on this side of it is taken.

    Returns
    -------
    dict of str to PriorTable
        For `PriorSet.with_`.

    Raises
    ------
    InputError
        If there is no such mechanism, or its activation enthalpy changes and no temperature is
        given. If the third is in series with another one than the second.

    Examples
    --------
    >>> second = pyburgers.mechanism_priors(creep, "creep")
    >>> ice = pyburgers.priors("ice").with_(**second)
    """
    found = {one.name: one for one in fit.law.mechanisms}
    names = [name for name in (second, third) if name]
    for name in names:
        if name not in found:
            raise InputError(
                f"{fit.directory.path}: has no mechanism {name!r}, {nearest(name, found)}"
            )
        if found[name].premelting_temperature and temperature is None:
            raise InputError(
                f"{fit.directory.path}: the activation enthalpy of {name} changes at "
                f"{found[name].premelting_temperature:g} K, expected the temperature of the tests."
            )
    processes = [found[name].process for name in names]
    others = {one.process for one in fit.law.mechanisms if one.name not in names}
    if third and processes[1] in others:
        raise InputError(
            f"{fit.directory.path}: {third} is in series with a mechanism other than {second}, "
            "expected them the other way round, or one mechanism."
        )
    in_series = (processes[0] in others, len(set(processes)) < len(processes))
    tables: dict[str, PriorTable] = {}
    for which, name, flag in zip(FURTHER_MECHANISMS, names, in_series, strict=False):
        tables |= _priors_of(fit, found[name], which, temperature or 0.0, in_series=flag)
    return tables


def _priors_of(
    fit: RateFit, mechanism: Mechanism, which: str, temperature: float, *, in_series: bool
) -> dict[str, PriorTable]:
    """Return a mechanism, at a temperature (K), as priors of the second or the third one."""
    predictions = fit.posterior["predictions"].to_dataset()
    law = predictions["law"].sel(mechanism=mechanism.name)
    log_rate, exponent, grain_size_exponent, enthalpy, premelting, *environment = (
        all_draws(law.isel(column=MECHANISM_PARAMETERS.index(name)))
        for name in (*MECHANISM_PARAMETERS[:5], *mechanism.environment)
    )
    at, change = fit.law.reference, mechanism.premelting_temperature
    if 0.0 < change < temperature:
        # The same rate at the change (`stan/physics/composite_law.stan`).
        slower = 1 / change - 1 / at.temperature
        log_rate = log_rate + (premelting - enthalpy) / GAS_CONSTANT * slower
        enthalpy = premelting
    mean_rate = all_draws(fit.posterior["posterior"].to_dataset()[REFERENCE_FLOW_RATE])
    log_rate = log_rate + all_draws(predictions[FLOW_RATE_OF_TEST]) - np.log(mean_rate)
    rate, *numbers, flag = FURTHER_MECHANISMS[which]
    bounds = (LOWER_LIMITS[numbers[0]][0], 0.0, 0.0, *[None] * len(environment))
    numbers += [f"{which}_{name}" for name in mechanism.environment]
    draws = (exponent, grain_size_exponent, enthalpy, *environment)
    constants = (float(in_series), at.stress, at.grain_size, at.temperature)
    source = f"{fit.data.id}: {fit.provenance.source}; {mechanism.name} of {fit.law.priors.title}"

    def unit(name: str) -> str:
        return PARAMETER_BY_NAME[name].si_unit

    median = float(np.exp(log_rate.mean()))
    tables = {rate: lognormal(median, float(log_rate.std()), unit(rate), source=source)}
    for name, lower, own in zip(numbers, bounds, draws, strict=True):
        tables[name] = (
            normal(float(own.mean()), float(own.std()), unit(name), lower=lower, source=source)
            if np.ptp(own) > 0
            else fixed(float(own[0]), unit(name), source=source)
        )
    for name, value in zip((flag, *MECHANISM_REFERENCES), constants, strict=True):
        tables[name] = fixed(value, unit(name), source=source)
    return tables
