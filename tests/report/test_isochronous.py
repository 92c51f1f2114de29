"""Isochronous view of creep tests that are fitted together."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import with_fixed
from history_twins import TRUTH, history_twin

from pyburgers.fitting.fit import Fit, fit_jointly
from pyburgers.model.display import STRAIN_FACTOR, STRESS_FACTOR
from pyburgers.model.priors import default_priors
from pyburgers.protocols.forward import simulate_data
from pyburgers.protocols.loading_history.experiment import LoadingHistory
from pyburgers.protocols.loading_history.isochronous import isochronous, isochronous_figure
from pyburgers.sampling.options import SamplerOptions

pytestmark = pytest.mark.usefixtures("programs")

LOADS = (3e6, 5e6)


def creep_at(stress: float) -> LoadingHistory:
    twin = history_twin("creep", 20)
    loaded = replace(
        twin, id=f"creep_{stress / 1e6:g}", stages=(replace(twin.stages[0], value=stress),)
    )
    return simulate_data(loaded, dict(TRUTH), np.random.default_rng(1), source="test")


@pytest.fixture(scope="module")
def joint(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    known = {name: TRUTH[name] for name in default_priors("ice").free if name in TRUTH}
    known = {name: v for name, v in known.items() if name not in ("kelvin_modulus", "stress_noise")}
    return fit_jointly(
        [creep_at(stress) for stress in LOADS],
        with_fixed(default_priors("ice"), known),
        out=tmp_path_factory.mktemp("fit") / "run",
        options=SamplerOptions(chains=2, warmup=100, draws=50, seed=4, adapt_delta=0.8),
    )


def test_strains_stand_over_the_loads(joint: Fit) -> None:
    (figure,) = isochronous_figure(list(joint.tests().values()))
    (axes,) = figure.draw().axes
    drawn = [np.asarray(line.get_xydata()) for line in axes.get_lines()]
    over_loads = [points for points in drawn if len(points) == len(LOADS)]
    assert over_loads
    for points in over_loads:
        np.testing.assert_allclose(points[:, 1], STRESS_FACTOR * np.array(LOADS))
    last = creep_at(LOADS[1])
    strain = max(points[:, 0].max() for points in over_loads)
    assert strain == pytest.approx(STRAIN_FACTOR * last.reading[-1], rel=0.1)
    legend = axes.get_legend()
    assert legend is not None
    assert len(legend.get_texts()) == 4


def test_one_load_has_no_such_view(joint: Fit) -> None:
    assert isochronous_figure([joint["creep_3"]]) == ()


def test_the_page_of_the_joint_fit_has_it(joint: Fit, tmp_path: Path) -> None:
    isochronous(list(joint.tests().values())).savefig(tmp_path / "view.png")
    figures = joint.problem.protocol.joint_figures(list(joint.tests().values()))
    assert [figure.name for figure in figures] == ["isochronous"]
