"""The dashpot's fluidity under stress cycles against numerical integration."""

import numpy as np
from attenuation_oracle import fluidity_of_stress
from conftest import FunctionValues
from stan_values import PHYSICS

from pyburgers.kinds.attenuation.likelihood import stress_nodes

CASES = [
    # median, amplitude (Pa), n, sigma_L (Pa)
    (0.0, 1e5, 1.0, 0.0),
    (0.0, 2e6, 2.9, 0.0),
    (0.0, 5e5, 3.78, 0.0),
    (0.0, 2e6, 3.1, 1.2e6),
    (1e6, 0.17e6, 4.0, 0.0),
    (1e6, 0.17e6, 2.6, 0.0),
    (4e6, 1.5e6, 4.0, 0.0),
    (2e6, 0.9e6, 1.8, 0.7e6),
    (1e6, 1e6, 3.3, 0.0),
    (1e6, 1.2e6, 2.5, 0.0),
    (0.3e6, 2e6, 1.4, 0.0),
    (0.3e6, 2e6, 3.6, 2e6),
    (0.9e6, 1e6, 2.7, 0.0),
    (1.02e6, 1e6, 5.0, 0.0),
    (5e6, 1e6, 4.5, 0.0),
]


def test_fluidity_is_its_integral_whatever_the_median_stress(
    function_values: FunctionValues,
) -> None:
    medians, amplitudes, exponents, breakdowns = np.array(CASES).T
    nodes = [stress_nodes(*pair) for pair in zip(medians, amplitudes, strict=True)]
    longest = max(len(own) for own in nodes)
    found = function_values(
        "physics_values",
        {
            **PHYSICS,
            "n_cycles": len(CASES),
            "median_stress": medians.tolist(),
            "amplitude": amplitudes.tolist(),
            "cyclic_exponent": exponents.tolist(),
            "breakdown_stress": breakdowns.tolist(),
            "n_nodes": longest,
            "node": [np.vstack([own, np.zeros((longest - len(own), 2))]).tolist() for own in nodes],
        },
    )
    expected = np.log([fluidity_of_stress(*case) for case in CASES])
    for name in ("log_fluidity", "log_fluidity_by_nodes"):
        np.testing.assert_allclose(found[name], expected, rtol=0, atol=1e-9, err_msg=name)


def test_cycles_that_were_not_stated_meet_a_linear_dashpot(
    function_values: FunctionValues,
) -> None:
    found = function_values(
        "physics_values",
        {
            **PHYSICS,
            "n_cycles": 2,
            "median_stress": [0.0, 0.0],
            "amplitude": [0.0, 3e6],
            "cyclic_exponent": [1.0, 1.0],
            "breakdown_stress": [0.0, 0.0],
            "n_nodes": 1,
            "node": [[[1.0, 1.0]]] * 2,
        },
    )
    np.testing.assert_allclose(found["log_fluidity"], 0.0, atol=1e-14)
