"""The paper's statements: verdicts follow the draws, and flip when the draws are changed."""

import re
from dataclasses import replace

import numpy as np
import numpy.typing as npt
import pytest
import xarray as xr
from known import make_known
from maor.ice import ice_statements
from maor.ice_curves import misfit_at_peak, peaks
from maor.olivine_statements import STRESS_AMPLITUDE, olivine_statements
from maor.sections import paper_statements
from maor.statements import Statement, Verdict
from synthetic_fit import make_fit, uniform
from synthetic_olivine_fit import make_olivine_fit, normal, oscillating, redrawn

from pyburgers.common.errors import InputError
from pyburgers.drawing.views.oscillation_response import predicted_response
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, RateSegment
from pyburgers.model.priors import PriorSet

FloatArray = npt.NDArray[np.float64]


@pytest.fixture(scope="module")
def ice(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("ice"), draws=250)


@pytest.fixture(scope="module")
def olivine(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_olivine_fit(tmp_path_factory.mktemp("olivine"))


def by_key(statements: tuple[Statement, ...]) -> dict[str, Statement]:
    return {statement.key: statement for statement in statements}


def of_ice(key: str, **fits: Fit) -> Statement:
    return by_key(ice_statements({name: make_known(fit) for name, fit in fits.items()}))[key]


def of_olivine(key: str, **fits: Fit) -> Statement:
    return by_key(olivine_statements({name: make_known(fit) for name, fit in fits.items()}))[key]


@pytest.mark.parametrize(
    ("mean", "sd", "verdict"),
    [
        (4.1, 0.05, Verdict.AGREES),
        (3.9, 0.4, Verdict.CANNOT_TELL),
        (3.3, 0.1, Verdict.DISAGREES),
    ],
)
def test_the_paper_s_value_is_looked_for_in_the_draws(
    ice: Fit, mean: float, sd: float, verdict: Verdict
) -> None:
    fit = redrawn(ice, stress_exponent=normal(ice, mean, sd))
    statement = of_ice("stress_exponent_of_PIL40", PIL40=fit)
    assert statement.verdict is verdict
    assert f"mean {mean:.1f}" in statement.evidence


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


def test_the_critical_strain_of_pil40_has_its_own_value(ice: Fit) -> None:
    for mean, verdict in ((0.031, Verdict.AGREES), (0.074, Verdict.DISAGREES)):
        fit = redrawn(ice, critical_strain_grain_size=normal(ice, mean, 0.004))
        statement = of_ice("critical_strain_grain_size_of_PIL40", PIL40=fit)
        assert statement.verdict is verdict


def test_another_sample_says_nothing_about_pil40(ice: Fit) -> None:
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


def test_strength_is_sensitive_where_its_exponent_is_large(ice: Fit) -> None:
    statement = of_ice("sensitivity", PIL40=ice)
    assert statement.verdict is Verdict.CANNOT_FAIL
    n, enthalpy, beta = (
        ice.posterior["posterior"][name].to_numpy()
        for name in ("stress_exponent", "activation_enthalpy", "beta")
    )
    changed = np.abs(np.exp(-0.01 * enthalpy * beta / n) - 1)
    assert f"PIL40 {100 * np.median(changed):.0f} % and" in statement.evidence
    cold = redrawn(ice, activation_enthalpy=normal(ice, 1e3, 1.0))
    assert of_ice("sensitivity", PIL40=cold).beliefs["PIL40"].posterior == 0


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


@pytest.mark.parametrize(
    ("spread", "verdict"),
    [(2e9, Verdict.AGREES), (13e9, Verdict.CANNOT_TELL), (24e9, Verdict.PRIOR_EXCLUDES)],
)
def test_the_kelvin_modulus_is_constrained_if_its_prior_has_shrunk(
    olivine: Fit, spread: float, verdict: Verdict
) -> None:
    fit = redrawn(
        olivine,
        kelvin_modulus=normal(olivine, 45e9, spread),
    )
    statement = of_olivine("kelvin_modulus_of_olivine", removed=fit, kept=fit)
    assert statement.verdict is verdict


def test_a_bell_is_told_from_a_flat_prior(olivine: Fit) -> None:
    flat = np.random.default_rng(4).uniform(7e8, 9e10, normal(olivine, 0, 1).shape)
    for draws, verdict in (
        (normal(olivine, 25e9, 2e9), Verdict.AGREES),
        (flat, Verdict.PRIOR_EXCLUDES),
    ):
        fit = redrawn(olivine, kelvin_modulus=draws)
        assert of_olivine("shape_of_kelvin_modulus", kept=fit).verdict is verdict


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


def test_the_critical_strain_is_free_where_it_has_its_prior(olivine: Fit) -> None:
    shape = normal(olivine, 0, 1).shape
    as_prior = np.random.default_rng(5).uniform(1e-3, 1.0, shape)
    expected: tuple[tuple[FloatArray, Verdict], ...] = (
        (as_prior, Verdict.PRIOR_GRANTS),
        (0.3 + 0.7 * as_prior, Verdict.CANNOT_TELL),
        (0.3 + 0.1 * as_prior, Verdict.DISAGREES),
    )
    for draws, verdict in expected:
        fit = redrawn(olivine, critical_strain_grain_size=draws)
        statement = of_olivine("critical_strain_of_olivine", removed=fit)
        assert statement.verdict is verdict
        assert "chains agree" in statement.evidence


def test_chains_that_disagree_are_mentioned(olivine: Fit) -> None:
    draws = normal(olivine, 0.5, 0.1)
    draws[0] += 0.3
    fit = redrawn(olivine, critical_strain_grain_size=draws)
    statement = of_olivine("critical_strain_of_olivine", kept=fit)
    assert "chains do not agree" in statement.evidence


def test_one_chain_has_nothing_to_agree_with(olivine: Fit) -> None:
    groups = {
        name: node.to_dataset().isel(chain=[0], missing_dims="ignore")
        for name, node in olivine.posterior.children.items()
    }
    fit = replace(olivine, posterior=xr.DataTree.from_dict(groups))
    statement = of_olivine("critical_strain_of_olivine", kept=fit)
    assert "not known whether chains agree (R-hat nan)" in statement.evidence


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


def test_a_spread_that_the_prior_has_already_is_no_finding(olivine: Fit) -> None:
    fit = oscillating(olivine, amplitude_sd=0.05, phase_sd=0.01)
    assert of_olivine("spread_in_amplitude", removed=fit).verdict is Verdict.PRIOR_GRANTS


def test_the_stress_exponent_of_olivine_is_looked_for_about_3(olivine: Fit) -> None:
    for mean, verdict in ((3.02, Verdict.AGREES), (3.6, Verdict.DISAGREES)):
        fit = redrawn(olivine, stress_exponent=normal(olivine, mean, 0.08))
        assert of_olivine("stress_exponent_of_olivine", kept=fit).verdict is verdict


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


def test_treatments_that_differ_leave_a_statement_undecided(olivine: Fit) -> None:
    fits = {
        "removed": oscillating(olivine, amplitude_sd=0.05, phase_sd=0.01),
        "kept": oscillating(olivine, amplitude_sd=0.01, phase_sd=0.05),
    }
    assert of_olivine("spread_in_amplitude", **fits).verdict is Verdict.CANNOT_TELL


def test_only_an_oscillation_has_amplitude_and_phase(ice: Fit) -> None:
    with pytest.raises(InputError, match="expected one of protocol 'forced_oscillation'"):
        predicted_response(ice)


def test_without_fits_there_is_nothing_to_say() -> None:
    assert paper_statements({}, {}, {}) == ()
