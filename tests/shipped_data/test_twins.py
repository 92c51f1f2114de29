"""Data in the project: the synthetic twins and the published peak stresses."""

import importlib.util
import sys
import tomllib
from pathlib import Path
from types import ModuleType

import numpy as np
import pandas as pd
import pytest

from pyburgers.model.parameters import PARAMETERS
from pyburgers.model.priors import default_priors
from pyburgers.protocols.constant_rate.experiment import load_constant_rate

ICE = Path(__file__).parents[2] / "data" / "ice"

# model.md, section 5: peak stress (MPa) and its strain.
PEAKS = {"PIL40": (7.995, 0.0313), "PIL72": (6.118, 0.0279), "PIL105": (4.420, 0.0272)}


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    spec = importlib.util.spec_from_file_location("generate_twins", ICE / "generate_twins.py")
    assert spec is not None
    assert spec.loader is not None
    module = importlib.util.module_from_spec(spec)
    # Dataclasses look their module up by name.
    sys.modules[spec.name] = module
    spec.loader.exec_module(module)
    return module


def test_the_generator_rewrites_the_files_bit_for_bit(
    generator: ModuleType, tmp_path: Path
) -> None:
    written = generator.write_twins(tmp_path)
    assert {path.name for path in written} == {f"{t}{s}" for t in PEAKS for s in (".toml", ".csv")}
    for path in written:
        assert path.read_bytes() == (ICE / path.name).read_bytes(), path.name


def test_stress_agrees_with_the_independent_table(generator: ModuleType) -> None:
    strain = np.array([0.002, 0.005, 0.01, 0.05, 0.1, 0.2])
    stress = generator.stress_at(generator.TWINS[0], strain) / 1e6
    np.testing.assert_allclose(stress, [3.93, 5.23, 6.54, 7.72, 6.67, 5.55], rtol=2e-3)


@pytest.mark.parametrize("number", range(3))
def test_peak_agrees_with_the_independent_table(generator: ModuleType, number: int) -> None:
    twin = generator.TWINS[number]
    strain = np.linspace(2e-4, 0.06, 300)
    stress = generator.stress_at(twin, strain)
    peak, at = PEAKS[twin.name]
    assert stress.max() / 1e6 == pytest.approx(peak, rel=2e-3)
    assert strain[stress.argmax()] == pytest.approx(at, abs=3e-4)


@pytest.mark.parametrize("name", PEAKS)
class TestTwinFiles:
    def test_they_say_that_they_are_synthetic_and_know_their_truth(self, name: str) -> None:
        experiment = load_constant_rate(ICE / f"{name}.toml")
        assert experiment.provenance.kind == "synthetic"
        assert experiment.true_parameters is not None
        assert list(experiment.true_parameters) == [parameter.name for parameter in PARAMETERS]
        assert experiment.notices == ()
        assert 60 <= experiment.n_points <= 100
        assert experiment.temperature == 260
        assert experiment.metadata["sample_temperature_K"] == 263

    def test_the_truth_lies_inside_the_priors(self, name: str) -> None:
        experiment = load_constant_rate(ICE / f"{name}.toml")
        priors = default_priors("ice").resolved(float(np.max(experiment.stress)))
        assert experiment.true_parameters is not None
        for parameter, value in experiment.true_parameters.items():
            share = priors[parameter].distribution().cdf(value)
            assert 1e-3 < share < 1 - 1e-3, parameter

    def test_noise_has_the_stated_size(self, generator: ModuleType, name: str) -> None:
        experiment = load_constant_rate(ICE / f"{name}.toml")
        twin = next(twin for twin in generator.TWINS if twin.name == name)
        residual = experiment.stress - generator.stress_at(twin, experiment.strain)
        assert np.std(residual) == pytest.approx(0.1e6, rel=0.3)
        assert abs(np.mean(residual)) < 0.04e6


def test_the_fastest_twin_has_few_points_around_its_peak() -> None:
    counts = []
    for name in PEAKS:
        strain = load_constant_rate(ICE / f"{name}.toml").strain
        counts.append(np.count_nonzero((strain > 0.02) & (strain < 0.045)))
    assert counts[0] <= 3
    assert min(counts[1:]) >= 10


class TestPeakStressTable:
    def test_23_rows_with_a_citation(self) -> None:
        with (ICE / "peak_stress_qi_goldsby_2021.toml").open("rb") as file:
            table = tomllib.load(file)
        rows = pd.read_csv(ICE / table["data"]["file"])
        assert list(rows["grain_size_mm"].value_counts().sort_index().items()) == [
            (0.23, 18),
            (0.63, 5),
        ]
        assert table["provenance"]["doi"] == "10.1029/2021JB021824"
        for quantity in ("temperature", "stress", "strain_rate", "grain_size"):
            assert table["data"][f"{quantity}_column"] in rows.columns

    def test_least_squares_gives_the_published_exponents(self) -> None:
        rows = pd.read_csv(ICE / "peak_stress_qi_goldsby_2021.csv")
        design = np.column_stack(
            [np.log(rows["stress_MPa"]), -np.log(rows["grain_size_mm"]), np.ones(len(rows))]
        )
        log_rate = np.log(rows["strain_rate_per_s"].to_numpy())
        (stress_exponent, grain_size_exponent, _), *_ = np.linalg.lstsq(design, log_rate)
        assert stress_exponent == pytest.approx(3.54, abs=0.01)
        assert grain_size_exponent == pytest.approx(0.58, abs=0.01)
