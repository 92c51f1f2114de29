"""One measured grain size tells which of the two mechanisms softened a twin."""

from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE
from history_twins import history_twin
from measures import grain_size_share

from pyburgers.drawing.views.softening import softening_shares
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import Experiment, MeasuredMicrostructure
from pyburgers.kinds.forward import simulate
from pyburgers.model.priors import default_priors
from pyburgers.posterior.labelled_draws import convergence_table
from pyburgers.sampling.options import SamplerOptions

pytestmark = [pytest.mark.slow, pytest.mark.usefixtures("programs")]

RecordProperty = Callable[[str, object], None]
OPTIONS = SamplerOptions(chains=2, draws=400, seed=5)
ERROR = 0.05
"""Of the measured grain size, relative."""


def share_of_curve(result: Fit) -> np.ndarray:
    return grain_size_share(result.posterior).to_numpy()


def share_of_history(result: Fit) -> np.ndarray:
    return softening_shares(result.posterior["predictions"].to_dataset())


def measured_size(size: float) -> float:
    """A size (m) with an error."""
    return size * float(np.exp(ERROR * np.random.default_rng(1).standard_normal()))


def check_that_it_helps(
    experiment: Experiment,
    measured: MeasuredMicrostructure,
    share: Callable[[Fit], np.ndarray],
    folder: Path,
    record: RecordProperty,
) -> None:
    """Fit a test with and without a measured grain size, and compare share and sampling."""
    sd, gradients = {}, {}
    for name, test in (
        ("without", experiment),
        ("with", replace(experiment, microstructure=(measured,))),
    ):
        result = fit(test, default_priors("ice"), out=folder / name, options=OPTIONS)
        found = share(result)
        stats = result.posterior["sample_stats"].to_dataset()
        draws = result.posterior["posterior"].to_dataset()
        sd[name] = float(found.std())
        least = float(convergence_table(result.posterior)["ess_bulk"].min())
        gradients[name] = float(stats["n_steps"].sum()) / least
        widths = {
            one: float(draws[one].std())
            for one in ("steady_state_grain_size", "steady_state_fabric_factor")
        }
        record(name, (float(found.mean()), sd[name], gradients[name], widths))
        print(name, float(found.mean()), sd[name], gradients[name], widths)
        print(name, float(stats["n_steps"].mean()), least, int(stats["diverging"].sum()))
        assert result.manifest["coordinates"]["system"] == "valley"
        assert not stats["diverging"].any()
    assert sd["with"] < 0.7 * sd["without"]
    assert gradients["with"] < 2 * gradients["without"]


def test_a_final_grain_size_resolves_grain_size_and_fabric(
    tmp_path: Path, record_property: RecordProperty
) -> None:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    truth = experiment.true_parameters or {}
    final = experiment.final_strain
    solution = simulate(experiment, truth, at=np.array([final])).set_index("strain")
    size = measured_size(float(solution["grain_size_m"][final]))
    measured = MeasuredMicrostructure(final, size, ERROR * size)
    check_that_it_helps(experiment, measured, share_of_curve, tmp_path, record_property)


def test_a_grain_size_after_creep_does_so_too(
    tmp_path: Path, record_property: RecordProperty
) -> None:
    experiment = history_twin("creep", 40)
    end = experiment.end_time
    solution = simulate(experiment, experiment.true_parameters or {}, at=np.array([end]))
    size = measured_size(float(solution["grain_size_m"].iloc[-1]))
    measured = MeasuredMicrostructure(None, size, ERROR * size, time=end)
    check_that_it_helps(experiment, measured, share_of_history, tmp_path, record_property)
