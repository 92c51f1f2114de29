"""Compare fits of the same data: how well does each predict a point that it has not seen.

The measure is the expected log pointwise predictive density (elpd) by leave-one-out
cross-validation, approximated from the draws of the fit of all points with Pareto smoothed
importance sampling (Vehtari, Gelman and Gabry 2017, Statistics and Computing 27, 1413-1432). A
point whose weights have too heavy a tail (Pareto k above 0.7) can be left out by fitting again.
"""

import logging
from collections.abc import Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import xarray as xr
from scipy.special import logsumexp

from pyburgers.checks.prior_influence import read_off_sentences
from pyburgers.cmdstan.program import load_program
from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.common.paths import given_path
from pyburgers.common.units import counted
from pyburgers.comparison.results import Comparison, LeaveOneOut
from pyburgers.comparison.same_data import (
    best_first,
    check_same_data,
    require_fits_by_name,
    sampling_doubts,
    tests_of,
)
from pyburgers.fitting.fit import Fit, fit_problem
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import one_test, problem_of
from pyburgers.kinds.program_data import tests_block
from pyburgers.kinds.stan_data import REFERENCE_SOLVER, SolverOptions, solver_block
from pyburgers.posterior.groups import GIVEN_OTHERS
from pyburgers.posterior.labelled_draws import (
    pointwise_log_density,
    relative_efficiency,
    smooth_weights,
)
from pyburgers.sampling.options import recorded_options

logger = logging.getLogger(__name__)


def compare(fits: Mapping[str, Fit], *, refits: str | Path | None = None) -> Comparison:
    """Compare fits of the same data by leave-one-out cross-validation.

    Parameters
    ----------
    fits : mapping of str to Fit
        At least two, by name; all of one test, or all joint ones of the same tests.
    refits : path, optional
        Folder for fits without single points, in ``NAME/point_K``: points with a Pareto k above 0.7
        are left out by another fit. Without it, and in joint fits and their parts, they are only
        flagged.

    Raises
    ------
    InputError
        If there are fewer than two fits, or they are of different data, or one has no likelihood.
    SamplingError
        If a fit without a point fails.

    Examples
    --------
    >>> comparison = pyburgers.compare({"one": fit, "same": fit})
    >>> sentence = comparison.pairs()[0].sentence()
    """
    require_fits_by_name("fits", fits)
    if len(fits) < 2:
        raise InputError(f"compare: found {counted(len(fits), 'fit')}, expected at least two.")
    check_same_data(fits)
    found = {}
    for name, one in fits.items():
        result = _of_all_tests(one)
        flagged = np.flatnonzero(result.unreliable).tolist()
        if flagged and refits is not None:
            if one.is_joint or one.is_part:
                logger.info(
                    f"{name}: points of a joint fit are not left out one by one, because each "
                    "would take a fit of all tests; they stay flagged."
                )
            elif reason := one.experiment.points_together:
                logger.info(
                    f"{name}: points cannot be left out one by one, because {reason}; they stay "
                    "flagged."
                )
            else:
                result = leave_out_exactly(one, result, flagged, given_path(refits) / name)
        found[name] = result
    ordered, weights = best_first(found)
    first = tests_of(next(iter(fits.values())))
    return Comparison(
        results=ordered,
        weights=weights,
        position=_positions(first),
        clock=likelihood_of(first[0].experiment).clock,
        variants={name: one.variant.short_text for name, one in fits.items()},
        correlated=tuple(name for name, one in fits.items() if one.variant.residuals_correlate),
    )


def leave_one_out(posterior: xr.DataTree) -> LeaveOneOut:
    """Return the elpd of every point by Pareto smoothed importance sampling.

    ArviZ has one relative efficiency for all points. If residuals correlate, the density given all
    others is used (Bürkner, Gabry and Vehtari 2021, Computational Statistics 36, 1243-1261).
    """
    pointwise = pointwise_log_density(posterior)
    by_point = all_draws(pointwise).T
    # Scaled, since a density in 1/Pa is of the order of 1e-6 and less.
    scaled = pointwise - pointwise.max(("chain", "draw"))
    efficiency = relative_efficiency(scaled.copy(data=np.exp(scaled.to_numpy())))
    elpd, pareto_k = [], []
    for log_lik, share in zip(by_point, efficiency, strict=True):
        log_weights, k = smooth_weights(-log_lik, relative_efficiency=float(share))
        elpd.append(float(logsumexp(log_weights + log_lik)))
        pareto_k.append(k)
    n_draws = by_point.shape[1]
    return LeaveOneOut(
        elpd=np.array(elpd),
        pareto_k=np.array(pareto_k),
        exact=np.zeros(len(elpd), dtype=bool),
        lppd=float(np.sum(logsumexp(by_point, axis=1) - np.log(n_draws))),
    )


def _of_all_tests(one: Fit) -> LeaveOneOut:
    """Return the elpd of the points of all tests of a fit, one after the other."""
    results = [leave_one_out(test.posterior) for test in tests_of(one)]
    return LeaveOneOut(
        elpd=np.concatenate([one.elpd for one in results]),
        pareto_k=np.concatenate([one.pareto_k for one in results]),
        exact=np.concatenate([one.exact for one in results]),
        lppd=sum(one.lppd for one in results),
        doubts=sampling_doubts(one, one.problem.name, "its elpd may be far off"),
        notes=read_off_sentences(one.read_off),
    )


def leave_out_exactly(
    one: Fit, result: LeaveOneOut, points: Sequence[int], folder: Path
) -> LeaveOneOut:
    """Replace the elpd of points, from 0, by that of fits without them, kept in ``point_K``."""
    elpd, exact, doubts = result.elpd.copy(), result.exact.copy(), result.doubts
    for point in points:
        logger.info(
            f"{one.experiment.id}: Pareto k of point {point + 1} is {result.pareto_k[point]:.2f}; "
            "fitting again without it."
        )
        again = fit_problem(
            problem_of([one.experiment.without_point(point)], one.priors),
            out=folder / f"point_{point + 1}",
            options=recorded_options(one.manifest["sampler"]),
            solver=SolverOptions(**one.manifest["solver"]),
            command=f"pyburgers compare (point {point + 1} left out)",
        )
        log_lik = _log_likelihood_of(again, one.experiment)[:, point]
        elpd[point] = logsumexp(log_lik) - np.log(log_lik.size)
        exact[point] = True
        doubts += sampling_doubts(
            again,
            f"{one.experiment.id} without point {point + 1}",
            "the density of that point may be far off",
        )
    return replace(result, elpd=elpd, exact=exact, doubts=doubts)


def _positions(tests: Sequence[Fit]) -> xr.DataArray:
    """Where the points of all tests lie, by segment; of several tests with their names, too."""
    parts: list[xr.DataArray] = []
    for test in tests:
        clock = likelihood_of(test.experiment).clock.name
        along = test.posterior["constant_data"].to_dataset().drop_vars("point", errors="ignore")
        part = along[clock]
        segment = along.get("segment", xr.zeros_like(part)).to_numpy().astype(np.int64)
        first = 1 + int(parts[-1]["segment"].max()) if parts else 0
        part = part.assign_coords(segment=("point", first + segment))
        name = np.full(part.size, test.experiment.id)
        parts.append(part.assign_coords(test=("point", name)) if len(tests) > 1 else part)
    return xr.concat(parts, "point")


def _log_likelihood_of(again: Fit, experiment: Experiment) -> FloatArray:
    """Log density of each point given all others at another fit's draws, (n_draws, n_points)."""
    program = load_program(likelihood_of(experiment).program)
    try:
        with again.directory.unchanged_copy(again.manifest, with_draws=True) as run:
            # Only the test is exchanged: the coordinates of the draws are those of the other fit.
            data = {
                **run.read_stan_data(),
                **tests_block(one_test(experiment, again.priors), use_likelihood=True),
                **solver_block(REFERENCE_SOLVER),
            }
            quantities = program.generate(
                data, run.draws_files(), seed=again.manifest["sampler"]["seed"]
            )
    except SamplingError as error:
        raise SamplingError(
            f"{again.directory.path}: some of its draws have no solution at all points of "
            f"{experiment.id}, so the point left out has no density."
        ) from error
    name = GIVEN_OTHERS if GIVEN_OTHERS in quantities else "log_lik"
    return all_draws(quantities.dataset([name])[name])
