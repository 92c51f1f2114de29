"""Where frozen microstructure fails: strains against quadrature, marks at the right frequencies."""

import itertools
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
import oracle
import pytest
import xarray as xr
from conftest import ICE as ICE_DATA
from conftest import resolved_priors
from imposed_stress import GRAIN_SIZE, ICE, TEMPERATURE
from scipy.integrate import quad, solve_ivp
from synthetic_fit import make_fit

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.prior_draws import prior_draws
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.predictions.attenuation import (
    attenuation_spectrum,
    overview_table,
    predict_attenuation,
    quantile_table,
)
from pyburgers.predictions.material import (
    elastic_modulus_sentence,
    frozen_limit_texts,
    frozen_sentence,
    likely_fails,
    pale_sentence,
    probability,
    strain_fails,
)
from pyburgers.predictions.stress_cycles import EVOLUTION, PAPER_REGIMES, Regime

PIEZOMETER = {
    "piezometer_reference_grain_size": 0.015,
    "piezometer_exponent": 1.33,
    "piezometer_stress_floor": 1e6,
}
FREQUENCIES = tuple(np.geomspace(1e-6, 1.0, 61).tolist())


def spectrum_of(
    parameters: Mapping[str, Any] = ICE,
    regimes: tuple[Regime, ...] = PAPER_REGIMES,
    frequencies: tuple[float, ...] = FREQUENCIES,
    **given: Any,
) -> xr.Dataset:
    conditions = {"temperature": TEMPERATURE, "grain_size": GRAIN_SIZE, **given}
    return attenuation_spectrum(parameters, frequencies, regimes, **conditions)


def dashpot_rate(stress: float) -> float:
    """Eq. 1 of the undeformed material."""
    log_factor = ICE["activation_enthalpy"] * (
        ICE["beta"] - 1 / (oracle.GAS_CONSTANT * TEMPERATURE)
    )
    size = float(np.sign(stress)) * abs(stress) ** ICE["stress_exponent"]
    return float(size * GRAIN_SIZE ** -ICE["grain_size_exponent"] * np.exp(log_factor))


@pytest.mark.parametrize("regime", [*PAPER_REGIMES, Regime(1e6, 2.5e6)], ids=lambda r: r.label)
@pytest.mark.parametrize("frequency", [1e-5, 1e-4, 1e-3, 1e-2, 1.0])
def test_the_strain_of_a_cycle_is_the_integral_of_the_rate(
    regime: Regime, frequency: float
) -> None:
    """The settled cycle from complex algebra and the flow law, integrated between its turns."""
    omega = 2 * np.pi * frequency
    compliance = 1 / ICE["maxwell_modulus"] + 1 / (
        ICE["kelvin_modulus"] + 1j * omega * ICE["kelvin_viscosity"]
    )

    def rate(time: float) -> float:
        elements = 1j * omega * compliance * regime.amplitude * np.exp(1j * omega * time)
        stress = regime.median_stress + regime.amplitude * np.sin(omega * time)
        return float(elements.imag) + dashpot_rate(stress)

    times = np.linspace(0.0, 1 / frequency, 401)
    values = [rate(time) for time in times]
    expected = sum(
        quad(lambda time: abs(rate(time)), low, high, epsrel=1e-6, limit=100)[0]
        if values[k] * values[k + 1] < 0
        else abs(quad(rate, low, high)[0])
        for k, (low, high) in enumerate(itertools.pairwise(times))
    )
    found = spectrum_of(regimes=(regime,), frequencies=(frequency,))["cycle_strain"]
    assert float(found.item()) == pytest.approx(expected, rel=2e-3)


@pytest.mark.parametrize("hold_time", [600.0, 5400.0])
def test_the_strain_of_the_hold_is_that_of_creep_from_rest(hold_time: float) -> None:
    found = spectrum_of(hold_time=hold_time)["hold_strain"].to_numpy()
    for regime, strain in zip(PAPER_REGIMES, found, strict=True):
        stress = regime.median_stress

        def rates(_: float, state: FloatArray, stress: float = stress) -> list[float]:
            driving = stress - ICE["kelvin_modulus"] * state[0]
            return [driving / ICE["kelvin_viscosity"], dashpot_rate(stress)]

        solution = solve_ivp(rates, (0.0, hold_time), [0.0, 0.0], rtol=1e-10, atol=1e-14)
        expected = stress / ICE["maxwell_modulus"] + solution.y[:, -1].sum()
        assert strain == pytest.approx(expected, rel=1e-6)


def test_curves_are_marked_where_the_strain_passes_the_share() -> None:
    found = spectrum_of(critical_share=0.1)
    cycle, hold = found["cycle_strain"].to_numpy(), found["hold_strain"].to_numpy()
    expected = (cycle > 0.1 * 0.07) | (hold[:, np.newaxis] > 0.1 * 0.07)
    np.testing.assert_array_equal(found["frozen_fails"], expected)
    # The larger stresses fail in the hold, so at all frequencies; the smallest at low ones.
    assert expected[3].all()
    assert expected[0, 0]
    assert not expected[0, -1]
    np.testing.assert_array_equal(likely_fails(found), expected)
    assert not spectrum_of(critical_share=100.0)["frozen_fails"].any()
    assert spectrum_of(critical_share=1e-6)["frozen_fails"].all()


def test_tables_say_what_fails_and_from_which_frequency_on() -> None:
    strains = spectrum_of()["cycle_strain"].to_numpy()
    limits = [np.array(FREQUENCIES)[strain > 0.1 * 0.07].max() for strain in strains]
    assert (np.diff(limits) > 0).all()
    holds = probability(strain_fails(spectrum_of(), "hold_strain"))
    assert holds.tolist() == [0, 0, 0, 1]
    texts = frozen_limit_texts(spectrum_of())
    shuffled = spectrum_of(frequencies=tuple(np.roll(FREQUENCIES, 20).tolist()))
    assert frozen_limit_texts(shuffled) == texts
    cycles = [f"in cycles up to {limit:.2g} Hz" for limit in limits]
    assert texts[:3] == [f"fails {one}, in the hold in 0 % of draws" for one in cycles[:3]]
    assert texts[3] == f"fails in the hold in 100 % of draws, {cycles[3]}"
    slow, fast = (spectrum_of(frequencies=one) for one in ((1e-6, 1e-7), (1e3, 1e4)))
    assert frozen_limit_texts(slow)[0] == "fails in all cycles, in the hold in 0 % of draws"
    assert frozen_limit_texts(fast)[0] == (
        "holds; fails in the hold in 0 % of draws, in no cycle down to 1e+03 Hz"
    )
    # One of three draws is not none.
    soft = fast.assign(cycle_strain=fast["cycle_strain"] + fast["critical_strain"])
    of_draws = xr.concat([fast, soft, fast], "draw", data_vars="all")
    assert frozen_limit_texts(of_draws)[0] == (
        "holds; fails in the hold in 0 % of draws, in cycles of 1e+03 Hz in 33 %"
    )


def test_what_is_at_its_steady_state_does_not_evolve() -> None:
    def critical(parameters: Mapping[str, Any] = ICE, **given: Any) -> float:
        return float(spectrum_of(parameters, **given)["critical_strain"][0])

    assert critical() == 0.07
    assert critical(grain_size=1e-4) == 0.2
    assert critical(fabric_factor=0.5) == 0.07
    assert np.isinf(critical(grain_size=1e-4, fabric_factor=0.5))
    assert critical({**ICE, "critical_strain_fabric": 0.01}) == 0.01
    # A piezometer lets the grain size evolve whatever the steady state says.
    assert critical({**ICE, **PIEZOMETER}, grain_size=1e-4, fabric_factor=0.5) < 0.07


@pytest.mark.parametrize(("breakdown", "n"), [(2e6, 1.0), (0.1e6, 1.0), (0.5e6, 3.7), (0.0, 5.0)])
def test_fabric_has_a_smaller_critical_strain_where_the_rate_is_steep(
    breakdown: float, n: float
) -> None:
    """The local exponent is n, or n x/tanh(x) under the hyperbolic sine."""
    law = {**ICE, "breakdown_stress": breakdown, "stress_exponent": n}
    found = spectrum_of(law, grain_size=1e-4, fabric_factor=0.8)["critical_strain"].to_numpy()
    for regime, critical in zip(PAPER_REGIMES, found, strict=True):
        steepness = n
        if breakdown:
            x = (regime.median_stress + regime.amplitude) / (0.8 * breakdown)
            steepness = n * x / np.tanh(x)
        assert critical == pytest.approx(0.2 / max(1.0, steepness / 4.0), rel=0.005)


def test_what_will_change_many_times_over_has_a_smaller_critical_strain() -> None:
    """Grains at low stress: the piezometer of the Stan program's test (`oracle.piezometer`)."""
    found = spectrum_of({**ICE, **PIEZOMETER})["critical_strain"].to_numpy()
    for regime, critical in zip(PAPER_REGIMES, found, strict=True):
        change = oracle.piezometer(regime.median_stress) / GRAIN_SIZE - 1
        assert change > 1
        assert critical == pytest.approx(0.07 / change)
    tripled = spectrum_of({**ICE, "steady_state_grain_size": 4 * GRAIN_SIZE})["critical_strain"]
    np.testing.assert_allclose(tripled, 0.07 / 3)


def test_without_evolution_it_cannot_be_told() -> None:
    found = spectrum_of({name: value for name, value in ICE.items() if name not in EVOLUTION})
    assert np.isnan(found["frozen_fails"]).all()
    assert frozen_limit_texts(found) == ["cannot tell"] * 4
    assert "cannot be told" in frozen_sentence(found)
    assert "cannot be told" in pale_sentence(found)
    assert not likely_fails(found).any()


def test_a_table_of_cycles_tells_nothing_of_evolution_or_an_apparatus(programs: None) -> None:
    table = load_attenuation(ICE_DATA / "attenuation_twin.toml")
    drawn = prior_draws(table, resolved_priors(table), draws=5, seed=1)
    spectrum = predict_attenuation(drawn, [1e-3])
    assert np.isnan(spectrum["critical_strain"]).all()
    assert elastic_modulus_sentence(spectrum) == "The elastic modulus is E_M of the fit."


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("run"), chains=2, draws=50)


def test_a_fit_says_where_its_prediction_fails(fit: Fit) -> None:
    spectrum = predict_attenuation(fit)
    posterior = fit.posterior["posterior"].to_dataset()
    of_fabric = posterior["critical_strain_fabric"] / (posterior["stress_exponent"] / 4).clip(1)
    smaller = np.minimum(posterior["critical_strain_grain_size"], of_fabric)
    np.testing.assert_allclose(spectrum["critical_strain"].isel(regime=2), smaller)
    table = quantile_table(spectrum)
    hardest = table[table["median_stress_MPa"] == 4.0]
    share = float((spectrum["hold_strain"].isel(regime=3) > 0.1 * smaller).mean())
    assert share > 0.9
    assert hardest["p_hold_fails"].to_numpy() == pytest.approx(share)
    easiest = table[table["median_stress_MPa"] == 1.0]
    assert easiest["p_cycle_fails"].is_monotonic_decreasing
    assert (table["p_frozen_fails"] >= table[["p_hold_fails", "p_cycle_fails"]].max(axis=1)).all()
    share = float((spectrum["cycle_strain"].isel(regime=0, frequency=0) > 0.1 * smaller).mean())
    assert easiest["p_cycle_fails"].iloc[0] == pytest.approx(share)
    assert table["cycle_strain"].iloc[0] == pytest.approx(
        float(spectrum["cycle_strain"].isel(regime=0, frequency=0).median())
    )
    words = overview_table(spectrum)["frozen microstructure"]
    share = hardest["p_hold_fails"].iloc[0]
    assert words.iloc[3].startswith(f"fails in the hold in {100 * share:.0f} % of draws, in cycles")
    sentence = frozen_sentence(spectrum)
    assert "1.5 h" in sentence
    assert "10 % of the smaller critical strain" in sentence
    assert "stiffness of the apparatus" in elastic_modulus_sentence(spectrum)
    steady = predict_attenuation(fit, microstructure="steady_state")
    assert (steady["frozen_fails"] == 0).all()
    assert "nothing evolves" in frozen_sentence(steady)
    assert "holds in most draws" in pale_sentence(steady)
    assert overview_table(steady)["frozen microstructure"].iloc[3].startswith("holds")


def test_stresses_where_curves_are_pale_are_named() -> None:
    found = spectrum_of()
    fails = likely_fails(found)
    assert fails.any()
    assert not fails.all()
    told = pale_sentence(found)
    for regime, of_regime in zip(PAPER_REGIMES, fails, strict=True):
        is_partly = bool(of_regime.any() and not of_regime.all())
        assert (regime.label in told) == of_regime.any()
        assert (f"{regime.label} (slow cycles)" in told) == is_partly


def test_the_elastic_modulus_can_be_given(fit: Fit, tmp_path: Path) -> None:
    given = predict_attenuation(fit, elastic_modulus=9.3e9)
    posterior = fit.posterior["posterior"].to_dataset()
    own = predict_attenuation(fit)
    np.testing.assert_allclose(
        given["storage_compliance"] - own["storage_compliance"],
        np.broadcast_to(
            (1 / 9.3e9 - 1 / posterior["maxwell_modulus"]).to_numpy()[..., None, None],
            own["tan_delta"].shape,
        ),
        rtol=1e-6,
        atol=1e-18,
    )
    np.testing.assert_allclose(given["loss_compliance"], own["loss_compliance"])
    assert "elastic modulus 9.3 GPa" in given.attrs["title"]
    scattered = predict_attenuation(fit, elastic_modulus=9.3e9, elastic_modulus_sd=0.5e9, seed=3)
    again = predict_attenuation(fit, elastic_modulus=9.3e9, elastic_modulus_sd=0.5e9, seed=3)
    xr.testing.assert_equal(scattered, again)
    assert "9.3 ± 0.5 GPa" in scattered.attrs["title"]
    # At high frequency the spring alone answers.
    fast = predict_attenuation(
        fit, [1e4], PAPER_REGIMES[:1], elastic_modulus=9.3e9, elastic_modulus_sd=0.5e9, seed=3
    )
    modulus = 1 / fast["storage_compliance"].to_numpy()
    assert modulus.std() == pytest.approx(0.5e9, rel=0.25)
    assert modulus.mean() == pytest.approx(9.3e9, rel=0.02)
    for mean, deviation in ((-1.0, 0.0), (1e9, -1.0)):
        with pytest.raises(InputError, match="elastic_modulus"):
            predict_attenuation(fit, elastic_modulus=mean, elastic_modulus_sd=deviation)
