"""One data set of a simulation-based calibration: a prior draw, data from it, a fit, ranks.

If program, coordinates and sampler are right, the rank of a true value among the draws of its
posterior is uniform (Talts et al. 2018, arXiv:1804.06788). `pyburgers.sbc.run` does this
many times, `pyburgers.sbc.rank_uniformity` judges the ranks.
"""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Any, TypeAlias

import numpy as np

from pyburgers.checks import verdicts
from pyburgers.checks.fit_checks import (
    CheckKind,
    check_divergences,
    check_effective_sample_size,
    check_rhat,
    run_checks,
)
from pyburgers.cmdstan.program import load_program
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError, SamplingError, SystemFailureError
from pyburgers.fitting.charts_at_modes import draw_priors
from pyburgers.fitting.fit import Fit, fit_problem
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forward import simulate, simulate_data
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import Problem, one_test
from pyburgers.kinds.program_data import given_parameters, program_data
from pyburgers.kinds.stan_data import CENTRE, SPREAD, SolverOptions
from pyburgers.model.parameters import CONDITIONS
from pyburgers.model.priors import PriorSet, default_priors, load_priors, shipped_prior_files
from pyburgers.posterior.labelled_draws import (
    convergence_table,
    free_parameters,
    largest_rhat,
    own_name,
    response_in,
)
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.repetitions import shortened
from pyburgers.sbc.replication import Replication

Range: TypeAlias = tuple[float, float]

LONGER = 4
"""Factor on the iterations of a fit that is repeated, and on how closely it keeps its target."""

RHAT_LIMIT = 1.05
"""Largest R-hat of a fit of a calibration: 1.01 is passed by chance in its short chains."""

CHECKS = tuple(
    one
    for one in verdicts.CHECKS
    if one.kind is CheckKind.SAMPLING and one not in (check_rhat, check_effective_sample_size)
)
"""Checks of a fit that short chains can pass."""

LOG_LIKELIHOOD = "log_likelihood"
"""Ranked beside the parameters: it sees errors that no single parameter shows (Modrák et al.
2023, Bayesian Analysis 20, 461-488)."""

PRIOR_ATTEMPTS = 1000
"""Draws from the prior, one after the other, of which none is of use, at which it gives up."""


SHORT_RUN = SamplerOptions(chains=2, warmup=300, draws=400, parallel_chains=1)
"""Default of each fit: long enough for as many nearly independent draws as are ranked."""


@dataclass(frozen=True)
class DataSetPlan:
    """How a data set is made, fitted and ranked."""

    n_ranked: int = 99
    """Draws of the fit among which the truth is ranked: evenly spaced, nearly independent."""
    refits: int = 1
    """How often a fit that has not converged is repeated, each time `LONGER` times as long."""
    sampler: SamplerOptions = SHORT_RUN
    """Of the first fit; its seed is that of the data set."""
    stress_range: Range | None = None
    strain_range: Range | None = None
    """Least and largest stress (Pa), and strain where strains are read: data sets whose largest
    |stress| or |strain| lies outside are replaced. That looks at the data alone, so that the ranks
    of the others stay uniform."""


@dataclass(frozen=True, eq=False)
class Simulated:
    """Data simulated at a draw from the prior: the true parameters of the problem's tests."""

    problem: Problem
    pooled: Mapping[str, float]
    """True centres (SI) and spreads of partially pooled parameters: NAME[centre], NAME[spread]."""
    n_unsolvable: int
    """Draws before it whose curve the solver could not compute."""
    n_outside: int
    """Data sets before it whose stresses or strains lay outside their range."""


def calibration_priors(material: str, protocol: str | None = None) -> PriorSet:
    """Return a material's priors: its protocol's, those in calibration/, or its own."""
    if protocol is not None and material in shipped_prior_files(protocol):
        return default_priors(material, protocol)
    files = shipped_prior_files("calibration")
    return load_priors(files[material]) if material in files else default_priors(material)


def check_template(problem: Problem, strain_range: Range | None = None) -> None:
    """Refuse priors that differ between tests, none free, or a strain range without strains."""
    first, tests = problem.priors[0], problem.experiments
    if strain_range is not None and all(one.largest_strain_read is None for one in tests):
        raise InputError(f"strain_range: found no test in {problem.name} in which strain is read.")
    if not first.free:
        raise InputError(f"{first.title}: all parameters are fixed, expected a free one to rank.")
    for test, own in enumerate(problem.priors):
        free = [n for n in first.free if n not in CONDITIONS and problem.has_effect(n, test)]
        differing = [name for name in free if own[name] != first[name]]
        if differing:
            raise InputError(
                f"{first.title}: the prior of {differing[0]} is a share of the largest stress of "
                "each test, expected one in a unit, because simulated stresses differ."
            )


def simulate_from_prior(
    template: Problem,
    *,
    seed: int,
    stress_range: Range | None = None,
    strain_range: Range | None = None,
) -> Simulated:
    """Simulate the tests at the first draw from the prior with a solution within the ranges."""
    rng = np.random.default_rng(seed)
    n_unsolvable = n_outside = 0
    for _ in range(PRIOR_ATTEMPTS):
        drawn, pooled = _draw(template, rng)
        source = f"a draw from the prior, seed {seed}"
        simulated = []
        try:
            for experiment, values in zip(template.experiments, drawn, strict=True):
                simulate(experiment, values, solver=SolverOptions())
                simulated.append(simulate_data(experiment, values, rng, source=source))
        except SamplingError:
            n_unsolvable += 1
            continue
        within = (
            _lies_in(stress_range, one.largest_stress)
            and _lies_in(strain_range, one.largest_strain_read)
            for one in simulated
        )
        if not all(within):
            n_outside += 1
            continue
        named = tuple(replace(one, id=f"{one.id}_simulated_{seed}") for one in simulated)
        problem = replace(template, experiments=named, given_priors=template.priors[0])
        return Simulated(problem, pooled, n_unsolvable, n_outside)
    raise SamplingError(
        f"{template.name}: none of {PRIOR_ATTEMPTS} draws from the prior has a finite solution "
        f"within the ranges of the data ({n_unsolvable} without solution, {n_outside} outside); "
        "check the units and the bounds of the priors."
    )


def _lies_in(limits: Range | None, largest: float | None) -> bool:
    """Tell whether the largest reading of a kind lies in the range for it; None always does."""
    if limits is None or largest is None:
        return True
    low, high = limits
    return low <= largest <= high


def _draw(
    template: Problem, rng: np.random.Generator
) -> tuple[list[dict[str, float]], dict[str, float]]:
    """Draw the parameters of every test from the prior, and centres and spreads (`Simulated`)."""
    drawn = draw_priors(template, rng)
    pooled: dict[str, float] = {}
    for name in template.partial:
        # The first test's draw is that of the centre: both have the same prior.
        centre = drawn[0][name]
        spread = template.pooling.spread_scales[name] * abs(float(rng.standard_normal()))
        pooled |= {own_name(name, CENTRE): centre, own_name(name, SPREAD): spread}
        for own, coordinates in zip(drawn, template.coordinates, strict=True):
            k = coordinates.parameters.index(name)
            middle = float(coordinates.of_quantity(k, centre))
            own[name] = coordinates.value(k, middle + spread * float(rng.standard_normal()))
    return drawn, pooled


def replicate(
    template: Problem,
    out: Path,
    *,
    seed: int,
    plan: DataSetPlan,
    before: Replication | None = None,
) -> Replication:
    """Simulate one data set of a seed, and go on as `fit_and_rank`."""
    simulated = simulate_from_prior(
        template, seed=seed, stress_range=plan.stress_range, strain_range=plan.strain_range
    )
    return fit_and_rank(simulated, template, out, seed=seed, plan=plan, before=before)


def fit_and_rank(
    simulated: Simulated,
    template: Problem,
    out: Path,
    *,
    seed: int,
    plan: DataSetPlan,
    before: Replication | None = None,
) -> Replication:
    """Fit simulated data in `out`, after `before`, until converged, then rank the truth."""
    found: dict[str, Any] = {
        "seed": seed,
        "n_draws": plan.n_ranked,
        "n_unsolvable": simulated.n_unsolvable,
        "n_outside": simulated.n_outside,
    }
    first, failed = (before.n_refits + 1, before.failed_checks) if before else (0, ())
    for n_refits in range(first, plan.refits + 1):
        found["n_refits"] = n_refits
        try:
            result = fit_problem(
                simulated.problem,
                out=out / f"fit_{n_refits}",
                options=lengthened(replace(plan.sampler, seed=seed), n_refits, failed),
                command=f"a calibration, data set {seed}",
            )
        except SamplingError as error:
            return Replication(**found, failure=str(error))
        for lost in result.missing_chains():
            if lost.by_system:
                raise SystemFailureError(lost.reason)
        failed = not_converged(result, plan.n_ranked)
        found |= {
            "failed_checks": failed,
            "n_shortened": len(shortened(result.manifest)),
            "divergences": int(result.posterior["sample_stats"]["diverging"].sum()),
            "rhat": largest_rhat(result.posterior),
            "least_ess": float(convergence_table(result.posterior)["ess_bulk"].min()),
            "coordinates": result.manifest["coordinates"]["system"],
        }
        if not failed:
            ranks = rank_truth(result, simulated, template, plan.n_ranked)
            return Replication(**found, ranks=ranks)
    return Replication(**found)


def lengthened(options: SamplerOptions, n_refits: int, failed: Sequence[str]) -> SamplerOptions:
    """Return settings of a repetition (0 is the first fit): longer, stricter after divergences."""
    assert options.warmup is not None
    assert options.adapt_delta is not None
    # A stricter target mends nothing else: steps would only be too short.
    stricter = LONGER**n_refits if check_divergences.name in failed else 1
    return replace(
        options,
        warmup=options.warmup * LONGER**n_refits,
        draws=options.draws * LONGER**n_refits,
        adapt_delta=1 - (1 - options.adapt_delta) / stricter,
        max_minutes=0.0,  # the number of draws follows from the data alone
    )


def not_converged(result: Fit, n_ranked: int) -> tuple[str, ...]:
    """Return the names of the checks of convergence that a fit failed."""
    n_effective = convergence_table(result.posterior)["ess_bulk"]
    return (
        *(one.name for one in run_checks(result.checked_draws, CHECKS) if not one.passed),
        *([] if largest_rhat(result.posterior) <= RHAT_LIMIT else ["R-hat"]),
        *([] if n_effective.min() >= n_ranked else ["independent draws"]),
    )


def rank_truth(
    result: Fit, simulated: Simulated, template: Problem, n_thinned: int
) -> dict[str, int]:
    """Count thinned draws below the truth for every quantity, named and driven by the template."""
    draws = result.posterior["posterior"].to_dataset()
    solver, problem = SolverOptions(**result.manifest["solver"]), simulated.problem
    truths = [
        _at_truth(experiment, driven, solver)
        for experiment, driven in zip(problem.experiments, template.experiments, strict=True)
    ]
    found = free_parameters(result.posterior)
    # Place of the true value, and the name to rank it by.
    ranked = {name: (name, truth[name]) for truth in truths[:1] for name in truth if name in found}
    if not problem.is_single:
        for e, truth in enumerate(truths):
            ranked |= {
                own_name(name, problem.owner(name, e)): (
                    own_name(name, template.owner(name, e)),
                    value,
                )
                for name, value in truth.items()
                if own_name(name, problem.owner(name, e)) in found
            }
    ranked |= {name: (name, value) for name, value in simulated.pooled.items()}
    values = {name: (draws[column], value) for column, (name, value) in ranked.items()}
    total = sum(truth[LOG_LIKELIHOOD] for truth in truths)
    likelihood = response_in(result.posterior, "log_likelihood").sum("point")
    values[LOG_LIKELIHOOD] = (likelihood, total)
    n_draws = draws.sizes["chain"] * draws.sizes["draw"]
    kept = np.linspace(0, n_draws - 1, n_thinned).astype(int)
    return {
        name: int(np.sum(all_draws(drawn)[kept] < truth)) for name, (drawn, truth) in values.items()
    }


def _at_truth(
    experiment: Experiment, driven: Experiment, solver: SolverOptions
) -> dict[str, float]:
    """Return true parameters, reference quantity and log likelihood of simulated data."""
    values = experiment.true_parameters
    assert values is not None  # simulated
    likelihood = likelihood_of(experiment)
    given = given_parameters(experiment.material, values)
    data = program_data(one_test(experiment, given), solver=solver)
    error = experiment.driving_error(driven)
    draw = load_program(likelihood.program).evaluate(data, {"coordinate": error.tolist()})
    return {
        **values,
        likelihood.reference.name: float(np.exp(draw["log_reference"][0])),
        LOG_LIKELIHOOD: float(draw["log_lik"].sum()),
    }
