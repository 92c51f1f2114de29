"""Measured grain sizes and fabric factors: their tables in files, and those of simulated tests."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE

from pyburgers.drawing.view import view_of
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD
from pyburgers.kinds.experiment import MeasuredMicrostructure
from pyburgers.kinds.forward import simulate, simulate_data
from pyburgers.kinds.kind import save_experiment
from pyburgers.kinds.problem import problem_of
from pyburgers.model.priors import default_priors

ROWS = """
[[microstructure]]
strain = 5.0
grain_size_m = 200e-6
grain_size_sd_m = 10e-6

[[microstructure]]
strain = 15.0
grain_size_m = 170e-6
grain_size_sd_m = 8e-6
fabric_factor = 0.7
fabric_factor_sd = 0.05
"""
MEASURED = (
    MeasuredMicrostructure(0.05, 200e-6, 10e-6),
    MeasuredMicrostructure(0.15, 170e-6, 8e-6, 0.7, 0.05),
)


def with_rows(folder: Path, rows: str = ROWS) -> Path:
    """A copy of a twin with rows, strains in percent."""
    path = save_experiment(load_constant_rate(ICE / "PIL40.toml"), folder)
    text = path.read_text(encoding="utf-8") + rows
    path.write_text(
        text.replace('strain_unit = "fraction"', 'strain_unit = "percent"'), encoding="utf-8"
    )
    head, *lines = (folder / "experiment.csv").read_text(encoding="utf-8").splitlines()
    cells = [line.split(",") for line in lines]
    scaled = [f"{100 * float(strain)},{stress}" for strain, stress in cells]
    (folder / "experiment.csv").write_text("\n".join([head, *scaled]), encoding="utf-8")
    return path


def test_rows_are_in_the_unit_of_the_strains(tmp_path: Path) -> None:
    experiment = load_constant_rate(with_rows(tmp_path))
    assert experiment.microstructure == MEASURED
    facts = dict(view_of(experiment).facts(experiment))
    assert "fabric factor 0.700 ± 0.050 at 15 % strain" in facts["Measured microstructure"]
    assert "Measured microstructure" not in dict(
        view_of(experiment).facts(load_constant_rate(ICE / "PIL40.toml"))
    )


def test_the_test_goes_on_to_the_last_row(tmp_path: Path) -> None:
    path = with_rows(tmp_path, ROWS.replace("15.0", "24.0"))
    lines = path.read_text(encoding="utf-8").splitlines(keepends=True)
    kept = [line for line in lines if not line.startswith("final_strain")]
    path.write_text("".join(kept), encoding="utf-8")
    assert load_constant_rate(path).final_strain == pytest.approx(0.24)


def test_strains_say_all_of_a_section_and_points_stay_where_they_were() -> None:
    known = load_constant_rate(ICE / "PIL40.toml")
    experiment = replace(known, microstructure=MEASURED)
    priors = problem_of([known], default_priors("ice")).priors
    without, found = (
        LIKELIHOOD.tests_block([known], priors),
        LIKELIHOOD.tests_block([experiment] * 2, [*priors] * 2),
    )
    assert without["measured"] == []
    assert without["measured_end"] == [0, 0]
    assert found["measured_end"] == [0, 2, 4]
    rows = [[200e-6, 0.05, 0.0, 0.0], [170e-6, 8 / 170, 0.7, 0.05]] * 2
    np.testing.assert_allclose(found["measured"], rows, rtol=1e-12)
    n = known.n_points
    assert found["point_position"][:n] == without["point_position"]
    assert found["output_of_point"][:n] == without["output_of_point"]
    assert found["measured_path_strain"] == [0.05, 0.15] * 2
    assert found["output_of_measured"] == [0] * 4


@pytest.mark.usefixtures("programs")
def test_simulated_tests_are_measured_with_the_stated_errors() -> None:
    experiment = replace(load_constant_rate(ICE / "PIL40.toml"), microstructure=MEASURED)
    truth = dict(experiment.true_parameters or {})
    rng = np.random.default_rng(1)
    drawn = [simulate_data(experiment, truth, rng, source="test").microstructure for _ in range(40)]
    solution = simulate(experiment, truth, at=np.array([0.05, 0.15])).set_index("strain")
    for k, strain in enumerate((0.05, 0.15)):
        sizes = np.log([one[k].grain_size / solution["grain_size_m"][strain] for one in drawn])
        error = MEASURED[k].grain_size_sd / MEASURED[k].grain_size
        assert abs(sizes.mean()) < 4 * error / np.sqrt(40)
        assert sizes.std() == pytest.approx(error, rel=0.4)
        assert all(
            one[k].grain_size_sd / one[k].grain_size == pytest.approx(error) for one in drawn
        )
    factors = np.array([one[1].fabric_factor for one in drawn]) - solution["fabric_factor"][0.15]
    assert abs(factors.mean()) < 4 * 0.05 / np.sqrt(40)
    assert factors.std() == pytest.approx(0.05, rel=0.4)
    assert all(one[0].fabric_factor is None for one in drawn)
