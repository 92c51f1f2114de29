"""Stages under a force over the first area: the area follows from the strain of the sample."""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import history_oracle
import numpy as np
import pytest
from history_files import history, stage
from history_twins import GRAIN_SIZE, TEMPERATURE, TRUTH
from same_contents import assert_equal

from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import InputError
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.kind import save_experiment
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.files import load_loading_history
from pyburgers.kinds.loading_history.stages import Leg
from pyburgers.kinds.program_data import solve
from pyburgers.kinds.stan_data import SolverOptions

COMPLIANCE = 1.8e-9
AT_CONDITIONS = {
    "temperature_K": TEMPERATURE,
    "initial_grain_size_m": GRAIN_SIZE,
    "stress_measure": "engineering",
}
STAGES: Mapping[str, tuple[tuple[float, float, float], ...]] = {
    "constant": ((4000.0, 5e6, 0.0),),
    "tension": ((1500.0, -5e6, 0.0),),
    "ramps and steps": ((200.0, 0.0, 2.5e4), (2000.0, 5e6, 0.0), (800.0, 2e6, 0.0)),
}
"""Duration (s), force at the start (Pa), and its rate (Pa/s), of each stage."""

MATERIALS: Mapping[str, Mapping[str, float]] = {
    "ice": {},
    "power-law Kelvin": {"kelvin_stress_exponent": 2.5, "kelvin_reference_stress": 1e6},
    "sine that hardens": {"breakdown_stress": 2e6, "steady_state_fabric_factor": 1.5},
    "piezometer": {
        "steady_state_grain_size": GRAIN_SIZE,
        "piezometer_reference_grain_size": 3e-4,
        "piezometer_exponent": 1.33,
        "piezometer_stress_floor": 1e6,
    },
}


def forced(
    stages: tuple[tuple[float, float, float], ...], columns: Mapping[str, FloatArray], **head: Any
) -> HistoryExperiment:
    """A test of the given forces in an apparatus that gives way."""
    start, listed = 0.0, []
    for duration, force, rate in stages:
        own: dict[str, Any] = {"control": "stress", "stress": force / 1e6}
        if rate:
            own = {"control": "stress_rate", "start_stress": force / 1e6, "stress_rate": rate / 1e6}
        listed.append({"start_time": start, "end_time": start + duration, **own})
        start += duration
    keys = {"stage_stress_unit": "MPa", "apparatus": {"compliance_per_Pa": COMPLIANCE}, **head}
    return history(listed, columns, {"strain_unit": "fraction"}, **AT_CONDITIONS, **keys)


def by_scipy(
    values: Mapping[str, float], stages: tuple[tuple[float, float, float], ...], at: FloatArray
) -> FloatArray:
    """True stress and strain of the sample at times inside the stages, (2, n)."""
    legs, start = [], 0.0
    for duration, force, slope in stages:
        end = start + duration
        legs.append(Leg("stress", start, end, force, slope, TEMPERATURE, 0, is_force=True))
        start = end
    times = [at[(at > leg.start_time) & (at <= leg.end_time)] for leg in legs]
    state = history_oracle.history(values, GRAIN_SIZE, legs, times)
    return np.asarray(state[[history_oracle.STRESS, history_oracle.STRAIN]])


@pytest.mark.usefixtures("programs")
@pytest.mark.parametrize(
    ("stages", "material"),
    [*((stages, "ice") for stages in STAGES), *(("ramps and steps", one) for one in MATERIALS)],
)
def test_a_force_without_data_is_solved_with_the_area_of_the_solution(
    stages: str, material: str
) -> None:
    values = {**TRUTH, **MATERIALS[material]}
    test = forced(STAGES[stages], {})
    at = np.linspace(0.0, test.end_time, 41)[1:-1] + 0.5
    stress, strain = by_scipy(values, STAGES[stages], at)
    found = simulate(test, values, at=at)
    np.testing.assert_allclose(found["stress_Pa"], stress, rtol=1e-6)
    read = strain + COMPLIANCE * stress
    np.testing.assert_allclose(found["strain"], read, rtol=1e-5, atol=1e-9)
    # The area matters here: a constant true stress would strain the sample otherwise.
    assert np.abs(strain).max() > 0.03


@pytest.mark.usefixtures("programs")
@pytest.mark.parametrize("stages", STAGES)
def test_the_strain_rate_under_a_force_is_the_slope_of_the_strain(stages: str) -> None:
    """That of the apparatus and of the error of the load cell included."""
    test = forced(STAGES[stages], {})
    values = {**TRUTH, "apparatus_compliance": COMPLIANCE, "stress_calibration_error": 0.05}
    middle = np.linspace(0.0, test.end_time, 20)[1:-1] + 0.7
    at = np.sort(np.concatenate([middle - 0.1, middle, middle + 0.1]))
    found = solve(test, values, at, solver=SolverOptions(tolerance=1e-11, max_num_steps=1_000_000))
    slope = (found["grid_strain"][2::3] - found["grid_strain"][::3]) / 0.2
    np.testing.assert_allclose(found["grid_strain_rate"][1::3], slope, rtol=1e-4)


def test_a_copy_of_a_test_under_a_force_is_the_same(tmp_path: Path) -> None:
    original = forced(STAGES["ramps and steps"], {})
    assert_equal(load_loading_history(save_experiment(original, tmp_path)), original)


@pytest.mark.parametrize("zero", [0.0, 0.01])
def test_the_area_under_a_force_is_without_the_strain_of_the_apparatus(zero: float) -> None:
    """A creep test of scipy, whose strain is read with the share of the apparatus."""
    stages = ((4000.0, 20e6, 0.0),)
    time = np.linspace(1.0, 3999.0, 400)
    values = {**TRUTH, "beta": TRUTH["beta"] - 8e-5}
    stress, strain = by_scipy(values, stages, time)
    columns = {"time": time, "strain": strain + COMPLIANCE * stress + zero}
    test = forced(stages, columns, strain_offset={"value": zero, "unit": "fraction"})
    corner, value = np.transpose(test.stages[0].knots)
    np.testing.assert_allclose(np.interp(time, corner, value), stress, rtol=2e-3)
    assert COMPLIANCE * stress[0] > 0.03  # by which the area would be wrong


def test_engineering_stresses_are_those_of_the_sample() -> None:
    strain, stress = np.array([0.02, 0.08, 0.15]), np.array([10e6, 30e6, 40e6])
    columns = {
        "time": np.array([10.0, 20.0, 30.0]),
        "strain": -np.expm1(-(strain + COMPLIANCE * stress)),
        "stress": stress * np.exp(strain),
    }
    test = history(
        [stage(40.0, "strain_rate", strain_rate_per_s=0.005)],
        columns,
        {"strain_unit": "fraction", "stress_unit": "Pa"},
        apparatus={"compliance_per_Pa": COMPLIANCE},
        strain_measure="engineering",
        **AT_CONDITIONS,
    )
    np.testing.assert_allclose(test.reading, stress, rtol=1e-12)


def test_a_compliance_in_another_unit_is_refused() -> None:
    columns = {"time": np.array([1.0, 3999.0]), "strain": np.array([0.1, 0.2])}
    with pytest.raises(InputError, match=r"'compliance_per_Pa'.*check its unit"):
        forced(STAGES["constant"], columns, apparatus={"compliance_per_Pa": 1.8e-3})
