"""Drawings of the model, and its power law beside the hyperbolic sine of the paper's Eq. 2."""

import numpy as np
import pytest
from synthetic_fit import make_fit
from synthetic_olivine_fit import make_olivine_fit

from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit
from pyburgers.protocols.constant_rate.figures import constant_rate_test
from pyburgers.studies.maor.drawings import (
    FlowLaws,
    circuit,
    flow_laws,
    flow_laws_figure,
    flow_laws_table,
    strain_parts,
)


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("ice"), draws=50)


@pytest.fixture(scope="module")
def laws(programs: None, fit: Fit) -> FlowLaws:
    return flow_laws(fit)


def test_the_hyperbolic_sine_is_that_of_equation_2(laws: FlowLaws, fit: Fit) -> None:
    rate = constant_rate_test(fit).segments[0].strain_rate
    relative = laws.stress / laws.breakdown_stress
    at = laws.reference_stress / laws.breakdown_stress
    expected = rate * np.sinh(relative) / np.sinh(at)
    assert laws.sinh == pytest.approx(expected, rel=1e-6)
    # Its slope where the laws meet is the stress exponent.
    slope = at / np.tanh(at)
    exponent = float(fit.posterior["posterior"]["stress_exponent"].median())
    assert slope == pytest.approx(exponent, rel=1e-6)


def test_at_low_stress_it_is_linear_and_the_power_law_is_not(laws: FlowLaws) -> None:
    low = laws.stress < 0.1 * laws.breakdown_stress
    assert low.sum() >= 2
    assert laws.linear[low] == pytest.approx(laws.sinh[low], rel=2e-3)
    assert np.median(laws.power_law, axis=0)[0] < 1e-2 * laws.linear[0]


def test_the_laws_agree_at_the_stress_of_the_test(laws: FlowLaws) -> None:
    table = flow_laws_table(laws)
    at = table[np.isclose(table["stress_Pa"], laws.reference_stress)].iloc[0]
    assert at["hyperbolic_sine_per_s"] == pytest.approx(at["power_law_per_s"], rel=0.02)
    assert at["linear_per_s"] < 0.5 * at["power_law_per_s"]


def test_the_strains_of_the_elements_add_up(fit: Fit) -> None:
    above, below = strain_parts(fit).axes
    names = {line.get_label(): line.get_xydata() for line in below.lines}
    assert list(names) == ["spring $E_M$", "Kelvin element", "power-law dashpot"]
    assert "strain" in below.get_xlabel()
    assert "MPa" in above.get_ylabel()


def test_the_circuit_and_the_laws_are_labelled(fit: Fit, laws: FlowLaws) -> None:
    texts = [text.get_text() for text in circuit().axes[0].texts]
    assert {"$E_M$", "$E_K$", r"$\eta_K$"} <= set(texts)
    legend = flow_laws_figure(fit, laws).axes[0].get_legend()
    assert legend is not None
    assert "its linear limit" in [text.get_text() for text in legend.get_texts()]


def test_another_kind_of_test_is_refused(tmp_path_factory: pytest.TempPathFactory) -> None:
    with pytest.raises(InputError, match="expected the fit of a test at imposed strain rate"):
        flow_laws(make_olivine_fit(tmp_path_factory.mktemp("olivine")))
