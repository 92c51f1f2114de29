"""A second or third mechanism is found again in a test that loads, relaxes and creeps."""

from pathlib import Path

import numpy as np
import pytest
from history_twins import GRAIN_SIZE, TEMPERATURE, TRUTH, history_twin

from pyburgers import SamplerOptions, fit, priors, with_variant
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.prior_families import fixed_prior
from pyburgers.predictions.stress_cycles import EVOLUTION

SECOND = {
    "second_rate": 2e-5,
    "second_stress_exponent": 1.0,
    "second_grain_size_exponent": 3.0,
    "second_activation_enthalpy": 60e3,
    "mechanism_reference_stress": 5e6,
    "mechanism_reference_grain_size": GRAIN_SIZE,
    "mechanism_reference_temperature": TEMPERATURE,
}
THIRD = {
    "second_rate": 1e-5,
    "second_stress_exponent": 1.8,
    "second_grain_size_exponent": 1.4,
    **{name.replace("second", "third"): value for name, value in SECOND.items()},
    "second_activation_enthalpy": 49e3,
}
"""The same diffusion as a third one, beside sliding that is known."""
OPTIONS = SamplerOptions(chains=2, warmup=300, draws=500, seed=3)


@pytest.mark.slow
@pytest.mark.parametrize("which", ["second", "third"])
def test_the_rate_of_diffusion_is_found_again(which: str, tmp_path: Path) -> None:
    numbers = {"second": SECOND, "third": THIRD}[which]
    rate = f"{which}_rate"
    truth = {**TRUTH, **numbers, "residual_correlated_share": 0.0}
    test = history_twin("mixed", 40, values=truth)
    known = [
        fixed_prior(PARAMETER_BY_NAME[one], truth[one], "known")
        for one in (*EVOLUTION, *numbers)
        if one != rate
    ]
    choices = {"residuals": "independent", f"{which}_mechanism": "diffusion"}
    chosen = with_variant(priors("ice").exchanging(*known), test, choices)
    draws = fit(test, chosen, out=tmp_path / "run", options=OPTIONS).posterior["posterior"]
    for parameter in (rate, "stress_exponent"):
        low, high = np.quantile(draws[parameter], [0.005, 0.995])
        assert low < truth[parameter] < high, parameter
    # In the prior ln(rate) has a standard deviation of 3.
    assert np.log(draws[rate]).std() < 0.5
