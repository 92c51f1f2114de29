"""Uncertain temperature and calibration: what files say of them, and which tests share an error."""

from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import ICE
from refusals import refusal

from pyburgers import normal
from pyburgers.common.errors import InputError
from pyburgers.fitting.charts_at_modes import share_values
from pyburgers.kinds.conditions import prior_doubts
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import LIKELIHOOD as CONSTANT_RATE
from pyburgers.kinds.experiment import UncertainCondition
from pyburgers.kinds.kind import load_experiment, save_experiment
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.parameters import PLACE, PROGRAM_PARAMETERS
from pyburgers.model.pooling import SEPARATE, pooling_of
from pyburgers.model.priors import default_priors, load_priors, save_priors

OLIVINE = ICE.parent / "olivine" / "olivine_twin.toml"
TEMPERATURE, CALIBRATION = "temperature_error", "stress_calibration_error"


def uncertain(
    experiment: ConstantRateExperiment, sd: float, furnace: str | None
) -> ConstantRateExperiment:
    return replace(experiment, uncertain=(UncertainCondition(TEMPERATURE, sd, furnace),))


def problem(*conditions: tuple[float, str | None]) -> Problem:
    tests = [
        uncertain(load_constant_rate(ICE / f"{name}.toml"), *condition)
        for name, condition in zip(("PIL40", "PIL72", "PIL105"), conditions, strict=False)
    ]
    return problem_of(tests, default_priors("ice"), pooling_of())


def edited(source: Path, folder: Path, *lines: str) -> Path:
    """A copy of an experiment with keys added at its top."""
    copy = save_experiment(load_experiment(source), folder)
    copy.write_text("".join(f"{line}\n" for line in lines) + copy.read_text(), encoding="utf-8")
    return copy


@pytest.mark.parametrize("source", [ICE / "PIL40.toml", OLIVINE])
def test_files_state_standard_deviations_and_apparatus(source: Path, tmp_path: Path) -> None:
    lines = ("temperature_sd_K = 5.0", 'furnace = "D-DIA"', "stress_calibration_sd = 0.02")
    experiment = load_experiment(edited(source, tmp_path, *lines))
    assert experiment.uncertain == (
        UncertainCondition(TEMPERATURE, 5.0, "D-DIA"),
        UncertainCondition(CALIBRATION, 0.02, None),
    )
    priors = problem_of([experiment], default_priors(experiment.material)).priors[0]
    assert priors.free[-2:] == (TEMPERATURE, CALIBRATION)
    for name, sd in ((TEMPERATURE, 5.0), (CALIBRATION, 0.02)):
        assert priors[name].mean_sd() == pytest.approx((0.0, sd))


def test_the_prior_of_a_material_has_none(tmp_path: Path) -> None:
    path = tmp_path / "priors.toml"
    tests = problem((5.0, None))
    save_priors(tests.priors[0], path)
    assert TEMPERATURE in tests.priors[0].free
    assert TEMPERATURE not in load_priors(path).priors
    table = (
        '[parameters.temperature_error]\nfamily = "fixed"\nvalue = 0\nunit = "K"\nsource = "x"\n'
    )
    path.write_text(path.read_text(encoding="utf-8") + table, encoding="utf-8")
    assert "file of a test" in refusal(path, load_priors)


def test_without_them_nothing_is_added() -> None:
    experiment = load_constant_rate(ICE / "PIL40.toml")
    alone = problem_of([experiment], default_priors("ice"))
    data = program_data(alone, solver=SolverOptions())
    assert data["n_coordinates"] == len(alone.free) == 12
    for name in (TEMPERATURE, CALIBRATION):
        k = PLACE[name] - 1
        assert data["prior_family"][0][k] == data["prior_location"][0][k] == 0


def test_priors_whose_dashpot_flows_far_from_the_data_are_told() -> None:
    """Q_M and beta of two flow laws: each number is likely, the stress is not."""
    ice, test = default_priors("ice"), load_constant_rate(ICE / "PIL40.toml")
    assert prior_doubts(ice, [test]) == ()
    for enthalpy in (40, 110):
        far = ice.with_(activation_enthalpy=normal(enthalpy, 0.2, "kJ/mol"))
        (said,) = prior_doubts(far, [test])
        assert said.startswith("PIL40: with these priors the dashpot flows at ")
        assert said.endswith("the data reach 8 MPa: check n, Q_M and beta together.")
    elastic = replace(test, strain=1e-4 * test.strain, stress=1e-2 * test.stress)
    slow = ice.with_(activation_enthalpy=normal(80, 0.2, "kJ/mol"))
    assert prior_doubts(slow, [elastic]) == ()


def test_tests_of_one_furnace_share_one_error() -> None:
    tests = problem((5.0, "big"), (3.0, "small"), (5.0, "big"))
    layout, i = tests.layout, tests.layout.names.index(TEMPERATURE)
    first, second, third = layout.position[:, i]
    assert first == third != second
    assert sorted({*layout.position.ravel(), *layout.centre, *layout.spread}) == list(
        range(layout.size)
    )
    assert tests.kind(TEMPERATURE) == "by apparatus"
    owners = [tests.owner(TEMPERATURE, e) for e in range(3)]
    assert owners == ["PIL40+PIL105", "PIL72", "PIL40+PIL105"]
    data = program_data(tests, solver=SolverOptions())
    counted = np.array(data["prior_family"])[:, PLACE[TEMPERATURE] - 1]
    assert counted.tolist() == [2, 2, 0]
    h = data["shared_parameter"].index(PLACE[TEMPERATURE])
    assert [row[h] for row in data["shared_from"]] == [1, 2, 1]
    drawn = [{p.name: float(e) for p in PROGRAM_PARAMETERS} for e in range(3)]
    assert [own[TEMPERATURE] for own in share_values(tests, drawn)] == [0.0, 1.0, 0.0]


def test_one_furnace_of_all_tests_and_none_named() -> None:
    common, own = problem((5.0, "big"), (5.0, "big")), problem((5.0, None), (5.0, None))
    assert TEMPERATURE in common.shared
    assert TEMPERATURE not in own.shared
    assert own.kind(TEMPERATURE) == "separate"
    assert own.layout.size == common.layout.size + 1
    left = problem((5.0, "big"), (5.0, "big")).without("PIL40")
    assert left.priors[0][TEMPERATURE].mean_sd() == pytest.approx((0.0, 5.0))


def test_joint_fits_ask_for_conditions_that_go_together() -> None:
    with pytest.raises(InputError, match="expected one number for the furnace 'big'"):
        problem((5.0, "big"), (4.0, "big"))
    known = load_constant_rate(ICE / "PIL72.toml")
    other = uncertain(load_constant_rate(ICE / "PIL40.toml"), 5.0, None)
    with pytest.raises(InputError, match="PIL72: key 'temperature_sd_K' is missing"):
        problem_of([other, known], default_priors("ice"), SEPARATE)
    with pytest.raises(InputError, match="furnace"):
        pooling_of({TEMPERATURE: "shared"})


def test_all_tests_state_an_environment_on_which_rates_depend() -> None:
    first, second = (load_constant_rate(ICE / f"{name}.toml") for name in ("PIL40", "PIL72"))
    first = replace(first, environment={"pressure": 2e8})
    priors = default_priors("ice")
    assert len(problem_of([first, second], priors, pooling_of()).experiments) == 2
    depend = priors.with_(activation_volume=normal(-13.0, 3.0, "cm3/mol"))
    with pytest.raises(InputError, match=r"PIL72: key 'pressure_Pa' is missing, .* PIL40"):
        problem_of([first, second], depend, pooling_of())
    both = [first, replace(second, environment={"pressure": 0.0})]
    assert len(problem_of(both, depend, pooling_of()).experiments) == 2


def test_tests_of_two_protocols_keep_their_conditions() -> None:
    history = CONSTANT_RATE.as_history(load_constant_rate(ICE / "PIL40.toml"))
    tests = [
        replace(test, uncertain=(UncertainCondition(TEMPERATURE, 5.0, "big"),))
        for test in (history, load_constant_rate(ICE / "PIL72.toml"))
    ]
    joint = problem_of(tests, default_priors("ice"), pooling_of())
    assert TEMPERATURE in joint.shared
    assert [one.protocol for one in joint.experiments] == ["loading_history"] * 2
