"""Calibration: simulated data are the program's, and truths are ranked among draws."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from conftest import ICE, resolved_priors, with_fixed
from scipy import stats
from stan_data import one_test_data
from synthetic_fit import make_fit
from truths import truth_of

from pyburgers.cmdstan.program import load_program
from pyburgers.common.atomic_files import write_json
from pyburgers.common.errors import InputError, SamplingError, SystemFailureError
from pyburgers.fitting.fit import Fit, fit_problem
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forced_oscillation.experiment import with_background
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forced_oscillation.preparation import Background, prepare
from pyburgers.kinds.forward import simulate, simulate_data
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import Problem, one_test, problem_of
from pyburgers.kinds.program_data import given_parameters
from pyburgers.kinds.stan_data import REFERENCE_SOLVER
from pyburgers.model.pooling import pooling_of
from pyburgers.model.priors import default_priors, load_priors
from pyburgers.posterior.labelled_draws import convergence_table, largest_rhat
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory
from pyburgers.sbc.data_sets import (
    LOG_LIKELIHOOD,
    RHAT_LIMIT,
    DataSetPlan,
    Simulated,
    calibration_priors,
    check_template,
    rank_truth,
    replicate,
    simulate_from_prior,
)
from pyburgers.sbc.replication import simulation_file
from pyburgers.sbc.run import CalibrationPlan, _replicate_into

SHARED_EXPONENT = {"all": "separate", "stress_exponent": "shared"}
TEMPLATES = ICE.parent / "calibration"
OLIVINE = ICE.parent / "olivine" / "olivine_twin.toml"


def test_simulated_data_are_the_solution_at_a_prior_draw_with_noise(programs: None) -> None:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    priors = resolved_priors(experiment)
    template = one_test(experiment, priors)
    simulated = simulate_from_prior(template, seed=4)
    (test,), (again,) = (
        one.problem.experiments for one in (simulated, simulate_from_prior(template, seed=4))
    )
    np.testing.assert_array_equal(test.response, again.response)
    assert test.provenance.kind == "synthetic"
    truth = truth_of(test)
    solution = simulate(experiment, truth, at=np.unique(experiment.strain))
    stress = np.interp(experiment.strain, solution["strain"], solution["stress_Pa"])
    deviation = (test.response - stress) / truth["stress_noise"]
    # A sum of 61 squares of standard normal numbers.
    assert stats.chi2(experiment.n_points).cdf(float(np.sum(deviation**2))) == pytest.approx(
        0.5, abs=0.4999
    )
    assert simulated.n_unsolvable == 0


def test_a_simulated_record_is_prepared_as_the_measured_one_is(programs: None) -> None:
    experiment = with_background(load_forced_oscillation(OLIVINE), "removed")
    truth = dict(experiment.true_parameters or {})
    rng = np.random.default_rng(2)
    simulated = simulate_data(experiment, truth, rng, source="the truth")
    assert simulated.settings == experiment.settings
    np.testing.assert_array_equal(simulated.prepared.time, experiment.prepared.time)
    np.testing.assert_array_equal(simulated.stress, simulated.prepared.stress)
    # Two draws of the noise on one solution, both without trend.
    difference = (simulated.stress - experiment.stress) / truth["stress_noise"]
    assert np.sqrt(np.mean(difference**2)) < 4.0
    quiet = simulate_data(
        experiment, {**truth, "stress_noise": 1.0}, np.random.default_rng(2), source="the truth"
    )
    deviation = (simulated.stress - quiet.stress) / experiment.prepared.uncertainty
    assert 0.7 < np.std(deviation) < 1.3


def test_the_trend_leaves_as_much_noise_as_the_likelihood_expects(programs: None) -> None:
    # The log likelihood at the truth is stationary in the noise s, in the mean over records, if the
    # mean sum of squares is the power of s that its normalisation falls with. That mean is the sum
    # over records with one noisy point.
    experiment = with_background(load_forced_oscillation(OLIVINE), "removed")
    truth = dict(experiment.true_parameters or {})
    sure = np.full_like(experiment.record.strain, 1e-12)
    experiment = replace(experiment, record=replace(experiment.record, strain_uncertainty=sure))
    quiet = simulate_data(
        experiment, {**truth, "stress_noise": 1.0}, np.random.default_rng(1), source="the truth"
    )
    model = load_program(likelihood_of(quiet).program)

    def log_likelihood(log_factor: float) -> float:
        values = {**truth, "stress_noise": truth["stress_noise"] * np.exp(log_factor)}
        data = one_test_data(quiet, given_parameters("olivine", values), solver=REFERENCE_SOLVER)
        return float(model.evaluate(data)["log_lik"].sum())

    step = 0.1
    loss = (log_likelihood(-step) - log_likelihood(step)) / (2 * step)
    noise = truth["stress_noise"] * quiet.prepared.relative_uncertainty
    # Over the readings, without their own weighted trend.
    position = 2 * (quiet.prepared.time - quiet.prepared.time[0]) / np.ptp(quiet.prepared.time) - 1
    degree, squares = quiet.prepared.stress_fit.degree, 0.0
    for one in np.eye(quiet.n_points):
        trend = np.polyval(np.polyfit(position, noise * one, degree, w=1 / noise), position)
        squares += float(np.sum((one - trend / noise) ** 2))
    assert squares == pytest.approx(loss, abs=0.02)
    assert squares == pytest.approx(quiet.n_points - degree - 1)


def test_draws_without_solution_are_counted_and_replaced(
    programs: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    priors = resolved_priors(experiment)
    refused = 2

    def solve_from_the_third_on(*arguments: Any, **options: Any) -> object:
        nonlocal refused
        if refused > 0:
            refused -= 1
            raise SamplingError("no solution")
        return simulate(*arguments, **options)

    monkeypatch.setattr("pyburgers.sbc.data_sets.simulate", solve_from_the_third_on)
    template = one_test(experiment, priors)
    simulated = simulate_from_prior(template, seed=4)
    assert (simulated.n_unsolvable, simulated.n_outside) == (2, 0)
    rng = np.random.default_rng(4)
    third = [priors.sample(rng) for _ in range(3)][2]
    assert simulated.problem.experiments[0].true_parameters == third
    refused = 10**6
    monkeypatch.setattr("pyburgers.sbc.data_sets.PRIOR_ATTEMPTS", 20)
    with pytest.raises(SamplingError, match=r"none of 20 draws from the prior .* bounds"):
        simulate_from_prior(template, seed=4)


def stress_of(test: Experiment) -> float:
    return test.largest_stress


def strain_of(test: Experiment) -> float:
    return test.largest_strain_read or 0.0


@pytest.mark.parametrize(
    ("template", "limit", "low", "high", "number", "largest"),
    [
        # Half of the draws of Table 1 lie above 70 MPa.
        (ICE / "PIL40.toml", "stress_range", 5e6, 20e6, 2, stress_of),
        # At one imposed stress the whole priors creep from nothing to many times the length.
        (TEMPLATES / "ice_creep.toml", "strain_range", 0.01, 0.3, 2, strain_of),
    ],
)
def test_data_sets_outside_a_range_are_counted_and_replaced(
    template: Path,
    limit: str,
    low: float,
    high: float,
    number: int,
    largest: Callable[[Experiment], float],
    programs: None,
) -> None:
    own = template.parent / "priors" / template.name
    priors = load_priors(own) if own.is_file() else calibration_priors("ice")
    problem = one_test(load_experiment(template), priors)
    ranges: dict[str, Any] = {limit: (low, high)}
    made = [simulate_from_prior(problem, seed=seed, **ranges) for seed in range(number)]
    found = [largest(one.problem.experiments[0]) for one in made]
    assert low <= min(found) < max(found) <= high
    assert sum(one.n_outside for one in made) > number


def test_tests_of_a_joint_template_share_what_is_shared(programs: None) -> None:
    experiments = [load_constant_rate(ICE / f"{name}.toml") for name in ("PIL40", "PIL72")]
    template = problem_of(experiments, calibration_priors("ice"), pooling_of(SHARED_EXPONENT))
    simulated = simulate_from_prior(template, seed=3)
    first, second = (one.true_parameters or {} for one in simulated.problem.experiments)
    assert template.shared
    for name in template.free:
        assert (first[name] == second[name]) == (name in template.shared)
    assert simulated.problem.pooling == template.pooling


def test_partially_pooled_parameters_lie_about_their_centre(
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """On the real line, where the spread is that of the tests; the tests are not solved."""

    def with_truth(
        experiment: Experiment, values: dict[str, float], *_: object, **__: object
    ) -> Experiment:
        return replace(experiment, true_parameters=values)

    monkeypatch.setattr("pyburgers.sbc.data_sets.simulate", lambda *_, **__: None)
    monkeypatch.setattr("pyburgers.sbc.data_sets.simulate_data", with_truth)
    pair = [load_constant_rate(ICE / f"{name}.toml") for name in ("PIL40", "PIL72")]
    pooling = pooling_of({"all": "separate", "stress_exponent": "partial:0.3"})
    template = problem_of(pair, calibration_priors("ice"), pooling)
    check_template(template)
    coordinates = template.coordinates[0]
    k = coordinates.parameters.index("stress_exponent")
    distances, spreads = [], []
    for seed in range(60):
        simulated = simulate_from_prior(template, seed=seed)
        centre, spread = (
            simulated.pooled[f"stress_exponent[{owner}]"] for owner in ("centre", "spread")
        )
        spreads.append(spread)
        for test in simulated.problem.experiments:
            drawn = (test.true_parameters or {})["stress_exponent"]
            distance = coordinates.of_quantity(k, drawn) - coordinates.of_quantity(k, centre)
            distances.append(float(distance) / spread)
    assert stats.kstest(distances, "norm").pvalue > 0.01
    assert stats.kstest(spreads, stats.halfnorm(scale=0.3).cdf).pvalue > 0.01


def test_every_quantity_of_a_joint_fit_is_ranked(tmp_path: Path, programs: None) -> None:
    """Under the names of the templates, which data sets have in common."""
    pair = [load_constant_rate(ICE / f"{name}.toml") for name in ("PIL40", "PIL72")]
    free = ("maxwell_modulus", "activation_enthalpy", "stress_noise")
    truth = dict(pair[0].true_parameters or {})
    priors = calibration_priors("ice")
    priors = with_fixed(priors, {name: truth[name] for name in priors.free if name not in free})
    pooling = pooling_of(
        {"all": "separate", "activation_enthalpy": "shared", "maxwell_modulus": "partial"}
    )
    template = problem_of(pair, priors, pooling)
    simulated = simulate_from_prior(template, seed=2)
    options = SamplerOptions(chains=1, warmup=20, draws=40, max_treedepth=3, coordinates="plain")
    result = fit_problem(simulated.problem, out=tmp_path, options=options, command="test")
    ranks = rank_truth(result, simulated, template, 39)
    own = ("maxwell_modulus", "stress_noise", "reference_stress")
    assert set(ranks) == {
        "activation_enthalpy",
        "maxwell_modulus[centre]",
        "maxwell_modulus[spread]",
        *(f"{name}[{test.id}]" for name in own for test in pair),
        LOG_LIKELIHOOD,
    }
    draws = result.posterior["posterior"].to_dataset()
    second = simulated.problem.experiments[1]
    drawn = draws[f"stress_noise[{second.id}]"].to_numpy().ravel()
    kept = drawn[np.linspace(0, drawn.size - 1, 39).astype(int)]
    below = int(np.sum(kept < (second.true_parameters or {})["stress_noise"]))
    assert ranks["stress_noise[PIL72]"] == below


@pytest.mark.parametrize("background", ["removed", "kept"])
def test_strains_are_simulated_too_and_their_errors_are_known(
    background: Background, programs: None
) -> None:
    template = with_background(load_forced_oscillation(OLIVINE), background)
    record = replace(template.record, strain_uncertainty=np.full_like(template.record.strain, 1e-4))
    template = replace(
        template, record=record, prepared=prepare(record, template.settings, template.id)
    )
    truth = dict(template.true_parameters or {})
    simulated = simulate_data(template, truth, np.random.default_rng(5), source="the truth")
    strain = template.prepared.strain_fit
    noise = simulated.record.strain - strain.periodic(record.strain_time)
    noise -= strain.trend(record.strain_time)
    assert np.std(noise) == pytest.approx(1e-4, rel=0.2)
    assert simulated.prepared.start_stress == template.prepared.start_stress
    error = simulated.driving_error(template)
    assert error.size == (6 if background == "removed" else 8)
    assert 0.1 < np.sqrt(np.mean(error**2)) < 2.5
    found, true = (
        (one.strain_fit.sine, one.strain_fit.cosine, one.background_rate)
        for one in (simulated.prepared, template.prepared)
    )
    change = np.split(error @ simulated.prepared.strain_error, [3, 6])
    for part, one, expected in zip(change, found, true, strict=True):
        np.testing.assert_allclose(one + part, expected, atol=1e-9 * np.abs(expected).max())


def test_a_fit_that_does_not_converge_is_repeated_longer_and_never_ranked(
    small_fit: Fit, tmp_path: Path, programs: None, monkeypatch: pytest.MonkeyPatch
) -> None:
    lengths: list[tuple[int, int | None, float | None]] = []

    def fitted(problem: Problem, *, out: Path, options: SamplerOptions, command: str) -> Fit:
        lengths.append((options.draws, options.warmup, options.adapt_delta))
        return small_fit

    monkeypatch.setattr("pyburgers.sbc.data_sets.fit_problem", fitted)
    monkeypatch.setattr("pyburgers.sbc.data_sets.not_converged", lambda *_: ("divergences",))
    template = one_test(load_constant_rate(ICE / "PIL40.toml"), calibration_priors("ice"))
    options = SamplerOptions(warmup=100, draws=50, adapt_delta=0.8)
    plan = DataSetPlan(n_ranked=19, refits=2, sampler=options)
    done = replicate(template, tmp_path, seed=1, plan=plan)
    assert lengths == [
        (50, 100, 0.8),
        (200, 400, pytest.approx(0.95)),
        (800, 1600, pytest.approx(0.9875)),
    ]
    assert (done.ranks, done.n_refits, done.failed_checks) == ({}, 2, ("divergences",))
    # Where nothing diverged a stricter target would only cost steps.
    lengths.clear()
    monkeypatch.setattr("pyburgers.sbc.data_sets.not_converged", lambda *_: ("R-hat",))
    replicate(template, tmp_path, seed=1, plan=plan)
    assert lengths == [(50, 100, 0.8), (200, 400, 0.8), (800, 1600, 0.8)]
    # A repetition of its own goes by what the fit before it failed.
    lengths.clear()
    for failed in (("R-hat",), ("divergences", "R-hat")):
        before = done.model_copy(update={"n_refits": 1, "failed_checks": failed})
        replicate(template, tmp_path, seed=1, plan=plan, before=before)
    assert lengths == [(800, 1600, 0.8), (800, 1600, pytest.approx(0.9875))]


def test_a_chain_that_the_system_killed_is_run_again(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Its data set has the outcome of one in which nothing was killed."""
    whole = make_fit(tmp_path / "fit", chains=2)
    failure = {"chain": 2, "reason": "Chain 2 was killed.", "by_system": True}
    one_chain = xr.DataTree.from_dict(
        {"posterior": whole.posterior["posterior"].to_dataset().isel(chain=[0])}
    )
    lost = replace(whole, posterior=one_chain, manifest={**whole.manifest, "failures": [failure]})
    fits: list[Fit] = []

    def fitted(problem: Problem, **_: object) -> Fit:
        return fits.pop(0)

    monkeypatch.setattr("pyburgers.sbc.data_sets.fit_problem", fitted)
    monkeypatch.setattr("pyburgers.sbc.data_sets.rank_truth", lambda *_: {"beta": 7})
    monkeypatch.setattr("pyburgers.sbc.data_sets.not_converged", lambda *_: ())
    monkeypatch.setattr(
        "pyburgers.sbc.data_sets.simulate_from_prior",
        lambda *_, **__: Simulated(whole.problem, {}, 0, 0),
    )
    monkeypatch.setattr("pyburgers.sbc.run.recorded_problem", lambda *_: whole.problem)
    plan = CalibrationPlan(simulations=1, sampler=SamplerOptions(warmup=100, adapt_delta=0.8))
    outcomes = []
    for out, fits[:] in (("a", [lost, lost, whole]), ("b", [whole])):
        run = RunDirectory(tmp_path / out)
        (run.path / "simulations").mkdir(parents=True)
        write_json(run.manifest_file, {})
        assert _replicate_into(run.path, 1, plan) == "ranked"
        outcomes.append(simulation_file(run, 1).read_bytes())
    assert outcomes[0] == outcomes[1]
    fits[:] = [lost] * 3
    with pytest.raises(SystemFailureError, match="Chain 2 was killed"):
        _replicate_into(run.path, 2, plan)
    assert not simulation_file(run, 2).exists()


def test_ranks_count_the_draws_below_the_truth(small_fit: Fit) -> None:
    truth = truth_of(small_fit.experiment)
    draws = small_fit.posterior["posterior"].to_dataset()["maxwell_modulus"].to_numpy().ravel()
    simulated = Simulated(small_fit.problem, {}, 0, 0)
    ranks = rank_truth(small_fit, simulated, small_fit.problem, draws.size)
    assert ranks["maxwell_modulus"] == int(np.sum(draws < truth["maxwell_modulus"]))
    assert set(ranks) == {*small_fit.priors.free, "reference_stress", LOG_LIKELIHOOD}
    high = replace(small_fit.experiment, true_parameters={**truth, "maxwell_modulus": 1e12})
    problem = replace(small_fit.problem, experiments=(high,))
    ranks = rank_truth(small_fit, replace(simulated, problem=problem), problem, 50)
    assert ranks["maxwell_modulus"] == 50
    assert ranks[LOG_LIKELIHOOD] == 0  # such a modulus fits far worse than any draw


def test_rhat_of_a_single_chain_compares_its_halves(
    long_fit: Fit, caplog: pytest.LogCaptureFixture
) -> None:
    single = long_fit.posterior.isel(chain=[0])
    assert convergence_table(single)["rhat"].isna().all()
    assert largest_rhat(single) < RHAT_LIMIT
    assert largest_rhat(long_fit.posterior) == convergence_table(long_fit.posterior)["rhat"].max()
    drifting = single.copy(deep=True)
    modulus = drifting["posterior"]["maxwell_modulus"]
    modulus += 3 * float(modulus.std()) * np.linspace(0, 1, modulus.size)
    assert largest_rhat(drifting) > RHAT_LIMIT
    assert not caplog.records


def test_templates_need_data_and_priors_that_are_the_same_for_all_tests() -> None:
    empty = replace(load_constant_rate(ICE / "PIL40.toml"), strain=np.empty(0), stress=np.empty(0))
    with pytest.raises(InputError, match=r"no data, expected a \[data\] table"):
        problem_of([empty], default_priors("ice"))
    pair = [load_constant_rate(ICE / f"{name}.toml") for name in ("PIL40", "PIL105")]
    with pytest.raises(InputError, match=r"stress_noise is a share of the largest stress"):
        check_template(problem_of(pair, default_priors("ice"), pooling_of(SHARED_EXPONENT)))
    known = dict.fromkeys(calibration_priors("ice").free, 1.0)
    with pytest.raises(InputError, match=r"all parameters are fixed"):
        check_template(problem_of(pair, with_fixed(calibration_priors("ice"), known)))


def test_calibrations_use_the_priors_of_the_paper_with_noise_that_is_never_next_to_none() -> None:
    assert calibration_priors("dunite") == default_priors("dunite")
    assert calibration_priors("ice", "constant_rate") == calibration_priors("ice")
    assert calibration_priors("ice", "attenuation") == default_priors("ice", "attenuation")
    for material in ("ice", "olivine"):
        found, paper = calibration_priors(material), default_priors(material)
        for name in paper.free:
            same = [
                (prior.family, prior.location, prior.scale, prior.lower, prior.upper)
                for prior in (found[name], paper[name])
            ]
            assert (same[0] == same[1]) == (name != "stress_noise"), name
        assert not any(prior.relative_to_max_stress for prior in found.priors.values())


@pytest.mark.parametrize("file", sorted(TEMPLATES.glob("*.toml")), ids=lambda file: file.stem)
def test_shipped_templates_can_be_simulated(file: Path, programs: None) -> None:
    template = one_test(
        experiment := load_experiment(file), calibration_priors(experiment.material)
    )
    check_template(template)
    simulated = simulate_from_prior(template, seed=1, stress_range=(1e6, 1e9))
    (test,) = simulated.problem.experiments
    assert 1e6 <= test.largest_stress <= 1e9
    assert test.n_points == experiment.n_points
    if file.stem == "ice_mixed":
        priors = load_priors(TEMPLATES / "priors" / file.name)
        assert {"stress_noise", "strain_noise"} <= set(one_test(experiment, priors).free)
