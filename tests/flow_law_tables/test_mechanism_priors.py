"""Mechanisms of a table of rates as further mechanisms of a dashpot."""

from dataclasses import replace

import numpy as np
import pytest
from history_twins import history_twin

from pyburgers import mechanism_priors
from pyburgers.common.errors import InputError
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.laws import MECHANISM_PARAMETERS
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import variant_of


def test_a_mechanism_of_a_table_is_handed_on(creep: RateFit) -> None:
    ice, test = default_priors("ice"), history_twin("mixed", 16)
    priors = ice.with_(**mechanism_priors(creep, "creep"))
    assert variant_of(priors, test).second_mechanism == "power_law"
    draws = creep.posterior["posterior"].to_dataset()
    for name in ("stress_exponent", "activation_enthalpy"):
        found, own = priors[f"second_{name}"], draws[f"{name}[creep]"].to_numpy()
        assert (found.location, found.scale) == pytest.approx((own.mean(), own.std()))
    # Of another specimen, at the conditions for which the table gives its rate.
    log_rate = np.log(draws["mechanism_rate[creep]"].to_numpy())
    scatter = draws["rate_scatter"].to_numpy()
    rate = priors["second_rate"]
    assert np.log(rate.location) == pytest.approx(log_rate.mean(), abs=0.05)
    assert rate.scale > np.hypot(log_rate.std(), 0.8 * scatter.mean())
    assert priors["mechanism_reference_stress"].location == creep.law.reference.stress
    (one,) = creep.law.mechanisms
    both = (one, replace(one, name="other", premelting_temperature=260.0))
    changed = replace(creep, law=replace(creep.law, mechanisms=both))
    in_series = ice.with_(**mechanism_priors(changed, "creep"))
    assert variant_of(in_series, test).second_mechanism == "in_series"
    with pytest.raises(InputError, match="enthalpy of other changes at 260 K"):
        mechanism_priors(changed, "other")
    with pytest.raises(InputError, match="has no mechanism 'sliding'"):
        mechanism_priors(changed, "sliding")


@pytest.mark.parametrize("temperature", [250.0, 265.0])
def test_a_mechanism_that_premelts_is_handed_on_at_a_temperature(
    temperature: float, creep: RateFit
) -> None:
    (one,) = creep.law.mechanisms
    mechanisms = (replace(one, premelting_temperature=260.0),)
    posterior = creep.posterior.copy(deep=True)
    numbers = posterior["predictions"].to_dataset()["law"]
    cold, warm = (
        MECHANISM_PARAMETERS.index(name) for name in ("activation_enthalpy", "premelting_enthalpy")
    )
    numbers[{"column": warm}] = 1.5 * numbers[{"column": cold}]
    posterior["predictions"] = posterior["predictions"].assign(law=numbers)
    changed = replace(creep, law=replace(creep.law, mechanisms=mechanisms), posterior=posterior)
    own = mechanism_priors(changed, "creep", temperature=temperature)
    priors = default_priors("ice").with_(**own)
    reference = creep.law.reference.temperature
    enthalpy = priors["second_activation_enthalpy"].location / GAS_CONSTANT
    found = np.log(priors["second_rate"].location) - enthalpy * (1 / temperature - 1 / reference)
    distance = 1 / min(temperature, 260.0) - 1 / reference
    distance += 1.5 * (1 / max(temperature, 260.0) - 1 / 260.0)
    log_rate, mean = (float(numbers[{"column": k}].mean()) for k in (0, cold))
    assert found == pytest.approx(log_rate - mean / GAS_CONSTANT * distance, abs=0.05)
