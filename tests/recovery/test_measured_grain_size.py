"""One measured grain size tells which of the two mechanisms softened a twin."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE

from pyburgers.fitting.fit import fit
from pyburgers.model.priors import default_priors
from pyburgers.posterior.labelled_draws import convergence_table, grain_size_share
from pyburgers.protocols.constant_rate.experiment import load_constant_rate
from pyburgers.protocols.forward import simulate
from pyburgers.protocols.microstructure import MeasuredMicrostructure
from pyburgers.sampling.options import SamplerOptions

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("programs")]

RecordProperty = Callable[[str, object], None]
OPTIONS = SamplerOptions(chains=2, draws=400, seed=5)
ERROR = 0.05
"""Of the measured grain size, relative."""


def test_a_final_grain_size_resolves_grain_size_and_fabric(
    tmp_path: Path, record_property: RecordProperty
) -> None:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    truth = experiment.true_parameters or {}
    final = experiment.final_strain
    solution = simulate(experiment, truth, at=np.array([final])).set_index("strain")
    size = float(solution["grain_size_m"][final])
    size *= float(np.exp(ERROR * np.random.default_rng(1).standard_normal()))
    measured = (MeasuredMicrostructure(final, size, ERROR * size),)
    sd, gradients = {}, {}
    for name, test in (
        ("without", experiment),
        ("with", replace(experiment, microstructure=measured)),
    ):
        result = fit(test, default_priors("ice"), out=tmp_path / name, options=OPTIONS)
        share = grain_size_share(result.posterior)
        stats = result.posterior["sample_stats"].to_dataset()
        sd[name] = float(share.std())
        least = float(convergence_table(result.posterior)["ess_bulk"].min())
        gradients[name] = float(stats["n_steps"].sum()) / least
        record_property(name, (float(share.mean()), sd[name], gradients[name]))
        print(name, float(share.mean()), sd[name], gradients[name])
        assert result.manifest["coordinates"]["system"] == "valley"
        assert not stats["diverging"].any()
    assert sd["with"] < 0.7 * sd["without"]
    assert gradients["with"] < 2 * gradients["without"]
