"""Variants by name: what they do to the priors, what is refused, what a run keeps of them."""

import json
import math
import tomllib
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest
import tomli_w
import xarray as xr
from conftest import ICE, SMALL_RUN, Problem, fixed, with_fixed
from history_twins import BACKSTRESS, DISLOCATIONS, SECOND, THIRD, TRUTH, history_twin
from history_twins import PIEZOMETER as FOLLOWED
from linear_priors import flow_law
from scipy import stats
from stan_data import one_test_data

from pyburgers.checks.description import check_coverage
from pyburgers.checks.fit_checks import CheckedDraws
from pyburgers.common.errors import InputError
from pyburgers.comparison.by_points import compare, leave_one_out, leave_out_exactly
from pyburgers.comparison.conclusions import comparison_table
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment, RateSegment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.forward import simulate, simulate_data
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.flow_law_prior import Conditions
from pyburgers.model.laws import KELVIN_LAWS, KelvinLaw
from pyburgers.model.parameters import (
    ALL_ENVIRONMENT_NUMBERS,
    MATERIAL_PARAMETERS,
    PARAMETERS,
    PIEZOMETER,
    PROGRAM_PARAMETERS,
    STANDARD_VALUES,
)
from pyburgers.model.prior_families import priors_of_freed_parameters
from pyburgers.model.priors import (
    PriorSet,
    default_priors,
    load_priors,
    save_priors,
    with_flow_law,
)
from pyburgers.model.variants import (
    CHOICES,
    ModelVariant,
    check_variant,
    parse_choices,
    variant_of,
    with_variant,
)
from pyburgers.posterior.labelled_draws import CORRELATED

FloatArray = npt.NDArray[np.float64]

OLIVINE = Path(__file__).parents[2] / "data" / "olivine" / "olivine_twin.toml"

PIEZOMETER_OF_ICE = {name: FOLLOWED[name] for name in PIEZOMETER}

EVERY_CHOICE = {
    "kelvin": "power_law",
    "maxwell": "linear",
    "grain_size": "constant",
    "fabric": "constant",
    "residuals": "autocorrelated",
    "hardening": "none",
    "second_mechanism": "none",
    "third_mechanism": "none",
}


@pytest.fixture(scope="module")
def ice() -> ConstantRateExperiment:
    return load_constant_rate(ICE / "PIL40.toml")


@pytest.fixture(scope="module")
def history() -> HistoryExperiment:
    return history_twin("mixed", 16)


@pytest.fixture(scope="module")
def priors() -> PriorSet:
    return default_priors("ice")


def test_no_choice_changes_nothing(ice: ConstantRateExperiment, priors: PriorSet) -> None:
    assert with_variant(priors, ice, {}) is priors
    assert variant_of(priors, ice) == ModelVariant()
    standard = ModelVariant().record()
    assert with_variant(priors, ice, standard) == priors
    assert ModelVariant().short_text == "standard"
    data = one_test_data(ice, priors.resolved(1e7), solver=SolverOptions())
    (family,), (location,) = data["prior_family"], data["prior_location"]
    assert family[len(PARAMETERS) :] == [0] * len(STANDARD_VALUES)
    assert location[len(PARAMETERS) :] == list(STANDARD_VALUES.values())
    assert max(data["own_parameter"]) == len(PARAMETERS)


@pytest.mark.parametrize(
    ("argument", "wrong"),
    [("priors", "ice"), ("experiment", None), ("choices", "kelvin=power_law")],
)
def test_an_argument_of_another_type_is_refused(
    argument: str, wrong: Any, ice: ConstantRateExperiment, priors: PriorSet
) -> None:
    arguments: dict[str, Any] = {"priors": priors, "experiment": ice, "choices": {}}
    with pytest.raises(InputError, match=f"^{argument}: found .*, expected"):
        with_variant(**arguments | {argument: wrong})


REVERSIBLE: Mapping[str, tuple[str, ...]] = {
    "kelvin": tuple(law for law in CHOICES["kelvin"] if law != "andrade"),
    "maxwell": tuple(law for law in CHOICES["maxwell"] if law != "linear"),
    **{
        part: CHOICES[part]
        for part in ("residuals", "hardening", "second_mechanism", "third_mechanism")
    },
}
"""Laws that leave the priors of the others as they are."""


@pytest.mark.parametrize(("part", "law"), [(k, law) for k, laws in CHOICES.items() for law in laws])
def test_a_choice_changes_its_part_alone_and_gives_way_to_another(
    part: str, law: str, ice: ConstantRateExperiment, priors: PriorSet, history: HistoryExperiment
) -> None:
    own = with_fixed(priors, PIEZOMETER_OF_ICE)
    if part == "third_mechanism":
        own = with_variant(own, ice, {"second_mechanism": "power_law"})
    for test in (ice, history):
        changed = with_variant(own, test, {part: law})
        found = variant_of(changed, test)
        assert found.record() == variant_of(own, test).record() | {part: law}
        assert (f"{part}={law}" in found.short_text) is (law != CHOICES[part][0])
        assert with_variant(changed, test, {part: law}) == changed
        if law not in REVERSIBLE.get(part, ()):
            continue
        for other in CHOICES[part]:
            another = with_variant(changed, test, {part: other})
            assert variant_of(another, test).record() == found.record() | {part: other}
            assert another.free == with_variant(own, test, {part: other}).free
            if other in REVERSIBLE[part]:
                again = with_variant(another, test, {part: law})
                assert again.free == changed.free
                assert again == changed or not (part.endswith("mechanism") and law != "none")


def test_all_choices_survive_a_prior_file(
    ice: ConstantRateExperiment, priors: PriorSet, tmp_path: Path
) -> None:
    changed = with_variant(priors, ice, EVERY_CHOICE)
    save_priors(changed, tmp_path / "priors.toml")
    again = load_priors(tmp_path / "priors.toml")
    assert again == changed
    assert variant_of(again, ice).record() == EVERY_CHOICE
    assert with_variant(again, ice, EVERY_CHOICE) == again
    for line in ("Kelvin part power law", "fabric constant", "residuals autocorrelated"):
        assert line in variant_of(again, ice).text


@pytest.mark.parametrize("law", [law for law in KELVIN_LAWS.values() if law.times])
def test_laws_with_many_relaxation_times_free_their_parameters(
    ice: ConstantRateExperiment, priors: PriorSet, law: KelvinLaw
) -> None:
    changed = with_variant(priors, ice, {"kelvin": law.name})
    assert set(changed.free) - set(priors.free) == {*law.parameters}
    # For what viscosity and times are given:
    assert changed["kelvin_reference_temperature"].location == ice.temperature
    assert changed["kelvin_reference_grain_size"].location == ice.initial_grain_size
    # The modulus of Andrade creep is a convention.
    assert set(priors.free) - set(changed.free) == {*law.conventions}


def test_one_law_of_the_kelvin_part_takes_the_place_of_another(
    ice: ConstantRateExperiment, priors: PriorSet
) -> None:
    peak = with_variant(priors, ice, {"kelvin": "extended_peak"})
    band = with_variant(peak, ice, {"kelvin": "extended"})
    assert band["relaxation_exponent"] == peak["relaxation_exponent"]
    creep = with_variant(priors, ice, {"kelvin": "andrade"})
    with pytest.raises(InputError, match="needs a prior of kelvin_modulus, which is fixed"):
        with_variant(creep, ice, {"kelvin": "linear"})


def test_laws_of_the_kelvin_part_are_refused_where_they_cannot_be_solved(
    ice: ConstantRateExperiment, priors: PriorSet
) -> None:
    message = "kelvin=extended is not for tests of the protocol forced_oscillation, expected linear"
    with pytest.raises(InputError, match=message):
        with_variant(default_priors("olivine"), load_experiment(OLIVINE), {"kelvin": "extended"})
    two = with_variant(priors, ice, {"kelvin": "power_law"}).exchanging(
        with_variant(priors, ice, {"kelvin": "andrade"})["andrade_exponent"]
    )
    with pytest.raises(InputError, match="expected one law of the Kelvin part"):
        check_variant(two, ice)


def test_the_viscosity_of_a_power_law_kelvin_dashpot_is_given_at_the_test(
    ice: ConstantRateExperiment, priors: PriorSet
) -> None:
    changed = with_variant(priors, ice, {"kelvin": "power_law"})
    assert changed["kelvin_reference_stress"].location == 2e6  # 8.1 MPa / 4
    assert changed["kelvin_reference_temperature"].location == ice.temperature
    assert changed["kelvin_stress_exponent"].lower == 1.0
    assert with_variant(changed, ice, {"kelvin": "linear"})["kelvin_stress_exponent"].is_fixed


def test_constant_microstructure_is_that_of_the_start(
    ice: ConstantRateExperiment, priors: PriorSet
) -> None:
    changed = with_variant(priors, ice, {"grain_size": "constant", "fabric": "constant"})
    assert changed["steady_state_grain_size"].location == ice.initial_grain_size
    assert changed["steady_state_fabric_factor"].location == 1.0
    assert set(priors.free) - set(changed.free) == {
        "steady_state_grain_size",
        "steady_state_fabric_factor",
        "critical_strain_grain_size",
        "critical_strain_fabric",
    }


def test_grain_size_may_follow_the_piezometer_of_the_material(
    ice: ConstantRateExperiment, priors: PriorSet
) -> None:
    with pytest.raises(InputError, match="needs a piezometer, found none in the priors 'Ice"):
        with_variant(priors, ice, {"grain_size": "piezometric"})
    own = with_fixed(priors, PIEZOMETER_OF_ICE)
    assert variant_of(own, ice).grain_size == "evolving"
    changed = with_variant(own, ice, {"grain_size": "piezometric"})
    assert variant_of(changed, ice).short_text == "grain_size=piezometric"
    assert {name: changed[name].location for name in PIEZOMETER} == PIEZOMETER_OF_ICE
    assert set(priors.free) - set(changed.free) == {"steady_state_grain_size"}
    constant = with_variant(changed, ice, {"grain_size": "constant"})
    assert variant_of(constant, ice).grain_size == "constant"


def test_a_piezometer_that_is_not_followed_is_not_in_the_data(
    ice: ConstantRateExperiment, priors: PriorSet
) -> None:
    own = with_fixed(priors, PIEZOMETER_OF_ICE)
    place = [p.name for p in PROGRAM_PARAMETERS].index(PIEZOMETER[0])
    for law, size in (("evolving", 0.0), ("piezometric", 2e-3), ("constant", 0.0)):
        chosen = with_variant(own, ice, {"grain_size": law}).resolved(1e7)
        data = one_test_data(ice, chosen, solver=SolverOptions())
        assert data["prior_location"][0][place] == size


def test_materials_of_olivine_rock_have_its_piezometer(ice: ConstantRateExperiment) -> None:
    for material in ("olivine", "dunite"):
        own = default_priors(material)
        assert [own[name].location for name in PIEZOMETER] == [0.015, 1.33, 1e6]
        assert variant_of(own, ice).grain_size == "evolving"


def test_an_oscillation_of_a_material_without_piezometer_is_refused() -> None:
    twin = load_experiment(OLIVINE)
    none = with_fixed(default_priors("olivine"), {PIEZOMETER[0]: 0.0})
    sentence = "olivine_twin: .*follows a piezometer, found none.*expected piezometer_reference"
    with pytest.raises(InputError, match=sentence):
        check_variant(none, twin)
    check_variant(with_variant(none, twin, {"grain_size": "constant"}), twin)
    assert twin.true_parameters is not None
    values = {k: v for k, v in twin.true_parameters.items() if k not in PIEZOMETER}
    with pytest.raises(InputError, match="follows a piezometer, found none"):
        simulate(twin, values)


def test_a_linear_maxwell_dashpot_has_no_place_for_a_joint_flow_law(
    ice: ConstantRateExperiment, priors: PriorSet
) -> None:
    at = Conditions(260.0, 5e6, 2e-4)
    source = flow_law([3.8, 0.5, -9.0, -7.29e-4], [0.3, 0.3, 0.3, 1e-6], at)
    joint = with_flow_law(priors, source, "here")
    with pytest.raises(InputError, match="maxwell=linear fixes the stress exponent"):
        with_variant(joint, ice, {"maxwell": "linear"})
    assert with_variant(joint, ice, {"maxwell": "power_law"}) is joint


def test_a_linear_maxwell_dashpot_keeps_the_prior_of_its_rate_at_the_largest_stress(
    ice: ConstantRateExperiment, priors: PriorSet
) -> None:
    changed = with_variant(priors, ice, {"maxwell": "linear"})
    log_stress = math.log(np.abs(ice.stress).max())
    inverse_rt = 1 / (8.314462618 * ice.temperature)
    rng = np.random.default_rng(3)

    def log_rate(priors: PriorSet) -> FloatArray:
        exponent, enthalpy, beta = (
            np.full(4000, prior.location)
            if prior.is_fixed
            else prior.distribution().rvs(4000, random_state=rng)
            for prior in (
                priors[name] for name in ("stress_exponent", "activation_enthalpy", "beta")
            )
        )
        return np.asarray(exponent * log_stress + enthalpy * (beta - inverse_rt))

    linear, power_law = log_rate(changed), log_rate(priors)
    assert linear.mean() == pytest.approx(power_law.mean(), abs=0.05 * power_law.std())
    assert linear.std() == pytest.approx(power_law.std(), rel=0.2)


def test_oscillating_tests_follow_a_piezometer_and_have_no_fabric() -> None:
    twin, priors = load_experiment(OLIVINE), default_priors("olivine")
    found = variant_of(priors, twin)
    assert (found.grain_size, found.fabric) == ("piezometric", "constant")
    frozen = with_variant(priors, twin, {"grain_size": "constant", "kelvin": "power_law"})
    assert variant_of(frozen, twin).short_text == (
        "kelvin=power_law grain_size=constant fabric=constant"
    )
    with pytest.raises(InputError, match=r"fabric=evolving does not go with .* forced_oscillation"):
        with_variant(priors, twin, {"fabric": "evolving"})
    with pytest.raises(InputError, match="residuals=autocorrelated is for tests of the protocol"):
        with_variant(priors, twin, {"residuals": "autocorrelated"})


def test_a_part_has_one_law() -> None:
    assert parse_choices(["kelvin=power_law", "fabric=constant"]) == {
        "kelvin": "power_law",
        "fabric": "constant",
    }
    with pytest.raises(InputError, match="a second choice for kelvin"):
        parse_choices(["kelvin=power_law", "kelvin=linear"])
    assert set(CHOICES) == set(EVERY_CHOICE)


def test_priors_without_a_law_cannot_follow_it(
    ice: ConstantRateExperiment, priors: PriorSet
) -> None:
    linear = with_fixed(priors, {"stress_exponent": 1.0})
    with pytest.raises(InputError, match=r"maxwell=power_law does not go .*\(maxwell is linear"):
        with_variant(linear, ice, {"maxwell": "power_law"})
    constant = with_variant(priors, ice, {"fabric": "constant"})
    with pytest.raises(InputError, match=r"fabric=evolving does not go .*\(fabric is constant"):
        with_variant(constant, ice, {"fabric": "evolving"})


def test_two_readings_at_one_strain_correlate_in_part(
    ice: ConstantRateExperiment, priors: PriorSet
) -> None:
    strain = ice.strain.copy()
    strain[4] = strain[3]
    twice = replace(ice, strain=strain)
    changed = with_variant(priors, twice, {"residuals": "autocorrelated"})
    assert {"residual_correlation_strain", "residual_correlated_share"} <= set(changed.free)
    wholly = with_fixed(changed, {"residual_correlated_share": 1.0})
    check_variant(wholly, ice)
    with pytest.raises(InputError, match="need points at different strains, found two at"):
        check_variant(wholly, twice)


VARIANT_TABLES = {
    "kelvin_activation_enthalpy": '"normal"\nlocation = 60\nscale = 5\nlower = 0\nunit = "kJ/mol"',
    "residual_correlation_strain": '"lognormal"\nlocation = 1.0\nscale = 1.0\nunit = "percent"',
    "piezometer_reference_grain_size": '"fixed"\nvalue = 2.0\nunit = "mm"',
}
IN_FILES = [p.name for p in MATERIAL_PARAMETERS if p.name not in ALL_ENVIRONMENT_NUMBERS]


def prior_file(folder: Path, changed: Mapping[str, str | None]) -> Path:
    """Write every parameter of variants: weak priors, standard values, `VARIANT_TABLES`."""
    ice, standard = default_priors("ice"), {k: fixed(k, v) for k, v in STANDARD_VALUES.items()}
    priors = {**standard, **priors_of_freed_parameters(), **ice.priors}
    every = replace(ice, priors={name: priors[name] for name in IN_FILES})
    path = folder / "priors.toml"
    save_priors(every, path)
    table = tomllib.loads(path.read_text(encoding="utf-8"))
    for name, text in {**VARIANT_TABLES, **changed}.items():
        del table["parameters"][name]
        if text is not None:
            own = tomllib.loads(f'family = {text}\nsource = "test"')
            table["parameters"][name] = own
    path.write_text(tomli_w.dumps(table), encoding="utf-8")
    return path


def test_prior_files_may_name_the_parameters_of_variants(tmp_path: Path) -> None:
    priors = load_priors(prior_file(tmp_path, {}))
    assert list(priors.priors) == IN_FILES
    assert priors["kelvin_activation_enthalpy"].location == 60e3
    assert priors["residual_correlation_strain"].location == 0.01


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"kelvin_reference_stress": None}, r"\[parameters.kelvin_reference_stress\] is missing"),
        ({"kelvin_reference_temperature": None}, "because kelvin_activation_enthalpy is not fixed"),
        ({"piezometer_exponent": None}, r"\[parameters.piezometer_exponent\] is missing"),
        (
            {"kelvin_reference_stress": '"uniform"\nlower = 1.0\nupper = 2.0\nunit = "MPa"'},
            "found 'uniform', expected 'fixed'",
        ),
        (
            {"kelvin_stress_exponent": '"uniform"\nlower = 0.5\nupper = 5.0\nunit = "1"'},
            "key 'lower': found 0.5, expected at least 1",
        ),
        ({"kelvin_stress_exponent": '"fixed"\nvalue = 0.9\nunit = "1"'}, "key 'value': found 0.9"),
        (
            {"relaxation_exponent": '"uniform"\nlower = 0.1\nupper = 1.0\nunit = "1"'},
            "key 'upper': found 1, expected less than 1",
        ),
        ({"peak_width": None}, r"\[parameters.peak_width\] is missing"),
        ({"relaxation_exponent": None}, "because relaxation_time_decades is not fixed"),
        (
            {"recovery_exponent": '"fixed"\nvalue = 0.9\nunit = "1"'},
            "key 'value': found 0.9, expected at least 1",
        ),
        (
            {"second_rate": '"lognormal"\nlocation = 1e-6\nscale = 1\nunit = "1/s"'}
            | {"mechanism_reference_stress": None},
            r"\[parameters.mechanism_reference_stress\] is missing",
        ),
    ],
)
def test_wrong_tables_are_named(
    changed: dict[str, str | None], message: str, tmp_path: Path
) -> None:
    with pytest.raises(InputError, match=message):
        load_priors(prior_file(tmp_path, changed))


@pytest.mark.parametrize(
    ("given", "message"),
    [
        ({"kelvin_stress_exponent": 3.0}, "'kelvin_reference_stress' is missing, expected it"),
        ({"kelvin_stress_exponent": 0.5}, r"kelvin_stress_exponent is 0\.5, expected at least 1\."),
        (
            {**SECOND, "second_stress_exponent": 0.9},
            r"second_stress_exponent is 0\.9, expected at least 1",
        ),
        (
            {**BACKSTRESS, "recovery_exponent": 0.9},
            r"recovery_exponent is 0\.9, expected at least 1",
        ),
        ({**THIRD, "second_rate": 0.0}, "without a second mechanism"),
        (
            {**SECOND, **BACKSTRESS, "second_in_series": 1.0},
            "can turn the flow of the first mechanism against",
        ),
        *(
            ({**DISLOCATIONS, name: 0.0}, f"found {name} fixed at 0 beside a reference_backstress")
            for name in ("hardening_modulus", "initial_backstress")
        ),
    ],
)
def test_given_parameters_are_checked(given: Mapping[str, float], message: str) -> None:
    with pytest.raises(InputError, match=message):
        simulate(history_twin("creep", 4), {**TRUTH, **given})


def test_simulated_residuals_are_correlated(programs: None, ice: ConstantRateExperiment) -> None:
    truth = ice.true_parameters
    assert truth is not None
    correlated = dict(truth) | {"residual_correlation_strain": 0.02}
    clean = simulate(ice, truth, at=ice.strain)["stress_Pa"].to_numpy()
    dense = np.exp(-np.abs(ice.strain[:, None] - ice.strain) / 0.02)
    whitened = []
    for seed in range(40):
        data = simulate_data(ice, correlated, np.random.default_rng(seed), source="test")
        residual = (data.stress - clean) / truth["stress_noise"]
        whitened.append(np.linalg.solve(np.linalg.cholesky(dense), residual))
    assert stats.kstest(np.ravel(whitened), "norm").pvalue > 1e-3


@pytest.mark.slow
def test_simulated_residuals_start_anew_at_a_step(
    programs: None, ice: ConstantRateExperiment
) -> None:
    """Two readings at the strain of the step lie on its two sides."""
    truth = ice.true_parameters
    assert truth is not None
    strain = np.array([0.02, 0.03, 0.03, 0.03, 0.04])
    stepped = replace(
        ice,
        segments=(RateSegment(0.0, 1e-4), RateSegment(0.03, 1e-5)),
        strain=strain,
        stress=np.zeros(5),
    )
    assert stepped.reading_segment.tolist() == [0, 0, 1, 1, 1]
    values = dict(truth) | {"residual_correlation_strain": 0.05, "residual_correlated_share": 0.8}
    clean = simulate(stepped, truth, at=strain)["stress_Pa"].to_numpy()[[0, 1, 1, 1, 2]]
    residual = np.stack(
        [
            simulate_data(stepped, values, np.random.default_rng(seed), source="test").stress
            for seed in range(300)
        ]
    )
    found = np.cov((residual - clean).T / truth["stress_noise"])
    distance = np.abs(strain[:, None] - strain)
    together = np.equal.outer([0, 0, 1, 1, 1], [0, 0, 1, 1, 1])
    expected = 0.8 * np.exp(-distance / 0.05) * together + 0.2 * np.eye(5)
    np.testing.assert_allclose(found, expected, atol=5 / np.sqrt(150))


@pytest.fixture(scope="module")
def correlated_fit(
    programs: None, small_problem: Problem, tmp_path_factory: pytest.TempPathFactory
) -> Fit:
    """The small problem with residuals that correlate, fitted as such."""
    experiment, rng = small_problem.experiment, np.random.default_rng(5)
    assert experiment.true_parameters is not None
    truth = dict(experiment.true_parameters) | {"residual_correlation_strain": 0.005}
    data = simulate_data(experiment, truth, rng, source="test")
    priors = with_variant(small_problem.priors, data, {"residuals": "autocorrelated"})
    out = tmp_path_factory.mktemp("correlated") / "run"
    return fit(data, priors, out=out, options=SMALL_RUN)


def dataset(result: Fit, group: str) -> xr.Dataset:
    return result.posterior[group].to_dataset()


def test_a_run_keeps_its_variant(correlated_fit: Fit) -> None:
    loaded = Fit.load(correlated_fit.directory.path)
    assert loaded.variant.short_text == "residuals=autocorrelated"
    manifest = json.loads(loaded.directory.manifest_file.read_text(encoding="utf-8"))
    assert manifest["variant"] == loaded.variant.record()
    assert "residual_correlation_strain" in loaded.summary("SI").index


def test_leave_one_out_uses_the_density_given_all_others(correlated_fit: Fit) -> None:
    """Of the residuals of one draw: what the fit kept, against a dense precision matrix."""
    experiment = correlated_fit.experiment
    assert isinstance(experiment, ConstantRateExperiment)
    draws = dataset(correlated_fit, "posterior").isel(chain=0, draw=3)
    values = {name: float(draws[name]) for name in correlated_fit.priors.priors}
    tolerance = correlated_fit.manifest["solver"]["tolerance"]
    solution = simulate(
        experiment, values, at=experiment.strain, solver=SolverOptions(tolerance=tolerance)
    )
    residual = experiment.stress - solution["stress_Pa"].to_numpy()
    distance = np.abs(experiment.strain[:, None] - experiment.strain)
    correlation = np.exp(-distance / values["residual_correlation_strain"])
    share = values["residual_correlated_share"]
    assert 0 < share < 1
    covariance = values["stress_noise"] ** 2 * (
        share * correlation + (1 - share) * np.eye(residual.size)
    )
    precision = np.linalg.inv(covariance)
    sd = np.diag(precision) ** -0.5
    given_others = stats.norm.logpdf(precision @ residual * sd**2, 0.0, sd)
    kept = dataset(correlated_fit, CORRELATED)["stress"].isel(chain=0, draw=3)
    np.testing.assert_allclose(kept, given_others, atol=1e-3)
    before = dataset(correlated_fit, "log_likelihood")["stress"].isel(chain=0, draw=3)
    joint = stats.multivariate_normal.logpdf(residual, np.zeros(residual.size), covariance)
    assert float(before.sum()) == pytest.approx(joint, abs=1e-2)


def test_the_fit_that_knows_of_the_correlation_predicts_better(
    correlated_fit: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    independent = fit(
        correlated_fit.experiment, small_problem.priors, out=tmp_path / "run", options=SMALL_RUN
    )
    comparison = compare({"plain": independent, "correlated": correlated_fit})
    table = comparison_table(comparison)
    assert table.index[0] == "correlated"
    assert table["variant"].to_dict() == {
        "correlated": "residuals=autocorrelated",
        "plain": "standard",
    }


def test_leaving_a_point_out_in_earnest_agrees_with_the_conditional_density(
    correlated_fit: Fit, tmp_path: Path
) -> None:
    approximate = leave_one_out(correlated_fit.posterior)
    assert CORRELATED in correlated_fit.posterior.children
    point = correlated_fit.experiment.n_points // 2
    assert approximate.pareto_k[point] < 0.7
    exact = leave_out_exactly(correlated_fit, approximate, [point], tmp_path / "refits")
    assert exact.elpd[point] == pytest.approx(approximate.elpd[point], abs=0.3)


def test_correlated_residuals_of_a_right_model_pass(correlated_fit: Fit) -> None:
    """Fitted replicates have a noise of their own, which takes runs outside the band with it."""
    coverage = check_coverage(CheckedDraws(correlated_fit.posterior))
    assert coverage.table["found"].item() <= coverage.table["at_most"].item()
    assert coverage.passed
