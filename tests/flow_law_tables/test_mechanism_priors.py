"""A mechanism of a table of rates as the second mechanism of a dashpot."""

from dataclasses import replace

import numpy as np
import pytest
from history_twins import history_twin

from pyburgers import second_mechanism_priors
from pyburgers.common.errors import InputError
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import variant_of


def test_a_mechanism_of_a_table_is_handed_on(creep: RateFit) -> None:
    ice, test = default_priors("ice"), history_twin("mixed", 16)
    priors = ice.with_(**second_mechanism_priors(creep, "creep"))
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
    assert priors["second_reference_stress"].location == creep.law.reference.stress
    (one,) = creep.law.mechanisms
    both = (one, replace(one, name="other", premelting_temperature=260.0))
    changed = replace(creep, law=replace(creep.law, mechanisms=both))
    in_series = ice.with_(**second_mechanism_priors(changed, "creep"))
    assert variant_of(in_series, test).second_mechanism == "in_series"
    with pytest.raises(InputError, match="enthalpy of other changes at 260 K"):
        second_mechanism_priors(changed, "other")
    with pytest.raises(InputError, match="has no mechanism 'sliding'"):
        second_mechanism_priors(changed, "sliding")
