"""Fit a composite flow law to tables of steady rates, papers and laboratories as a level.

A run has the files of a fit of a curve (`pyburgers.sampling.run_directory`), with the table and
the law in ``inputs/``; with the softening of a curve, `FLOW_LAW_PRIOR_FILE` is beside the draws.
"""

from collections.abc import Collection, Sequence
from dataclasses import asdict, replace
from pathlib import Path
from types import NoneType

import numpy as np

from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.atomic_files import write_json
from pyburgers.common.errors import InputError, one_or_several, require_type
from pyburgers.common.messages import tell_notes
from pyburgers.common.paths import given_path
from pyburgers.common.units import counted
from pyburgers.fitting.problem_run import sample_until_good
from pyburgers.fitting.sampled_fit import write_tables
from pyburgers.flow_law_tables.fit import LAW_FILE, SOFTENING_FILE, RateFit, is_rate_run
from pyburgers.flow_law_tables.hand_over import flow_law_prior
from pyburgers.flow_law_tables.laws import (
    SCATTER,
    SOURCE_SPREADS,
    RateLaw,
    rate_law,
    save_rate_law,
)
from pyburgers.flow_law_tables.program_data import (
    first_metric,
    law_for,
    rate_data,
    start_of_chain,
    usable_rows,
)
from pyburgers.flow_law_tables.softening import softening_prior
from pyburgers.flow_law_tables.table_files import save_rate_table
from pyburgers.flow_law_tables.tables import LEAST_ROWS, RateTable, in_order_of_tests, joined
from pyburgers.model.flow_law_prior import FLOW_LAW_PRIOR_FILE
from pyburgers.model.prior_families import is_fixed_at
from pyburgers.model.priors import SOME_PRIORS, PriorSet, shipped_prior_files
from pyburgers.model.unlikely_numbers import unlikely_priors
from pyburgers.posterior.labelled_draws import own_name
from pyburgers.sampling.options import SOME_OPTIONS, SamplerOptions
from pyburgers.sampling.run import (
    as_recorded,
    complete_chains,
    draws_to_add,
    fingerprint,
    run_record,
    way_out,
)
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
    held_out : list of str
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
        more_draws, command = draws_to_add(run, more_draws, overwrite=overwrite)
    tables = one_or_several("tables", tables, RateTable, "a table, as of pyburgers.load_rate_table")
    require_type("held_out", held_out, (list, tuple, set, frozenset), "a list of sources")
    a_law = "a law, as of pyburgers.rate_law('ice_composite')"
    require_type("law", law, (RateLaw, NoneType), a_law)
    require_type("curve", curve, (PriorSet, NoneType), SOME_PRIORS)
    data = joined(tables, held_out, softened=curve is not None)
    kind = "power_law" if curve is None else "flow_law"
    law = _default_law(data.material, kind) if law is None else law
    for name in (SCATTER, *SOURCE_SPREADS):
        if is_fixed_at(law.priors[name], 0.0):
            raise InputError(
                f"{law.priors.title!r}: {name}: found a fixed 0, expected a positive number or a "
                "prior."
            )
    tell_notes(unlikely_priors(law.priors, data.material))
    data = in_order_of_tests(usable_rows(data, law))
    if {*held_out} - {*data.sources} or {*held_out} >= {*data.sources}:
        raise InputError(
            f"{data.id}: found {', '.join(sorted(held_out))} to be held out, expected some but not "
            f"all of {', '.join(data.sources)}, of which the law can take rows."
        )
    used = data.rows(~np.isin(data.source, list(held_out)))
    if used.n_rows < LEAST_ROWS:
        raise InputError(
            f"{data.id}: found {counted(used.n_rows, 'row')} to fit, expected at least "
            f"{LEAST_ROWS}; hold out fewer sources, or take a law that needs less of each row."
        )
    options = options or SamplerOptions()
    require_type("options", options, SamplerOptions, SOME_OPTIONS)
    softening = None
    if curve is not None:
        tell_notes(unlikely_priors(curve, data.material))
        _refuse_softening(law)
        softening = softening_prior(used, curve, seed=options.seed)
    options = replace(
        options,
        warmup=options.warmup or WARMUP,
        adapt_delta=options.adapt_delta or TARGET_ACCEPTANCE,
        coordinates="plain",
    )
    known = law_for(data, law)
    if not known.priors.free and len(data.sources) == 1:
        raise InputError(
            f"{law.priors.title!r}: found every parameter fixed, expected a prior of one, such as "
            "rate_scatter."
        )
    stan_data = rate_data(
        data, known, held_out=held_out, softening=softening, use_likelihood=use_likelihood
    )
    model = load_program(stan_directory() / "rates.stan")
    identity = fingerprint(stan_data, options, model.recipe)
    there = run.read_manifest() if run.manifest_file.is_file() else {"fingerprint": identity}
    if there.get("fingerprint") != identity and is_rate_run(run.path):
        if not overwrite:
            raise InputError(
                f"{run.path}: holds a run of other inputs; {way_out(run, more_draws)}."
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
            recorded, made_by = as_recorded(run, options, command, more)
            run.update_manifest(
                run_record(
                    run,
                    {
                        "sampler": asdict(recorded),
                        "use_likelihood": use_likelihood,
                        "held_out": sorted(held_out),
                        "first_window": FIRST_WINDOW,
                    },
                    name=data.id,
                    data_kind=data.provenance.kind,
                    identity=identity,
                    made_by=made_by,
                )
            )
            complete_chains(
                model,
                run,
                recorded,
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
