"""Full fits of the olivine twin: its truth is found again, background removed or kept."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE

from pyburgers.fitting.fit import fit
from pyburgers.model.priors import default_priors
from pyburgers.protocols.forced_oscillation.experiment import (
    load_forced_oscillation,
    with_background,
)
from pyburgers.protocols.forced_oscillation.preparation import Background
from pyburgers.report.tables import truth_table
from pyburgers.sampling.options import SamplerOptions

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("programs")]

TWIN_FILE = ICE.parent / "olivine" / "olivine_twin.toml"
RecordProperty = Callable[[str, object], None]


@pytest.mark.parametrize("background", ["removed", "kept"])
def test_the_truth_of_the_twin_is_recovered(
    background: Background, tmp_path: Path, record_property: RecordProperty
) -> None:
    experiment = with_background(load_forced_oscillation(TWIN_FILE), background)
    result = fit(
        experiment,
        default_priors("olivine"),
        out=tmp_path / "run",
        options=SamplerOptions(chains=4, draws=1000, seed=20261120),
    )
    assert result.manifest["coordinates"]["system"] == "sheared"
    truth = truth_table(result)
    assert truth is not None
    print(truth.drop(columns="unit").to_string())
    for share in (50, 90):
        record_property(f"inside_{share}", int(truth[f"inside_{share}"].sum()))
    for parameter in ("stress_exponent", "kelvin_modulus", "kelvin_viscosity"):
        assert truth["inside_95"][parameter], parameter
    draws = result.posterior["posterior"].to_dataset()
    outside = []
    for name, true in truth["truth"].items():
        low, high = np.quantile(draws[str(name)], [0.005, 0.995])
        if not low <= true <= high:
            outside.append(name)
    assert len(truth) == 9
    assert outside == []
    assert {check.name: check.sentence for check in result.checks() if not check.passed} == {}
