"""Data in the project: the synthetic twins and the published peak stresses."""

import tomllib
from collections.abc import Callable, Iterable
from dataclasses import fields, replace
from pathlib import Path
from types import ModuleType
from typing import Any

import numpy as np
import pandas as pd
import pytest
from data_script import data_script
from independent_table import PEAKS, STRAIN_RATES, STRESS_OF_FAST, TRUTHS
from truths import truth_of

from pyburgers.common.array_types import FloatArray
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.model.parameters import PARAMETERS
from pyburgers.model.priors import default_priors

ICE = Path(__file__).parents[2] / "data" / "ice"

# Published conditions (Qi and Goldsby 2021): 1/s, MPa.
PUBLISHED = {"PIL40": (1.69e-4, 8.03), "PIL72": (8.0e-5, 6.32), "PIL105": (2.53e-5, 4.49)}


@pytest.fixture(scope="module")
def generator() -> ModuleType:
    return data_script(ICE / "generate_twins.py")


@pytest.fixture(scope="module")
def searcher() -> ModuleType:
    return data_script(ICE / "search_twins.py")


@pytest.mark.parametrize(
    ("script", "write", "names"),
    [
        ("ice/generate_twins.py", "write_twins", PUBLISHED),
        ("olivine/generate_record.py", "write_record", ["olivine_twin_s*", "olivine_twin"]),
    ],
)
def test_the_generator_rewrites_the_files_bit_for_bit(
    script: str, write: str, names: Iterable[str], tmp_path: Path
) -> None:
    generator = ICE.parent / script
    written = getattr(data_script(generator), write)(tmp_path)
    files = {file for name in names for file in generator.parent.glob(f"{name}.[tc]*")}
    assert {path.name for path in written} == {file.name for file in files}
    for path in written:
        assert path.read_bytes() == (generator.parent / path.name).read_bytes(), path.name


def of_table(generator: ModuleType, name: str) -> Any:
    """A twin with a truth of the independent table in the place of its own."""
    twin = generator.TWINS[0]
    known = {field.name for field in fields(twin)}
    truth = {key: value for key, value in TRUTHS[name].items() if key in known}
    return replace(twin, strain_rate=STRAIN_RATES[name], **truth)


def test_stress_agrees_with_the_independent_table(generator: ModuleType) -> None:
    strain = np.array(list(STRESS_OF_FAST))
    stress = generator.stress_at(of_table(generator, "fast"), strain) / 1e6
    np.testing.assert_allclose(stress, list(STRESS_OF_FAST.values()), rtol=2e-3)


@pytest.mark.parametrize("name", PEAKS)
def test_peak_agrees_with_the_independent_table(generator: ModuleType, name: str) -> None:
    strain = np.linspace(2e-4, 0.06, 300)
    stress = generator.stress_at(of_table(generator, name), strain)
    peak, at = PEAKS[name]
    assert stress.max() / 1e6 == pytest.approx(peak, rel=2e-3)
    assert strain[stress.argmax()] == pytest.approx(at, abs=3e-4)


def solved(searcher: ModuleType, stress_at: Callable[[Any], FloatArray], twin: Any) -> pd.DataFrame:
    """Truth and properties of its curve in the form of the search, by the independent solver."""
    stress = stress_at(twin)
    names = (*searcher.SEARCHED, "activation_enthalpy")
    return pd.DataFrame(
        [
            {
                **{name: getattr(twin, name) for name in names},
                "peak_stress": stress.max(),
                "peak_strain": searcher.STRAIN[stress.argmax()],
                "final_stress": stress[-1],
                "final_slope": np.log(stress[-1] / stress[-2]) / 0.01,
            }
        ]
    )


class TestTruths:
    """Each could be the paper's sample: see docs/synthetic_ice.md."""

    @pytest.mark.parametrize("number", range(3))
    def test_every_printed_statement_holds(
        self, searcher: ModuleType, generator: ModuleType, number: int
    ) -> None:
        twin, sample = generator.TWINS[number], searcher.SAMPLES[number]
        assert (twin.name, twin.strain_rate) == (sample.name, sample.strain_rate)
        assert PUBLISHED[twin.name] == (sample.strain_rate, sample.peak_stress / 1e6)
        truth = solved(searcher, lambda t: generator.stress_at(t, searcher.STRAIN), twin)
        met = searcher.requirements(sample, truth)
        assert all(bool(one.all()) for one in met.values()), met
        for name, (low, high) in sample.found.items():
            assert low <= getattr(twin, name) <= high

    def test_pil40_has_the_values_that_the_paper_finds(self, generator: ModuleType) -> None:
        pil40 = generator.TWINS[0]
        assert pil40.stress_exponent == pytest.approx(4.0, abs=0.05)
        assert pil40.critical_strain_grain_size == pytest.approx(0.03, abs=0.0025)

    def test_no_truth_keeps_its_peak_of_attenuation_at_every_stress(
        self, generator: ModuleType
    ) -> None:
        for twin in generator.TWINS:
            assert twin.kelvin_modulus / twin.maxwell_modulus > 1 / 8

    @pytest.mark.parametrize("name", TRUTHS)
    def test_a_soft_kelvin_element_does_not_meet_them(
        self, searcher: ModuleType, generator: ModuleType, name: str
    ) -> None:
        """It gives the same peak of stress, but attenuation with a peak at every stress."""
        twin = of_table(generator, name)
        sample = searcher.SAMPLES[list(TRUTHS).index(name)]
        truth = solved(searcher, lambda t: generator.stress_at(t, searcher.STRAIN), twin)
        met = searcher.requirements(sample, truth)
        assert met["peak near 3 %"].all()
        assert not met["one falling stretch, at 1 MPa"].any()

    @pytest.mark.parametrize("number", range(3))
    def test_they_are_the_candidates_of_the_seeded_search(
        self, searcher: ModuleType, generator: ModuleType, number: int
    ) -> None:
        twin, rng = generator.TWINS[number], np.random.default_rng([searcher.SEED, number])
        drawn = searcher.candidates(searcher.SAMPLES[number], searcher.CANDIDATES, rng)
        candidate = drawn.loc[twin.candidate]
        for name in searcher.SEARCHED:
            assert getattr(twin, name) == pytest.approx(candidate[name], rel=5e-3), name

    @pytest.mark.slow
    def test_the_search_finds_pil40_again(
        self, searcher: ModuleType, generator: ModuleType
    ) -> None:
        rng = np.random.default_rng([searcher.SEED, 0])
        sample, twin = searcher.SAMPLES[0], generator.TWINS[0]
        found, _ = searcher.search(sample, searcher.CANDIDATES, rng)
        truth = searcher.truth_of(sample, searcher.typical(found))
        assert truth.name == twin.candidate
        assert {name: getattr(twin, name) for name in truth.index} == truth.to_dict()


def test_one_noise_seed_serves_all_twins(generator: ModuleType) -> None:
    seeds = {load_constant_rate(ICE / f"{n}.toml").metadata["noise_seed"] for n in PUBLISHED}
    assert seeds == {generator.SEED}


@pytest.mark.parametrize("name", PUBLISHED)
class TestTwinFiles:
    def test_they_say_that_they_are_synthetic_and_know_their_truth(self, name: str) -> None:
        experiment = load_constant_rate(ICE / f"{name}.toml")
        assert experiment.provenance.kind == "synthetic"
        assert list(truth_of(experiment)) == [parameter.name for parameter in PARAMETERS]
        assert experiment.notices == ()
        assert 60 <= experiment.n_points <= 100
        assert experiment.temperature == 260
        assert experiment.metadata["sample_temperature_K"] == 263

    def test_the_truth_lies_inside_the_priors(self, name: str) -> None:
        experiment = load_constant_rate(ICE / f"{name}.toml")
        priors = default_priors("ice").resolved(float(np.max(experiment.stress)))
        for parameter, value in truth_of(experiment).items():
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
    for name in PUBLISHED:
        strain = load_constant_rate(ICE / f"{name}.toml").strain
        counts.append(np.count_nonzero((strain > 0.02) & (strain < 0.045)))
    assert counts[0] <= 3
    assert min(counts[1:]) >= 10


class TestPeakStressTable:
    def test_23_rows_with_a_citation(self) -> None:
        with (ICE / "rates" / "qi_goldsby_2021.toml").open("rb") as file:
            table = tomllib.load(file)
        rows = pd.read_csv(ICE / "rates" / table["data"]["file"])
        assert list(rows["grain_size_mm"].value_counts().sort_index().items()) == [
            (0.23, 18),
            (0.63, 5),
        ]
        assert table["provenance"]["doi"] == "10.1029/2021JB021824"
        for quantity in ("temperature", "stress", "strain_rate", "grain_size"):
            assert table["data"][f"{quantity}_column"] in rows.columns

    def test_least_squares_gives_the_published_exponents(self) -> None:
        rows = pd.read_csv(ICE / "rates" / "qi_goldsby_2021.csv")
        design = np.column_stack(
            [np.log(rows["stress_MPa"]), -np.log(rows["grain_size_mm"]), np.ones(len(rows))]
        )
        log_rate = np.log(rows["strain_rate_per_s"].to_numpy())
        (stress_exponent, grain_size_exponent, _), *_ = np.linalg.lstsq(design, log_rate)
        assert stress_exponent == pytest.approx(3.54, abs=0.01)
        assert grain_size_exponent == pytest.approx(0.58, abs=0.01)
