"""The closed-form attenuation spectrum: limits, closed forms, invariants, tables, files."""

import time
import tracemalloc
from collections.abc import Callable, Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import oracle
import pytest
import xarray as xr
from imposed_stress import simulate_imposed_stress
from synthetic_fit import INITIAL_GRAIN_SIZE, make_fit

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit
from pyburgers.predictions.attenuation import (
    DEFAULT_FREQUENCIES,
    attenuation_spectrum,
    overview_table,
    predict_attenuation,
    quantile_table,
    save_spectrum,
)
from pyburgers.predictions.material import fitted_material
from pyburgers.predictions.stress_cycles import (
    PAPER_REGIMES,
    PARAMETER_NAMES,
    Regime,
    flow_rate,
    regimes_named,
)

TEMPERATURE = 260.0
FLUIDITY = 1.778058e-31  # A_eff of model.md, section 6, Pa^-4 s^-1
SHORT = (1e-4, 1e-3, 1e-2)
PAPER_LIKE_DRAWS: dict[str, tuple[float, float]] = {
    "maxwell_modulus": (2e9, 6e9),
    "kelvin_modulus": (5e8, 2e9),
    "kelvin_viscosity": (1e10, 1e11),
    "stress_exponent": (2.7, 4.5),
    "grain_size_exponent": (0.1, 0.7),
    "activation_enthalpy": (61e3, 69e3),
    "beta": (-7.31e-4, -7.27e-4),
}


def material(exponent: float = 4.0, fluidity: float = FLUIDITY, **changes: float) -> dict[str, Any]:
    """Parameters of model.md's table, with A_eff = `fluidity` at `TEMPERATURE` whatever d."""
    enthalpy = 60e3
    return {
        "maxwell_modulus": 4e9,
        "kelvin_modulus": 5e8,
        "kelvin_viscosity": 1e11,
        "stress_exponent": exponent,
        "grain_size_exponent": 0.0,
        "activation_enthalpy": enthalpy,
        "beta": np.log(fluidity) / enthalpy + 1 / (oracle.GAS_CONSTANT * TEMPERATURE),
        **changes,
    }


def spectrum_of(
    parameters: Mapping[str, npt.ArrayLike],
    regimes: tuple[Regime, ...] = PAPER_REGIMES,
    frequencies: tuple[float, ...] = SHORT,
    **conditions: Any,
) -> xr.Dataset:
    given = {"temperature": TEMPERATURE, "grain_size": 1e-4, **conditions}
    return attenuation_spectrum(parameters, frequencies, regimes, **given)


def dashpot_fluidity(
    parameters: Mapping[str, Any], regimes: tuple[Regime, ...], **conditions: Any
) -> FloatArray:
    """B (1/(Pa s)) of each regime: what the loss compliance has at a frequency without Kelvin."""
    frozen = {**parameters, "kelvin_viscosity": 0.0}
    spectrum = spectrum_of(frozen, regimes, (1.0,), **conditions)
    fluidity: FloatArray = 2 * np.pi * spectrum["loss_compliance"].to_numpy()[..., 0]
    return fluidity


def random_draws(shape: tuple[int, ...]) -> dict[str, FloatArray]:
    rng = np.random.default_rng(1)
    return {name: rng.uniform(*ends, shape) for name, ends in PAPER_LIKE_DRAWS.items()}


def test_the_values_of_an_independent_computation() -> None:
    regimes = (PAPER_REGIMES[0], PAPER_REGIMES[3])
    expected = [[0.63270, 1.06305, 0.64634], [36.20369, 8.76002, 3.65217]]
    np.testing.assert_allclose(spectrum_of(material(), regimes)["tan_delta"], expected, rtol=1e-5)


@pytest.mark.parametrize("breakdown", [0.0, 5e5])
def test_the_flow_rate_is_that_of_the_flow_law(breakdown: float) -> None:
    """Draws along the first axis, stresses of both signs along the second."""
    exponents, stress = np.array([[2.5], [3.7]]), np.array([-2e6, 0.0, 1e6])
    parameters = {**material(grain_size_exponent=0.5), "stress_exponent": exponents}
    found = flow_rate(
        {**parameters, "breakdown_stress": breakdown},
        stress,
        temperature=250.0,
        grain_size=2e-4,
        fabric_factor=0.7,
    )
    slower = np.exp(60e3 / oracle.GAS_CONSTANT * (1 / TEMPERATURE - 1 / 250.0))
    load = stress / 0.7
    if breakdown > 0:
        load = breakdown * np.sinh(load / breakdown)
    expected = FLUIDITY * slower * 2e-4**-0.5 * np.sign(load) * np.abs(load) ** exponents
    np.testing.assert_allclose(found, expected, rtol=1e-12)


BAND = {"relaxation_time_decades": 4.0, "relaxation_exponent": 0.3}
CREEP = {"andrade_exponent": 0.3}


@pytest.mark.parametrize("law", [BAND, CREEP, BAND | {"peak_strength": 0.5, "peak_width": 2.0}])
def test_a_broad_kelvin_part_changes_all_but_the_dashpot(law: dict[str, float]) -> None:
    frequencies = (1e-6, 1e-3, 1.0)
    one = spectrum_of(material(), frequencies=frequencies, hold_time=50.0)
    many = spectrum_of(material() | law, frequencies=frequencies, hold_time=50.0)
    omega = 2 * np.pi * np.array(frequencies)
    x = omega * 1e11 / 5e8
    kelvin = {
        "storage_compliance": 1 / (5e8 * (1 + x**2)),
        "loss_compliance": x / (5e8 * (1 + x**2)),
    }
    for name, compliance in kelvin.items():
        added = many[name] - one[name] + compliance
        # Of stress the Kelvin part knows nothing: the same in every regime.
        np.testing.assert_allclose(added, np.broadcast_to(added[0], added.shape), rtol=1e-6)
    assert not np.allclose(many["hold_strain"], one["hold_strain"], rtol=1e-3)


def test_relaxation_times_follow_temperature_and_grain_size() -> None:
    thermal = {
        "kelvin_activation_enthalpy": 6e4,
        "kelvin_reference_temperature": TEMPERATURE,
        "kelvin_grain_size_exponent": 2.0,
        "kelvin_reference_grain_size": 1e-4,
    }
    here = spectrum_of(material() | BAND | thermal)
    np.testing.assert_array_equal(here["tan_delta"], spectrum_of(material() | BAND)["tan_delta"])
    slower = np.exp(6e4 / oracle.GAS_CONSTANT * (1 / 250.0 - 1 / TEMPERATURE)) * 4
    elsewhere = spectrum_of(material() | BAND | thermal, temperature=250.0, grain_size=2e-4)
    shifted = spectrum_of(
        material() | BAND, frequencies=tuple(np.multiply(SHORT, slower)), temperature=TEMPERATURE
    )
    np.testing.assert_allclose(
        elsewhere["storage_compliance"], shifted["storage_compliance"], rtol=1e-9
    )
    # Andrade creep loses the same share of its own strain at all frequencies.
    stiff = material() | CREEP | {"maxwell_modulus": 1e30}
    regimes = (Regime(1e3, 1.0),)  # too small for the dashpot
    spectrum = spectrum_of(stiff, regimes, (1e-3, 1.0, 1e3))
    np.testing.assert_allclose(spectrum["tan_delta"], np.tan(0.15 * np.pi), rtol=1e-6)
    # One more decade of frequency, less compliance by the power of the exponent.
    storage = spectrum["storage_compliance"][0]
    assert float(storage[0] / storage[1]) == pytest.approx(1e3**0.3, rel=1e-6)


def test_a_wide_band_shows_no_peak_where_one_element_does() -> None:
    soft = material() | {"maxwell_modulus": 1e8, "kelvin_viscosity": 1e9}
    regimes = (Regime(1e5, 1e4),)
    assert bool(spectrum_of(soft, regimes)["debye_peak"].all())
    narrow = soft | {"relaxation_time_decades": 0.1, "relaxation_exponent": 0.5}
    assert bool(spectrum_of(narrow, regimes)["debye_peak"].all())
    assert not bool(spectrum_of(soft | CREEP, regimes)["debye_peak"].any())


def test_a_second_element_far_below_the_longest_time_shows_its_peak() -> None:
    elements = {"kelvin_modulus": 9e9, "kelvin_viscosity": 9e14, "maxwell_modulus": 9e9}
    second = {"peak_strength": 1.0, "peak_time_decades": 6.0}
    regimes = (Regime(0.25e6, 0.025e6),)  # so fast a dashpot hides the slower element
    frequencies = np.geomspace(1e-3, 10.0, 60)
    found = spectrum_of(material() | elements | second, regimes, tuple(frequencies))
    assert bool((np.diff(found["tan_delta"][0]) > 0).any())
    assert bool(found["debye_peak"].all())
    alone = spectrum_of(material() | elements, regimes, tuple(frequencies))
    assert not bool((np.diff(alone["tan_delta"][0]) > 0).any())
    of_band = {"relaxation_time_decades": 1.0, "relaxation_exponent": 0.3, "peak_width": 1.0}
    on_top = spectrum_of(material() | elements | second | of_band, regimes, tuple(frequencies))
    assert bool(on_top["debye_peak"].all())


def test_a_linear_material_answers_as_complex_algebra_says_in_every_regime() -> None:
    viscosity = 3e13
    parameters = material(1.0, 1 / viscosity)
    frequencies = np.geomspace(1e-6, 1.0, 25)
    omega = 2 * np.pi * frequencies
    compliance = 1 / 4e9 + 1 / (5e8 + 1j * omega * 1e11) + 1 / (1j * omega * viscosity)
    regimes = (*PAPER_REGIMES, Regime(0.0, 1e6), Regime(1e6, 3e6))
    spectrum = spectrum_of(parameters, regimes, tuple(frequencies))
    for k in range(len(regimes)):
        of_regime = spectrum.isel(regime=k)
        np.testing.assert_allclose(of_regime["storage_compliance"], compliance.real, rtol=1e-12)
        np.testing.assert_allclose(of_regime["loss_compliance"], -compliance.imag, rtol=1e-12)
        np.testing.assert_allclose(
            of_regime["tan_delta"], -compliance.imag / compliance.real, rtol=1e-12
        )


def test_microstructure_and_temperature_act_through_the_flow_law() -> None:
    parameters = material(3.5, 1e-27, grain_size_exponent=0.6)
    reference = dashpot_fluidity(parameters, PAPER_REGIMES)
    for conditions, factor in (
        ({"grain_size": 2e-4}, 2**-0.6),
        ({"fabric_factor": 0.5}, 2**3.5),
        (
            {"temperature": 250.0},
            np.exp(60e3 / oracle.GAS_CONSTANT * (1 / TEMPERATURE - 1 / 250.0)),
        ),
    ):
        changed = dashpot_fluidity(parameters, PAPER_REGIMES, **conditions)
        np.testing.assert_allclose(changed / reference, factor, rtol=1e-10)
    # A modulus that falls with temperature is taken at that of the prediction.
    falls = {"modulus_temperature_coefficient": 1e-3, "modulus_reference_temperature": 250.0}
    softer = spectrum_of(material() | falls)["storage_compliance"]
    other = material() | {"maxwell_modulus": 4e9 * (1 + 1e-3 * (TEMPERATURE - 250.0))}
    np.testing.assert_allclose(softer, spectrum_of(other)["storage_compliance"], rtol=1e-12)
    # It is linear in temperature, and not for every temperature.
    with pytest.raises(InputError, match="not positive in 1 of 1 draws"):
        spectrum_of(material() | {**falls, "modulus_temperature_coefficient": -1.0})
    # Small cycles see the slope of the flow law.
    found = dashpot_fluidity(material(3.7, 1e-28), (Regime(2e6, 2e2),))
    assert found[0] == pytest.approx(1e-28 * 3.7 * 2e6**2.7, rel=1e-7)


def test_attenuation_rises_with_the_amplitude_of_a_nonlinear_material_only() -> None:
    regimes = tuple(Regime(2e6, amplitude) for amplitude in (0.1e6, 0.5e6, 1e6, 2e6, 3e6))
    assert {regime.median_stress for regime in regimes} == {2e6}
    nonlinear = spectrum_of(material(), regimes)["tan_delta"]
    linear = spectrum_of(material(1.0, 1e-14), regimes)["tan_delta"]
    assert (nonlinear.diff("regime") > 0).all()
    np.testing.assert_allclose(linear.diff("regime"), 0.0, atol=1e-12)


def test_one_array_expression_gives_what_single_draws_and_regimes_give() -> None:
    draws = random_draws((2, 3))
    grain_size = np.linspace(1e-4, 2e-4, 6).reshape(2, 3)
    together = spectrum_of(draws, grain_size=grain_size)["tan_delta"]
    assert together.dims == ("chain", "draw", "regime", "frequency")
    for k, regime in enumerate(PAPER_REGIMES):
        alone = spectrum_of(
            {name: values[1, 2] for name, values in draws.items()},
            (regime,),
            grain_size=grain_size[1, 2],
        )["tan_delta"]
        assert alone.dims == ("regime", "frequency")
        np.testing.assert_allclose(together[1, 2, k], alone[0], rtol=1e-13)


def test_a_spectrum_says_what_it_is() -> None:
    spectrum = spectrum_of(random_draws((5,)), fabric_factor=np.full(5, 0.8))
    assert spectrum["tan_delta"].dims == ("draw", "regime", "frequency")
    assert spectrum["tan_delta"].attrs["units"] == "1"
    assert spectrum["loss_compliance"].attrs["units"] == "1/Pa"
    assert spectrum["frequency"].attrs["units"] == "Hz"
    assert spectrum["median_stress"].attrs["units"] == "Pa"
    assert spectrum["regime"].to_numpy().tolist() == [
        "1 ± 0.17 MPa",
        "1.5 ± 0.5 MPa",
        "2 ± 0.9 MPa",
        "4 ± 1.5 MPa",
    ]
    np.testing.assert_array_equal(spectrum["fabric_factor"], 0.8)
    np.testing.assert_allclose(
        spectrum["tan_delta"], spectrum["loss_compliance"] / spectrum["storage_compliance"]
    )
    # Strains are left out if nobody asks for them.
    draws = random_draws((5,))
    whole, bare = spectrum_of(draws), spectrum_of(draws, with_strains=False)
    strains = {"hold_strain", "cycle_strain", "critical_strain", "frozen_fails"}
    assert set(whole) - set(bare) == strains
    xr.testing.assert_identical(bare, whole.drop_vars(strains))


def test_the_criterion_of_the_peak_counts_the_turns_of_the_curve() -> None:
    """Draws near the limit included, where dip and peak merge."""
    rng = np.random.default_rng(5)
    ratio = np.append(rng.uniform(0.02, 1.0, 60), [0.2, 0.2, 0.125, 0.12])
    limit = (1 + ratio) / np.maximum(8 * ratio - 1, 1e-3)
    background = limit * np.append(rng.uniform(0.1, 2.0, 60), [0.97, 1.03, 1.0, 1.0])
    background[ratio <= 0.125] = rng.uniform(0.1, 3.0, int((ratio <= 0.125).sum()))
    kelvin = 5e8 * np.ones(ratio.size)
    viscosity = 1e11
    parameters = {
        **{name: np.full(ratio.size, value) for name, value in material(1.0, 1.0).items()},
        "maxwell_modulus": kelvin / ratio,
        "activation_enthalpy": np.full(ratio.size, 60e3),
        "beta": np.log(background / viscosity) / 60e3 + 1 / (oracle.GAS_CONSTANT * TEMPERATURE),
    }
    frequencies = tuple(np.geomspace(1e-6, 1e1, 20_001))
    spectrum = spectrum_of(parameters, PAPER_REGIMES[:1], frequencies, with_strains=False)
    slopes = np.sign(np.diff(spectrum["tan_delta"].to_numpy()[:, 0], axis=-1))
    n_turns = (np.diff(slopes, axis=-1) != 0).sum(axis=-1)
    assert set(n_turns.tolist()) == {0, 2}
    np.testing.assert_array_equal(spectrum["debye_peak"][:, 0], n_turns == 2)


def test_a_whole_posterior_takes_little_time_and_memory() -> None:
    assert len(DEFAULT_FREQUENCIES) == 60
    start = time.process_time()
    spectrum_of(random_draws((4, 500)), frequencies=DEFAULT_FREQUENCIES)
    assert time.process_time() - start < 1.0
    tracemalloc.start()
    spectrum_of(random_draws((4, 250)), frequencies=DEFAULT_FREQUENCIES)
    _, peak = tracemalloc.get_traced_memory()
    tracemalloc.stop()
    assert peak < 25e6


DRAWS = random_draws((2, 3))
Call = Callable[..., object]
REFUSED: list[tuple[Call, tuple[Any, ...], dict[str, Any], str]] = [
    *(
        (spectrum_of, (DRAWS,), {name: value}, words)
        for name, value, words in (
            ("frequencies", (np.nan,), "frequencies: found nan"),
            ("frequencies", ["a"], r"frequencies: found \['a'\], expected numbers"),
            ("grain_size", "1 mm", "grain_size: found '1 mm', expected numbers"),
            ("frequencies", (), "frequencies: found an array of shape"),
            ("grain_size", np.ones(7), r"grain_size: found the shape \(7,\)"),
        )
    ),
    *(
        (spectrum_of, (draws,), {}, words)
        for draws, words in (
            (DRAWS | {"beta": DRAWS["beta"][0]}, r"'beta' has the shape \(3,\), expected \(2, 3\)"),
            (DRAWS | {"beta": np.full((2, 3), np.nan)}, "draws that are not finite"),
            (DRAWS | {"kelvin_viscosity": np.full((2, 3), np.inf)}, "draws that are not finite"),
            ({name: own for name, own in DRAWS.items() if name != "beta"}, "'beta' is missing"),
            ({name: own[np.newaxis] for name, own in DRAWS.items()}, r"shape \(1, 2, 3\)"),
        )
    ),
    *(
        (Regime, numbers, {}, rf"^{name}: found .* expected")
        for numbers, name in (
            ((np.nan, 1e6), "median_stress"),
            ((1e6, np.inf), "amplitude"),
        )
    ),
    (
        simulate_imposed_stress,
        (material() | BAND, PAPER_REGIMES[0], 1e-2, np.array([1.0])),
        {"temperature": TEMPERATURE, "grain_size": 1e-4},
        "relaxation_time_decades: found values other than 0",
    ),
]


@pytest.mark.parametrize(("call", "values", "options", "words"), REFUSED)
def test_what_has_no_spectrum_is_refused(
    call: Call, values: tuple[Any, ...], options: dict[str, Any], words: str
) -> None:
    with pytest.raises(InputError, match=words):
        call(*values, **options)
    assert regimes_named(["4", "1"]) == (PAPER_REGIMES[3], PAPER_REGIMES[0])


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("run"), chains=2, draws=50)


def draws_of(fit: Fit) -> dict[str, FloatArray]:
    posterior = fit.posterior["posterior"].to_dataset()
    return {
        name: posterior[name].transpose("chain", "draw").to_numpy()
        for name in (*PARAMETER_NAMES, "steady_state_grain_size", "steady_state_fabric_factor")
    }


def test_the_title_of_a_prediction_says_that_no_data_took_part(fit: Fit) -> None:
    prior_alone = replace(fit, manifest={**fit.manifest, "use_likelihood": False})
    title = str(predict_attenuation(prior_alone, SHORT).attrs["title"])
    assert title.startswith("PIL40 (ice, drawn from priors): 260 K")


GIVEN: dict[str, Any] = {"temperature": 250.0, "grain_size": 1e-3, "fabric_factor": 0.5}


@pytest.mark.parametrize(
    ("microstructure", "given", "title"),
    [
        ("initial", {}, "PIL40 (ice, fitted to synthetic data): 260 K, initial microstructure"),
        ("steady_state", {}, "PIL40 (ice, fitted to synthetic data): 260 K, steady-state"),
        ("steady_state", GIVEN, "250 K, grain size 1000 µm"),
    ],
)
def test_a_fit_predicts_each_draw_with_its_microstructure_or_the_given_one(
    microstructure: str, given: dict[str, Any], title: str, fit: Fit
) -> None:
    found = predict_attenuation(fit, SHORT, microstructure=microstructure, **given)
    draws = draws_of(fit)
    own: dict[str, Any] = {"grain_size": INITIAL_GRAIN_SIZE}
    if microstructure == "steady_state":
        names = ("grain_size", "fabric_factor")
        own = {name: draws[f"steady_state_{name}"] for name in names}
    expected = spectrum_of(draws, **{**own, **given})
    np.testing.assert_allclose(found["tan_delta"], expected["tan_delta"], rtol=1e-13)
    for name in ("chain", "draw"):
        np.testing.assert_array_equal(found[name], fit.posterior["posterior"][name])
    assert title in found.attrs["title"]
    assert ("fabric factor 0.5" in found.attrs["title"]) == bool(given)
    if microstructure == "steady_state" and not given:
        # Softer than the undeformed material in every draw.
        assert (found["tan_delta"] > predict_attenuation(fit, SHORT)["tan_delta"]).all()
    with pytest.raises(InputError, match="'frozen', expected 'initial' or 'steady_state'"):
        predict_attenuation(fit, SHORT, microstructure="frozen")


def test_a_fit_predicts_at_a_pressure_on_which_its_rates_depend(fit: Fit) -> None:
    posterior = fit.posterior.copy()
    draws = posterior["posterior"].to_dataset()
    volume = xr.full_like(draws["kelvin_viscosity"], 6e-6)
    posterior["posterior"] = posterior["posterior"].assign(kelvin_activation_volume=volume)
    dependent = replace(fit, posterior=posterior)
    deep = predict_attenuation(dependent, SHORT, environment={"pressure": 3e8})
    slower = np.exp(3e8 * 6e-6 / (oracle.GAS_CONSTANT * fit.experiment.temperature))
    own = draws_of(fit)
    expected = spectrum_of(
        {**own, "kelvin_viscosity": slower * own["kelvin_viscosity"]}, grain_size=INITIAL_GRAIN_SIZE
    )
    np.testing.assert_allclose(deep["tan_delta"], expected["tan_delta"], rtol=1e-9)
    assert "pressure 300 MPa" in deep.attrs["title"]
    # Without one it is that of the test, which no other rate feels.
    under = replace(fit.experiment, environment={"pressure": 2e8, "melt_fraction": 0.1})
    problem = replace(fit.problem, experiments=(under,))
    title = fitted_material(replace(dependent, problem=problem)).attributes["title"]
    assert title.endswith("initial microstructure, pressure 200 MPa")
    for environment, message in (
        ({"melt_fraction": 0.1}, "found melt_fraction, on which no rate of the fit depends"),
        ({"presure": 1e8}, "unknown name 'presure'"),
        ({"pressure": -1.0}, "the pressure is -1 Pa, expected at least 0"),
    ):
        with pytest.raises(InputError, match=message):
            predict_attenuation(fit, SHORT, environment=environment)


def test_the_table_holds_the_quantiles_of_the_draws(fit: Fit) -> None:
    spectrum = predict_attenuation(fit, SHORT)
    table = quantile_table(spectrum)
    assert list(table) == [
        "median_stress_MPa",
        "amplitude_MPa",
        "frequency_Hz",
        "mean",
        "sd",
        "q5",
        "q25",
        "q50",
        "q75",
        "q95",
        "hold_strain",
        "cycle_strain",
        "p_hold_fails",
        "p_cycle_fails",
        "p_frozen_fails",
    ]
    assert len(table) == len(PAPER_REGIMES) * len(SHORT)
    row = table[(table["amplitude_MPa"] == 0.9) & (table["frequency_Hz"] == 1e-3)].iloc[0]
    values = spectrum["tan_delta"].sel(regime="2 ± 0.9 MPa", frequency=1e-3)
    assert row["median_stress_MPa"] == 2.0
    assert row["mean"] == pytest.approx(float(values.mean()))
    assert row["sd"] == pytest.approx(float(values.std()))
    for percent in (5, 25, 50, 75, 95):
        assert row[f"q{percent}"] == pytest.approx(np.percentile(values, percent))


def test_the_overview_has_a_few_frequencies_and_the_share_of_peaks(fit: Fit) -> None:
    spectrum = predict_attenuation(fit)
    table = overview_table(spectrum)
    assert list(table)[:2] == ["regime", "frozen microstructure"]
    assert list(table)[-1] == "Debye peak"
    assert len(table.columns) == 8
    share = float(spectrum["debye_peak"].isel(regime=3).mean())
    assert table["Debye peak"].iloc[3] == f"{100 * share:.0f} % of draws"
    assert len(overview_table(predict_attenuation(fit, [1e-3])).columns) == 4


def test_a_saved_spectrum_reads_back(fit: Fit, tmp_path: Path) -> None:
    spectrum = predict_attenuation(fit, SHORT)
    save_spectrum(spectrum, tmp_path / "spectrum.nc")
    with xr.open_dataset(tmp_path / "spectrum.nc", engine="h5netcdf") as opened:
        again = opened.load()
    assert again["tan_delta"].dtype == np.float32
    np.testing.assert_allclose(again["tan_delta"], spectrum["tan_delta"], rtol=1e-6)
    np.testing.assert_array_equal(again["debye_peak"], spectrum["debye_peak"])
    np.testing.assert_array_equal(again["regime"], spectrum["regime"])
    assert again["frequency"].attrs == {"units": "Hz"}
    assert again.attrs == spectrum.attrs
    assert [path.name for path in tmp_path.iterdir()] == ["spectrum.nc"]


@pytest.mark.parametrize(
    ("segments", "is_told"), [(((0.0, 1.69e-4),), True), (((0.0, 1e-15), (0.1, 0.1)), False)]
)
def test_cycles_slower_or_longer_than_what_was_fitted_are_told(
    segments: tuple[tuple[float, float], ...], is_told: bool, tmp_path: Path
) -> None:
    fit = make_fit(tmp_path, chains=2, draws=50, segments=segments)
    told = predict_attenuation(fit, [1e-9], [Regime(1e6, 1e5), Regime(2e6, 1e5)]).attrs["cautions"]
    slow, fast = (
        float(
            np.median(
                flow_rate(draws_of(fit), one, temperature=260.0, grain_size=INITIAL_GRAIN_SIZE)
            )
        )
        for one in (1.1e6, 2.1e6)
    )
    rates = f"strain rate {slow:.4g} to {fast:.4g} 1/s (fitted: 0.000169)"
    assert (rates in told) == ("Cycles of 1e+09 s last longer" in told) == is_told
    assert ("strain rate" in told) == is_told
