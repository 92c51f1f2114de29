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

from pyburgers.cmdstan.program import load_model
from pyburgers.cmdstan.toolchain import last_lines, run_tool
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.comparison.bridge_sampling import LogIntegral, log_integral
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.sampled_fit import SampledFit
from pyburgers.posterior.labelled_draws import read_chains
from pyburgers.protocols.constant_rate.protocol import CONSTANT_RATE
from pyburgers.protocols.forward import REFERENCE_SOLVER, quiet_cmdstanpy
from pyburgers.protocols.registry import protocol_of
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
        Of tests whose program gives its log density. Where the data took no part it is 0, but for
        its error.

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
    if isinstance(fit, Fit) and not protocol_of(fit.experiment).gives_log_density:
        raise InputError(
            f"{fit.directory.path}: is a fit of a test of the protocol {fit.experiment.protocol}, "
            "expected one whose program gives its log density, such as constant_rate."
        )
    run = fit.directory
    with quiet_cmdstanpy():
        chains = read_chains([str(run.draws_file(chain)) for chain in run.finished_chains()])
        draws = chains.draws_xr(["coordinate"])["coordinate"].to_numpy()
    stats = fit.posterior["sample_stats"].to_dataset()
    at_reference = (stats["lp"] + stats["solver_log_ratio"]).transpose("chain", "draw").to_numpy()
    data: StanData = json.loads(run.stan_data_file.read_text(encoding="utf-8"))
    data = {**with_later_additions(data), **solver_block(REFERENCE_SOLVER)}
    program = Path(str(load_model(CONSTANT_RATE.program).exe_file))
    logger.info(f"Marginal likelihood of {fit.manifest['experiment']}: bridge sampling.")
    with tempfile.TemporaryDirectory() as name:
        folder = Path(name)
        (folder / "data.json").write_text(json.dumps(data), encoding="utf-8")
        return log_integral(
            draws,
            # A draw without solution at the reference tolerance has no density there.
            np.where(np.isnan(at_reference), -np.inf, at_reference),
            lambda points: log_density_at(program, folder, points),
            seed=fit.manifest["sampler"]["seed"],
        )


def log_density_at(program: Path, folder: Path, points: FloatArray) -> FloatArray:
    """Log density of coordinates, minus infinity where the model has no solution.

    Parameters
    ----------
    program : Path
        Executable of the program for constant rate.
    folder : Path
        Holds its data, ``data.json``; other files are written there.
    points : array, shape (n_points, n_coordinates)
        Coordinates.
    """
    found = _generated(program, folder, points)
    if len(found) == len(points):
        return np.where(np.isnan(found), -np.inf, found)
    if len(points) == 1:
        return np.array([-np.inf])
    # CmdStan leaves points without solution out and does not say which.
    return np.concatenate(
        [log_density_at(program, folder, part) for part in np.array_split(points, 2)]
    )


def _generated(program: Path, folder: Path, points: FloatArray) -> FloatArray:
    """Log density of those points that have one, in their order, from generated quantities."""
    fitted, output = folder / "points.csv", folder / "generated.csv"
    names = [
        *(f"sampler_{k}__" for k in range(SAMPLER_COLUMNS)),
        *(f"coordinate.{k + 1}" for k in range(points.shape[1])),
    ]
    columns = np.hstack([np.zeros((len(points), SAMPLER_COLUMNS)), points])
    pd.DataFrame(columns, columns=names).to_csv(fitted, index=False, float_format="%.17g")
    done = run_tool(
        [
            *(program, "generate_quantities", f"fitted_params={fitted}"),
            *("data", f"file={folder / 'data.json'}", "random", "seed=1"),
            *("output", f"file={output}", "sig_figs=17"),
        ],
        cwd=folder,
    )
    if done.returncode != 0:
        raise SamplingError(f"The log density could not be computed: {last_lines(done.stdout, 3)}")
    table = pd.read_csv(output, comment="#", usecols=["log_density"])
    return table["log_density"].to_numpy(dtype=np.float64)
