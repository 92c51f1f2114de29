"""Marginal likelihood of a finished run: density of all its data, the parameters integrated out.

By bridge sampling in the sampler's coordinates, which make posteriors close to normal. All terms
of the log density are normalised, in the program: that of the coordinates is what it samples.
"""

import json
import logging
import tempfile
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pandas as pd

from pyburgers.cmdstan.draws import read_draws
from pyburgers.cmdstan.program import ALL_DIGITS, Program, Unsolved, load_program
from pyburgers.common.errors import InputError
from pyburgers.comparison.bridge_sampling import LogIntegral, log_integral
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import SampledFit
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment
from pyburgers.protocols.forward import REFERENCE_SOLVER, constant_rate_program
from pyburgers.protocols.stan_data import StanData, solver_block, with_later_additions

logger = logging.getLogger(__name__)

FloatArray = npt.NDArray[np.float64]

SAMPLER_COLUMNS = 7
"""Columns of CmdStan's chain files ahead of the parameters."""


def log_marginal_likelihood(fit: SampledFit) -> LogIntegral:
    """Log density of all data of a run under its priors, of stresses in Pa.

    Parameters
    ----------
    fit : Fit or JointFit
        Of tests at constant rate. Where the data took no part it is 0, but for its error.

    Returns
    -------
    LogIntegral
        At the reference tolerance of the solver. Draws that miss a part of the posterior are not
        in the error: see the checks of the run.

    Raises
    ------
    InputError
        If the test is of another protocol, or there are too few draws.
    SamplingError
        If the program fails or the draws have no spread.
    """
    if isinstance(fit, Fit) and not isinstance(fit.experiment, ConstantRateExperiment):
        raise InputError(
            f"{fit.directory.path}: is a fit of a test of the protocol {fit.experiment.protocol}, "
            "expected constant_rate, the only one with a marginal likelihood."
        )
    run = fit.directory
    draws = read_draws(run.draws_files())["coordinate"]
    stats = fit.posterior["sample_stats"].to_dataset()
    at_reference = (stats["lp"] + stats["solver_log_ratio"]).transpose("chain", "draw").to_numpy()
    data: StanData = json.loads(run.stan_data_file.read_text(encoding="utf-8"))
    data = {**with_later_additions(data), **solver_block(REFERENCE_SOLVER)}
    program = load_program(constant_rate_program())
    logger.info(f"Marginal likelihood of {fit.manifest['experiment']}: bridge sampling.")
    return log_integral(
        draws,
        # A draw without solution at the reference tolerance has no density there.
        np.where(np.isnan(at_reference), -np.inf, at_reference),
        lambda points: log_density_at(program, data, points),
        seed=fit.manifest["sampler"]["seed"],
    )


def log_density_at(program: Program, data: StanData, points: FloatArray) -> FloatArray:
    """Log density of coordinates, minus infinity where the model has no solution.

    Parameters
    ----------
    program : Program
        The program for constant rate.
    data : dict
        Its data.
    points : array, shape (n_points, n_coordinates)
        Coordinates.
    """
    try:
        found = _generated(program, data, points)
    except Unsolved:
        if len(points) == 1:
            return np.array([-np.inf])
        return np.concatenate(
            [log_density_at(program, data, part) for part in np.array_split(points, 2)]
        )
    return np.where(np.isnan(found), -np.inf, found)


def _generated(program: Program, data: StanData, points: FloatArray) -> FloatArray:
    """Log density of points that all have one, from generated quantities."""
    names = [
        *(f"sampler_{k}__" for k in range(SAMPLER_COLUMNS)),
        *(f"coordinate.{k + 1}" for k in range(points.shape[1])),
    ]
    columns = np.hstack([np.zeros((len(points), SAMPLER_COLUMNS)), points])
    with tempfile.TemporaryDirectory(prefix="pyburgers-") as folder:
        file = Path(folder) / "points.csv"
        pd.DataFrame(columns, columns=names).to_csv(file, index=False, float_format="%.17g")
        found: FloatArray
        (found,) = program.generate(data, [file], seed=1, digits=ALL_DIGITS)["log_density"]
        return found
