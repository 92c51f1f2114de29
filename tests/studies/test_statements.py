"""The paper's statements: verdicts follow the draws, and flip when the draws are changed."""

from collections.abc import Mapping
from dataclasses import replace
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import pytest
import xarray as xr
from synthetic_fit import make_fit
from synthetic_olivine_fit import make_olivine_fit, normal, oscillating, redrawn

from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit
from pyburgers.predictions.attenuation import attenuation_spectrum, predict_attenuation
from pyburgers.predictions.stress_cycles import amplitude_regimes
from pyburgers.protocols.forced_oscillation.response import stress_spread
from pyburgers.studies.maor.sections import paper_statements
from pyburgers.studies.maor.statements import (
    Statement,
    Verdict,
    statements_table,
)

FloatArray = npt.NDArray[np.float64]

TEMPERATURE, GRAIN_SIZE = 260.0, 230e-6
GAS_CONSTANT = 8.314462618

FLUIDITY = 6e-31
"""Dashpot (n = 4, Pa^-4 s^-1) that with `KELVIN` leaves a falling stretch at 1 MPa alone."""

KELVIN = MappingProxyType({"kelvin_modulus": 1e9, "kelvin_viscosity": 3e11})


@pytest.fixture(scope="module")
def ice(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("ice"), draws=250)


@pytest.fixture(scope="module")
def olivine(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_olivine_fit(tmp_path_factory.mktemp("olivine"))


def spectrum(
    *,
    exponent: float = 4.0,
    fluidity: float | FloatArray = FLUIDITY,
    kelvin: Mapping[str, float] = KELVIN,
) -> xr.Dataset:
    """Spectra of 40 draws; the dashpot flows at 1 MPa as with n = 4 whatever the exponent."""
    draws = np.ones(40)
    enthalpy = 60e3
    at_megapascal = np.broadcast_to(fluidity, draws.shape) * 1e6 ** (4.0 - exponent)
    return attenuation_spectrum(
        {
            "maxwell_modulus": 4e9 * draws,
            **{name: value * draws for name, value in kelvin.items()},
            "stress_exponent": exponent * draws,
            "grain_size_exponent": 0.0 * draws,
            "activation_enthalpy": enthalpy * draws,
            "beta": np.log(at_megapascal) / enthalpy + 1 / (GAS_CONSTANT * TEMPERATURE),
        },
        temperature=TEMPERATURE,
        grain_size=GRAIN_SIZE,
    )


def of_spectra(key: str, *spectra: xr.Dataset) -> Statement:
    named = {f"sample {k}": spectrum for k, spectrum in enumerate(spectra)}
    return by_key(paper_statements({}, named, {}))[key]


def by_key(statements: tuple[Statement, ...]) -> dict[str, Statement]:
    return {statement.key: statement for statement in statements}


@pytest.mark.parametrize(
    ("mean", "sd", "verdict"),
    [(4.1, 0.1, "agrees"), (3.9, 0.4, "undecided"), (3.3, 0.1, "does not agree")],
)
def test_the_paper_s_value_is_looked_for_in_the_interval(
    ice: Fit, mean: float, sd: float, verdict: Verdict
) -> None:
    fit = redrawn(ice, stress_exponent=normal(ice, mean, sd))
    statement = by_key(paper_statements({"PIL40": fit}, {}, {}))["stress_exponent_of_PIL40"]
    assert statement.verdict == verdict
    assert f"mean {mean:.1f}" in statement.evidence


def test_the_critical_strain_of_pil40_has_its_own_value(ice: Fit) -> None:
    for mean, verdict in ((0.031, "agrees"), (0.074, "does not agree")):
        fit = redrawn(ice, critical_strain_grain_size=normal(ice, mean, 0.004))
        statements = by_key(paper_statements({"PIL40": fit}, {}, {}))
        assert statements["critical_strain_grain_size_of_PIL40"].verdict == verdict


def test_another_sample_says_nothing_about_pil40(ice: Fit) -> None:
    assert {"narrow_posteriors"} == by_key(paper_statements({"PIL72": ice}, {}, {})).keys()


def scaled_priors_fit(fit: Fit, share: float, names: tuple[str, ...]) -> Fit:
    """Give some parameters draws with a share of their prior's standard deviation."""
    return redrawn(
        fit,
        **{
            name: normal(
                fit,
                float(fit.priors[name].distribution().mean()),
                share * float(fit.priors[name].distribution().std()),
            )
            for name in names
        },
    )


@pytest.mark.parametrize(
    ("n_narrow", "verdict"),
    [(11, "agrees"), (8, "agrees"), (5, "undecided"), (2, "does not agree")],
)
def test_narrow_posteriors_are_counted(ice: Fit, n_narrow: int, verdict: Verdict) -> None:
    names = tuple(name for name in ice.priors.free if name != "stress_noise")
    wide = scaled_priors_fit(ice, 0.9, names[n_narrow:])
    fit = scaled_priors_fit(wide, 0.1, names[:n_narrow])
    statement = by_key(paper_statements({"PIL72": fit}, {}, {}))["narrow_posteriors"]
    assert statement.verdict == verdict
    assert statement.evidence.startswith(f"{n_narrow} of 11 ")


@pytest.mark.parametrize(
    ("spread", "verdict"), [(2e9, "agrees"), (13e9, "undecided"), (24e9, "does not agree")]
)
def test_the_kelvin_modulus_is_constrained_if_its_prior_has_shrunk(
    olivine: Fit, spread: float, verdict: Verdict
) -> None:
    fit = redrawn(
        olivine,
        kelvin_modulus=normal(olivine, 45e9, spread),
    )
    statements = by_key(paper_statements({}, {}, {"removed": fit, "kept": fit}))
    assert statements["kelvin_modulus_of_olivine"].verdict == verdict


def test_the_critical_strain_is_free_where_it_has_its_prior(olivine: Fit) -> None:
    shape = normal(olivine, 0, 1).shape
    as_prior = np.random.default_rng(5).uniform(1e-3, 1.0, shape)
    expected: tuple[tuple[FloatArray, Verdict], ...] = (
        (as_prior, "agrees"),
        (0.3 + 0.7 * as_prior, "undecided"),
        (0.3 + 0.1 * as_prior, "does not agree"),
    )
    for draws, verdict in expected:
        fit = redrawn(olivine, critical_strain_grain_size=draws)
        statement = by_key(paper_statements({}, {}, {"removed": fit}))["critical_strain_of_olivine"]
        assert statement.verdict == verdict
        assert "chains agree" in statement.evidence


def test_chains_that_disagree_are_mentioned(olivine: Fit) -> None:
    draws = normal(olivine, 0.5, 0.1)
    draws[0] += 0.3
    fit = redrawn(olivine, critical_strain_grain_size=draws)
    statement = by_key(paper_statements({}, {}, {"kept": fit}))["critical_strain_of_olivine"]
    assert "chains do not agree" in statement.evidence


def test_one_chain_has_nothing_to_agree_with(olivine: Fit) -> None:
    groups = {
        name: node.to_dataset().isel(chain=[0], missing_dims="ignore")
        for name, node in olivine.posterior.children.items()
    }
    fit = replace(olivine, posterior=xr.DataTree.from_dict(groups))
    statement = by_key(paper_statements({}, {}, {"kept": fit}))["critical_strain_of_olivine"]
    assert "not known whether chains agree (R-hat nan)" in statement.evidence


@pytest.mark.parametrize(
    ("amplitude_sd", "phase_sd", "verdict"),
    [(0.05, 0.01, "agrees"), (0.02, 0.02, "undecided"), (0.01, 0.05, "does not agree")],
)
def test_the_spread_of_stress_is_split_into_amplitude_and_phase(
    olivine: Fit, amplitude_sd: float, phase_sd: float, verdict: Verdict
) -> None:
    fit = oscillating(olivine, amplitude_sd=amplitude_sd, phase_sd=phase_sd)
    assert stress_spread(fit) == pytest.approx((amplitude_sd, phase_sd), rel=0.1)
    statements = by_key(paper_statements({}, {}, {"removed": fit}))
    assert statements["spread_in_amplitude"].verdict == verdict


def test_treatments_that_differ_leave_a_statement_undecided(olivine: Fit) -> None:
    fits = {
        "removed": oscillating(olivine, amplitude_sd=0.05, phase_sd=0.01),
        "kept": oscillating(olivine, amplitude_sd=0.01, phase_sd=0.05),
    }
    statement = by_key(paper_statements({}, {}, fits))["spread_in_amplitude"]
    assert statement.verdict == "undecided"


def test_only_an_oscillation_has_amplitude_and_phase(ice: Fit) -> None:
    with pytest.raises(InputError, match="expected the fit of a forced oscillation"):
        stress_spread(ice)


def test_attenuation_has_peak_and_background_where_both_show() -> None:
    stiff = {**KELVIN, "kelvin_modulus": 2e10}  # the Kelvin element hardly deforms: no peak
    key = "peak_and_background"
    assert of_spectra(key, spectrum(fluidity=0.3 * FLUIDITY)).verdict == "agrees"
    assert of_spectra(key, spectrum(kelvin=stiff)).verdict == "does not agree"
    # Without flow of the dashpot the peak has no background.
    assert of_spectra(key, spectrum(fluidity=1e-9 * FLUIDITY)).verdict == "does not agree"


def test_attenuation_rises_with_stress_if_flow_does_more_than_linearly() -> None:
    assert of_spectra("rise_with_stress", spectrum()).verdict == "agrees"
    weakening = spectrum(exponent=0.5)
    assert of_spectra("rise_with_stress", weakening).verdict == "does not agree"


def test_a_falling_stretch_must_be_at_1_mpa_alone_and_near_1_mhz() -> None:
    key = "one_falling_stretch"
    assert of_spectra(key, spectrum()).verdict == "agrees"
    everywhere = spectrum(fluidity=1e-3 * FLUIDITY)
    nowhere = spectrum(fluidity=1e3 * FLUIDITY)
    faster = {**KELVIN, "kelvin_viscosity": 1e-2 * KELVIN["kelvin_viscosity"]}
    elsewhere = spectrum(fluidity=1e2 * FLUIDITY, kelvin=faster)
    assert elsewhere["debye_peak"].mean("draw").to_numpy().tolist() == [1, 0, 0, 0]
    for other in (everywhere, nowhere, elsewhere):
        assert of_spectra(key, other).verdict == "does not agree"


def test_the_upper_step_is_compared_with_the_lower() -> None:
    assert of_spectra("larger_step", spectrum()).verdict == "agrees"
    assert of_spectra("larger_step", spectrum(exponent=1.2)).verdict == "does not agree"


def test_draws_and_samples_that_differ_leave_a_statement_undecided() -> None:
    key = "one_falling_stretch"
    mixed = spectrum(fluidity=FLUIDITY * np.where(np.arange(40) < 20, 1.0, 1e-3))
    statement = of_spectra(key, mixed)
    assert statement.verdict == "undecided"
    assert "0.50" in statement.evidence
    several = of_spectra(key, spectrum(), spectrum(fluidity=1e-3 * FLUIDITY))
    assert several.verdict == "undecided"


def test_the_order_of_frequencies_does_not_matter() -> None:
    forward = spectrum()
    backward = forward.isel(frequency=slice(None, None, -1))
    assert paper_statements({}, {"a": forward}, {}) == paper_statements({}, {"a": backward}, {})


def test_spectra_of_a_fit_have_what_the_statements_need(ice: Fit) -> None:
    fits = {"PIL40": ice}
    statements = paper_statements(fits, {"PIL40": predict_attenuation(ice)}, {})
    table = statements_table(statements)
    assert len(table) == len(statements) == 7
    assert list(table["verdict"]) == [statement.verdict for statement in statements]
    assert table["rule"].str.endswith(".").all()
    assert table["our posterior"].str.endswith(".").all()


def test_other_regimes_are_refused(ice: Fit) -> None:
    other = predict_attenuation(ice, regimes=amplitude_regimes(1e6, (0.1e6, 0.2e6, 0.3e6, 0.4e6)))
    with pytest.raises(InputError, match=r"'PIL40' has the regimes 1 ± 0.1 MPa.*paper's, 1 ± 0.17"):
        paper_statements({}, {"PIL40": other}, {})


def test_without_fits_there_is_nothing_to_say() -> None:
    assert paper_statements({}, {}, {}) == ()
    assert statements_table(()).empty
