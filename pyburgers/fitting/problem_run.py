"""The run of a problem: what is asked for, its inputs, coordinates and starts, then its chains.

Chains continue with shorter steps, or because their draws are too few.
"""

import logging
import math
import re
from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import asdict, replace
from typing import Any

import numpy as np

from pyburgers.checks.fit_checks import (
    CheckKind,
    Outcome,
    check_divergences,
    check_effective_sample_size,
    check_rhat,
    check_solver,
    draws_lacking,
    run_checks,
)
from pyburgers.cmdstan.program import Density
from pyburgers.common.atomic_files import write_json
from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import read_json
from pyburgers.common.units import counted, duration_text
from pyburgers.fitting.charts_at_modes import ChosenChart, choose_chart, draw_start
from pyburgers.fitting.run_inputs import input_texts, other_files, write_inputs
from pyburgers.fitting.sampled_fit import FitT, SampledFit
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import density_of
from pyburgers.kinds.stan_data import REFERENCE_SOLVER, SolverOptions, solver_block, solver_in
from pyburgers.model.pooling import pooling_from
from pyburgers.model.priors import load_priors
from pyburgers.sampling.chains import chains_at_once
from pyburgers.sampling.manifest import FitManifest, NoisyTolerance
from pyburgers.sampling.modes import noisy_tolerances
from pyburgers.sampling.options import INDECISIVE, SamplerOptions
from pyburgers.sampling.repetitions import (
    TIGHTENING,
    shorten_steps,
    shortened,
    shortening,
    tighten_solver,
)
from pyburgers.sampling.run import as_recorded, complete_chains, fingerprint, run_record, way_out
from pyburgers.sampling.run_directory import RunDirectory

logger = logging.getLogger(__name__)

BYTES_OF_TEST, BYTES_OF_READING = 4500, 66
"""Of each draw that is kept, in all files of a run: measured with 73 and 1000 readings."""

MAX_TOLD = 6
"""Differences that are told; there are as many as parameters where all priors differ."""


def run_chains(
    problem: Problem,
    run: RunDirectory,
    *,
    options: SamplerOptions,
    solver: SolverOptions,
    use_likelihood: bool,
    command: str,
    more_draws: int | None = None,
    overwrite: bool = False,
    remedy: str | None = None,
) -> None:
    """Run the chains that a run directory lacks, and record everything in it.

    The directory is new, or of an earlier run with the same inputs; if a run of others is there,
    `overwrite` has it removed, and `remedy` stands in the error for `way_out`. Every chain is
    extended by `more_draws`. `command` regenerates the run, for its manifest. On a
    `KeyboardInterrupt` the chains are stopped; the same call continues the run.
    """
    settled = settled_options(problem, options)
    density = density_of(problem, solver, use_likelihood=use_likelihood)
    # As the chains use it: not every program has the fast one.
    solver = solver_in(density.data)
    wanted = {
        **problem_record(problem),
        "sampler": asdict(settled),
        "solver": asdict(solver),
        "use_likelihood": use_likelihood,
    }
    # As given: priors are resolved for each test by itself.
    inputs = input_texts(problem.experiments, problem.given_priors)
    identity = fingerprint(density.data, settled, density.program.recipe)
    there = run.read_manifest() if run.manifest_file.is_file() else None
    if there is not None and there.get("fingerprint") != identity:
        if "experiments" not in there and there.get("status") != "claimed":
            raise InputError(
                f"{run.path}: its manifest.json is of something else than a fit of tests, expected "
                "a new folder, or one of an earlier fit; choose another --out."
            )
        if not overwrite:
            raise InputError(refusal(run, wanted, inputs, problem.free, more_draws, remedy))
        run.clear(identity)
    with run.claimed(identity):
        write_inputs(run, inputs)
        if not run.stan_data_file.is_file():
            chart = choose_chart(problem, density, wanted=settled.coordinates, seed=settled.seed)
            _write_chart(run, density.with_data(chart.block), chart, seed=settled.seed)
            n_readings = sum(one.n_points for one in problem.experiments)
            of_draw = BYTES_OF_TEST * len(problem.experiments) + BYTES_OF_READING * n_readings
            size = math.ceil(of_draw * settled.chains * settled.draws / 1e6)
            read = counted(n_readings, "reading")
            logger.info(f"Sampling with {read}; the run takes about {size} MB.")
        settled, made_by = as_recorded(run, settled, command, more_draws)
        known, data = run.read_manifest(), run.read_stan_data()
        record = run_record(
            run,
            {**wanted, "sampler": asdict(settled)},
            name=problem.name,
            data_kind=problem.data_kind,
            identity=identity,
            made_by=made_by,
        )
        kept = {"refits": known.get("refits", []), "shortened": shortened(known)}
        run.update_manifest({**record, **kept, "solver": asdict(solver_in(data))})
        in_chart = Density(density.program, data)

        def start(chain: int) -> dict[str, list[float]]:
            laplace = None
            if run.metric_file.is_file():
                noted = read_json(run.metric_file)
                laplace = np.array(noted["centre"]), np.array(noted["covariance"])
            return draw_start(problem, in_chart, laplace, seed=settled.seed, chain=chain)

        complete_chains(density.program, run, settled, start, more_draws=more_draws)


def settled_options(problem: Problem, options: SamplerOptions) -> SamplerOptions:
    """Fill in warm-up and target acceptance, and refuse coordinates that the tests do not have."""
    likelihood, chart = problem.likelihood, problem.likelihood.chart.name
    if options.coordinates not in ("auto", "plain", chart):
        raise InputError(
            f"{problem.name}: {options.coordinates} coordinates are not for tests of the protocol "
            f"{likelihood.name}, expected --coordinates auto, plain or {chart}."
        )
    return replace(
        options,
        warmup=options.warmup or likelihood.warmup,
        adapt_delta=options.adapt_delta or likelihood.target_acceptance,
    )


def _write_chart(run: RunDirectory, density: Density, chart: ChosenChart, *, seed: int) -> None:
    """Save coordinates, metric and data, at a tolerance that is good to sample with."""
    why = "as asked for" if chart.reason == "asked for" else f"because {chart.reason}"
    logger.info(f"Coordinates: {chart.name}, {why}.")
    noisy: list[NoisyTolerance] = []
    metric = chart.first_metric
    if chart.centre is not None and chart.covariance is not None and metric is not None:
        arrays = {"inv_metric": metric, "centre": chart.centre, "covariance": chart.covariance}
        write_json(run.metric_file, {name: array.tolist() for name, array in arrays.items()})
        exact = solver_block(REFERENCE_SOLVER)
        noisy = noisy_tolerances(density, exact, chart.centre, chart.covariance, seed=seed)
    found = {
        "coordinates": {"system": chart.name, "reason": chart.reason},
        "other_modes": [one.model_dump() for one in chart.other_modes],
        "noisy": [one.model_dump() for one in noisy],
    }
    run.update_manifest(found)
    if noisy:
        tolerance = noisy[-1].tolerance / TIGHTENING
        logger.info(
            f"At a tolerance of {noisy[-1].tolerance:g} of the solver the log density jumps by "
            f"{noisy[-1].noise:.1g} from point to point: sampling at {tolerance:g}."
        )
        density = density.with_data({"tolerance": tolerance})
    # Last: it tells that all is there.
    write_json(run.stan_data_file, density.data)


def problem_record(problem: Problem) -> dict[str, Any]:
    """Note what is fitted: tests, pooling, variant of the model, another source of the flow law."""
    priors = problem.given_priors
    return {
        "experiments": [experiment.id for experiment in problem.experiments],
        "pooling": problem.pooling.record(),
        "variant": problem.variant.record(),
        "priors_from": None if priors.flow_law is None else priors.flow_law.source,
    }


def recorded_problem(run: RunDirectory, record: Mapping[str, Any]) -> Problem:
    """Return what a run fits, from its copies of tests and priors and its `problem_record`."""
    return problem_of(
        [load_experiment(run.test_file(name)) for name in record["experiments"]],
        load_priors(run.priors_file),
        pooling_from(record["pooling"]),
    )


def refusal(
    run: RunDirectory,
    wanted: Mapping[str, Any],
    inputs: Mapping[str, str],
    free: Sequence[str],
    more_draws: int | None,
    remedy: str | None = None,
) -> str:
    """Say what differs in a run from what is `wanted` and `input_texts`, and what to do.

    `free` names the parameters that are inferred, `more_draws` is what chains were to get, `remedy`
    is what to do if not `way_out`.
    """
    try:
        manifest = run.read_manifest(FitManifest)
        found = list(_differences(run, manifest, wanted, inputs, free))
    except (InputError, OSError):  # damaged, or of another kind
        found = ["it is no finished fit of tests"]
    found = found or ["Stan programs, CmdStan or the compiler are others now"]
    more = [f"and {len(found) - MAX_TOLD} more"] if len(found) > MAX_TOLD else []
    longer = ""
    if (remedy or more_draws) is None and len(found) == 1 and re.match(r"draws \d", found[0]):
        there = [manifest["sampler"]["draws"], *manifest.get("more_draws", [])]
        if (lacking := wanted["sampler"]["draws"] - sum(there)) > 0:
            longer = f", or --more-draws {lacking} to add draws to its chains"
    return (
        f"{run.path}: holds a run of other inputs: {'; '.join([*found[:MAX_TOLD], *more])}; "
        f"{remedy or way_out(run, more_draws)}{longer}."
    )


def _differences(
    run: RunDirectory,
    manifest: Mapping[str, Any],
    wanted: Mapping[str, Any],
    inputs: Mapping[str, str],
    free: Sequence[str],
) -> Iterator[str]:
    """Return what is asked for and what the run has, where they differ."""
    ours, theirs = (_decisive(record, free) for record in (wanted, manifest))
    different = [name for name in ours if ours[name] != theirs.get(name)]
    for name in different[:1] if "tests" in different else different:
        yield f"{name} {ours[name]} where the run has {theirs.get(name)}"
    if "tests" not in different:
        yield from other_files(run, inputs)


def _decisive(record: Mapping[str, Any], free: Sequence[str]) -> dict[str, Any]:
    """Return what decides the draws of a run by its name in messages, the tests first."""
    tests, sampler = record["experiments"], record["sampler"]
    # The tolerance that was asked for; what follows from the draws tightens it.
    tightened = [*record.get("noisy", []), *record.get("refits", []), record["solver"]]
    decisive = {
        "tests": "+".join(tests),
        **{name: value for name, value in sampler.items() if name not in INDECISIVE},
        "draws of": "data and prior" if record["use_likelihood"] else "the prior alone",
        "tolerance": f"{tightened[0]['tolerance']:g}",
        "solver": record["solver"]["method"],
        **record["variant"],
    }
    if len(tests) > 1:
        pooled = record["pooling"]["kinds"]
        decisive |= {f"pooling of {name}": pooled.get(name) for name in free}
    return decisive


MAX_REFITS = 2
"""Times that a run is repeated at a tighter tolerance of the solver."""

MAX_SHORTENED = 2
"""Times that a run is repeated with shorter steps."""

MAX_DIVERGENT_SHARE = 0.1
"""Share of the trajectories that may diverge for shorter steps to be tried; if more do, coordinates
or priors do not suit the posterior."""

MENDED_BY_DRAWS = frozenset({check_rhat.name, check_effective_sample_size.name})
"""Checks that more draws of the same chains can mend."""


def sample_until_good(
    sample: Callable[[int | None], FitT], options: SamplerOptions, more_draws: int | None
) -> FitT:
    """Sample until more of the same would not help, or would take too long; return the last fit.

    `sample` runs the chains that the run directory lacks, adds draws to each chain if it is given
    a number, first `more_draws`, and loads the fit.
    """
    result = sample(more_draws)
    while True:
        if put_aside_where_few_diverged(result):
            result = sample(None)
        elif more_draws := _more_draws(result, options):
            result = sample(more_draws)
        else:
            return result


def put_aside_where_few_diverged(result: SampledFit) -> bool:
    """Put chains aside in which a few trajectories diverged, so that they go on; tell whether.

    They go on with shorter steps. The manifest notes it (`shorten_steps`): the same command samples
    as many draws. Nothing is put aside if no number depends on the divergences
    (`check_divergences`), chains are missing, more than `MAX_DIVERGENT_SHARE` diverged, shorter
    steps would be more than a trajectory may have, or were taken `MAX_SHORTENED` times.
    """
    diverging = result.posterior["sample_stats"]["diverging"]
    counts = {int(chain): int(diverging.sel(chain=chain).sum()) for chain in diverging["chain"]}
    divergences = sum(counts.values())
    many = divergences > MAX_DIVERGENT_SHARE * diverging.size
    factor = shortening(divergences)
    steps = factor * float(result.posterior["sample_stats"]["n_steps"].mean())
    if (
        many
        or steps >= 2**result.checked_draws.max_treedepth
        or len(shortened(result.manifest)) == MAX_SHORTENED
        or result.missing_chains()
    ):
        return False
    found = check_divergences(result.checked_draws)
    if found.passed:
        return False
    shorten_steps(result.directory, counts)
    concerned = sum(count > 0 for count in counts.values())
    logger.info(
        f"{found.meaning}. {counted(concerned, 'chain')} of {len(counts)} continue from the last "
        f"draw with steps {factor:.2g} times shorter; the earlier draws are put aside."
    )
    return True


def _more_draws(result: SampledFit, options: SamplerOptions) -> int | None:
    """Return the draws that every chain lacks, if they are all that is lacking and time is left.

    It is decided by the draws alone how many: as many as the least effective sample size asks for,
    and at least half as many again. If they do not fit into the time, none are added.
    """
    minutes = options.minutes_of_sampling
    if not minutes:
        return None
    asked = [one for one in result.asked_checks() if one.kind is CheckKind.SAMPLING]
    failed = [one for one in run_checks(result.checked_draws, asked) if not one.passed]
    curable = all(
        one.name in MENDED_BY_DRAWS and one.outcome is Outcome.NO and not one.unusable
        for one in failed
    )
    if not failed or not curable:
        return None
    n_draws = int(result.posterior["posterior"].sizes["draw"])
    more = draws_lacking(result.posterior)
    spent = sum(one["wall_seconds"] for one in result.manifest["chains"].values())
    spent /= chains_at_once(options)
    needed = spent * more / (n_draws + result.manifest["sampler"]["warmup"])
    how_long = f"{counted(more, 'more draw')} of each chain take about {duration_text(needed)}"
    if spent + needed > 60.0 * minutes:
        enough = math.ceil((spent + needed) / 60.0)
        logger.info(
            f"{failed[0].meaning}. {how_long}, which --max-minutes {minutes:g} does not allow: run "
            f"the same command with --max-minutes {enough}."
        )
        return None
    logger.info(f"{failed[0].meaning}. {how_long}: all chains continue.")
    return more


def put_aside_where_tolerance_matters(result: SampledFit) -> bool:
    """Put all chains aside if the tolerance of the solver was too loose, and tell whether."""
    solver = check_solver(result.checked_draws)
    loose = solver.outcome is Outcome.NO and not result.missing_chains()
    if not loose or len(result.manifest["refits"]) == MAX_REFITS:
        return False
    tight = tighten_solver(result.directory, float(solver.table["pareto_k"].iloc[0]))
    logger.info(f"{solver.sentence} Sampling all chains again at a tolerance of {tight:g}.")
    return True
