"""A flow law as a joint prior: its density, its draws, its files, and what a curve gains."""

from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
from conftest import ICE, valley_of, with_fixed, write_problem
from history_twins import history_twin
from oracle import GAS_CONSTANT
from refusals import CommandLine
from scipy import stats
from stan_data import one_test_data

from pyburgers.checks.prior_influence import prior_influence
from pyburgers.cli.main import main
from pyburgers.cmdstan.program import load_program
from pyburgers.common.array_types import FloatArray
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import values_of_test
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.flow_law_prior import (
    FLOW_LAW_PRIOR_FILE,
    PRIOR_QUANTITIES,
    Conditions,
    FlowLawPrior,
)
from pyburgers.model.peak_test import PeakTest
from pyburgers.model.pooling import pooling_of
from pyburgers.model.priors import (
    FLOW_LAW,
    JOINT_PRIOR,
    PriorSet,
    default_priors,
    load_priors,
    save_priors,
    with_flow_law,
)
from pyburgers.sampling.options import SamplerOptions

pytestmark = pytest.mark.usefixtures("programs")


OLIVINE = ICE.parent / "olivine" / "olivine_twin.toml"


def flow_law(material: str = "ice") -> FlowLawPrior:
    """Narrow normal about laboratory values with correlations of all signs."""
    beta, spread = {"ice": (-7.29e-4, 1e-6), "olivine": (-9.2e-5, 1e-6)}[material]
    deviations = np.array([0.1, 0.08, 0.3, spread])
    correlation = np.array(
        [[1, 0.3, -0.4, 0.2], [0.3, 1, 0.5, -0.1], [-0.4, 0.5, 1, 0.3], [0.2, -0.1, 0.3, 1]]
    )
    return FlowLawPrior(
        quantities=PRIOR_QUANTITIES,
        mean=np.array([3.6, 0.58, -9.2, beta]),
        covariance=correlation * np.outer(deviations, deviations),
        conditions=Conditions(temperature=263.5, stress=6e6, grain_size=3e-4)
        if material == "ice"
        else Conditions(temperature=1450.0, stress=1.2e8, grain_size=1e-5),
        material=material,
        source="made up",
    )


def quantities(law: FlowLawPrior, values: Mapping[str, npt.ArrayLike]) -> FloatArray:
    """Return n, p, ln(flow rate s) and beta of draws, shape (4, ...), written out again."""
    n, p, enthalpy, beta = (np.asarray(values[name]) for name in FLOW_LAW)
    at = law.conditions
    log_rate = (
        n * np.log(at.stress)
        - p * np.log(at.grain_size)
        + enthalpy * (beta - 1 / (GAS_CONSTANT * at.temperature))
    )
    return np.array([n, p, log_rate, beta])


def log_density(law: FlowLawPrior, values: Mapping[str, float]) -> float:
    """Density of n, p, Q_M and beta by scipy."""
    # In standard deviations, since scipy takes the variance of beta, 1e-12, for none.
    deviation = np.sqrt(np.diag(law.covariance))
    joint = stats.multivariate_normal(np.zeros(4), law.covariance / np.outer(deviation, deviation))
    scaled = (quantities(law, values) - law.mean) / deviation
    slope = 1 / (GAS_CONSTANT * law.conditions.temperature) - values["beta"]
    return float(joint.logpdf(scaled) - np.sum(np.log(deviation)) + np.log(slope))


def experiment_of(material: str) -> Experiment:
    if material == "olivine":
        return load_forced_oscillation(OLIVINE)
    return load_constant_rate(ICE / "PIL40.toml")


@pytest.mark.parametrize("system", ["plain", "valley", "olivine"])
def test_the_density_is_that_of_the_normal_and_of_the_other_priors(system: str) -> None:
    material = "olivine" if system == "olivine" else "ice"
    experiment, law = experiment_of(material), flow_law(material)
    own = default_priors(material).resolved(experiment.largest_stress)
    priors = with_flow_law(own, law, "test")
    data = one_test_data(experiment, priors, solver=SolverOptions(), use_likelihood=False)
    if system == "valley":
        ice = load_constant_rate(ICE / "PIL40.toml")
        valley = valley_of(ice, priors)
        data = one_test_data(ice, priors, solver=SolverOptions(), reference=valley)
    model = load_program(likelihood_of(experiment).program)
    rng = np.random.default_rng(5)
    for _ in range(4):
        position = 0.3 * rng.standard_normal(len(priors.free))
        found = model.evaluate(data, {"coordinate": position.tolist()})
        values = values_of_test(found["parameter"], 0)
        others = sum(
            float(own[name].distribution().logpdf(values[name]))
            for name in own.free
            if name not in FLOW_LAW
        )
        assert found["lprior"] == pytest.approx(others + log_density(law, values), rel=1e-9)


@pytest.mark.slow
def test_without_likelihood_draws_are_those_of_the_normal(tmp_path: Path) -> None:
    experiment, law = load_constant_rate(ICE / "PIL40.toml"), flow_law()
    priors = with_flow_law(default_priors("ice").resolved(8e6), law, "test")
    options = SamplerOptions(chains=2, warmup=400, draws=1200, seed=4, adapt_delta=0.9)
    short = replace(
        experiment, strain=experiment.strain[:2], stress=experiment.stress[:2], final_strain=0.01
    )
    result = fit(short, priors, out=tmp_path / "run", options=options, use_likelihood=False)
    draws = result.posterior["posterior"].to_dataset()
    found = quantities(law, {name: all_draws(draws[name]) for name in FLOW_LAW})
    deviation = np.sqrt(np.diag(law.covariance))
    # 2400 draws, about a quarter of them independent: errors of 0.04, and half as much again.
    np.testing.assert_allclose((found.mean(axis=1) - law.mean) / deviation, 0.0, atol=0.15)
    expected = law.covariance / np.outer(deviation, deviation)
    np.testing.assert_allclose(np.cov(found) / np.outer(deviation, deviation), expected, atol=0.15)
    # Marginals of the law are fixed as well, since the joint draw replaces them.
    law_alone = with_fixed(priors, {name: priors[name].location for name in priors.free})
    prior_draws = [law_alone.sample(np.random.default_rng(k)) for k in range(2000)]
    drawn = quantities(law, {k: np.array([v[k] for v in prior_draws]) for k in FLOW_LAW})
    np.testing.assert_allclose((drawn.mean(axis=1) - law.mean) / deviation, 0.0, atol=0.1)
    np.testing.assert_allclose(np.cov(drawn) / np.outer(deviation, deviation), expected, atol=0.1)


def test_marginals_stand_in_the_set_and_survive_a_file(tmp_path: Path) -> None:
    law = flow_law()
    priors = with_flow_law(default_priors("ice"), law, "test")
    rng = np.random.default_rng(1)
    draws = [law.sample(rng) for _ in range(4000)]
    for name in FLOW_LAW:
        values = np.array([draw[name] for draw in draws])
        assert priors[name].location == pytest.approx(values.mean(), abs=4 * values.std() / 60)
        assert priors[name].scale == pytest.approx(values.std(), rel=0.05)
    assert priors["maxwell_modulus"] == default_priors("ice")["maxwell_modulus"]
    save_priors(priors, tmp_path / "priors.toml")
    again = load_priors(tmp_path / "priors.toml")
    assert again.priors == priors.priors
    assert again.flow_law is not None
    np.testing.assert_array_equal(again.flow_law.mean, law.mean)
    np.testing.assert_array_equal(again.flow_law.covariance, law.covariance)
    assert again.flow_law.conditions == law.conditions
    law.save(tmp_path / "law.json")
    assert FlowLawPrior.load(tmp_path / "law.json").source == "made up"


def saved(**changed: Any) -> Callable[[Path], object]:
    """Write the flow law with something changed."""
    return replace(flow_law(), **changed).save


@pytest.mark.parametrize(
    ("write", "expected"),
    [
        (lambda path: None, "does not exist"),
        (lambda path: path.write_text("{"), "is not valid JSON"),
        (lambda path: path.write_text('{"mean": [1.0]}'), "is not a flow law prior"),
        (saved(mean=np.ones(1)), r"found a mean of shape \(1,\)"),
        (saved(covariance=-np.eye(4)), "not symmetric and positive definite"),
        (saved(covariance=np.triu(np.ones((4, 4)))), "not symmetric and positive definite"),
        (saved(quantities=("a", "b", "c", "d")), "found the quantities a, b, c, d, expected"),
        (saved(conditions=Conditions(0.0, 1e6, 1e-4)), "expected positive numbers"),
    ],
)
def test_files_that_hold_no_distribution_are_refused(
    write: Callable[[Path], object], expected: str, tmp_path: Path
) -> None:
    write(tmp_path / "law.json")
    with pytest.raises(InputError, match=expected):
        FlowLawPrior.load(tmp_path / "law.json")


@pytest.fixture(scope="module")
def source(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """A run directory as far as --priors-from reads it."""
    folder = tmp_path_factory.mktemp("rates")
    flow_law().save(folder / FLOW_LAW_PRIOR_FILE)
    return folder


def test_a_curve_is_not_fitted_with_a_flow_law_that_it_has_gone_into(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    row = PeakTest(strain_rate=1.69e-4, stress=8.03e6, temperature=263.47, grain_size=2.3e-4)
    other = replace(row, strain_rate=8e-5)
    for tests, refused in (((other, row), True), ((other,), False)):
        law = replace(flow_law(), tests=tests)
        law.save(tmp_path / FLOW_LAW_PRIOR_FILE)
        assert FlowLawPrior.load(tmp_path / FLOW_LAW_PRIOR_FILE).tests == tests
        priors = with_flow_law(default_priors("ice"), law, "test")
        save_priors(priors, tmp_path / "priors.toml")
        assert load_priors(tmp_path / "priors.toml") == priors
        curve = load_constant_rate(ICE / "PIL40.toml")
        if not refused:
            problem_of([curve], priors)
            continue
        with pytest.raises(InputError, match=r"PIL40: may be the test with 0\.000169 1/s"):
            problem_of([curve], priors)
        with pytest.raises(InputError, match="PIL40: may be the test"):
            problem_of([curve, history_twin("creep", 8)], priors, pooling_of())
        command = ["fit", str(ICE / "PIL40.toml"), "--priors-from", str(tmp_path)]
        assert main([*command, "--out", str(tmp_path / "run")]) == 2
        assert "fit-rates --without" in capsys.readouterr().err
        assert not (tmp_path / "run").exists()


FREE = {*FLOW_LAW, "maxwell_modulus", "stress_noise"}
RUN = ("--chains", "2", "--warmup", "150", "--draws", "300", "--adapt-delta", "0.8")


@pytest.mark.slow
def test_a_curve_learns_the_flow_law_from_another_source(source: Path, tmp_path: Path) -> None:
    problem = write_problem(tmp_path / "inputs", free=FREE, max_strain=0.02, stride=3)
    arguments = ["fit", str(problem.experiment_file), "--priors", str(problem.priors_file), *RUN]
    main([*arguments, "--out", str(tmp_path / "alone")])
    main([*arguments, "--out", str(tmp_path / "both"), "--priors-from", str(source)])
    alone, both = (Fit.load(tmp_path / name) for name in ("alone", "both"))
    assert alone.manifest["priors_from"] is None
    assert both.manifest["priors_from"] == "made up"
    sd = {fit: fit.summary("SI")["sd"] for fit in (alone, both)}
    for name, share in (("stress_exponent", 0.75), ("grain_size_exponent", 0.75)):
        assert sd[both][name] < share * sd[alone][name]
        assert sd[both][name] < 1.1 * both.priors[name].scale
    assert "made up" in both.priors.title
    found = prior_influence(both.posterior, both.priors)
    assert found["grain_size_exponent"].priors[0] == JOINT_PRIOR


def test_a_source_that_does_not_suit_is_refused(
    source: Path, tmp_path: Path, cli: CommandLine
) -> None:
    curve, record = str(ICE / "PIL40.toml"), str(OLIVINE)

    def refused(words: str, *arguments: str) -> None:
        cli.refused(["fit", *arguments, "--out", tmp_path / "run"], words)
        assert not (tmp_path / "run").exists()

    given = ("--priors-from", str(source))
    refused("is a flow law of ice, expected one of olivine", record, *given)
    priors: PriorSet = with_fixed(default_priors("ice"), {"beta": -7.29e-4})
    save_priors(priors, tmp_path / "fixed.toml")
    refused("beta is fixed by the priors", curve, "--priors", str(tmp_path / "fixed.toml"), *given)
    words = f"has no {FLOW_LAW_PRIOR_FILE}, expected a run of pyburgers fit-rates"
    refused(words, curve, "--priors-from", str(tmp_path))
