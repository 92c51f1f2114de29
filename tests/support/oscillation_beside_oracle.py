"""A simulated oscillation beside an independent solution, for laws of the dashpot."""

from collections.abc import Mapping

import numpy as np
import oracle

from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forward import simulate


def check_law_beside_oracle(
    test: OscillationExperiment, power_law: Mapping[str, float], law: Mapping[str, float]
) -> None:
    """Assert that a test under a law has the independent stress, and another one under no law.

    `power_law` are parameters (SI) of the power law, `law` those that make it another law.
    """
    prepared, parameters = test.prepared, {**power_law, **law}
    imposed = oracle.OscillatingStrain(
        prepared.period,
        prepared.strain_sine.tolist(),
        prepared.strain_cosine.tolist(),
        (0.0,),
        prepared.start,
    )
    time = prepared.start + np.linspace(20.0, 900.0, 45)
    found = simulate(test, parameters, at=time)["stress_Pa"]
    independent = oracle.oscillation(
        parameters,
        test.temperature,
        test.initial_grain_size,
        imposed,
        start=imposed.zero_ahead(test.spin_up_cycles),
        start_stress=0.0,
        time=time,
    )[0]
    scale = np.abs(independent).max()
    np.testing.assert_allclose(found, independent, atol=2e-3 * scale, rtol=0)
    without = simulate(test, power_law, at=time)["stress_Pa"]
    assert np.abs(without - independent).max() > 0.02 * scale
