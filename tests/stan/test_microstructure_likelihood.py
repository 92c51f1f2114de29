"""Likelihood of measured microstructure: its density, and its draws, apart from the stresses."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
from conftest import ICE, Problem, resolved_priors, valley_of
from log_density import program_with
from scipy import stats
from stan_data import one_test_data, parameters_in

from pyburgers.cmdstan.program import load_program
from pyburgers.comparison.same_data import data_hash
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD
from pyburgers.kinds.experiment import MeasuredMicrostructure
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.likelihood import strains_of
from pyburgers.kinds.program_data import given_parameters
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.sampling.options import SamplerOptions

FloatArray = npt.NDArray[np.float64]
pytestmark = pytest.mark.usefixtures("programs")

TIGHT = SolverOptions(tolerance=1e-10, max_num_steps=1_000_000)
QUICK = SamplerOptions(chains=2, warmup=20, draws=15, seed=1, adapt_delta=0.8)
MEASURED = (
    MeasuredMicrostructure(0.05, 200e-6, 10e-6),
    MeasuredMicrostructure(0.15, 170e-6, 8e-6, 0.7, 0.05),
)
PIEZOMETER = {
    "piezometer_reference_grain_size": 1e-3,
    "piezometer_exponent": 1.2,
    "piezometer_stress_floor": 1e6,
}


def expected_log_density(
    experiment: ConstantRateExperiment, values: dict[str, float]
) -> FloatArray:
    """Of each grain size and fabric factor, from another run of the program."""
    strains = strains_of(experiment.microstructure)
    solution = simulate(experiment, values, at=strains).set_index("strain")
    found = np.zeros((strains.size, 2))
    for row, strain, one in zip(found, strains.tolist(), experiment.microstructure, strict=True):
        size, factor = (solution[name][strain] for name in ("grain_size_m", "fabric_factor"))
        error = one.grain_size_sd / one.grain_size
        row[0] = stats.lognorm.logpdf(one.grain_size, error, scale=size)
        if one.fabric_factor is not None and one.fabric_factor_sd is not None:
            row[1] = stats.norm.logpdf(one.fabric_factor, factor, one.fabric_factor_sd)
    return found


@pytest.mark.parametrize("system", ["plain", "valley"])
def test_the_density_gains_that_of_each_measurement(system: str, tmp_path: Path) -> None:
    known = load_constant_rate(ICE / "PIL40.toml")
    experiment, priors = replace(known, microstructure=MEASURED), resolved_priors(known)
    reference = valley_of(known, priors) if system == "valley" else None
    without, program = (
        program_with(
            LIKELIHOOD.program,
            one_test_data(one, priors, solver=TIGHT, reference=reference),
            tmp_path / name,
        )
        for name, one in (("without", known), ("with", experiment))
    )
    point = {"coordinate": (0.3 * np.random.default_rng(3).standard_normal(12)).tolist()}
    before, after = without.columns_at(point), program.columns_at(point)
    expected = expected_log_density(experiment, parameters_in(after))
    found = [[after[f"microstructure_log_lik.{i}.{k}"] for k in (1, 2)] for i in (1, 2)]
    np.testing.assert_allclose(found, expected, rtol=1e-8)
    assert after["lp__"] - before["lp__"] == pytest.approx(expected.sum(), rel=1e-7)
    assert after["log_density"] == pytest.approx(after["lp__"], rel=1e-7)
    for i in range(1, known.n_points + 1):
        assert after[f"log_lik.{i}"] == pytest.approx(before[f"log_lik.{i}"], rel=1e-6)
    assert not [name for name in before if name.startswith("microstructure")]


def test_a_grain_size_that_follows_a_piezometer_is_measured_too() -> None:
    known = load_constant_rate(ICE / "PIL40.toml")
    experiment = replace(known, microstructure=MEASURED)
    evolving = dict(known.true_parameters or {})
    # What tells the law: the steady state is no other size than that at the start.
    start = {"steady_state_grain_size": known.initial_grain_size}
    values = {**evolving, **PIEZOMETER, **start}
    priors = given_parameters("ice", values)
    data = one_test_data(experiment, priors, solver=TIGHT)
    found = load_program(LIKELIHOOD.program).evaluate(data)
    expected = expected_log_density(experiment, values)
    np.testing.assert_allclose(found["microstructure_log_lik"], expected, rtol=1e-5)
    assert np.abs(expected - expected_log_density(experiment, evolving)).max() > 0.1


def test_draws_keep_it_apart(small_problem: Problem, small_fit: Fit, tmp_path: Path) -> None:
    """And it counts as data: in influences of the prior, and where fits are compared."""
    one = small_problem.experiment
    rows = (MeasuredMicrostructure(0.01, 220e-6, 5e-6), *MEASURED[1:])
    seen = tuple(replace(row, strain=0.01 * (k + 1)) for k, row in enumerate(rows))
    other = replace(one, id="other", microstructure=())
    measured = replace(one, microstructure=seen)
    single = fit(measured, small_problem.priors, out=tmp_path / "single", options=QUICK)
    joint = fit([other, measured], small_problem.priors, out=tmp_path / "joint", options=QUICK)
    for result in (single, joint):
        group = result.posterior["microstructure"].to_dataset()
        assert group["model"].dims == ("chain", "draw", "section", "quantity")
        assert group["quantity"].values.tolist() == ["grain_size", "fabric_factor"]
        np.testing.assert_allclose(group["strain"], [0.01, 0.02])
        np.testing.assert_allclose(group["measured"], [[220e-6, np.nan], [170e-6, 0.7]], rtol=1e-12)
        assert (np.ptp(group["replicated"].to_numpy(), axis=(0, 1))[:, 0] > 1e-6).all()
    own = joint[one.id].posterior
    assert own["microstructure"].to_dataset().equals(joint.posterior["microstructure"].to_dataset())
    assert "microstructure" not in small_fit.posterior.children
    assert "microstructure" not in joint["other"].posterior.children
    assert data_hash(small_fit) != data_hash(single)
    ratio = single.posterior["sample_stats"]["solver_log_ratio"]
    assert float(np.abs(ratio).max()) < 0.1
