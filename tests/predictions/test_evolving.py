"""Stress cycles of an evolving microstructure: limits, and an independent solver."""

from collections.abc import Mapping
from typing import Any

import numpy as np
import oracle
import pandas as pd
import pytest
import xarray as xr
from imposed_stress import GRAIN_SIZE, ICE, TEMPERATURE, simulate_imposed_stress
from scipy.integrate import solve_ivp
from synthetic_fit import make_fit

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit
from pyburgers.predictions.attenuation import material_spectrum, predict_attenuation
from pyburgers.predictions.evolving import (
    evolving_attenuation,
    evolving_overview,
    evolving_sentence,
    evolving_table,
)
from pyburgers.predictions.figures import BEYOND_LABEL, EVOLVING_LABEL, attenuation
from pyburgers.predictions.material import Material, fitted_material
from pyburgers.predictions.stress_cycles import PAPER_REGIMES, Regime

pytestmark = pytest.mark.usefixtures("programs")


PIEZOMETRIC = {
    "piezometer_reference_grain_size": 5e-4,
    "piezometer_exponent": 1.33,
    "piezometer_stress_floor": 1e6,
}


OF_GRAINS = {
    "kelvin_grain_size_exponent": 1.5,
    "kelvin_reference_grain_size": 3 * GRAIN_SIZE,
}


def material(
    parameters: Mapping[str, float] = ICE,
    grain_size: float = GRAIN_SIZE,
    fabric_factor: float = 1.0,
) -> Material:
    """One draw."""
    return Material(
        parameters={name: np.full((1, 1), value) for name, value in parameters.items()},
        temperature=TEMPERATURE,
        grain_size=np.full((1, 1), grain_size),
        fabric_factor=np.full((1, 1), fabric_factor),
        chain=np.array([1]),
        draw=np.array([0]),
        attributes={"title": "a heading", "elastic_modulus": ""},
    )


def independent_solution(
    parameters: Mapping[str, float],
    regime: Regime,
    frequency: float,
    times: FloatArray,
    hold: float,
) -> FloatArray:
    """Kelvin and dashpot strain, path strain, d and F from the rates as the paper has them."""
    p, omega = dict(parameters), 2 * np.pi * frequency

    def preferred(stress: float) -> float:
        if "piezometer_reference_grain_size" not in p:
            return p["steady_state_grain_size"]
        larger = np.hypot(stress, p["piezometer_stress_floor"]) / 1e6
        return float(p["piezometer_reference_grain_size"] * larger ** -p["piezometer_exponent"])

    coarser = GRAIN_SIZE / p.get("kelvin_reference_grain_size", GRAIN_SIZE)
    viscosity = p["kelvin_viscosity"] * coarser ** p.get("kelvin_grain_size_exponent", 0.0)
    log_factor = p["activation_enthalpy"] * (p["beta"] - 1 / (oracle.GAS_CONSTANT * TEMPERATURE))

    def rates(time: float, state: FloatArray, amplitude: float) -> list[float]:
        kelvin, _, _, size, fabric = state
        stress = regime.median_stress + amplitude * np.sin(omega * time)
        stress_rate = amplitude * omega * np.cos(omega * time)
        of_kelvin = (stress - p["kelvin_modulus"] * kelvin) / viscosity
        of_dashpot = (
            np.sign(stress)
            * (abs(stress) / fabric) ** p["stress_exponent"]
            * size ** -p["grain_size_exponent"]
            * np.exp(log_factor)
        )
        path = abs(stress_rate / p["maxwell_modulus"] + of_kelvin + of_dashpot)
        return [
            of_kelvin,
            of_dashpot,
            path,
            path * (preferred(stress) - size) / p["critical_strain_grain_size"],
            path * (p["steady_state_fabric_factor"] - fabric) / p["critical_strain_fabric"],
        ]

    loading = regime.median_stress / p["maxwell_modulus"]
    first = preferred(regime.median_stress)
    decay = [np.exp(-loading / p[f"critical_strain_{of}"]) for of in ("grain_size", "fabric")]
    start = [
        0.0,
        0.0,
        loading,
        first + (GRAIN_SIZE - first) * decay[0],
        p["steady_state_fabric_factor"] + (1 - p["steady_state_fabric_factor"]) * decay[1],
    ]
    given: dict[str, Any] = {"rtol": 1e-10, "atol": 1e-14, "method": "LSODA"}
    held = solve_ivp(rates, (-hold, 0.0), start, args=(0.0,), **given).y[:, -1]
    cycles = solve_ivp(
        rates,
        (0.0, times[-1]),
        held,
        args=(regime.amplitude,),
        t_eval=times,
        max_step=0.02 / frequency,
        **given,
    )
    solution: FloatArray = cycles.y
    return solution


@pytest.mark.parametrize(
    "changes",
    [{}, PIEZOMETRIC, OF_GRAINS],
    ids=["steady state", "piezometer", "relaxation time of the grain size"],
)
@pytest.mark.parametrize("regime", [PAPER_REGIMES[1], PAPER_REGIMES[3]], ids=lambda r: r.label)
def test_the_solution_is_that_of_an_independent_solver(
    regime: Regime, changes: dict[str, float]
) -> None:
    parameters, frequency, hold = ICE | changes, 1e-3, 3600.0
    times = np.arange(1, 49) / 16 / frequency
    record = simulate_imposed_stress(
        parameters,
        regime,
        frequency,
        times,
        temperature=TEMPERATURE,
        grain_size=GRAIN_SIZE,
        hold_time=hold,
        evolving=True,
    ).iloc[1:]
    expected = independent_solution(parameters, regime, frequency, times, hold)
    columns = ("kelvin_strain", "dashpot_strain", "path_strain", "grain_size_m", "fabric_factor")
    for column, values in zip(columns, expected, strict=True):
        np.testing.assert_allclose(record[column], values, rtol=2e-6, err_msg=column)
    strain = record["stress_Pa"] / 4e9 + record["kelvin_strain"] + record["dashpot_strain"]
    np.testing.assert_allclose(record["strain"], strain, rtol=1e-13)


def test_the_maxwell_modulus_is_that_of_the_temperature() -> None:
    """E_M [1 + a_E (T - T_E)] and a modulus that is so at every temperature give one solution."""
    falls = {"modulus_temperature_coefficient": -0.03, "modulus_reference_temperature": 250.0}
    softer = ICE["maxwell_modulus"] * (1 - 0.03 * (TEMPERATURE - 250.0))
    records = [
        simulate_imposed_stress(
            parameters,
            PAPER_REGIMES[3],
            1e-3,
            np.linspace(-5000.0, 3000.0, 17),
            temperature=TEMPERATURE,
            grain_size=GRAIN_SIZE,
            evolving=True,
        )
        for parameters in (ICE | falls, ICE | {"maxwell_modulus": softer}, ICE)
    ]
    pd.testing.assert_frame_equal(records[0], records[1], rtol=1e-9)
    assert not np.allclose(records[0]["path_strain"], records[2]["path_strain"], rtol=1e-5)
    found, expected = (
        evolving_attenuation(material(parameters), (1e-3,), (PAPER_REGIMES[3],))
        for parameters in (ICE | falls, ICE | {"maxwell_modulus": softer})
    )
    xr.testing.assert_allclose(found, expected, rtol=1e-9)


@pytest.mark.parametrize("exponent", [1.0, 3.7])
def test_a_small_strain_leaves_the_frozen_closed_form(exponent: float) -> None:
    """Stresses so small that a few cycles strain by less than a hundredth of a percent."""
    enthalpy, size = 60e3, 0.5
    log_factor = np.log(2e-12 if exponent == 1 else 2e-12 / 1e4 ** (exponent - 1))
    beta = (log_factor + size * np.log(GRAIN_SIZE)) / enthalpy + 1 / (
        oracle.GAS_CONSTANT * TEMPERATURE
    )
    changes = {"stress_exponent": exponent, "activation_enthalpy": enthalpy, "beta": float(beta)}
    found = evolving_attenuation(material(ICE | changes), regimes=(Regime(1e3, 5e2),))
    assert float(found["path_strain"].max()) < 1e-4
    np.testing.assert_allclose(found["tan_delta_evolving"], found["tan_delta_frozen"], rtol=1e-3)
    np.testing.assert_allclose(found["fluidity_ratio"], 1.0, rtol=2e-3)


def test_a_steady_state_stays_as_it_is_whatever_the_strain() -> None:
    found = evolving_attenuation(material(grain_size=1e-4, fabric_factor=0.5))
    assert float(found["path_strain"].max()) > 1.0
    np.testing.assert_allclose(found["tan_delta_evolving"], found["tan_delta_frozen"], rtol=1e-5)
    np.testing.assert_allclose(found["grain_size"], 1e-4, rtol=1e-9)
    np.testing.assert_allclose(found["fabric_factor"], 0.5, rtol=1e-9)


def test_after_a_large_strain_the_dashpot_is_that_of_the_steady_state() -> None:
    found = evolving_attenuation(material(), (1e-3,), (PAPER_REGIMES[3],), hold_time=200e3)
    expected = 0.5**-3.7 * 0.5**-0.5
    assert found["fluidity_ratio"].item() == pytest.approx(expected, rel=1e-4)
    steady = evolving_attenuation(
        material(grain_size=1e-4, fabric_factor=0.5), (1e-3,), (PAPER_REGIMES[3],)
    )
    assert found["tan_delta_evolving"].item() == pytest.approx(
        steady["tan_delta_frozen"].item(), rel=1e-4
    )


def test_softening_shows_first_where_the_material_strains_most() -> None:
    found = evolving_attenuation(material())
    ratio = found["fluidity_ratio"].isel(draw=0)
    assert (ratio > 1).all()
    assert (ratio.diff("regime") > 0).all()
    assert (ratio.diff("frequency") < 0).all()
    # At the largest stress and the lowest frequency the frozen closed form is several times off.
    assert float(ratio.isel(regime=3, frequency=0)) > 3
    assert float(ratio.isel(regime=0, frequency=2)) < 1.1


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("run"), chains=2, draws=10)


@pytest.fixture(scope="module")
def comparison(fit: Fit) -> xr.Dataset:
    return evolving_attenuation(fitted_material(fit), (1e-3, 1e-2), max_draws=7)


def test_draws_of_a_fit_are_compared_one_by_one(fit: Fit, comparison: xr.Dataset) -> None:
    assert comparison["tan_delta_evolving"].sizes == {"draw": 7, "regime": 4, "frequency": 2}
    frozen = predict_attenuation(fit, (1e-3, 1e-2))["tan_delta"].to_numpy().reshape(20, 4, 2)
    np.testing.assert_allclose(comparison["tan_delta_frozen"], frozen[np.arange(7) * 20 // 7])
    assert comparison.attrs["title"].startswith("PIL40")


def test_table_overview_and_sentence_say_what_was_found(comparison: xr.Dataset) -> None:
    table = evolving_table(comparison)
    assert len(table) == 8
    ratio = comparison["fluidity_ratio"].to_numpy()
    np.testing.assert_allclose(table["fluidity_ratio_q50"], np.median(ratio, axis=0).ravel())
    evolving = np.median(comparison["tan_delta_evolving"], axis=0)
    np.testing.assert_allclose(table["evolving_q50"], evolving.ravel())
    assert table["median_stress_MPa"].tolist() == [1.0, 1.0, 1.5, 1.5, 2.0, 2.0, 4.0, 4.0]
    assert (table["draws"] == 7).all()
    assert len(evolving_overview(comparison)) == 8
    assert "3 cycles" in evolving_sentence(comparison)


def test_a_lag_beyond_a_quarter_cycle_is_infinite_in_tables_and_above_all_in_the_figure() -> None:
    softer = material(ICE | {"activation_enthalpy": 59e3, "critical_strain_fabric": 2.0})
    regimes = (PAPER_REGIMES[0], PAPER_REGIMES[3])
    found = evolving_attenuation(softer, (1e-4,), regimes)
    assert np.isinf(found["tan_delta_evolving"].to_numpy()).ravel().tolist() == [False, True]
    assert evolving_table(found)["evolving_q50"].tolist()[1] == np.inf
    assert evolving_overview(found)["tan δ, evolving"].tolist()[1] == "inf [inf, inf]"
    figure = attenuation(material_spectrum(softer, (1e-4, 1e-3), regimes), found)
    (axes,) = figure.axes
    triangles = [line for line in axes.lines if line.get_marker() == "^"]
    assert triangles
    heights = [np.asarray(line.get_ydata(), dtype=np.float64) for line in axes.lines]
    highest = max(height[np.isfinite(height)].max(initial=0.0) for height in heights)
    for line in triangles:
        assert float(np.max(np.asarray(line.get_ydata(), dtype=np.float64))) == highest
    assert BEYOND_LABEL in [text.get_text() for text in figure.legends[0].get_texts()]


def test_the_figure_shows_what_was_solved(fit: Fit, comparison: xr.Dataset) -> None:
    figure = attenuation(predict_attenuation(fit), comparison)
    (axes,) = figure.axes
    drawn = [line for line in axes.lines if line.get_label() == "_evolving"]
    medians = np.median(comparison["tan_delta_evolving"], axis=0)
    assert len(drawn) == 4
    for line, expected in zip(drawn, medians, strict=True):
        np.testing.assert_allclose(np.asarray(line.get_ydata(), dtype=np.float64), expected)
    assert EVOLVING_LABEL in [text.get_text() for text in figure.legends[0].get_texts()]


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"cycles": 1}, "cycles: found 1, expected at least 2"),
        ({"max_draws": 0}, "max_draws: found 0"),
    ],
)
def test_numbers_out_of_range_are_refused(given: dict[str, Any], message: str) -> None:
    with pytest.raises(InputError, match=message):
        evolving_attenuation(material(), **given)
    known = {name: value for name, value in ICE.items() if not name.startswith("critical")}
    with pytest.raises(InputError, match="'critical_strain_grain_size' is missing"):
        evolving_attenuation(material(known))
