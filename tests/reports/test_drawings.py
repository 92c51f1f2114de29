"""Drawings of the model, the laws of the paper, and what one number makes of its prior."""

import numpy as np
import pytest
from maor.before_data import READING_ERROR, Knowledge, knowledge
from maor.drawings import (
    circuit,
    flow_laws_figure,
    mean_solution,
    strain_parts,
)
from maor.flow_law import (
    STRESSES,
    FlowLaws,
    flow_laws,
    flow_laws_table,
)
from maor.ice_curves import PEAK_STRESS, peaks
from synthetic_fit import make_fit

from pyburgers.fitting.fit import Fit

PEAK = 8e6


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("ice"), draws=20)


@pytest.fixture(scope="module")
def laws(fit: Fit) -> FlowLaws:
    return flow_laws(fit, PEAK * STRESSES, shared_stress=PEAK)


def test_the_hyperbolic_sine_is_that_of_equation_2(laws: FlowLaws, fit: Fit) -> None:
    draws = fit.posterior["posterior"].to_dataset()
    n, p, enthalpy, beta = (
        draws[name].to_numpy().reshape(-1, 1)
        for name in ("stress_exponent", "grain_size_exponent", "activation_enthalpy", "beta")
    )
    arrhenius = np.exp(enthalpy * (beta - 1 / (8.314462618 * 260.0)))
    power_law = laws.stress**n * 230e-6**-p * arrhenius
    assert laws.power_law == pytest.approx(power_law, rel=1e-9)
    limit = laws.breakdown_stress[:, None]
    at_peak = PEAK**n * 230e-6**-p * arrhenius
    expected = at_peak * np.sinh(laws.stress / limit) / np.sinh(PEAK / limit)
    assert laws.sinh == pytest.approx(expected, rel=1e-9)
    # Its slope where the laws meet is the stress exponent.
    slope = PEAK / limit / np.tanh(PEAK / limit)
    assert slope == pytest.approx(n, rel=1e-6)
    # At low stress it is linear and the power law is not.
    low = laws.stress < 0.2 * laws.breakdown_stress.min()
    assert low.sum() >= 2
    assert laws.linear[:, low] == pytest.approx(laws.sinh[:, low], rel=7e-3)
    assert (laws.power_law[:, 0] < 1e-2 * laws.linear[:, 0]).all()
    table = flow_laws_table(laws)
    at = table[np.isclose(table["stress_Pa"], PEAK)].iloc[0]
    assert at["hyperbolic_sine_per_s"] == pytest.approx(at["power_law_per_s"], rel=0.02)
    assert at["linear_per_s"] < 0.5 * at["power_law_per_s"]


def test_drawings_of_the_model_are_labelled(fit: Fit, laws: FlowLaws) -> None:
    above, below = strain_parts(fit).axes
    elements = [line.get_label() for line in below.lines]
    assert elements == ["spring $E_M$", "Kelvin element", "power-law dashpot"]
    assert "strain" in below.get_xlabel()
    assert "MPa" in above.get_ylabel()
    (axes,) = mean_solution(fit).axes
    lines = {line.get_label(): line for line in axes.lines}
    solution = fit.posterior["posterior_mean_solution"]["stress"]
    drawn = lines["solution at the posterior mean"].get_ydata()
    assert drawn == pytest.approx(solution.to_numpy() * 1e-6)
    assert "strain" in axes.get_xlabel()
    texts = [text.get_text() for text in circuit().axes[0].texts]
    assert {"$E_M$", "$E_K$", r"$\eta_K$"} <= set(texts)
    legend = flow_laws_figure(fit, laws).axes[0].get_legend()
    assert legend is not None
    assert "its linear limit" in [text.get_text() for text in legend.get_texts()]


N_DRAWS = 600


@pytest.fixture(scope="module")
def known(programs: None, fit: Fit) -> Knowledge:
    return knowledge(fit, PEAK_STRESS, n_draws=N_DRAWS, seed=1)


def test_the_peak_stress_weighs_the_draws_that_meet_it(known: Knowledge, fit: Fit) -> None:
    observed = fit.experiment.response.max()
    _, stress = peaks(known.prior)
    deviation = (stress / observed - 1) / READING_ERROR
    assert known.weights.sum() == pytest.approx(1)
    expected = np.exp(-(deviation**2) / 2)
    assert known.weights == pytest.approx(expected / expected.sum(), rel=1e-9, abs=1e-300)
    assert known.effective_draws == pytest.approx(expected.sum() ** 2 / (expected**2).sum())
    mean = known.weights @ stress
    assert mean == pytest.approx(observed, rel=2 * READING_ERROR)


def test_the_peak_stress_narrows_n_through_the_priors_of_the_flow_law(known: Knowledge) -> None:
    alone, with_peak = known.sd_before("stress_exponent")
    assert with_peak < 0.6 * alone
    # Nothing in a peak stress is about the fabric's critical strain.
    alone, with_peak = known.sd_before("critical_strain_fabric")
    assert with_peak > 0.3 * alone
