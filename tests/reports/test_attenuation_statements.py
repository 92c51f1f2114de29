"""Verdicts on statements, and those that the paper makes about attenuation."""

import re
from collections.abc import Mapping
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
import xarray as xr
from maor.attenuation import (
    Spectra,
    attenuation_statements,
    peaks,
    spectra_of,
)
from maor.before_data import Knowledge
from maor.statements import (
    Belief,
    Statement,
    Verdict,
    common_verdict,
    statements_table,
)
from synthetic_fit import make_experiment, make_priors

from pyburgers.common.array_types import FloatArray
from pyburgers.fitting.prior_draws import PriorDraws

GAS_CONSTANT = 8.314462618
TEMPERATURE = 260.0

FLUIDITY = 6e-31
"""Dashpot (n = 4, Pa^-4 s^-1) that with `KELVIN` leaves a falling stretch at 1 MPa alone."""

KELVIN = MappingProxyType({"kelvin_modulus": 1e9, "kelvin_viscosity": 3e11})
N_DRAWS = 100


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


def statements(before: PriorDraws, *fits: PriorDraws) -> dict[str, Statement]:
    weights = np.full(N_DRAWS, 1 / N_DRAWS)
    spectra: dict[str, Spectra] = {
        f"sample {k}": spectra_of(Knowledge(fit, before, weights)) for k, fit in enumerate(fits)
    }
    return {one.key: one for one in attenuation_statements(spectra)}


def statement(key: str, before: PriorDraws, *fits: PriorDraws) -> Statement:
    return statements(before, *fits)[key]


STIFF = {**KELVIN, "kelvin_modulus": 2e10}
"""The Kelvin element hardly deforms: no peak."""

SOFT = {**KELVIN, "kelvin_modulus": 4e9 / 8}
"""With E_K at most an eighth of E_M no background buries its peak."""


YES, NO = Verdict.AGREES, Verdict.DISAGREES


@pytest.mark.parametrize(
    ("changes", "verdicts"),
    [
        (
            {},
            {
                "rise_with_stress": YES,
                "buried_peak": YES,
                "larger_step": YES,
                "amplitude": YES,
                "background": YES,
            },
        ),
        ({"fluidity": 0.3 * FLUIDITY}, {"peak_and_background": YES}),
        ({"kelvin": STIFF}, {"peak_and_background": NO}),
        # Without flow of the dashpot the peak has no background.
        ({"fluidity": 1e-9 * FLUIDITY}, {"peak_and_background": NO}),
        ({"exponent": 0.5}, {"rise_with_stress": NO, "background": NO}),
        ({"fluidity": 1e-3 * FLUIDITY}, {"buried_peak": NO}),
        ({"fluidity": 1e4 * FLUIDITY, "kelvin": SOFT}, {"buried_peak": NO}),
        ({"exponent": 1.001}, {"amplitude": NO}),
    ],
)
def test_verdicts_follow_the_material_of_the_draws(
    changes: dict[str, Any], verdicts: dict[str, Verdict], before: PriorDraws
) -> None:
    found = statements(before, drawn(**changes))
    assert {key: found[key].verdict for key in verdicts} == verdicts


def test_a_rise_with_stress_is_no_finding_where_the_prior_knows_n_above_1_only() -> None:
    rng = np.random.default_rng(1)
    of_paper = drawn(exponent=rng.uniform(2.7, 4.5, N_DRAWS))
    assert statement("rise_with_stress", of_paper, drawn()).verdict is Verdict.CANNOT_FAIL


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
    others = [(key, other) for other in (everywhere, nowhere, elsewhere)]
    for own_key, other in (*others, ("larger_step", drawn(exponent=1.2))):
        (belief,) = statement(own_key, before, other).beliefs.values()
        assert belief.posterior == 0


def test_the_slope_at_4_mpa_hardly_varies_where_the_dashpot_is_all(before: PriorDraws) -> None:
    key = "slope_at_4_MPa"
    flowing = drawn(fluidity=1e4 * FLUIDITY, kelvin={**KELVIN, "kelvin_modulus": 2e10})
    assert statement(key, before, flowing).beliefs["sample 0"].posterior == 1
    with_peak = statement(key, before, drawn(fluidity=1e-3 * FLUIDITY))
    assert with_peak.beliefs["sample 0"].posterior == 0
    assert re.search(r"median: sample 0 1\.\d\d\.$", with_peak.evidence)


def test_what_the_paper_does_not_state_is_not_judged(before: PriorDraws) -> None:
    assert not statements(before, drawn()).keys() & {
        "grain_size",
        "frozen",
        "broadened",
        "flow_law",
    }


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


MANY = 200.0


@pytest.mark.parametrize(
    ("prior", "number", "posterior", "verdict"),
    [
        (0.3, 0.4, 0.99, Verdict.AGREES),
        (0.3, 0.4, 0.01, Verdict.DISAGREES),
        (0.3, 0.4, 0.5, Verdict.CANNOT_TELL),
        # The model cannot do otherwise, whatever the data say.
        (1.0, 1.0, 1.0, Verdict.CANNOT_FAIL),
        (0.0, 0.0, 0.0, Verdict.CANNOT_HOLD),
        # The prior says so by the rule by which the posterior would.
        (0.95, 0.97, 0.999, Verdict.PRIOR_GRANTS),
        # Sure now, hardly less so before: odds of 9.5 after 5.
        (0.83, 0.85, 0.905, Verdict.PRIOR_GRANTS),
        # The one number says it already: the rest of the curve added nothing.
        (0.3, 0.96, 0.97, Verdict.NUMBER_GRANTS),
        (0.04, 0.2, 0.001, Verdict.PRIOR_EXCLUDES),
        (0.5, 0.05, 0.001, Verdict.NUMBER_EXCLUDES),
    ],
)
def test_a_verdict_says_what_the_data_added(
    prior: float, number: float, posterior: float, verdict: Verdict
) -> None:
    assert Belief(prior, number, posterior, MANY).verdict is verdict


def test_too_few_effective_draws_cannot_tell_what_the_curve_added() -> None:
    assert Belief(0.3, 0.4, 0.99, 12.0).verdict is Verdict.CANNOT_TELL
    # What the prior grants does not hang on them.
    assert Belief(0.95, 0.4, 0.99, 12.0).verdict is Verdict.PRIOR_GRANTS


@pytest.mark.parametrize(
    ("prior", "number", "posterior", "verdict"),
    [
        (False, False, True, Verdict.AGREES),
        (False, None, True, Verdict.AGREES),
        (True, True, True, Verdict.PRIOR_GRANTS),
        (False, True, True, Verdict.NUMBER_GRANTS),
        (True, True, False, Verdict.DISAGREES),
        (True, None, False, Verdict.DISAGREES),
        (None, False, False, Verdict.NUMBER_EXCLUDES),
        # What does not hold without the data either is not theirs to deny.
        (False, False, False, Verdict.PRIOR_EXCLUDES),
        (True, False, None, Verdict.CANNOT_TELL),
    ],
)
def test_a_statement_about_a_distribution_holds_or_does_not(
    prior: bool | None, number: bool | None, posterior: bool | None, verdict: Verdict
) -> None:
    assert Belief(prior, number, posterior, MANY).verdict is verdict


def test_only_findings_of_the_whole_curve_count() -> None:
    assert {verdict for verdict in Verdict if verdict.counts} == {
        Verdict.AGREES,
        Verdict.DISAGREES,
    }


def test_samples_share_a_verdict_with_the_least_credit() -> None:
    assert common_verdict([Verdict.AGREES, Verdict.AGREES]) is Verdict.AGREES
    assert common_verdict([Verdict.AGREES, Verdict.PRIOR_GRANTS]) is Verdict.PRIOR_GRANTS
    assert common_verdict([Verdict.DISAGREES, Verdict.NUMBER_EXCLUDES]) is Verdict.NUMBER_EXCLUDES
    # Impossible in one sample, unlikely in the other: what they share is that the prior says so.
    assert common_verdict([Verdict.CANNOT_HOLD, Verdict.DISAGREES]) is Verdict.PRIOR_EXCLUDES
    assert common_verdict([Verdict.CANNOT_HOLD, Verdict.CANNOT_HOLD]) is Verdict.CANNOT_HOLD
    assert common_verdict([Verdict.CANNOT_FAIL, Verdict.NUMBER_GRANTS]) is Verdict.PRIOR_GRANTS
    assert common_verdict([Verdict.AGREES, Verdict.DISAGREES]) is Verdict.CANNOT_TELL
    assert common_verdict([]) is Verdict.CANNOT_TELL


def test_the_table_has_what_was_believed_before_beside_the_posterior() -> None:
    beliefs = {"a": Belief(0.3, 0.4, 0.99, MANY), "b": Belief(0.31, 0.5, 0.98, 150.0)}
    statement = Statement("key", "Fig. 1", "Text.", "Evidence.", beliefs, "Rule.")
    (row,) = statements_table([statement]).to_dict("records")
    assert row["prior"] == "0.30 / 0.31"
    assert row["prior and one number"] == "0.40 / 0.50"
    assert row["posterior"] == "0.99 / 0.98"
    assert row["effective draws"] == "200 / 150"
    assert row["of"] == "a / b"
    assert row["verdict"] == "agrees"
    assert np.all(statements_table([]).columns == list(row))
