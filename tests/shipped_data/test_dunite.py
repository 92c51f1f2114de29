"""The measured dunite tests that come with the project."""

import numpy as np
import pytest
from conftest import DUNITE

from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate

# Sample: readings above zero strain, temperature (K), strain rates (1/s), where each rate starts.
TESTS = {
    4506: (14, 1553, [1.20e-4], [0.0]),
    4580: (48, 1673, [1.00e-4, 3.20e-5, 1.00e-5], [0.0, 0.041, 0.071]),
    4469: (35, 1573, [1.10e-4, 1.00e-5, 1.10e-4], [0.0, 0.077, 0.096]),
    4581: (55, 1573, [1.07e-4, 3.20e-5, 1.10e-5], [0.0, 0.051, 0.0803]),
}


def load(sample: int) -> ConstantRateExperiment:
    return load_constant_rate(DUNITE / f"dunite_{sample}.toml")


@pytest.mark.parametrize("sample", TESTS)
def test_each_sample_is_read_with_its_rates(sample: int) -> None:
    n_points, temperature, rates, starts = TESTS[sample]
    experiment = load(sample)
    assert experiment.id == f"dunite_{sample}"
    assert experiment.n_points == n_points
    assert experiment.temperature == temperature
    assert [segment.strain_rate for segment in experiment.segments] == rates
    assert [segment.start_strain for segment in experiment.segments] == starts
    assert np.all(np.diff(experiment.strain) >= 0)
    assert experiment.provenance.kind == "digitised"
    for author in ("Chopra", "Paterson", "Masuti", "Barbot"):
        assert author in experiment.provenance.source


def test_4506_has_a_peak_and_weakens() -> None:
    experiment = load(4506)
    assert experiment.stress.max() == pytest.approx(480.4937e6)
    assert experiment.strain[experiment.stress.argmax()] == pytest.approx(0.0336)
    assert "dropped 2 points at zero strain" in experiment.notices[0]


def test_readings_behind_a_rate_step_are_lower() -> None:
    experiment = load(4581)
    assert "1 point out of order by at most 1e-05" in experiment.notices[0]
    _, second, third = (segment.start_strain for segment in experiment.segments)
    at_ends = [experiment.stress[experiment.strain < start][-1] for start in (second, third)]
    np.testing.assert_allclose([*at_ends, experiment.stress[-1]], [369.4e6, 271.6e6, 211.9e6], 1e-3)


def test_a_reading_past_a_step_belongs_to_the_rate_before_it() -> None:
    experiment = load(4580)
    at_step = experiment.stress[experiment.strain == 0.041]
    np.testing.assert_allclose(at_step, [190.20174e6, 190.0e6], rtol=1e-12)


def test_the_table_names_who_measured_and_who_digitised() -> None:
    text = (DUNITE / "chopra_paterson_1984.csv").read_text(encoding="utf-8")
    comments = [line for line in text.splitlines() if line.startswith("#")]
    assert any("Chopra" in line and "89, 7861" in line for line in comments)
    assert any("Masuti" in line and "10.1186/s40623-021-01543-9" in line for line in comments)
