"""The paper's statements: verdicts follow the draws, and flip when the draws are changed."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from known import make_known
from maor.flow_law import rates_of_undeformed
from maor.ice import ice_statements
from maor.ice_curves import misfit_at_peak, peaks
from maor.olivine_statements import STRESS_AMPLITUDE, olivine_statements
from maor.sections import paper_statements
from maor.statements import Statement, Verdict
from synthetic_fit import make_fit, uniform
from synthetic_olivine_fit import make_olivine_fit, normal, oscillating, redrawn

from pyburgers.common.array_types import FloatArray
from pyburgers.drawing.views.oscillation_response import predicted_response
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, RateSegment
from pyburgers.model.priors import PriorSet


@pytest.fixture(scope="module")
def ice(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("ice"), draws=250)


@pytest.fixture(scope="module")
def olivine(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_olivine_fit(tmp_path_factory.mktemp("olivine"))


@pytest.fixture(autouse=True)
def same_rates(monkeypatch: pytest.MonkeyPatch) -> None:
    """Leave out the flow law: every statement is judged each time, and one needs it."""
    monkeypatch.setattr("maor.ice.rates_of_undeformed", lambda *_: np.ones((1, 1)))


def by_key(statements: tuple[Statement, ...]) -> dict[str, Statement]:
    return {statement.key: statement for statement in statements}


def of_ice(key: str, **fits: Fit) -> Statement:
    return by_key(ice_statements({name: make_known(fit) for name, fit in fits.items()}))[key]


def of_olivine(key: str, **fits: Fit) -> Statement:
    return by_key(olivine_statements({name: make_known(fit) for name, fit in fits.items()}))[key]


def about(mean: float, sd: float) -> Callable[[Fit], FloatArray]:
    return lambda fit: normal(fit, mean, sd)


def flat(fit: Fit) -> FloatArray:
    return np.random.default_rng(4).uniform(7e8, 9e10, normal(fit, 0, 1).shape)


def critical_strain(low: float, width: float) -> Callable[[Fit], FloatArray]:
    def draws(fit: Fit) -> FloatArray:
        shape = normal(fit, 0, 1).shape
        return low + width * np.random.default_rng(5).uniform(1e-3, 1.0, shape)

    return draws


OF_DRAWS: list[tuple[str, str, Callable[[Fit], FloatArray], Verdict, str]] = [
    ("stress_exponent_of_PIL40", "stress_exponent", about(mean, sd), verdict, f"mean {mean:.1f}")
    for mean, sd, verdict in (
        (4.1, 0.05, Verdict.AGREES),
        (3.9, 0.4, Verdict.CANNOT_TELL),
        (3.3, 0.1, Verdict.DISAGREES),
    )
]
OF_DRAWS += [
    ("critical_strain_grain_size_of_PIL40", "critical_strain_grain_size", draws, verdict, "")
    for draws, verdict in (
        (about(0.031, 0.004), Verdict.AGREES),
        (about(0.074, 0.004), Verdict.DISAGREES),
    )
]
OF_DRAWS += [
    ("kelvin_modulus_of_olivine", "kelvin_modulus", about(45e9, sd), verdict, "")
    for sd, verdict in (
        (2e9, Verdict.AGREES),
        (13e9, Verdict.CANNOT_TELL),
        (24e9, Verdict.PRIOR_EXCLUDES),
    )
]
OF_DRAWS += [
    ("shape_of_kelvin_modulus", "kelvin_modulus", about(25e9, 2e9), Verdict.AGREES, ""),
    ("shape_of_kelvin_modulus", "kelvin_modulus", flat, Verdict.PRIOR_EXCLUDES, ""),
    ("stress_exponent_of_olivine", "stress_exponent", about(3.02, 0.08), Verdict.AGREES, ""),
    ("stress_exponent_of_olivine", "stress_exponent", about(3.6, 0.08), Verdict.DISAGREES, ""),
]
OF_DRAWS += [
    (
        "critical_strain_of_olivine",
        "critical_strain_grain_size",
        critical_strain(low, width),
        verdict,
        "chains agree",
    )
    for low, width, verdict in (
        (0.0, 1.0, Verdict.PRIOR_GRANTS),
        (0.3, 0.7, Verdict.CANNOT_TELL),
        (0.3, 0.1, Verdict.DISAGREES),
    )
]


@pytest.mark.parametrize(("key", "parameter", "draws", "verdict", "evidence"), OF_DRAWS)
def test_what_the_paper_says_of_a_parameter_is_looked_for_in_its_draws(
    key: str,
    parameter: str,
    draws: Callable[[Fit], FloatArray],
    verdict: Verdict,
    evidence: str,
    ice: Fit,
    olivine: Fit,
) -> None:
    of_ice_alone = key.endswith("PIL40")
    source = ice if of_ice_alone else olivine
    fit = redrawn(source, **{parameter: draws(source)})
    statement = (
        of_ice(key, PIL40=fit)
        if of_ice_alone
        else of_olivine(key, **({"removed": fit} if "chains" in evidence else {"kept": fit}))
    )
    assert statement.verdict is verdict
    assert evidence in statement.evidence


def test_chains_that_disagree_are_mentioned_and_one_has_nothing_to_agree_with(olivine: Fit) -> None:
    draws = normal(olivine, 0.5, 0.1)
    draws[0] += 0.3
    fit = redrawn(olivine, critical_strain_grain_size=draws)
    key = "critical_strain_of_olivine"
    assert "chains do not agree" in of_olivine(key, kept=fit).evidence
    groups = {
        name: node.to_dataset().isel(chain=[0], missing_dims="ignore")
        for name, node in olivine.posterior.children.items()
    }
    fit = replace(olivine, posterior=xr.DataTree.from_dict(groups))
    told = of_olivine(key, kept=fit).evidence
    assert "not known whether chains agree (R-hat nan)" in told


def test_what_peak_stress_and_other_priors_narrow_is_not_credited_to_the_curve(ice: Fit) -> None:
    fit = redrawn(ice, stress_exponent=normal(ice, 4.0, 0.08))
    drawn = (
        make_known(fit, n_draws=1000)
        .prior.posterior["posterior"]["stress_exponent"]
        .to_numpy()
        .ravel()
    )
    # The draws that meet the peak stress have n within 0.2 of 4, by the priors of Q_M and beta.
    close = np.abs(drawn - 4.0) < 0.2
    known = make_known(fit, n_draws=1000, weights=close / close.sum())
    statement = by_key(ice_statements({"PIL40": known}))["stress_exponent_of_PIL40"]
    (belief,) = statement.beliefs.values()
    assert belief.prior == pytest.approx(0.5 / 1.8, abs=0.1)
    assert belief.number == pytest.approx(1.0)
    assert belief.effective_draws == pytest.approx(close.sum())
    assert statement.verdict is Verdict.NUMBER_GRANTS


def test_another_sample_says_nothing_about_pil40(ice: Fit) -> None:
    assert paper_statements({}, {}, {}) == ()
    keys = by_key(ice_statements({"PIL72": make_known(ice)})).keys()
    assert not any("PIL40" in key for key in keys)
    assert "most_uncertain" in keys
    assert not {"narrow_posteriors", "mechanism"} & set(keys)


def test_a_fabric_factor_that_the_prior_keeps_below_one_is_no_finding(ice: Fit) -> None:
    statement = of_ice("softer_fabric", PIL40=ice)
    assert statement.verdict is Verdict.CANNOT_FAIL
    above = ice.priors.exchanging(uniform("steady_state_fabric_factor", 0.1, 1.9))
    known = make_known(_with_priors(ice, above))
    statement = by_key(ice_statements({"PIL40": known}))["softer_fabric"]
    assert statement.verdict is Verdict.AGREES


def _with_priors(fit: Fit, priors: PriorSet) -> Fit:
    return replace(fit, problem=replace(fit.problem, given_priors=priors, priors=(priors,)))


def test_the_kelvin_element_is_most_uncertain_if_it_has_the_largest_relative_spread(
    ice: Fit,
) -> None:
    uncertain = redrawn(
        ice,
        kelvin_modulus=np.abs(normal(ice, 1.0, 0.8)) * 1e9,
        kelvin_viscosity=np.abs(normal(ice, 1.0, 0.8)) * 1e11,
        critical_strain_fabric=normal(ice, 0.1, 0.01),
    )
    wide = np.random.default_rng(1).uniform(0.0, 1.0, 400) ** 3

    def judged(fit: Fit) -> Verdict:
        known = make_known(fit, critical_strain_fabric=0.01 + 0.4 * wide)
        return by_key(ice_statements({"PIL40": known}))["most_uncertain"].verdict

    assert judged(uncertain) is Verdict.AGREES
    assert judged(ice) is Verdict.PRIOR_EXCLUDES  # make_fit leaves eps_c2 wider, as the prior has
    viscosity = np.abs(normal(ice, 1.0, 0.8)) * 1e11
    viscosity[0] += 4e11
    assert judged(redrawn(uncertain, kelvin_viscosity=viscosity)) is Verdict.PRIOR_EXCLUDES


def with_solutions(fit: Fit, peak_strain: float, *, factor: float = 1.0) -> Fit:
    """Let all solutions peak at a strain, at a multiple of the observed peak stress."""
    groups = {name: node.to_dataset() for name, node in fit.posterior.children.items()}
    predictions = groups["predictions"]
    strain = predictions["strain"].to_numpy()
    relative = strain / peak_strain
    curve = factor * float(fit.experiment.response.max()) * relative * np.exp(1 - relative)
    stress = np.broadcast_to(curve, predictions["stress"].shape)
    groups["predictions"] = predictions.assign(stress=(predictions["stress"].dims, stress))
    return replace(fit, posterior=xr.DataTree.from_dict(groups))


def test_the_peak_of_a_solution_is_found_between_its_points(ice: Fit) -> None:
    strain, stress = peaks(with_solutions(ice, 0.0307))
    assert strain == pytest.approx(np.full(strain.size, 0.0307), abs=5e-4)
    assert stress == pytest.approx(np.full(strain.size, ice.experiment.response.max()), rel=1e-3)


def test_peaks_are_looked_for_near_3_percent(ice: Fit) -> None:
    prior = make_known(ice).prior.posterior["predictions"]["stress"].to_numpy()[0]
    for at, verdict in ((0.031, Verdict.AGREES), (0.045, Verdict.DISAGREES)):
        fit = with_solutions(ice, at)
        spread = np.where(np.arange(len(prior))[:, None] % 2, prior, prior[:, ::-1])
        near = with_solutions(ice, 0.03).posterior["predictions"]["stress"].to_numpy()[0, 0]
        spread[::3] = near
        statement = by_key(ice_statements({"PIL40": make_known(fit, stress=spread)}))
        assert statement["peak_strain"].verdict is verdict


def test_a_few_minutes_are_ten_at_most(ice: Fit) -> None:
    rate = 8e-5
    assert isinstance(ice.experiment, ConstantRateExperiment)
    slower = replace(ice.experiment, segments=(RateSegment(0.0, rate),))
    slow = replace(ice, problem=replace(ice.problem, experiments=(slower,)))
    for strain, verdict in ((0.02, Verdict.AGREES), (0.08, Verdict.DISAGREES)):
        fit = with_solutions(slow, strain)
        grid = fit.posterior["predictions"]["strain"].to_numpy()
        peak = np.random.default_rng(2).uniform(0.02, 0.1, (400, 1))
        known = make_known(fit, stress=8e6 * grid / peak * np.exp(1 - grid / peak))
        statement = by_key(ice_statements({"PIL40": known}))["time_of_peak"]
        assert statement.verdict is verdict
        minutes = float(statement.evidence.split()[-2])
        assert minutes == pytest.approx(strain / rate / 60, abs=0.2)


def test_strength_is_sensitive_where_its_exponent_is_large(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("maor.ice.rates_of_undeformed", rates_of_undeformed)
    ice = make_fit(tmp_path, draws=30)

    def judged(fit: Fit) -> Statement:
        return by_key(ice_statements({"PIL40": make_known(fit, n_draws=100)}))["sensitivity"]

    statement = judged(ice)
    assert statement.verdict is Verdict.CANNOT_FAIL
    n, enthalpy, beta = (
        ice.posterior["posterior"][name].to_numpy()
        for name in ("stress_exponent", "activation_enthalpy", "beta")
    )
    changed = np.abs(np.exp(-0.01 * enthalpy * beta / n) - 1)
    assert f"PIL40 {100 * np.median(changed):.0f} % and" in statement.evidence
    cold = redrawn(ice, activation_enthalpy=normal(ice, 1e3, 1.0))
    assert judged(cold).beliefs["PIL40"].posterior == 0


def test_first_draws_that_differ_from_chain_to_chain_need_a_burn_in(ice: Fit) -> None:
    assert of_ice("burn_in", PIL40=ice).verdict is Verdict.CANNOT_TELL
    draws = normal(ice, 4.0, 0.1)
    draws[0, :40] += 3.0
    statement = of_ice("burn_in", PIL40=redrawn(ice, stress_exponent=draws))
    assert statement.verdict is Verdict.DISAGREES


def test_the_faster_test_is_compared_with_the_slower_at_its_peak(ice: Fit) -> None:
    assert isinstance(ice.experiment, ConstantRateExperiment)
    slower = replace(ice.experiment, segments=(RateSegment(0.0, 1e-5),))
    slow = replace(ice, problem=replace(ice.problem, experiments=(slower,)))
    curves = make_known(ice).prior.posterior["predictions"]["stress"].to_numpy()[0]
    anywhere = curves * np.random.default_rng(1).uniform(0.5, 1.5, (len(curves), 1))

    def compared(fast: Fit, slow: Fit) -> Statement:
        fits = {"PIL40": fast, "PIL72": slow}
        known = {name: make_known(fit, stress=anywhere) for name, fit in fits.items()}
        return by_key(ice_statements(known))["error_at_peak"]

    missed, met = with_solutions(ice, 0.03, factor=0.8), with_solutions(slow, 0.03)
    assert misfit_at_peak(missed).min() > 2 * misfit_at_peak(met).max()
    assert compared(missed, met).verdict is Verdict.AGREES
    statement = compared(with_solutions(ice, 0.03), with_solutions(slow, 0.03, factor=0.8))
    assert statement.verdict is Verdict.DISAGREES
    assert list(statement.beliefs) == ["PIL40 against PIL72"]
    assert "error_at_peak" not in by_key(ice_statements({"PIL40": make_known(ice)}))


def test_the_solution_at_the_mean_has_to_stay_in_the_band(ice: Fit) -> None:
    groups = {name: node.to_dataset() for name, node in ice.posterior.children.items()}
    mean = groups["posterior_mean_solution"]
    noise = float(groups["posterior"]["stress_noise"].mean())
    assert of_ice("mean_solution", PIL40=ice).verdict is Verdict.AGREES
    bump = 3.0 * noise * (np.abs(mean["strain"] - 0.05) < 0.01)
    groups["posterior_mean_solution"] = mean.assign(stress=mean["stress"] + bump)
    away = replace(ice, posterior=xr.DataTree.from_dict(groups))
    statement = of_ice("mean_solution", PIL40=away)
    assert statement.verdict is Verdict.PRIOR_EXCLUDES  # nor does that at the mean of the prior
    assert re.search(r"leaves the predictive band, (2.9|3.[01]) s", statement.evidence)


def test_an_offset_is_by_n_where_the_two_go_together(olivine: Fit) -> None:
    groups = {name: node.to_dataset() for name, node in olivine.posterior.children.items()}
    stress = groups["predictions"]["stress"]
    n = groups["posterior"]["stress_exponent"]
    other = n.copy(data=normal(olivine, 3.0, float(n.std())))
    level = 1e6 * np.sin(np.arange(stress.shape[-1]))
    known_stress = 1e8 * np.random.default_rng(3).normal(size=(400, 1)) + level
    for cause, answer in ((n, True), (other, False), (0 * n, None)):
        offset = (1e8 * cause).expand_dims({stress.dims[-1]: stress.sizes[stress.dims[-1]]}, 2)
        groups["predictions"] = groups["predictions"].assign(
            stress=(stress.dims, offset.to_numpy() + level)
        )
        fit = replace(olivine, posterior=xr.DataTree.from_dict(groups))
        known = make_known(fit, stress=known_stress)
        statement = by_key(olivine_statements({"kept": known}))["cause_of_offset"]
        assert statement.beliefs["kept"].posterior is answer
        assert statement.beliefs["kept"].prior is False
    assert "no draw has an offset" in statement.evidence


@pytest.mark.parametrize(
    ("amplitude_sd", "phase_sd", "verdict"),
    [
        (0.05, 0.01, Verdict.AGREES),
        (0.02, 0.02, Verdict.CANNOT_TELL),
        (0.01, 0.05, Verdict.DISAGREES),
    ],
)
def test_the_spread_of_stress_is_split_into_amplitude_and_phase(
    olivine: Fit, amplitude_sd: float, phase_sd: float, verdict: Verdict
) -> None:
    fit = oscillating(olivine, amplitude_sd=amplitude_sd, phase_sd=phase_sd)
    oscillation = predicted_response(fit)
    amplitude = oscillation.amplitude
    assert amplitude.std() / amplitude.mean() == pytest.approx(amplitude_sd, rel=0.1)
    assert oscillation.lag.std() == pytest.approx(phase_sd, rel=0.1)
    open_before = oscillating(olivine, amplitude_sd=0.02, phase_sd=0.02)
    stress = open_before.posterior["predictions"]["stress"].to_numpy().reshape(1000, -1)
    known = make_known(fit, n_draws=1000, stress=stress)
    statement = by_key(olivine_statements({"removed": known}))["spread_in_amplitude"]
    assert statement.verdict is verdict
    # A spread that the prior has already is no finding; treatments that differ decide nothing.
    key = "spread_in_amplitude"
    mostly, hardly = (
        oscillating(olivine, amplitude_sd=amplitude, phase_sd=phase)
        for amplitude, phase in ((0.05, 0.01), (0.01, 0.05))
    )
    assert of_olivine(key, removed=mostly).verdict is Verdict.PRIOR_GRANTS
    assert of_olivine(key, removed=mostly, kept=hardly).verdict is Verdict.CANNOT_TELL


def test_grain_growth_is_negligible_below_a_tenth(olivine: Fit) -> None:
    size = olivine.experiment.initial_grain_size
    groups = {name: node.to_dataset() for name, node in olivine.posterior.children.items()}
    predictions = groups["predictions"]
    shape = predictions["grain_size"].shape
    before = size * np.random.default_rng(1).uniform(0.7, 1.5, (400, 1)) * np.ones(shape[-1])
    for growth, verdict in ((1.03, Verdict.AGREES), (1.4, Verdict.DISAGREES)):
        grown = np.full(shape, growth * size)
        groups["predictions"] = predictions.assign(
            grain_size=(predictions["grain_size"].dims, grown)
        )
        fit = replace(olivine, posterior=xr.DataTree.from_dict(groups))
        known = make_known(fit, grain_size=before)
        statement = by_key(olivine_statements({"kept": known}))["grain_growth_of_olivine"]
        assert statement.verdict is verdict


def test_the_one_number_of_an_oscillation_is_its_amplitude(olivine: Fit) -> None:
    known = make_known(oscillating(olivine, amplitude_sd=0.0, phase_sd=0.01, amplitude_factor=1.5))
    observed, predicted = (
        STRESS_AMPLITUDE.observed(known.prior),
        STRESS_AMPLITUDE.predicted(known.prior),
    )
    assert predicted == pytest.approx(np.full(predicted.size, 1.5 * observed), rel=1e-3)
