"""What the paper states about attenuation: verdicts follow the spectra of the draws."""

import re
from collections.abc import Mapping
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import pytest
import xarray as xr
from maor.attenuation import (
    Spectra,
    attenuation_statements,
    peaks,
    spectra_of,
)
from maor.before_data import Knowledge
from maor.statements import Statement, Verdict
from synthetic_fit import make_experiment, make_priors

from pyburgers.fitting.prior_draws import PriorDraws

FloatArray = npt.NDArray[np.float64]

GAS_CONSTANT = 8.314462618
TEMPERATURE = 260.0

FLUIDITY = 6e-31
"""Dashpot (n = 4, Pa^-4 s^-1) that with `KELVIN` leaves a falling stretch at 1 MPa alone."""

KELVIN = MappingProxyType({"kelvin_modulus": 1e9, "kelvin_viscosity": 3e11})
N_DRAWS = 400


def drawn(
    *,
    exponent: float | FloatArray = 4.0,
    fluidity: float | FloatArray = FLUIDITY,
    kelvin: Mapping[str, float | FloatArray] = KELVIN,
    grain_size_exponent: float | FloatArray = 0.0,
) -> PriorDraws:
    """Return draws of the parameters; the dashpot flows at 1 MPa as with n = 4 whatever n is."""
    experiment = make_experiment("PIL40", "synthetic", ((0.0, 1e-4),), np.random.default_rng(1))
    enthalpy = 60e3
    log_fluidity = (
        np.log(fluidity)
        + (4.0 - exponent) * np.log(1e6)
        + grain_size_exponent * np.log(experiment.initial_grain_size)
    )
    values: dict[str, float | FloatArray] = {
        "maxwell_modulus": 4e9,
        **kelvin,
        "stress_exponent": exponent,
        "grain_size_exponent": grain_size_exponent,
        "activation_enthalpy": enthalpy,
        "beta": log_fluidity / enthalpy + 1 / (GAS_CONSTANT * TEMPERATURE),
        "steady_state_grain_size": 1e-4,
        "steady_state_fabric_factor": 0.5,
        "critical_strain_grain_size": 0.05,
        "critical_strain_fabric": 0.1,
    }
    posterior = xr.Dataset(
        {
            name: (("chain", "draw"), np.broadcast_to(value, (1, N_DRAWS)))
            for name, value in values.items()
        },
        {"chain": [1], "draw": np.arange(N_DRAWS)},
    )
    tree = xr.DataTree.from_dict({"posterior": posterior})
    return PriorDraws(experiment, make_priors(), tree, 0)


def open_before() -> PriorDraws:
    """Return draws that leave open what is stated."""
    rng = np.random.default_rng(7)
    kind = rng.integers(0, 5, N_DRAWS)
    return drawn(
        exponent=np.where(kind == 0, 0.5, rng.uniform(0.8, 4.5, N_DRAWS)),
        fluidity=FLUIDITY * np.where(kind == 1, 1e-9, 10.0 ** rng.uniform(-2, 2, N_DRAWS)),
        kelvin={
            "kelvin_modulus": np.where(kind == 2, 2e10, 10.0 ** rng.uniform(8.5, 10, N_DRAWS)),
            "kelvin_viscosity": 10.0 ** rng.uniform(9.5, 11.7, N_DRAWS),
        },
        grain_size_exponent=rng.uniform(0.0, 0.7, N_DRAWS),
    )


@pytest.fixture(scope="module")
def before() -> PriorDraws:
    return open_before()


def statement(key: str, before: PriorDraws, *fits: PriorDraws) -> Statement:
    weights = np.full(N_DRAWS, 1 / N_DRAWS)
    spectra: dict[str, Spectra] = {
        f"sample {k}": spectra_of(Knowledge(fit, before, weights)) for k, fit in enumerate(fits)
    }
    return {one.key: one for one in attenuation_statements(spectra)}[key]


def test_attenuation_has_peak_and_background_where_both_show(before: PriorDraws) -> None:
    key = "peak_and_background"
    assert statement(key, before, drawn(fluidity=0.3 * FLUIDITY)).verdict is Verdict.AGREES
    stiff = {**KELVIN, "kelvin_modulus": 2e10}  # the Kelvin element hardly deforms: no peak
    assert statement(key, before, drawn(kelvin=stiff)).verdict is Verdict.DISAGREES
    # Without flow of the dashpot the peak has no background.
    bare = drawn(fluidity=1e-9 * FLUIDITY)
    assert statement(key, before, bare).verdict is Verdict.DISAGREES


def test_attenuation_rises_with_stress_if_flow_does_more_than_linearly(before: PriorDraws) -> None:
    key = "rise_with_stress"
    assert statement(key, before, drawn()).verdict is Verdict.AGREES
    assert statement(key, before, drawn(exponent=0.5)).verdict is Verdict.DISAGREES
    # The priors of the paper know n above 1 only: then it is no finding.
    rng = np.random.default_rng(1)
    of_paper = drawn(exponent=rng.uniform(2.7, 4.5, N_DRAWS))
    assert statement(key, of_paper, drawn()).verdict is Verdict.CANNOT_FAIL


def test_a_falling_stretch_must_be_at_1_mpa_alone_and_near_1_mhz(before: PriorDraws) -> None:
    key = "one_falling_stretch"
    found = statement(key, before, drawn())
    (belief,) = found.beliefs.values()
    assert belief.posterior == 1
    assert found.verdict in {Verdict.AGREES, Verdict.PRIOR_EXCLUDES}
    everywhere = drawn(fluidity=1e-3 * FLUIDITY)
    nowhere = drawn(fluidity=1e3 * FLUIDITY)
    faster = {**KELVIN, "kelvin_viscosity": 1e-2 * KELVIN["kelvin_viscosity"]}
    elsewhere = drawn(fluidity=1e2 * FLUIDITY, kelvin=faster)
    for other in (everywhere, nowhere, elsewhere):
        (belief,) = statement(key, before, other).beliefs.values()
        assert belief.posterior == 0


def test_at_4_mpa_the_peak_is_buried_or_not(before: PriorDraws) -> None:
    assert statement("buried_peak", before, drawn()).verdict is Verdict.AGREES
    shown = drawn(fluidity=1e-3 * FLUIDITY)
    assert statement("buried_peak", before, shown).verdict is Verdict.DISAGREES
    # With E_K at most an eighth of E_M no background buries it.
    soft = drawn(fluidity=1e4 * FLUIDITY, kelvin={**KELVIN, "kelvin_modulus": 4e9 / 8})
    assert statement("buried_peak", before, soft).verdict is Verdict.DISAGREES


def test_the_upper_step_is_compared_with_the_lower(before: PriorDraws) -> None:
    assert statement("larger_step", before, drawn()).verdict is Verdict.AGREES
    low = drawn(exponent=1.2)
    (belief,) = statement("larger_step", before, low).beliefs.values()
    assert belief.posterior == 0


def test_amplitude_matters_where_the_dashpot_is_not_linear(before: PriorDraws) -> None:
    assert statement("amplitude", before, drawn()).verdict is Verdict.AGREES
    assert statement("amplitude", before, drawn(exponent=1.001)).verdict is Verdict.DISAGREES


def test_the_slope_at_4_mpa_hardly_varies_where_the_dashpot_is_all(before: PriorDraws) -> None:
    key = "slope_at_4_MPa"
    flowing = drawn(fluidity=1e4 * FLUIDITY, kelvin={**KELVIN, "kelvin_modulus": 2e10})
    assert statement(key, before, flowing).beliefs["sample 0"].posterior == 1
    with_peak = statement(key, before, drawn(fluidity=1e-3 * FLUIDITY))
    assert with_peak.beliefs["sample 0"].posterior == 0
    assert re.search(r"median: sample 0 1\.\d\d\.$", with_peak.evidence)


def test_the_background_intensifies_where_flow_does_more_than_linearly(before: PriorDraws) -> None:
    assert statement("background", before, drawn()).verdict is Verdict.AGREES
    assert statement("background", before, drawn(exponent=0.5)).verdict is Verdict.DISAGREES


def test_what_the_paper_does_not_state_is_not_judged(before: PriorDraws) -> None:
    weights = np.full(N_DRAWS, 1 / N_DRAWS)
    spectra = {"PIL40": spectra_of(Knowledge(drawn(), before, weights))}
    keys = {one.key for one in attenuation_statements(spectra)}
    assert not keys & {"grain_size", "frozen", "broadened", "flow_law"}


def test_draws_and_samples_that_differ_leave_a_statement_open(before: PriorDraws) -> None:
    key = "buried_peak"
    mixed = drawn(fluidity=FLUIDITY * np.where(np.arange(N_DRAWS) < N_DRAWS / 2, 1.0, 1e-3))
    found = statement(key, before, mixed)
    assert found.verdict is Verdict.CANNOT_TELL
    assert "50 %" in found.evidence
    several = statement(key, before, drawn(), drawn(fluidity=1e-3 * FLUIDITY))
    assert several.verdict is Verdict.CANNOT_TELL


def test_what_is_open_before_is_open(before: PriorDraws) -> None:
    shares = peaks(spectra_of(Knowledge(before, before, np.ones(1))).before).mean(axis=0)
    assert (shares > 0.1).all()
    assert (shares < 0.9).all()
