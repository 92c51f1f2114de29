"""Tables of attenuation: their files, conversions, limits, what cannot be fitted."""

import re
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import attenuation_oracle
import numpy as np
import pytest
import xarray as xr
from conftest import ICE
from refusals import written
from truths import truth_of

from pyburgers.checks.advice import advise_on_spectra
from pyburgers.checks.discrepancies import place_text
from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.attenuation.table import Elasticity
from pyburgers.kinds.conditions import conditions, outside
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.likelihood import likelihood_of, likelihoods
from pyburgers.kinds.problem import problem_of
from pyburgers.model.laws import KELVIN_LAWS
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import with_variant

TWIN = ICE / "attenuation_twin.toml"
A1802 = ICE.parent / "olivine" / "attenuation_A1802.toml"
Edit = Callable[..., Path]

FILE = """
id = "t"
material = "olivine"
protocol = "attenuation"
temperature_K = 1473.15
initial_grain_size_m = 5e-6
[attenuation]
deformation = "shear"
poisson_ratio = 0.25
[data]
file = "t.csv"
period_column = "period"
period_unit = "s"
temperature_column = "T"
temperature_unit = "C"
attenuation_column = "Q"
attenuation_form = "tan_delta"
modulus_column = "G"
modulus_unit = "GPa"
[provenance]
kind = "synthetic"
source = "test"
"""
ROWS = "period,T,Q,G\n1,1200,0.05,50\n10,1200,0.1,45\n1,1100,0.02,60\n10,1100,0.03,58\n"


@pytest.fixture
def edit(tmp_path: Path) -> Edit:
    """Write the small table, changed."""

    def write(*changes: tuple[str, str], rows: str = ROWS) -> Path:
        return written(tmp_path / "t.toml", FILE, changes, {"t": rows})

    return write


def test_the_title_says_temperatures_and_periods_in_plain_numbers(edit: Edit) -> None:
    table = load_attenuation(edit(rows=ROWS.replace("10,", "1000,")))
    assert "\n1373.15 to 1473.15 K, periods 1 to 1000 s, shear" in table.title
    assert "\n1473.15 K, periods 1 to 1000 s, shear" in table.only_part("1473.15K").title


def test_places_say_temperature_and_periods_in_plain_numbers(edit: Edit) -> None:
    table = load_attenuation(edit(rows=ROWS.replace("10,", "1000,")))
    own = likelihood_of(table)
    along = xr.Dataset({name: ("point", values) for name, (values, _) in own.along(table).items()})
    assert place_text(own, along, 0, 1) == "attenuation at 1473 K, period 1 to 1000 s"
    assert place_text(own, along, 7, 7) == "modulus at 1373 K, period 1000 s"


def test_places_lead_back_to_periods_and_spectra(edit: Edit) -> None:
    conditions = load_attenuation(edit()).conditions
    period, spectrum, quantity = conditions.at(np.append(conditions.place, conditions.place + 2))
    np.testing.assert_allclose(period, np.tile(conditions.period, 2), rtol=1e-12)
    assert spectrum.tolist() == [0, 0, 1, 1] * 2
    assert quantity.tolist() == [0] * 4 + [1] * 4


@pytest.mark.usefixtures("programs")
@pytest.mark.parametrize(
    "elasticity",
    [
        Elasticity("axial"),
        Elasticity("shear", poisson_ratio=0.3),
        Elasticity("shear", bulk_modulus=9e9),
    ],
)
def test_axial_and_shear_cycles_follow_the_stated_rules(elasticity: Elasticity) -> None:
    table = replace(load_attenuation(TWIN), elasticity=elasticity)
    found = simulate(table, truth_of(table), at=table.position)
    tan_delta, modulus = attenuation_oracle.log_readings(
        table,
        truth_of(table),
        table.conditions.period,
        np.arange(table.conditions.n_rows),
    )
    np.testing.assert_allclose(found["log_reading"], np.append(tan_delta, modulus), rtol=1e-9)


def test_without_amplitudes_the_dashpot_has_to_be_linear() -> None:
    table = load_attenuation(A1802)
    priors = default_priors("olivine", "attenuation")
    nonlinear = priors.exchanging(default_priors("olivine")["stress_exponent"])
    problem_of([table], priors)
    with pytest.raises(InputError, match="only a linear dashpot"):
        problem_of([table], nonlinear)
    problem_of([table], with_variant(nonlinear, table, {"maxwell": "linear"}))


def test_readings_without_error_need_a_scatter() -> None:
    table = load_attenuation(A1802)
    with pytest.raises(InputError, match="modulus_scatter"):
        problem_of([table], without(table, "modulus_scatter"))
    # Attenuations have a stated error.
    problem_of([table], without(table, "attenuation_scatter"))


def without(table: AttenuationExperiment, name: str):  # type: ignore[no-untyped-def]
    priors = default_priors(table.material, table.protocol)
    return replace(priors, priors={k: v for k, v in priors.priors.items() if k != name})


def test_simulated_readings_have_scatter_and_stated_errors() -> None:
    twin = load_attenuation(TWIN)
    rng = np.random.default_rng(1)
    truth = np.append(np.full(36, np.log(0.2)), np.full(36, np.log(5e9)))
    drawn = [twin.with_noise(truth, truth_of(twin), rng) for _ in range(200)]
    truth[:36] = np.log(np.hypot(0.2, 0.004))
    left = np.array([one.response - truth for one in drawn])
    wanted = np.hypot(0.04, 0.004 / 0.2), 0.01
    for part, spread in zip((left[:, :36], left[:, 36:]), wanted, strict=True):
        assert part.std() == pytest.approx(spread, rel=0.05)
        assert abs(part.mean()) < 0.05 * spread


def test_conditions_of_a_table_are_temperatures_and_periods() -> None:
    table, kind = load_attenuation(A1802), likelihoods()["attenuation"]
    place = kind.grid(table)
    solutions = xr.Dataset(
        {
            name: (("chain", "draw", "place"), np.zeros((1, 1, place.size)))
            for name, _ in kind.grid_quantities.values()
        },
        {"place": place},
    )
    found = conditions(table, solutions, xr.Dataset())
    assert found["temperature"] == (1173.15, 1473.15)
    np.testing.assert_allclose(found["period"], (1.28, 999.77), rtol=1e-9)
    warmer = {**found, "temperature": (1173.15, 1573.15), "strain": (0.0, 0.01)}
    assert outside(warmer, [found]) == (
        "temperature 1173 to 1573 K (fitted: 1173 to 1473)",
        "strain up to 1 % (fitted: not stated)",
    )
    assert outside(found, [found]) == ()
    # Five kelvin change rates by a tenth; half a kelvin is rounding.
    for more, told in ((0.5, False), (5.0, True)):
        near = {**found, "temperature": (1173.15, 1473.15 + more)}
        assert bool(outside(near, [found])) == told


@pytest.mark.parametrize(
    ("law", "advised"),
    [("linear", ["extended"]), ("extended", ["extended_peak"]), ("extended_peak", [])],
)
def test_a_table_is_advised_the_next_law_and_not_its_own(law: str, advised: list[str]) -> None:
    advice = advise_on_spectra(KELVIN_LAWS[law].parameters)
    assert re.findall(r"kelvin=(\w+)", advice) == advised
    assert "temperatures by themselves" in advice


@pytest.mark.parametrize(("stated", "is_told"), [("", True), ("\nmedian_stress_Pa = 0.0", False)])
def test_a_median_that_is_not_stated_beside_an_amplitude_is_told(
    edit: Edit, stated: str, is_told: bool
) -> None:
    test = load_attenuation(edit(('"shear"', f'"shear"\namplitude_Pa = 1e5{stated}')))
    assert any("The median stress" in notice for notice in test.notices) == is_told


def test_an_amplitude_of_torsion_is_one_of_a_stress_that_varies(edit: Edit) -> None:
    (linear,) = load_attenuation(edit()).notices
    notices = load_attenuation(edit(('"shear"', '"shear"\namplitude_Pa = 1e5'))).notices
    assert "dashpot is linear" in linear
    assert any("about 0.8 of the amplitude at the outer radius" in notice for notice in notices)


@pytest.mark.parametrize("exponent", [1.5, 2.0, 3.0, 4.0])
def test_a_uniform_stress_of_0_8_dissipates_like_torsion(exponent: float) -> None:
    radius = (np.arange(1000) + 0.5) / 1000  # also the stress, over that at the edge
    loss = np.sum(radius ** (exponent + 1) * radius) / np.sum(radius**2 * radius)
    assert loss ** (1 / (exponent - 1)) == pytest.approx(0.8, abs=0.04)


@pytest.mark.parametrize(
    "stated", ["attenuation_uncertainty = 0.1", 'attenuation_uncertainty_column = "sd"']
)
def test_the_error_of_a_loss_angle_is_in_the_unit_of_the_angle(edit: Edit, stated: str) -> None:
    degrees = np.array([2.0, 30.0])
    rows = "period,T,Q,G,sd\n" + "".join(
        f"{10 * k + 1},1200,{angle},50,0.1\n" for k, angle in enumerate(degrees)
    )
    form = f'"loss_angle"\nattenuation_unit = "deg"\n{stated}'
    readings = load_attenuation(edit(('"tan_delta"', form), rows=rows)).readings
    ends = [np.tan(np.radians(degrees + 0.05 * sign)) for sign in (1, -1)]
    np.testing.assert_allclose(readings.tan_delta_error, ends[0] - ends[1], rtol=1e-5)
