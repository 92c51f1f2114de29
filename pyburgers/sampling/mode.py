"""Posterior mode, found by Stan's optimiser: where the sampler's coordinates and metric are set."""

import tempfile
from collections.abc import Iterable, Mapping
from pathlib import Path
from typing import Any

import cmdstanpy
import numpy as np
import numpy.typing as npt

from pyburgers.cmdstan.program import load_model
from pyburgers.common.atomic_files import write_json
from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.model.priors import PriorSet
from pyburgers.protocols.chart import Mode
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.forward import quiet_cmdstanpy
from pyburgers.protocols.registry import protocol_of
from pyburgers.protocols.stan_data import SolverOptions, StanData, program_data
from pyburgers.sampling.initial_values import draw_initial_values

FloatArray = npt.NDArray[np.float64]

N_STARTS = 4


class ModeNotFound(Exception):  # noqa: N818 - an outcome with a reason, not an error
    """The optimiser failed; the message says how."""


def find_mode(
    experiment: Experiment, priors: PriorSet, *, seed: int, solver: SolverOptions
) -> Mode:
    """Climb from `N_STARTS` draws of the prior and keep the best.

    Parameters
    ----------
    experiment : Experiment
        A test with data.
    priors : PriorSet
        Resolved priors.
    seed : int
        Decides the prior draws.
    solver : SolverOptions
        Tolerance and step limit.

    Raises
    ------
    ModeNotFound
        If the optimiser fails from all starts.
    """
    data = program_data(experiment, priors, solver=solver)
    model = load_model(protocol_of(experiment).program)
    starts = (
        draw_initial_values(experiment, priors, seed=seed, chain=start)
        for start in range(1, N_STARTS + 1)
    )
    variables = climb(model, data, starts, seed=seed)
    return Mode(
        {p.name: float(variables[p.name]) for p in PROGRAM_PARAMETERS},
        np.atleast_1d(np.asarray(variables["coordinate"], dtype=np.float64)),
    )


def climb(
    model: cmdstanpy.CmdStanModel,
    data: StanData,
    starts: Iterable[Mapping[str, object]],
    *,
    seed: int,
) -> Mapping[str, Any]:
    """Climb from every start with Stan's optimiser and return the variables at the best end.

    Parameters
    ----------
    model : CmdStanModel
        The program.
    data : dict
        Its data.
    starts : iterable of mapping
        Values of its parameters.
    seed : int
        For the optimiser's record; it draws nothing.

    Raises
    ------
    ModeNotFound
        If the optimiser fails from all starts.
    """
    best = None
    n_starts = 0
    for initial in starts:
        n_starts += 1
        with tempfile.TemporaryDirectory() as folder, quiet_cmdstanpy():
            files = {name: Path(folder) / f"{name}.json" for name in ("data", "initial")}
            write_json(files["data"], data)
            write_json(files["initial"], initial)
            try:
                found = model.optimize(
                    data=str(files["data"]),
                    inits=str(files["initial"]),
                    seed=seed,
                    algorithm="lbfgs",
                    iter=5000,
                    output_dir=folder,
                    sig_figs=17,
                    require_converged=False,
                )
                variables = found.stan_variables()
                density = float(found.optimized_params_dict["lp__"])
            except RuntimeError:
                continue  # the optimiser left the region where the solver finds a solution
        if best is None or density > best[0]:
            best = (density, variables)
    if best is None:
        raise ModeNotFound(f"the optimiser failed from all {n_starts} starts")
    return best[1]
