"""Microstructure measured along loading histories: tables in files, places, simulated tests."""

from dataclasses import replace

import numpy as np
import pytest
from conftest import ICE
from history_files import history
from history_twins import TRUTH, history_twin

from pyburgers.common.errors import InputError
from pyburgers.drawing.view import view_of
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD as CONSTANT_RATE
from pyburgers.kinds.experiment import MeasuredMicrostructure, Stated
from pyburgers.kinds.forward import simulate, simulate_data
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stan_data import section_times, solver_outputs
from pyburgers.kinds.loading_history.stan_data import tests_block as block_of
from pyburgers.kinds.problem import problem_of
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import with_variant

MEASURED = (
    MeasuredMicrostructure(0.03, 800e-6, 40e-6),
    MeasuredMicrostructure(None, 700e-6, 35e-6, time=1050.0),
    MeasuredMicrostructure(None, 650e-6, 30e-6, 0.8, 0.05, time=3600.0),
)
PIEZOMETER = {"grain_size": "piezometric"}


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
    assert test.microstructure == MEASURED
    fact = dict(view_of(test).facts(test))["Measured microstructure"]
    assert "800 ± 40 µm at a path strain of 3 %" in fact
    assert "fabric factor 0.800 ± 0.050 at 60 min" in fact


def test_the_solver_reports_there_and_readings_stay_where_they_were() -> None:
    known = history_twin("load and unload", 12)
    # The second is at the jump to the second stage, before it; none lies at a reading.
    sections = (
        MeasuredMicrostructure(0.01, 2e-4, 1e-5),
        MeasuredMicrostructure(None, 2e-4, 1e-5, time=1500.0),
        MeasuredMicrostructure(None, 1.9e-4, 1e-5, time=3000.1),
    )
    test = replace(known, microstructure=sections)
    outputs = solver_outputs(test, [one.time for one in sections])
    assert outputs.of_sections[0] == 0
    np.testing.assert_array_equal(outputs.time[outputs.of_readings - 1], known.time)
    np.testing.assert_array_equal(outputs.time[outputs.of_sections[1:] - 1], [1500.0, 3000.1])
    np.testing.assert_array_equal(outputs.leg[outputs.of_sections[1:] - 1], [0, 2])
    assert (np.diff(outputs.leg) >= 0).all()
    for leg in range(3):
        assert (np.diff(outputs.time[outputs.leg == leg]) >= 0).all()
    priors = problem_of([known], default_priors("ice")).priors
    without, found = block_of([known], priors), block_of([test] * 2, [*priors] * 2)
    n = known.n_points
    assert without["output_of_point"] == list(range(1, n + 1))
    assert without["measured"] == []
    assert found["output_end"] == [0, n + 2, 2 * n + 4]
    assert found["measured_end"] == [0, 3, 6]
    assert found["measured_path_strain"] == [0.01, 0.0, 0.0] * 2
    assert sum(found["n_outputs_in_leg"]) == 2 * n + 4


def piezometric(test: HistoryExperiment) -> list[float | None]:
    olivine = default_priors("olivine")
    priors = default_priors("ice").exchanging(
        *(olivine[name] for name in olivine.priors if name.startswith("piezometer"))
    )
    return section_times(test, with_variant(priors, test, PIEZOMETER))


def test_grains_that_follow_the_stress_need_a_time_that_is_known() -> None:
    curve = load_constant_rate(ICE / "PIL40.toml")
    seen = (MeasuredMicrostructure(0.05, 2e-4, 1e-5), MeasuredMicrostructure(0.2, 2e-4, 1e-5))
    imposed = CONSTANT_RATE.as_history(replace(curve, microstructure=seen))
    known = curve.time_at(np.array([0.05, 0.2]))
    np.testing.assert_allclose(np.array(piezometric(imposed), dtype=float), known, rtol=1e-12)
    assert section_times(imposed, default_priors("ice")) == [None, None]
    creep = replace(history_twin("creep", 12), microstructure=seen[:1])
    with pytest.raises(InputError, match=r"creep: \[\[microstructure\]\] number 1.*'time'"):
        piezometric(creep)
    with pytest.raises(InputError, match="not known in advance"):
        piezometric(replace(imposed, apparatus_compliance=Stated(1e-11, 0.0)))
    timed = replace(creep, microstructure=(replace(seen[0], strain=None, time=4000.0),))
    assert piezometric(timed) == [4000.0]


@pytest.mark.usefixtures("programs")
def test_simulated_tests_are_measured_at_their_places() -> None:
    sections = (
        MeasuredMicrostructure(0.1, 200e-6, 10e-6),
        MeasuredMicrostructure(None, 170e-6, 8e-6, 0.7, 0.05, time=4000.0),
    )
    test = replace(history_twin("creep", 12), microstructure=sections)
    rng = np.random.default_rng(1)
    drawn = [simulate_data(test, TRUTH, rng, source="a test").microstructure for _ in range(30)]
    end = simulate(test, TRUTH, at=np.array([4000.0])).iloc[-1]
    steady, start = TRUTH["steady_state_grain_size"], test.initial_grain_size
    gone = np.exp(-0.1 / TRUTH["critical_strain_grain_size"])
    for k, size in enumerate((steady + (start - steady) * gone, end["grain_size_m"])):
        errors = np.log([one[k].grain_size / size for one in drawn])
        expected = sections[k].grain_size_sd / sections[k].grain_size
        assert abs(errors.mean()) < 4 * expected / np.sqrt(30)
        assert errors.std() == pytest.approx(expected, rel=0.4)
        assert {(one[k].strain, one[k].time) for one in drawn} == {
            (sections[k].strain, sections[k].time)
        }
    factors = np.array([one[1].fabric_factor for one in drawn]) - end["fabric_factor"]
    assert abs(factors.mean()) < 4 * 0.05 / np.sqrt(30)
