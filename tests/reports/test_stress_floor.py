"""What the stress floor of the piezometer decides, by treatment of the background."""

from collections.abc import Iterator

import numpy as np
import pytest
from maor.stress_floor import (
    FLOORS,
    FloorEffect,
    floor_effects,
    sentence,
    stress_floor_section,
)
from synthetic_olivine_fit import make_olivine_fit

from pyburgers.common.errors import SamplingError
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.forward import simulate

pytestmark = pytest.mark.usefixtures("programs")


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fit]:
    folder = tmp_path_factory.mktemp("olivine")
    return {
        "kept": make_olivine_fit(folder / "kept", "kept", chains=1, draws=30),
        "removed": make_olivine_fit(folder / "removed", "removed", chains=1, draws=30),
    }


@pytest.fixture(autouse=True)
def few_draws() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("maor.stress_floor.SOLVED_DRAWS", 5)
        yield


def effect(floor: float, grain_size: float, share: float = 1.0) -> FloorEffect:
    return FloorEffect(floor, np.full(5, grain_size), share, 0)


def test_the_floor_decides_grain_size_only_where_the_background_is_removed(
    fits: dict[str, Fit],
) -> None:
    section = stress_floor_section(fits)
    (table,) = section.tables
    sizes = table.saved.pivot(index="background", columns="floor_Pa", values="grain_size_m_median")
    assert sizes.loc["kept"].max() < 1.02 * sizes.loc["kept"].min()
    small, middle, large = sizes.loc["removed"].to_numpy()
    assert small > 1.5 * middle > 1.5**2 * large
    kept, removed = section.paragraphs
    assert kept.startswith("With the background kept the floor does not matter: grains end at")
    assert removed.startswith("With the background removed the floor decides the grain size")
    assert (table.saved["n_unsolved"] == 0).all()


def test_draws_are_solved_at_their_own_values(fits: dict[str, Fit]) -> None:
    """And the fit's own floor changes no weight."""
    fit = fits["kept"]
    own = floor_effects(fit)[FLOORS.index(1e6)]
    assert own.effective_share == pytest.approx(1.0)
    draws = fit.posterior["posterior"].to_dataset()
    known = {name: prior.location for name, prior in fit.priors.priors.items() if prior.is_fixed}
    first = known | {name: float(draws[name].to_numpy()[0, 0]) for name in fit.priors.free}
    end = simulate(fit.experiment, first)["grain_size_m"].iloc[-1]
    assert own.grain_size[0] == pytest.approx(end, rel=1e-3)


def test_the_sentence_says_whether_the_data_notice() -> None:
    coarse = [effect(1e5, 3e-4), effect(1e6, 1e-4)]
    assert "an assumption, not a result" in sentence("removed", tuple(coarse))
    seen = (*coarse, effect(1e7, 5e-5, share=0.1))
    assert "fit again with the floor that you mean" in sentence("removed", seen)
    assert "does not matter" in sentence("kept", (effect(1e5, 1e-5), effect(1e6, 1.01e-5)))


def test_a_floor_without_solutions_is_an_error(
    fits: dict[str, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    def unsolved(*_arguments: object, **_options: object) -> None:
        raise SamplingError("no solution")

    monkeypatch.setattr("maor.stress_floor.simulate", unsolved)
    with pytest.raises(SamplingError, match=r"none of 5 draws .* floor of 0\.1 MPa"):
        floor_effects(fits["kept"])
