"""Which mechanism leads: against published laws, over draws, and what is refused."""

from typing import Any

import numpy as np
import pytest
from rate_oracle import GOLDSBY_KOHLSTEDT_2001, PowerLaw, composite_rate

import pyburgers
from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.flow_law_tables import mechanism_maps
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.fit_rates import fit_rates
from pyburgers.flow_law_tables.table_files import load_rate_table
from pyburgers.page.rate_section import mechanism_figures
from pyburgers.sampling.options import SamplerOptions

STRESS, GRAIN_SIZE, TEMPERATURE = 1e6, 1e-3, 250.0
"""Reference conditions, SI."""

NAMES = ("dislocation", "sliding", "basal_slip")
PROCESS = [1, 2, 2]


def row(law: PowerLaw) -> list[float]:
    """Row of a law as `stan/physics/composite_law.stan` has it."""
    at = (np.array(one) for one in (STRESS, GRAIN_SIZE, TEMPERATURE))
    return [float(np.log(law.rate(*at))), law.n, law.p, law.q, *[0.0] * 4]


def mapped(draws: list[list[list[float]]], *at: FloatArray) -> dict[str, Any]:
    """Evaluate the program at conditions: stress, grain size and temperature, each (n,)."""
    return dict(
        load_program(stan_directory() / "mechanism_map.stan").evaluate(
            {
                "n_draws": len(draws),
                "n_mechanisms": 3,
                "law": draws,
                "process": PROCESS,
                "premelting_temperature": [0.0, 0.0, 0.0],
                "reference_stress": STRESS,
                "reference_grain_size": GRAIN_SIZE,
                "reference_temperature": TEMPERATURE,
                "n_conditions": at[0].size,
                "stress": at[0].tolist(),
                "grain_size": at[1].tolist(),
                "temperature": at[2].tolist(),
                "n_environment": 0,
                "environment": [[]] * at[0].size,
                "keeps_draws": 1,
            }
        )
    )


def random_conditions(n: int) -> tuple[FloatArray, FloatArray, FloatArray]:
    rng = np.random.default_rng(4)
    return (
        10 ** rng.uniform(3.0, 7.5, n),
        10 ** rng.uniform(-5.5, -2.0, n),
        rng.uniform(180.0, 255.0, n),
    )


def test_the_leading_mechanism_of_a_published_law() -> None:
    at = random_conditions(300)
    found = mapped([[row(GOLDSBY_KOHLSTEDT_2001[name]) for name in NAMES]], *at)
    dislocation, sliding, basal = (GOLDSBY_KOHLSTEDT_2001[name].rate(*at) for name in NAMES)
    slower = np.where(sliding < basal, 1, 2)
    expected = np.where(dislocation > np.minimum(sliding, basal), 0, slower)
    assert set(expected) == {0, 1, 2}
    np.testing.assert_array_equal(found["probability"].argmax(axis=1), expected)
    np.testing.assert_allclose(found["probability"].sum(axis=1), 1.0)
    total = composite_rate(GOLDSBY_KOHLSTEDT_2001, [("sliding", "basal_slip")], *at)
    np.testing.assert_allclose(found["mean_log_rate"], np.log(total), rtol=1e-12)
    np.testing.assert_allclose(found["sd_log_rate"], 0.0, atol=1e-5)
    np.testing.assert_allclose(found["log_rate"][0], np.log(total), rtol=1e-12)
    step = 1e-4
    up, down = (
        np.log(composite_rate(GOLDSBY_KOHLSTEDT_2001, [("sliding", "basal_slip")], load, *at[1:]))
        for load in (at[0] * np.exp(step), at[0] * np.exp(-step))
    )
    np.testing.assert_allclose(found["stress_exponent"][0], (up - down) / (2 * step), rtol=1e-6)


def test_draws_count_alike() -> None:
    at = random_conditions(50)
    one = [row(GOLDSBY_KOHLSTEDT_2001[name]) for name in NAMES]
    fast = [[one[0][0] + 60.0, *one[0][1:]], *one[1:]]
    alone, both = (mapped(draws, *at)["probability"] for draws in ([one], [one, fast]))
    np.testing.assert_allclose(both[:, 0], 0.5 + 0.5 * alone[:, 0])


@pytest.fixture(scope="module")
def short_fit(tmp_path_factory: pytest.TempPathFactory) -> RateFit:
    """A short fit of a composite law to one table: what maps show of it is tested, not it."""
    table = pyburgers.shipped_folder("data") / "ice" / "rates" / "goldsby_kohlstedt_1997.toml"
    return fit_rates(
        [load_rate_table(table)],
        pyburgers.rate_law("ice_composite"),
        out=tmp_path_factory.mktemp("map") / "run",
        options=SamplerOptions(chains=1, warmup=150, draws=50, seed=1),
    )


def test_maps_of_a_fit(short_fit: RateFit) -> None:
    found = short_fit.mechanism_map(
        temperature=np.array([200.0, 240.0, 260.0]), stress=np.geomspace(1e3, 1e7, 5)
    )
    assert found.probability.shape == (5, 3, 3)
    np.testing.assert_allclose(found.probability.sum(axis=-1), 1.0)
    assert (np.diff(found.log_rate, axis=0) > 0).all()
    assert (np.diff(found.log_rate, axis=1) > 0).all()
    # Far below the stresses of the tests nobody has measured anything.
    assert not found.is_supported[0].any()
    assert found.is_supported.any()
    over = short_fit.mechanism_map(
        grain_size=np.array([1e-5, 1e-3]), temperature=240.0, stress=np.array([1e6])
    )
    assert over.over_grain_size


def test_rates_of_a_fit_are_those_of_its_map(short_fit: RateFit) -> None:
    rates = short_fit.rates_at([230.0, 250.0], 1e5, 1e-3)
    found = short_fit.mechanism_map(
        temperature=np.array([230.0, 250.0]), stress=np.array([1e5]), grain_size=1e-3
    )
    mean = rates["log_strain_rate"].mean("draw").to_numpy()
    np.testing.assert_allclose(mean, found.log_rate[0], rtol=1e-12)
    assert ((rates["stress_exponent"] > 1) & (rates["stress_exponent"] < 6)).all()


def test_rates_name_the_draws_that_are_solved(
    short_fit: RateFit, monkeypatch: pytest.MonkeyPatch
) -> None:
    every = short_fit.rates_at(230.0, 1e5, 1e-3)["log_strain_rate"]
    monkeypatch.setattr(mechanism_maps, "DRAWS", 7)
    some = short_fit.rates_at(230.0, 1e5, 1e-3)["log_strain_rate"]
    assert some.sizes["draw"] == 7
    np.testing.assert_array_equal(some, every.sel(draw=some.coords["draw"]))


def test_a_map_is_drawn(short_fit: RateFit) -> None:
    (figure,) = mechanism_figures(short_fit)
    drawn = figure.draw()
    assert [text.get_text() for text in drawn.legends[0].get_texts()] == [
        "dislocation",
        "sliding",
        "basal slip",
    ]
    assert "Hatched" in figure.caption


def test_maps_of_everything_are_refused(short_fit: RateFit) -> None:
    two = np.array([1.0, 2.0])
    with pytest.raises(InputError, match="found arrays of both"):
        short_fit.mechanism_map(temperature=200.0 * two, grain_size=1e-3 * two)
    with pytest.raises(InputError, match="stress: found -1"):
        short_fit.mechanism_map(stress=np.array([-1.0]))
