"""A backstress is found again in synthetic tests that load, unload, relax and creep."""

from collections.abc import Mapping
from pathlib import Path

import numpy as np
import pytest
from history_twins import GRAIN_SIZE, TRUTH, history_twin

from pyburgers import SamplerOptions, fit, priors, with_variant
from pyburgers.model.laws import HARDENING_LAWS
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.prior_families import fixed_prior
from pyburgers.predictions.stress_cycles import EVOLUTION

BACKSTRESS = {
    "hardening_modulus": 1e9,
    "backstress_limit": 4e6,
    "recovery_rate": 1e-3,
    "recovery_exponent": 2.0,
    "recovery_activation_enthalpy": 65e3,
    "kelvin_reference_temperature": 260.0,
}
OPTIONS = SamplerOptions(chains=2, warmup=300, draws=500, seed=3)


DISLOCATIONS = {
    **BACKSTRESS,
    "backstress_limit": 2e7,
    "recovery_exponent": 5.0,
    "initial_backstress": 8e5,
    "source_stress": 5e3,
    "boundary_recovery": 1.0,
    "reference_backstress": 3e6,
    "kelvin_reference_grain_size": GRAIN_SIZE,
}


@pytest.mark.slow
@pytest.mark.parametrize("name", ["mixed", "load and unload"])
@pytest.mark.parametrize(
    ("law", "numbers"), [("backstress", BACKSTRESS), ("dislocations", DISLOCATIONS)]
)
def test_the_numbers_of_a_backstress_are_found_again(
    name: str, law: str, numbers: Mapping[str, float], tmp_path: Path
) -> None:
    truth = {**TRUTH, **numbers, "residual_correlated_share": 0.0}
    test = history_twin(name, 40, values=truth)
    constant = [one for one in (*EVOLUTION, "reference_backstress") if one in truth]
    known = [fixed_prior(PARAMETER_BY_NAME[one], truth[one], "known") for one in constant]
    choices = {"residuals": "independent", "hardening": law}
    chosen = with_variant(priors("ice"), test, choices).exchanging(*known)
    draws = fit(test, chosen, out=tmp_path / "run", options=OPTIONS).posterior["posterior"]
    for parameter in HARDENING_LAWS[law].parameters:
        low, high = np.quantile(draws[parameter], [0.005, 0.995])
        assert low < truth[parameter] < high, parameter
    # The data say how fast flow stores it: ln H has a standard deviation of 1 in the prior. Loading
    # and unloading do not part dislocations from the Kelvin element.
    if (law, name) != ("dislocations", "load and unload"):
        assert np.log(draws["hardening_modulus"]).std() < 0.5
