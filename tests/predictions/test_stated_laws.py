"""Laws that `pyburgers export` states, evaluated from its text, against the Stan programs."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
from evaluated_laws import value_of
from history_twins import GRAIN_SIZE, TEMPERATURE, TRUTH, history_twin
from linear_bodies import LAWS

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.stages import Stage
from pyburgers.kinds.program_data import given_parameters
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.laws import DASHPOT_LAWS
from pyburgers.predictions.code_formats import CREEP_FORMATS
from pyburgers.predictions.exported import LOG_FACTOR, Exported, as_json, as_latex
from pyburgers.predictions.stated_laws import CreepLaw, laws_of

pytestmark = pytest.mark.usefixtures("programs")

EXACT = SolverOptions(tolerance=1e-11, max_num_steps=1_000_000)
STRESS = 3e6
SINE = {"breakdown_stress": 1e6}
PIEZOMETER = {
    "steady_state_grain_size": GRAIN_SIZE,
    "piezometer_reference_grain_size": 2e-4,
    "piezometer_exponent": 1.33,
    "piezometer_stress_floor": 1e6,
}
DASHPOTS: Mapping[str, Mapping[str, float]] = {
    "power law": {},
    "linear": {"stress_exponent": 1.0, "beta": -6.4e-4},
    "sine": SINE,
    "linear sine": {**SINE, "stress_exponent": 1.0, "beta": -6.4e-4},
    "sine that hardens": {**SINE, "steady_state_fabric_factor": 3.0},
    "threshold that hardens": {"threshold_stress": 1e6, "steady_state_fabric_factor": 3.0},
    "constant fabric": {"steady_state_fabric_factor": 1.0},
    "constant grains": {"steady_state_grain_size": GRAIN_SIZE},
    "piezometer": PIEZOMETER,
    "piezometer and sine": {**PIEZOMETER, **SINE},
}
SLOWER = {
    "kelvin_activation_enthalpy": 6e4,
    "kelvin_reference_temperature": TEMPERATURE + 10,
}
COARSER = {"kelvin_grain_size_exponent": 1.5, "kelvin_reference_grain_size": 1e-4}
KELVIN: Mapping[str, Mapping[str, float]] = {
    **LAWS,
    "two_elements": {**LAWS["two_elements"], "peak_width": 0.0},
    "power_law": {"kelvin_stress_exponent": 2.5, "kelvin_reference_stress": 1e6},
}


def creep(duration: float) -> HistoryExperiment:
    return replace(
        history_twin("creep", 2),
        stages=(Stage("stress", 0.0, duration, TEMPERATURE, STRESS),),
        time=np.empty(0),
        reading_stage=np.empty(0, dtype=np.int64),
        reading=np.empty(0),
    )


def exported(experiment: Experiment, values: Mapping[str, float]) -> Exported:
    """The export of a fit whose draws are all alike."""
    known = {**values, LOG_FACTOR: values["beta"] * values["activation_enthalpy"]}
    return Exported(
        test="t",
        material="ice",
        variant="v",
        run="r",
        draws_of="measured",
        conditions="",
        sampled_well="yes",
        describes_data="yes",
        names=tuple(known),
        mean=np.array(list(known.values())),
        covariance=np.zeros((len(known), len(known))),
        n_draws=1,
        decided_by=("data",) * len(known),
        by_prior_of=("",) * len(known),
        notes=(),
        laws=laws_of(given_parameters("ice", values), experiment),
    )


def read_back(experiment: Experiment, values: Mapping[str, float]) -> tuple[Any, dict[str, Any]]:
    """What a program reads from the JSON: the object, and values of the names of its laws."""
    content = json.loads(as_json(exported(experiment, values)))
    names = dict(zip(content["names"], content["mean"], strict=True))
    return content, {
        **names,
        "stress": STRESS,
        "temperature": TEMPERATURE,
        "initial_grain_size": GRAIN_SIZE,
        "R": GAS_CONSTANT,
    }


def solved(test: HistoryExperiment, values: Mapping[str, float], at: FloatArray) -> dict[str, Any]:
    solution = simulate(test, values, at=at, solver=EXACT)
    return {str(name): solution[name].to_numpy() for name in solution}


@pytest.mark.parametrize("state", ["undeformed", "steady"])
@pytest.mark.parametrize("law", DASHPOTS)
def test_the_flow_law_gives_the_rate_of_the_dashpot(law: str, state: str) -> None:
    # Before the microstructure evolves, and when it has.
    critical = 1e5 if state == "undeformed" else 1e-5
    values = {
        **TRUTH,
        **DASHPOTS[law],
        "critical_strain_grain_size": critical,
        "critical_strain_fabric": critical,
    }
    test = creep(2000.0)
    # The Kelvin element has settled; the spring does not change.
    content, names = read_back(test, values)
    found = solved(test, values, np.array([1000.0, 2000.0]))
    dashpot = found["strain"] - found["kelvin_strain"]
    structure = {
        name: value_of(text, names) for name, text in content["microstructure"][state].items()
    }
    assert found["grain_size_m"][-1] == pytest.approx(structure["grain_size"], rel=1e-5)
    assert found["fabric_factor"][-1] == pytest.approx(structure["fabric_factor"], rel=1e-5)
    expected = np.diff(dashpot).item() / 1000.0
    stated = value_of(content["flow_law"], {**names, **structure})
    assert stated == pytest.approx(expected, rel=1e-4)
    back = value_of(content["flow_law"], {**names, **structure, "stress": -names["stress"]})
    assert back == pytest.approx(-stated, rel=1e-12)


@pytest.mark.parametrize("law", ["power law", "constant fabric", "constant grains", "piezometer"])
def test_the_microstructure_changes_as_stated(law: str) -> None:
    values = {**TRUTH, **DASHPOTS[law]}
    content, names = read_back(test := creep(2000.0), values)
    found = solved(test, values, np.array([999.0, 1000.0, 1001.0]))
    here = {"grain_size": found["grain_size_m"][1], "fabric_factor": found["fabric_factor"][1]}
    evolved = {"grain_size": found["grain_size_m"], "fabric_factor": found["fabric_factor"]}
    for name, text in content["microstructure"]["change_per_path_strain"].items():
        change, strain = (np.diff(one[[0, 2]]).item() for one in (evolved[name], found["strain"]))
        assert value_of(text, {**names, **here}) == pytest.approx(change / strain, rel=1e-4)


@pytest.mark.parametrize("scaled", [{}, SLOWER, {**SLOWER, **COARSER}])
@pytest.mark.parametrize("law", KELVIN)
def test_the_kelvin_law_gives_the_strain_of_the_kelvin_part(
    law: str, scaled: Mapping[str, float]
) -> None:
    values = {**TRUTH, **scaled, **KELVIN[law]}
    test = creep(1000.0)
    content, names = read_back(test, values)
    time = np.array([30.0, 30.003, 400.0, 400.04])
    found = solved(test, values, time)
    strain = found["kelvin_strain"]
    left, right = content["kelvin_law"].split(" = ")
    for k in (0, 2):
        if left == "kelvin_strain_rate":
            middle = {**names, "kelvin_strain": strain[k : k + 2].mean()}
            expected = np.diff(strain[k : k + 2]).item() / np.diff(time[k : k + 2]).item()
            assert value_of(right, middle) == pytest.approx(expected, rel=1e-3)
        else:
            assert left == "kelvin_strain/stress"
            stated = STRESS * value_of(right, {**names, "time": time[k]})
            assert stated == pytest.approx(strain[k], rel=5e-4)


SPECTRUM = """
id = "spectrum"
material = "olivine"
protocol = "attenuation"
temperature_K = 1423.0
initial_grain_size_m = 10e-6
attenuation.deformation = "axial"
spectra = [{ periods_s = [1e-9] }]
provenance = { kind = "synthetic", source = "imagined" }
"""


@pytest.mark.parametrize("changes", [{}, {"modulus_temperature_coefficient": -1.2e-4}])
def test_the_elastic_law_gives_the_modulus_of_fast_cycles(
    changes: Mapping[str, float], tmp_path: Path
) -> None:
    path = tmp_path / "spectrum.toml"
    path.write_text(SPECTRUM, encoding="utf-8")
    test = load_attenuation(path)
    values = {**TRUTH, **DASHPOTS["linear"], **changes, "modulus_reference_temperature": 1200.0}
    content, names = read_back(test, values)
    both = simulate(test, values, at=test.conditions.place + np.array([0.0, 1.0]))
    modulus = np.exp(both["log_reading"].iloc[1])
    strain = value_of(content["elastic_law"], {**names, "temperature": 1423.0})
    assert strain == pytest.approx(STRESS / modulus, rel=1e-6)


def test_latex_states_the_same_laws() -> None:
    one = exported(creep(1.0), {**TRUTH, **SINE})
    text = as_latex(one)
    assert f"% flow_law: {DASHPOT_LAWS['hyperbolic_sine'].flow_law}\n" in text
    assert "% microstructure steady fabric_factor: steady_state_fabric_factor\n" in text
    assert "% microstructure change_per_path_strain fabric_factor: (steady" in text


def test_notes_of_files_end_with_their_line() -> None:
    """A path or a title with a line end would be a line of input."""
    text = CREEP_FORMATS["pism"].text(
        CreepLaw(-30.0, 3.0, 0.0, 6e4, 1e-3, 1.0), "x", ["run a\n-evil 1"], {}
    )
    assert "# run a -evil 1\n" in text
    latex = as_latex(replace(exported(creep(1.0), {**TRUTH, **SINE}), variant="a\n\\input{b}"))
    assert "\n\\input" not in latex
