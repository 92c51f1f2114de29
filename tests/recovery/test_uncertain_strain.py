"""Records whose strain is as uncertain as their stress: intervals are as wide as they should be."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ICE, with_fixed
from oscillation_records import part_of, with_record

from pyburgers.cmdstan.program import Density, load_program
from pyburgers.kinds.forced_oscillation.experiment import (
    OscillationExperiment,
    with_background,
)
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forced_oscillation.preparation import strain_shares
from pyburgers.kinds.forward import simulate_data
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.priors import default_priors

pytestmark = [pytest.mark.usefixtures("programs"), pytest.mark.slow]

TWIN = ICE.parent / "olivine" / "olivine_twin.toml"
FREE = ("kelvin_modulus", "kelvin_viscosity")
RECORDS = 60


def template() -> OscillationExperiment:
    """The twin with 30 strains of standard deviation 1e-4 and 37 stresses."""
    twin = load_forced_oscillation(TWIN)
    record = part_of(twin.record, slice(None, None, 7), slice(None, None, 2))
    spread = np.full_like(record.strain, 1e-4)
    return with_record(twin, replace(record, strain_uncertainty=spread))


def deviations(experiment: OscillationExperiment) -> list[float]:
    """Distances of the truth from the mode, in standard deviations there."""
    truth = dict(experiment.true_parameters or {})
    priors = default_priors("olivine")
    known = {name: truth[name] for name in priors.free if name not in FREE}
    problem = problem_of([experiment], with_fixed(priors, known))
    model = load_program(problem.likelihood.program)
    data = program_data(problem, solver=SolverOptions(tolerance=1e-8))
    (coordinates,) = problem.coordinates
    at_truth = coordinates.at(truth)
    start = np.append(at_truth, np.zeros(experiment.n_driving_errors))
    density = Density(model, data)
    mode = density.climb(start, seed=1).place
    covariance = density.laplace(mode)
    places = [coordinates.quantities.index(name) for name in FREE]
    return [float((mode[k] - at_truth[k]) / np.sqrt(covariance[k, k])) for k in places]


def spreads(original: OscillationExperiment) -> tuple[float, float]:
    """Root mean squares of 120 standardised errors with the strain's inferred, and ignored."""
    truth = dict(original.true_parameters or {})
    inferred: list[float] = []
    ignored: list[float] = []
    for seed in range(RECORDS):
        record = simulate_data(original, truth, np.random.default_rng(seed), source="the twin")
        assert record.n_driving_errors == original.n_driving_errors > 0
        inferred += deviations(record)
        ignored += deviations(record.to_be_solved())
    first, second = (float(np.sqrt(np.mean(np.square(z)))) for z in (inferred, ignored))
    return first, second


def share_of_fundamental(record: OscillationExperiment) -> float:
    """How much the errors of the strain's fundamental count beside those of the stress's."""
    share, _ = strain_shares(record.prepared.strain_fit, record.prepared.stress_fit)
    assert share > 0.3
    return share


def test_intervals_are_as_wide_as_errors_of_the_strain_make_them() -> None:
    """Without a background nothing but the fundamental counts: the share says by how much."""
    record = with_background(template(), "removed")
    assert record.n_driving_errors == 6
    inferred, ignored = spreads(record)
    assert inferred == pytest.approx(1.0, abs=0.2)  # three standard errors
    # Of the same records, so that chance has less part in it.
    expected = np.sqrt(1 + share_of_fundamental(record))
    assert ignored / inferred == pytest.approx(expected, rel=0.06)


def test_errors_of_the_mean_strain_rate_count_where_the_background_is_kept() -> None:
    """Intervals that infer them are right; what ignores them is worse than the fundamental says."""
    record = template()
    assert record.n_driving_errors == 8
    inferred, ignored = spreads(record)
    assert inferred == pytest.approx(1.0, abs=0.2)
    assert ignored / inferred > np.sqrt(1 + share_of_fundamental(record))
