"""The power-law Kelvin element and correlated residuals against closed forms."""

from collections.abc import Sequence

import numpy as np
import oracle
import pytest
from conftest import FunctionValues
from history_twins import POWER_LAW_KELVIN, residual_covariance
from imposed_stress import simulate_imposed_stress
from independent_table import TRUTHS
from scipy import stats
from scipy.integrate import solve_ivp
from stan_values import PHYSICS

from pyburgers.common.array_types import FloatArray
from pyburgers.predictions.stress_cycles import Regime

pytestmark = pytest.mark.usefixtures("programs")


def test_stress_cycles_of_a_power_law_kelvin_element_agree_with_scipy() -> None:
    parameters = {**TRUTHS["fast"], **POWER_LAW_KELVIN}
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
    values = {
        "stress_noise": 3e4,
        "residual_correlation_time": correlation_strain,
        "residual_correlated_share": share,
    }
    return residual_covariance(values, strain, np.array(segment), np.zeros(strain.size, bool))


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
    assert found["log_densities"][:, 0].sum() == pytest.approx(joint, rel=1e-9)
    for k in range(RESIDUAL.size):
        others = np.arange(RESIDUAL.size) != k
        before = np.arange(RESIDUAL.size) < k
        for column, known in enumerate((before, others)):
            weights = np.linalg.solve(dense[np.ix_(known, known)], dense[known, k])
            mean = weights @ RESIDUAL[known]
            sd = np.sqrt(dense[k, k] - weights @ dense[known, k])
            assert found["log_densities"][k, column] == pytest.approx(
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
    expected = covariance(strain, correlation_strain, segment, 0.7)
    np.testing.assert_allclose(
        np.cov(found["replicated"].T), expected, atol=5 * 9e8 / np.sqrt(n / 2)
    )
