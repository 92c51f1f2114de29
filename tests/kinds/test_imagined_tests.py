"""Imagined tests: oscillations and tables of attenuation without readings."""

import json
from dataclasses import replace
from pathlib import Path

import attenuation_oracle
import numpy as np
import oracle
import pandas as pd
import pytest
from conftest import ICE
from history_twins import BACKSTRESS, THIRD, TRUTH, history_twin
from refusals import written
from truths import truth_of

from pyburgers.cli.main import main
from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.conditions import doubts
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forced_oscillation.likelihood import START_MARGIN
from pyburgers.kinds.forward import simulate, with_laws
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.model.parameters import PIEZOMETER, STANDARD_VALUES

HEAD = """
id = "imagined"
material = "olivine"
protocol = "{}"
temperature_K = 1423.0
initial_grain_size_m = 10e-6

[provenance]
kind = "synthetic"
source = "imagined"
"""

OSCILLATION = (
    HEAD.format("forced_oscillation")
    + """
[oscillation]
period_s = 300.0
start_stress_Pa = 150e6

[imposed_cycles]
strain_amplitude = 2e-3
cycles = 5
mean_strain_rate_per_s = 5e-6
"""
)

TABLE = (
    HEAD.format("attenuation")
    + """
[attenuation]
deformation = "shear"
poisson_ratio = 0.25
amplitude_Pa = 1e5

[[spectra]]
periods_s = [1, 10, 100]

[[spectra]]
temperature_K = 1373
median_stress_Pa = 1e6
amplitude_Pa = 2e5
periods_s = [1, 1000]
"""
)

TWIN = Path(__file__).parents[2] / "data" / "olivine" / "olivine_twin.toml"


def simulated(
    test: Path, parameters: dict[str, float], folder: Path, *options: str
) -> pd.DataFrame:
    """What the command writes."""
    known, out = folder / "parameters.json", folder / "out.csv"
    known.write_text(json.dumps(parameters), encoding="utf-8")
    command = ["simulate", str(test), "--parameters", str(known), "--out", str(out), *options]
    assert main(command) == 0
    return pd.read_csv(out)


@pytest.fixture(scope="module")
def parameters() -> dict[str, float]:
    return truth_of(load_experiment(TWIN))


@pytest.mark.usefixtures("programs")
@pytest.mark.parametrize("cycles", [1, 2])
@pytest.mark.parametrize("amplitude", ["2e-3", "0.1"])
def test_imposed_cycles_have_as_many_cycles_ahead_as_the_file_says(
    cycles: int, amplitude: str, tmp_path: Path, parameters: dict[str, float]
) -> None:
    """Their stress is that of scipy, which starts that many periods ahead."""
    settings = f"period_s = 300.0\nspin_up_cycles = {cycles}"
    text = OSCILLATION.replace("2e-3", amplitude).replace("period_s = 300.0", settings)
    imagined = load_forced_oscillation(written(tmp_path / "one.toml", text, (), {}))
    time = np.linspace(10.0, 1500.0, 40)
    found = simulate(imagined, parameters, at=time)
    strain = float(amplitude) * np.sin(2 * np.pi * time / 300) + 5e-6 * time
    np.testing.assert_allclose(found["strain"], strain, rtol=1e-12, atol=1e-15)
    expected = oracle.oscillation(
        parameters,
        imagined.temperature,
        imagined.initial_grain_size,
        oracle.OscillatingStrain(300.0, [float(amplitude)], [0.0], [5e-6], -300.0 * START_MARGIN),
        start=-300.0 * cycles,
        start_stress=150e6,
        time=time,
    )
    for name, own in zip(("stress_Pa", "kelvin_strain", "grain_size_m"), expected, strict=True):
        np.testing.assert_allclose(found[name], own, rtol=0, atol=1e-4 * np.abs(own).max())


@pytest.mark.usefixtures("programs")
def test_simulate_writes_what_a_table_of_attenuation_reads(
    tmp_path: Path, parameters: dict[str, float]
) -> None:
    table = written(tmp_path / "table.toml", TABLE, (), {})
    out = simulated(table, parameters, tmp_path)
    assert out["period_s"].tolist() == [1, 10, 100, 1, 1000]
    assert out["temperature_K"].tolist() == [1423] * 3 + [1373] * 2
    assert out["median_stress_Pa"].tolist() == [0, 0, 0, 1e6, 1e6]
    assert out["amplitude_Pa"].tolist() == [1e5] * 3 + [2e5] * 2
    known = {**STANDARD_VALUES, **parameters}
    expected = attenuation_oracle.log_readings(
        load_attenuation(table), known, out["period_s"].to_numpy(), np.arange(5)
    )
    np.testing.assert_allclose(out["tan_delta"], np.exp(expected[0]), rtol=1e-7)
    np.testing.assert_allclose(out["modulus_Pa"], np.exp(expected[1]), rtol=1e-7)


@pytest.mark.usefixtures("programs")
def test_simulate_takes_a_variant(tmp_path: Path, parameters: dict[str, float]) -> None:
    """Without a piezometer an oscillation needs constant grains."""
    test = written(tmp_path / "one.toml", OSCILLATION, (), {})
    known = {name: value for name, value in parameters.items() if name not in PIEZOMETER}
    found = simulated(test, known, tmp_path, "--variant", "grain_size=constant")
    assert found["grain_size_m"].to_numpy() == pytest.approx(10e-6)
    expected = simulated(test, {**parameters, "critical_strain_grain_size": 1e9}, tmp_path)
    np.testing.assert_allclose(found["stress_Pa"], expected["stress_Pa"], rtol=1e-6)


def without_readings(test: HistoryExperiment) -> HistoryExperiment:
    none = np.empty(0)
    return replace(test, time=none, reading_stage=none.astype(np.int64), reading=none)


@pytest.mark.parametrize(("stress", "doubted"), [(3.0, 1), (8e6, 0), (3e12, 1)])
def test_stresses_of_an_imagined_test_are_doubted_where_a_unit_may_be_wrong(
    stress: float, doubted: int
) -> None:
    test = without_readings(history_twin("creep", 4))
    imagined = replace(test, stages=(replace(test.stages[0], value=stress),))
    assert len([one for one in doubts(imagined) if "check its unit" in one]) == doubted


def test_a_law_whose_parameter_is_not_given_is_refused(parameters: dict[str, float]) -> None:
    twin = load_experiment(TWIN)
    with pytest.raises(InputError, match=r"kelvin=power_law: .* kelvin_stress_exponent"):
        with_laws(twin, parameters, {"kelvin": "power_law"})


@pytest.mark.parametrize(
    ("part", "law", "missing"),
    [
        ("kelvin", "power_law", "kelvin_stress_exponent, kelvin_reference_stress"),
        ("maxwell", "threshold_stress", "threshold_stress"),
        ("maxwell", "linear", "stress_exponent = 1"),
        ("hardening", "backstress", "hardening_modulus, backstress_limit"),
        ("third_mechanism", "power_law", "third_rate, third_stress_exponent"),
    ],
)
def test_a_law_whose_parameter_is_not_given_to_an_imagined_test_is_refused(
    part: str, law: str, missing: str
) -> None:
    imagined = load_experiment(ICE.parent / "designs" / "dunite_creep.toml")
    with pytest.raises(InputError, match=rf"give values of the law's own parameters: {missing}"):
        with_laws(imagined, TRUTH, {part: law})


@pytest.mark.parametrize(
    "choices",
    [
        {"hardening": "none"},
        {"hardening": "backstress"},
        {"third_mechanism": "none", "second_mechanism": "none"},
        {"third_mechanism": "power_law"},
        {"kelvin": "power_law"},
    ],
    ids=str,
)
def test_a_law_that_needs_no_stress_needs_no_data(choices: dict[str, str]) -> None:
    test = history_twin("creep", 4)
    kelvin = {"kelvin_stress_exponent": 2.0, "kelvin_reference_stress": 1e6}
    values = {**TRUTH, **BACKSTRESS, **THIRD, **kelvin}
    found = with_laws(without_readings(test), values, choices)
    assert found == with_laws(test, values, choices)
