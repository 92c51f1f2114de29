"""Reference point and pins of the valley coordinates (`stan/functions/valley_coordinates.stan`).

Everything comes from the posterior mode in plain coordinates, found by Stan's optimiser: the mode
is the reference point, its solution the smooth curve that the pins lie on, and its residual sets
their weight. Digitising jitter, short records, rate steps and curves without a peak need no
special care then, and the speed of a run, not its result, is all that depends on it.
"""

import tempfile
from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt

from pyburgers.cmdstan import load_model
from pyburgers.experiment import Experiment
from pyburgers.initial_values import draw_initial_values
from pyburgers.parameters import PARAMETERS
from pyburgers.priors import PriorSet
from pyburgers.run_directory import write_json
from pyburgers.simulation import constant_rate_program, quiet_cmdstanpy, solve, strain_grid
from pyburgers.stan_data import (
    PlainCoordinates,
    SolverOptions,
    ValleyReference,
    constant_rate_data,
    plain_coordinates,
)

FloatArray = npt.NDArray[np.float64]

N_STARTS = 4
N_PINS = 12
MIN_FLOWING_POINTS = 4
FLOWING_SHARE = 0.5
"""Pins lie where the dashpot carries at least this share of the imposed rate."""

NEAR_BOUND = 0.05
"""A mode within this fraction of a parameter's range above its lower bound leans on the bound."""

SOLVED = ("steady_state_fabric_factor", "critical_strain_grain_size", "critical_strain_fabric")


class ValleyUnsuited(Exception):  # noqa: N818 - an outcome with a reason, not an error
    """The valley coordinates do not apply; the message says why."""


def find_valley(
    experiment: Experiment,
    priors: PriorSet,
    *,
    seed: int,
    solver: SolverOptions,
    report: Callable[[str], None],
) -> ValleyReference:
    """Find the posterior mode and set the pins.

    Parameters
    ----------
    experiment : Experiment
        A test with data.
    priors : PriorSet
        Resolved priors.
    seed : int
        Decides the prior draws from which the optimiser starts.
    solver : SolverOptions
        Tolerance and step limit.
    report : callable
        Receives progress sentences.

    Raises
    ------
    ValleyUnsuited
        If the priors or the record do not fit the coordinates.
    """
    coordinates = plain_coordinates(experiment, priors)
    _check_priors(priors, coordinates)
    values, position = _mode(experiment, priors, coordinates, seed, solver, report)
    observed = solve(experiment, values, np.unique(experiment.strain), solver=solver)
    flowing = np.isin(
        experiment.strain,
        observed["grid_strain"][observed["grid_dashpot_share"] >= FLOWING_SHARE],
    )
    n_flowing = int(flowing.sum())
    if n_flowing < MIN_FLOWING_POINTS:
        raise ValleyUnsuited(
            f"only {n_flowing} points lie where the dashpot flows, {MIN_FLOWING_POINTS} are needed"
        )
    quantiles = (np.arange(N_PINS) + 0.5) / N_PINS
    pin_strain = np.unique(np.quantile(experiment.strain[flowing], quantiles))
    knots = solve(experiment, values, _knot_strain(experiment, pin_strain), solver=solver)
    pin_knot = np.searchsorted(knots["grid_strain"], pin_strain)
    segment = np.searchsorted(
        [s.start_strain for s in experiment.segments[1:]], pin_strain, side="left"
    )
    rate = np.array([s.strain_rate for s in experiment.segments])[segment]
    stress = knots["grid_stress"][pin_knot]
    weight = n_flowing / pin_strain.size * (stress / values["stress_noise"]) ** 2
    time = experiment.time_at(knots["grid_strain"])
    return ValleyReference(
        coordinate=position,
        linear_from=_linear_from(position, coordinates),
        knot_time_step=np.diff(time, prepend=0.0),
        knot_stress=knots["grid_stress"],
        pin_knot=pin_knot + 1,
        pin=np.column_stack(
            [
                pin_strain,
                knots["grid_stress_slope"][pin_knot],
                rate,
                np.log(experiment.segments[0].strain_rate / rate),
                weight,
            ]
        ),
    )


def _check_priors(priors: PriorSet, coordinates: PlainCoordinates) -> None:
    """Ask for solved parameters between finite bounds, and for ln S_0 as a coordinate."""
    for name in SOLVED:
        prior = priors[name]
        if prior.is_fixed or not np.isfinite([prior.lower, prior.upper]).all():
            raise ValleyUnsuited(f"{name} is not free between two finite bounds")
    if coordinates.replaced_parameter is None:
        raise ValleyUnsuited("neither Q_M nor beta leaves its place to the reference stress")


def _mode(
    experiment: Experiment,
    priors: PriorSet,
    coordinates: PlainCoordinates,
    seed: int,
    solver: SolverOptions,
    report: Callable[[str], None],
) -> tuple[dict[str, float], FloatArray]:
    """Posterior mode on the real line: SI values by name, and plain coordinates."""
    data = constant_rate_data(experiment, priors, solver=solver)
    model = load_model(constant_rate_program(), report=report)
    best = None
    for start in range(1, N_STARTS + 1):
        initial = draw_initial_values(experiment, priors, seed=seed, chain=start)
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
        raise ValleyUnsuited(f"the optimiser failed from all {N_STARTS} starts")
    variables = best[1]
    values = {p.name: float(variables[p.name]) for p in PARAMETERS}
    return values, np.atleast_1d(np.asarray(variables["coordinate"], dtype=np.float64))


def _knot_strain(experiment: Experiment, pin_strain: FloatArray) -> FloatArray:
    """Strains of the piecewise linear reference curve: dense at each segment's start."""
    shape = np.union1d(np.geomspace(1e-3, 1.0, 25), np.linspace(0.0, 1.0, 16)[1:])
    strain: FloatArray = np.union1d(strain_grid(experiment, shape), pin_strain)
    return strain


def _linear_from(position: FloatArray, coordinates: PlainCoordinates) -> FloatArray:
    """Odds (value - lower)/(upper - value) of modes that lean on a lower bound, 0 elsewhere."""
    odds = np.exp(position)
    bounded = np.isfinite(coordinates.lower) & np.isfinite(coordinates.upper)
    leaning: FloatArray = np.where(bounded & (odds < NEAR_BOUND), odds, 0.0)
    return leaning
