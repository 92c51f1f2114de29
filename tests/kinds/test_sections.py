"""Microstructure measured along a test: tables in files, places, simulated tests.

The density of what was measured is held by tests/stan/test_microstructure_likelihood.py.
"""

from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from conftest import ICE
from history_files import history
from history_twins import history_twin
from truths import truth_of

from pyburgers.common.errors import InputError
from pyburgers.common.toml_files import without_none
from pyburgers.drawing.view import view_of
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD as CONSTANT_RATE
from pyburgers.kinds.experiment import Experiment, MeasuredMicrostructure, Stated
from pyburgers.kinds.forward import simulate, simulate_data
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stan_data import section_times
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import with_variant

CURVE, CREEP = load_constant_rate(ICE / "PIL40.toml"), history_twin("creep", 12)
ROWS: list[dict[str, Any]] = [
    {"strain": 5.0, "grain_size_m": 200e-6, "grain_size_sd_m": 10e-6},
    {"strain": 15.0, "grain_size_m": 170e-6, "grain_size_sd_m": 8e-6},
]
ROWS[1] |= {"fabric_factor": 0.7, "fabric_factor_sd": 0.05}
OF_CURVE = (
    MeasuredMicrostructure(0.05, 200e-6, 10e-6),
    MeasuredMicrostructure(0.15, 170e-6, 8e-6, 0.7, 0.05),
)
OF_CREEP = (
    MeasuredMicrostructure(0.1, 200e-6, 10e-6),
    MeasuredMicrostructure(None, 170e-6, 8e-6, 0.7, 0.05, time=4000.0),
)
OF_STAGES = (
    MeasuredMicrostructure(0.03, 800e-6, 40e-6),
    MeasuredMicrostructure(None, 700e-6, 35e-6, time=1050.0),
    MeasuredMicrostructure(None, 650e-6, 30e-6, 0.8, 0.05, time=3600.0),
)
PIEZOMETER = {"grain_size": "piezometric"}


def curve_with(rows: list[dict[str, Any]], **keys: Any) -> ConstantRateExperiment:
    """The curve with tables [[microstructure]], in a file that has strains in percent."""
    tables = without_none({**CURVE.tables(), "microstructure": rows, **keys})
    tables["data"]["strain_unit"] = "percent"
    tables["data"]["file"]["strain"] = 100 * CURVE.strain
    return load_constant_rate(Path("curve"), tables)


def test_rows_are_in_the_unit_of_the_strains() -> None:
    experiment = curve_with(ROWS)
    assert experiment.microstructure == OF_CURVE
    facts = dict(view_of(experiment).facts(experiment))
    assert "fabric factor 0.700 ± 0.050 at 15 % strain" in facts["Measured microstructure"]
    assert "Measured microstructure" not in dict(view_of(CURVE).facts(CURVE))


def test_the_test_goes_on_to_the_last_row() -> None:
    later = [ROWS[0], {**ROWS[1], "strain": 24.0}]
    assert curve_with(later, final_strain=None).final_strain == pytest.approx(0.24)


def test_places_are_in_the_units_of_the_file() -> None:
    fabric = {"fabric_factor": 0.8, "fabric_factor_sd": 0.05}
    test = history(
        [
            {"control": "strain_rate", "start_time": 2, "end_time": 12, "strain_rate_per_s": 1e-4},
            {"control": "hold_strain", "start_time": 12, "end_time": 20},
            {"control": "stress", "start_time": 20, "end_time": 62, "stress": 2.0},
        ],
        {
            "time": np.array([5, 12, 15, 20.5, 40, 62]),
            "stress": np.array([1.5, 2.0, 1.2, 2.0, 2.0, 2.0]),
            "strain": np.array([2, 6, 6, 6.1, 7, 8]),
        },
        {"time_unit": "min", "stress_unit": "MPa", "strain_unit": "percent"},
        stage_time_unit="min",
        stage_stress_unit="MPa",
        microstructure=[
            {"strain": 3.0, "grain_size_m": 800e-6, "grain_size_sd_m": 40e-6},
            {"time": 19.5, "grain_size_m": 700e-6, "grain_size_sd_m": 35e-6},
            {"time": "end", "grain_size_m": 650e-6, "grain_size_sd_m": 30e-6, **fabric},
        ],
    )
    assert test.microstructure == OF_STAGES
    fact = dict(view_of(test).facts(test))["Measured microstructure"]
    assert "800 ± 40 µm at a path strain of 3 %" in fact
    assert "fabric factor 0.800 ± 0.050 at 60 min" in fact


def piezometric(test: HistoryExperiment) -> list[float | None]:
    olivine = default_priors("olivine")
    priors = default_priors("ice").exchanging(
        *(olivine[name] for name in olivine.priors if name.startswith("piezometer"))
    )
    return section_times(test, with_variant(priors, test, PIEZOMETER))


def test_grains_that_follow_the_stress_need_a_time_that_is_known() -> None:
    seen = (MeasuredMicrostructure(0.05, 2e-4, 1e-5), MeasuredMicrostructure(0.2, 2e-4, 1e-5))
    imposed = CONSTANT_RATE.as_history(replace(CURVE, microstructure=seen))
    known = CURVE.time_at(np.array([0.05, 0.2]))
    np.testing.assert_allclose(np.array(piezometric(imposed), dtype=float), known, rtol=1e-12)
    assert section_times(imposed, default_priors("ice")) == [None, None]
    creep = replace(CREEP, microstructure=seen[:1])
    with pytest.raises(InputError, match=r"creep: \[\[microstructure\]\] number 1.*'time'"):
        piezometric(creep)
    with pytest.raises(InputError, match="not known in advance"):
        piezometric(replace(imposed, apparatus_compliance=Stated(1e-11, 0.0)))
    timed = replace(creep, microstructure=(replace(seen[0], strain=None, time=4000.0),))
    assert piezometric(timed) == [4000.0]


def state_at(test: Experiment, one: MeasuredMicrostructure) -> tuple[float, float]:
    """Grain size (m) and fabric factor at the place of a section."""
    truth, strain = truth_of(test), one.strain
    if strain is None:
        end = simulate(test, truth, at=np.array([one.time])).iloc[-1]
        return end["grain_size_m"], end["fabric_factor"]

    def settled(start: float, name: str) -> float:
        gone = np.exp(-strain / truth[f"critical_strain_{name.removesuffix('_factor')}"])
        steady = truth[f"steady_state_{name}"]
        return float(steady + (start - steady) * gone)

    return settled(test.initial_grain_size, "grain_size"), settled(1.0, "fabric_factor")


@pytest.mark.usefixtures("programs")
@pytest.mark.parametrize(
    ("test", "sections"), [(CURVE, OF_CURVE), (CREEP, OF_CREEP)], ids=("curve", "creep")
)
def test_simulated_tests_are_measured_at_their_places_with_the_stated_errors(
    test: Experiment, sections: tuple[MeasuredMicrostructure, ...]
) -> None:
    test, rng = replace(test, microstructure=sections), np.random.default_rng(1)
    drawn = [simulate_data(test, truth_of(test), rng, source="a test") for _ in range(40)]
    for k, one in enumerate(sections):
        own, (size, factor) = [each.microstructure[k] for each in drawn], state_at(test, one)
        errors = np.log([each.grain_size / size for each in own])
        expected = one.grain_size_sd / one.grain_size
        assert abs(errors.mean()) < 4 * expected / np.sqrt(40)
        assert errors.std() == pytest.approx(expected, rel=0.4)
        assert [each.grain_size_sd / each.grain_size for each in own] == pytest.approx(
            [expected] * 40
        )
        assert {(each.strain, each.time) for each in own} == {(one.strain, one.time)}
        if one.fabric_factor is None:
            assert {each.fabric_factor for each in own} == {None}
        else:
            factors = np.array([each.fabric_factor for each in own]) - factor
            assert abs(factors.mean()) < 4 * 0.05 / np.sqrt(40)
            assert factors.std() == pytest.approx(0.05, rel=0.4)
