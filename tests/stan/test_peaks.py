"""Peaks of the model and what has softened at them: against scipy, and as priors of a table."""

from dataclasses import replace
from pathlib import Path
from typing import NoReturn

import history_oracle
import numpy as np
import oracle
import pytest
from conftest import ICE, TABLE_RUN
from independent_table import TRUTHS

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.flow_law_tables import softening
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.fit_rates import fit_rates
from pyburgers.flow_law_tables.softening import simulate_peaks, softening_prior
from pyburgers.flow_law_tables.table_files import load_rate_table
from pyburgers.flow_law_tables.tables import PeakStrain, RateTable
from pyburgers.model.priors import PriorSet, default_priors

pytestmark = pytest.mark.usefixtures("programs")

MATERIAL = TRUTHS["fast"]
RATE, GRAIN_SIZE, TEMPERATURE = np.array([1.69e-4, 2e-5]), np.array([2.3e-4, 6e-4]), 260.0
CONDITIONS = {
    "strain_rate": RATE,
    "grain_size": GRAIN_SIZE,
    "temperature": np.full(2, TEMPERATURE),
}


def test_peaks_are_those_of_the_equations() -> None:
    peaks = simulate_peaks("ice", [MATERIAL], **CONDITIONS)
    strain = np.geomspace(1e-3, 0.2, 2000)
    factor = oracle.rate_factor(MATERIAL, TEMPERATURE)
    for k, (rate, grain_size) in enumerate(zip(RATE, GRAIN_SIZE, strict=True)):
        at_rate = [(0.0, rate)]
        state = history_oracle.at_rates(MATERIAL, TEMPERATURE, grain_size, at_rate, strain)
        stress = state[history_oracle.STRESS]
        assert np.exp(peaks.log_stress[0, k]) == pytest.approx(stress.max(), rel=2e-5)
        assert peaks.strain[0, k] == pytest.approx(strain[stress.argmax()], rel=0.01)
        undeformed = (rate * grain_size**0.55 / factor) ** (1 / 3.779)
        assert peaks.softening[0, k] == pytest.approx(np.log(undeformed / stress.max()), abs=2e-5)


def test_a_wanted_peak_is_met_by_another_activation_enthalpy() -> None:
    own = simulate_peaks("ice", [MATERIAL], **CONDITIONS)
    moved = {**MATERIAL, "activation_enthalpy": 70e3}
    met = simulate_peaks("ice", [moved], **CONDITIONS, peak_stress=np.exp(own.log_stress[0]))
    np.testing.assert_allclose(met.log_stress, own.log_stress, atol=1.1e-4)
    np.testing.assert_allclose(met.softening, own.softening, atol=1e-4)


def test_a_test_without_solution_is_told() -> None:
    with pytest.raises(SamplingError, match="has no solution to 20% strain"):
        simulate_peaks("ice", [{**MATERIAL, "activation_enthalpy": 1e7}], **CONDITIONS)


def test_the_prior_of_the_softening_is_that_of_materials_with_the_table_s_peak(
    peaks: RateFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    table = load_rate_table(ICE / "rates" / "qi_goldsby_2021.toml")
    curve = default_priors("ice")
    anywhere = softening_prior(replace(table, peak_strain=None), curve, seed=1)
    late = peaks.softening
    assert late is not None
    # Table 1's priors have their peaks before 2 % strain; three hundredths are stated.
    assert anywhere.peak_strain[1] < 0.012
    assert anywhere.peak_strain[1] < 0.5 * late.peak_strain[1]
    assert late.coefficients[0, 0] > anywhere.coefficients[0, 0] + 0.2
    # The first candidates do not leave as many independent materials as are simulated.
    assert late.n_effective == anywhere.n_effective == softening.N_MATERIALS
    for prior in (anywhere, late):
        assert 0.02 < np.exp(prior.coefficients[0, 0]) < 0.12
        assert 0.3 < prior.factor[0, 0] < 1.0
    monkeypatch.setattr(softening, "MOST_CANDIDATES", softening.N_CANDIDATES)
    few = softening_prior(table, curve, seed=TABLE_RUN.seed)
    assert softening.LEAST_MATERIALS < few.n_effective < softening.N_MATERIALS
    monkeypatch.setattr(softening, "N_CANDIDATES", 300)  # none of which has such a peak
    impossible = replace(table, peak_strain=PeakStrain(0.15, 0.005))
    with pytest.raises(InputError, match=r"key 'peak_strain': found 0\.15, but nine in ten peaks"):
        softening_prior(impossible, curve, seed=1)


def test_a_fit_simulates_its_softening_with_its_seed(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(softening, "N_MATERIALS", 20)
    table = replace(load_rate_table(ICE / "rates" / "qi_goldsby_2021.toml"), peak_strain=None)
    found: list[FloatArray] = []

    def simulated(data: RateTable, curve: PriorSet, *, seed: int) -> NoReturn:
        found.extend(softening_prior(data, curve, seed=k).coefficients for k in (seed, 9, 3))
        raise SamplingError("simulated")

    monkeypatch.setattr("pyburgers.flow_law_tables.fit_rates.softening_prior", simulated)
    options = replace(TABLE_RUN, seed=9)
    with pytest.raises(SamplingError, match="simulated"):
        fit_rates(table, out=tmp_path / "run", curve=default_priors("ice"), options=options)
    np.testing.assert_array_equal(found[0], found[1])
    assert (found[2] != found[0]).all()
