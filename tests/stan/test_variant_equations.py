"""Variants of the model against independent solutions, densities and closed forms."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import numpy.typing as npt
import oracle
import pytest
from conftest import ICE, FunctionValues
from independent_table import TRUTHS
from scipy import stats
from scipy.integrate import solve_ivp
from stan_values import PHYSICS

from pyburgers.common.errors import InputError
from pyburgers.kinds.constant_rate.experiment import (
    ConstantRateExperiment,
    RateSegment,
    load_constant_rate,
)
from pyburgers.kinds.forced_oscillation.experiment import (
    load_forced_oscillation,
    with_background,
)
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.program_data import solve
from pyburgers.kinds.stan_data import REFERENCE_SOLVER
from pyburgers.predictions.attenuation import attenuation_spectrum
from pyburgers.predictions.imposed_stress import simulate_imposed_stress
from pyburgers.predictions.stress_cycles import Regime

FloatArray = npt.NDArray[np.float64]
pytestmark = pytest.mark.usefixtures("programs")

OLIVINE = Path(__file__).parents[2] / "data" / "olivine" / "olivine_twin.toml"
STRAIN = np.concatenate([np.geomspace(1e-4, 0.01, 15), np.linspace(0.015, 0.2, 20)])
POWER_LAW = {
    "kelvin_stress_exponent": 3.0,
    "kelvin_activation_enthalpy": 60e3,
    "kelvin_reference_stress": 2e6,
    "kelvin_reference_temperature": 260.0,
}
PIEZOMETER = {
    "piezometer_reference_grain_size": 2e-3,
    "piezometer_exponent": 1.33,
    "piezometer_stress_floor": 1e6,
    # That of the start: nothing else moves the grain size.
    "steady_state_grain_size": 230e-6,
}


def protocol_at(
    temperature: float, segments: tuple[tuple[float, float], ...]
) -> ConstantRateExperiment:
    return replace(
        load_constant_rate(ICE / "PIL40.toml"),
        temperature=temperature,
        segments=tuple(RateSegment(start, rate) for start, rate in segments),
        strain=np.empty(0),
        stress=np.empty(0),
        final_strain=0.2,
    )


def truth() -> dict[str, float]:
    """A material whose Kelvin element counts."""
    return dict(TRUTHS["fast"])


@pytest.mark.parametrize("exponent", [1.0, 2.0, 3.5])
@pytest.mark.parametrize("temperature", [240.0, 260.0, 271.0])
@pytest.mark.parametrize(
    "segments",
    [((0.0, 1e-6),), ((0.0, 1.69e-4),), ((0.0, 1e-4), (0.03, 2e-5), (0.0501, 3e-4))],
    ids=["slow", "fast", "steps"],
)
def test_power_law_kelvin_element_agrees_with_scipy(
    segments: tuple[tuple[float, float], ...], temperature: float, exponent: float
) -> None:
    parameters = truth() | POWER_LAW | {"kelvin_stress_exponent": exponent}
    strain = np.union1d(STRAIN, [start for start, _ in segments[1:]])
    solution = simulate(protocol_at(temperature, segments), parameters, at=strain)
    independent = oracle.six_states(parameters, temperature, 230e-6, segments, strain)
    np.testing.assert_allclose(solution["stress_Pa"], independent[0], rtol=1e-5)
    np.testing.assert_allclose(solution["kelvin_strain"], independent[1], rtol=1e-5, atol=1e-10)


def test_the_exponent_matters_visibly() -> None:
    """The acceptance bound of 0.2 % would notice a linear element in its place."""
    test = protocol_at(260.0, ((0.0, 1.69e-4),))
    linear, cubic = (
        simulate(test, truth() | POWER_LAW | {"kelvin_stress_exponent": exponent}, at=STRAIN)
        for exponent in (1.0, 3.0)
    )
    assert np.max(np.abs(cubic["stress_Pa"] / linear["stress_Pa"] - 1)) > 0.05


def test_power_law_tends_to_the_linear_element() -> None:
    """Another right-hand side in the program, the same solution."""
    test = protocol_at(260.0, ((0.0, 1e-4), (0.05, 1e-5)))
    strain = np.union1d(STRAIN, [0.05])
    linear = simulate(test, truth(), at=strain)
    almost = POWER_LAW | {"kelvin_stress_exponent": 1 + 1e-12}
    power_law = simulate(test, truth() | almost, at=strain)
    np.testing.assert_allclose(power_law["stress_Pa"], linear["stress_Pa"], rtol=1e-8)


@pytest.mark.parametrize("exponent", [1.0, 3.0])
@pytest.mark.parametrize(
    "segments", [((0.0, 1e-6),), ((0.0, 1e-4), (0.03, 2e-5), (0.0501, 3e-4))], ids=["one", "steps"]
)
def test_piezometric_grain_size_agrees_with_scipy(
    segments: tuple[tuple[float, float], ...], exponent: float
) -> None:
    parameters = truth() | POWER_LAW | PIEZOMETER | {"kelvin_stress_exponent": exponent}
    strain = np.union1d(STRAIN, [start for start, _ in segments[1:]])
    solution = simulate(protocol_at(260.0, segments), parameters, at=strain)
    independent = oracle.six_states(parameters, 260.0, 230e-6, segments, strain)
    np.testing.assert_allclose(solution["stress_Pa"], independent[0], rtol=1e-5)
    np.testing.assert_allclose(solution["kelvin_strain"], independent[1], rtol=1e-5, atol=1e-10)
    np.testing.assert_allclose(solution["grain_size_m"], independent[4], rtol=1e-5)


def test_piezometric_grain_size_settles_at_that_of_the_stress() -> None:
    test = replace(protocol_at(260.0, ((0.0, 1e-4),)), final_strain=3.0)
    parameters = truth() | PIEZOMETER
    end = simulate(test, parameters, at=np.array([3.0])).iloc[-1]
    wanted = oracle.piezometer(end["stress_Pa"]) * 2e-3 / 0.015
    assert end["grain_size_m"] == pytest.approx(wanted, rel=1e-6)


def test_stress_slope_is_that_of_the_solution() -> None:
    test = protocol_at(250.0, ((0.0, 1e-4),))
    strain = np.linspace(0.01, 0.1, 2001)
    draw = solve(test, truth() | POWER_LAW, strain, solver=REFERENCE_SOLVER)
    slope = np.gradient(draw["grid_stress"], strain, edge_order=2)
    scale = np.max(np.abs(slope))
    np.testing.assert_allclose(draw["grid_stress_slope"], slope, atol=1e-4 * scale)


def test_oscillating_test_with_a_power_law_kelvin_element_agrees_with_scipy() -> None:
    twin = with_background(load_forced_oscillation(OLIVINE), "removed")
    assert twin.true_parameters is not None
    parameters = dict(twin.true_parameters) | {
        "kelvin_stress_exponent": 2.5,
        "kelvin_activation_enthalpy": 400e3,
        "kelvin_reference_stress": 100e6,
        "kelvin_reference_temperature": 1400.0,
    }
    prepared = twin.prepared
    imposed = oracle.OscillatingStrain(
        prepared.period,
        prepared.strain_sine.tolist(),
        prepared.strain_cosine.tolist(),
        (0.0,),
        prepared.start,
    )
    time = prepared.start + np.linspace(20.0, 900.0, 45)
    solution = simulate(twin, parameters, at=time)
    independent = oracle.oscillation(
        parameters,
        twin.temperature,
        twin.initial_grain_size,
        imposed,
        start=imposed.zero_ahead(twin.spin_up_cycles),
        start_stress=0.0,
        time=time,
    )
    scale = np.abs(independent[0]).max()
    np.testing.assert_allclose(solution["stress_Pa"], independent[0], atol=2e-3 * scale, rtol=0)
    linear = simulate(twin, twin.true_parameters, at=time)
    assert np.abs(linear["stress_Pa"] - independent[0]).max() > 0.02 * scale


def test_stress_cycles_of_a_power_law_kelvin_element_agree_with_scipy() -> None:
    parameters = truth() | POWER_LAW
    regime, frequency, hold = Regime(2e6, 0.9e6), 1e-3, 3600.0
    time = np.linspace(-3000.0, 4000.0, 71)
    found = simulate_imposed_stress(
        parameters, regime, frequency, time, temperature=263.0, grain_size=2e-4, hold_time=hold
    )

    def stress(at: float) -> float:
        cycles = regime.amplitude * np.sin(2 * np.pi * frequency * at) if at > 0 else 0.0
        return float(regime.median_stress + cycles)

    times = found["time_s"].to_numpy()
    expected = solve_ivp(
        lambda at, strain: [oracle.kelvin_rate(parameters, 263.0, stress(at), strain[0])],
        (-hold, times[-1]),
        [0.0],
        method="LSODA",
        t_eval=times,
        rtol=1e-10,
        atol=1e-14,
        max_step=20.0,
    )
    np.testing.assert_allclose(found["kelvin_strain"], expected.y[0], rtol=1e-6)


def test_attenuation_in_closed_form_refuses_a_power_law_kelvin_element() -> None:
    with pytest.raises(InputError, match="kelvin_stress_exponent: found values other than 1"):
        attenuation_spectrum(truth() | POWER_LAW, temperature=260.0, grain_size=2e-4)


def values_of_functions(
    function_values: FunctionValues,
    strain: FloatArray,
    residual: FloatArray,
    correlation_strain: float,
    *,
    segment: Sequence[int] | None = None,
    share: float = 1.0,
    replications: int = 0,
) -> dict[str, FloatArray]:
    return function_values(
        "physics_values",
        {
            **PHYSICS,
            "n": strain.size,
            "strain": strain.tolist(),
            "segment": [1] * strain.size if segment is None else list(segment),
            "correlated_share": share,
            "residual": residual.tolist(),
            "correlation_strain": correlation_strain,
            "n_replications": replications,
            "temperature": 250.0,
            "n_driving": 4,
            "driving_stress": [-3e6, 0.0, 1.0, 5e6],
        },
    )


IRREGULAR = np.sort(np.random.default_rng(1).uniform(0.001, 0.2, 12))
RESIDUAL = 3e4 * np.random.default_rng(2).standard_normal(IRREGULAR.size)


def test_kelvin_viscosity_is_converted_to_the_factor_of_masuti_and_barbot(
    function_values: FunctionValues,
) -> None:
    found = values_of_functions(function_values, IRREGULAR, RESIDUAL, 0.02)
    driving = np.array([-3e6, 0.0, 1.0, 5e6])
    rate_factor = 2e6 ** (1 - 3.0) / 2e10 * np.exp(60e3 / (oracle.GAS_CONSTANT * 260.0))
    expected = (
        rate_factor
        * np.sign(driving)
        * np.abs(driving) ** 3.0
        * np.exp(-60e3 / (oracle.GAS_CONSTANT * 250.0))
    )
    np.testing.assert_allclose(found["kelvin_rate"], expected, rtol=1e-12)


def covariance(
    strain: FloatArray, correlation_strain: float, segment: Sequence[int], share: float
) -> FloatArray:
    distance = np.abs(strain[:, None] - strain)
    together = np.equal.outer(segment, segment)
    correlated = share * np.exp(-distance / correlation_strain) * together
    matrix: FloatArray = 3e4**2 * (correlated + (1 - share) * np.eye(strain.size))
    return matrix


ONE_SEGMENT = [1] * 12
TWO_SEGMENTS = [1] * 5 + [2] * 7


@pytest.mark.parametrize("correlation_strain", [1e-4, 0.02, 0.5])
@pytest.mark.parametrize(
    ("segment", "share"), [(ONE_SEGMENT, 1.0), (TWO_SEGMENTS, 1.0), (TWO_SEGMENTS, 0.7)]
)
def test_densities_of_correlated_residuals_are_those_of_a_multivariate_normal(
    correlation_strain: float, segment: list[int], share: float, function_values: FunctionValues
) -> None:
    """Two readings at the strain of a step, and in the last case two more within a segment."""
    strain = IRREGULAR.copy()
    if segment == TWO_SEGMENTS:
        strain[5] = strain[4]
    if share < 1:
        strain[9] = strain[8]
    found = values_of_functions(
        function_values, strain, RESIDUAL, correlation_strain, segment=segment, share=share
    )
    dense = covariance(strain, correlation_strain, segment, share)
    joint = stats.multivariate_normal.logpdf(RESIDUAL, np.zeros(RESIDUAL.size), dense)
    assert found["log_density"].sum() == pytest.approx(joint, rel=1e-9)
    for k in range(RESIDUAL.size):
        others = np.arange(RESIDUAL.size) != k
        before = np.arange(RESIDUAL.size) < k
        for known, name in ((others, "log_density_given_others"), (before, "log_density")):
            weights = np.linalg.solve(dense[np.ix_(known, known)], dense[known, k])
            mean = weights @ RESIDUAL[known]
            sd = np.sqrt(dense[k, k] - weights @ dense[known, k])
            assert found[name][k] == pytest.approx(
                stats.norm.logpdf(RESIDUAL[k], mean, sd), rel=1e-8
            )


@pytest.mark.parametrize("correlation_strain", [0.0, 0.02])
def test_replicated_residuals_have_the_covariance(
    correlation_strain: float, function_values: FunctionValues
) -> None:
    strain, segment, n = np.array([0.01, 0.015, 0.015, 0.04]), [1, 1, 2, 2], 20_000
    found = values_of_functions(
        function_values,
        strain,
        np.zeros(4),
        correlation_strain,
        segment=segment,
        share=0.7,
        replications=n,
    )
    expected = (
        covariance(strain, correlation_strain, segment, 0.7)
        if correlation_strain
        else np.eye(4) * 9e8
    )
    np.testing.assert_allclose(
        np.cov(found["replicated"].T), expected, atol=5 * 9e8 / np.sqrt(n / 2)
    )
