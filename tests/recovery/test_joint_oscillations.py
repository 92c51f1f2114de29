"""Two records of oscillations of one material tell its flow law together."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from oscillation_pair import oscillation_pair

from pyburgers.common.draws import all_draws
from pyburgers.fitting.fit import fit
from pyburgers.model.priors import default_priors
from pyburgers.sampling.options import SamplerOptions

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("programs")]

OPTIONS = SamplerOptions(chains=4, draws=500, seed=20261122)
RecordProperty = Callable[[str, object], None]


def test_a_common_flow_law_is_recovered(tmp_path: Path, record_property: RecordProperty) -> None:
    experiments, priors = oscillation_pair(end=1300.0), default_priors("olivine")
    joint = fit(experiments, priors, out=tmp_path / "joint", options=OPTIONS)
    assert joint.manifest["coordinates"]["system"] == "sheared"
    failed = {check.name: check.sentence for check in joint.checks() if not check.passed}
    assert failed == {}
    draws = joint.posterior["posterior"].to_dataset()
    truth = experiments[0].true_parameters
    assert truth is not None
    assert {"stress_exponent", "activation_enthalpy", "kelvin_modulus"} <= set(joint.problem.shared)
    for name in joint.problem.shared:
        below = float(np.mean(all_draws(draws[name]) < truth[name]))
        print(f"{name}: {below:.3f} of the draws below the true value")
        assert 0.005 < below < 0.995, name
    alone = fit(experiments[0], priors, out=tmp_path / "alone", options=OPTIONS).summary("SI")["sd"]
    # Of a second record of the same noise and 0.8 of the signal, 0.78 where nothing else matters.
    for name in ("kelvin_modulus", "kelvin_viscosity"):
        ratio = float(draws[name].std()) / float(alone[name])
        record_property(f"sd_ratio_of_{name}", ratio)
        print(f"sd of {name}: joint over single {ratio:.3f}")
        assert ratio < 0.9
