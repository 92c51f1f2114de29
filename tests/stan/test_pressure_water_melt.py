"""Flow by pressure, water and melt: limits, gradients, tables, predictions, files, refusals."""

from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import oracle
import pytest
from conftest import ICE, TABLE_RUN, Problem
from evaluated_laws import names_of, value_of
from history_twins import BACKSTRESS, GRAIN_SIZE, SECOND, TEMPERATURE, THIRD, TRUTH, history_twin
from ice_spectrum import ice_spectrum
from log_density import assert_gradient_along
from rate_oracle import GAS_CONSTANT
from table_ranks import conditions

from pyburgers import (
    Regime,
    attenuation_spectrum,
    fixed,
    flow_rate,
    load_experiment,
    normal,
    rate_law,
)
from pyburgers.checks.fit_checks import Outcome
from pyburgers.common.errors import InputError
from pyburgers.fitting.new_test import parameters_for_other_test
from pyburgers.flow_law_tables.fit_rates import fit_rates
from pyburgers.flow_law_tables.hand_over import mechanism_priors
from pyburgers.flow_law_tables.laws import load_rate_law
from pyburgers.flow_law_tables.program_data import usable_rows
from pyburgers.flow_law_tables.table_files import load_rate_table, save_rate_table
from pyburgers.flow_law_tables.tables import RateTable
from pyburgers.kinds.conditions import outside
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forced_oscillation.experiment import with_background
from pyburgers.kinds.forced_oscillation.files import load_forced_oscillation
from pyburgers.kinds.forward import simulate, with_stated
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import given_parameters
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.parameters import (
    ALL_ENVIRONMENT_NUMBERS,
    ENVIRONMENT,
    PARAMETER_BY_NAME,
    STANDARD_VALUES,
)
from pyburgers.model.priors import default_priors
from pyburgers.model.variants import variant_of
from pyburgers.predictions.stated_laws import composite_law, laws_of

pytestmark = pytest.mark.usefixtures("programs")

EXACT = SolverOptions(tolerance=1e-12, max_num_steps=10_000_000)
PLACE = {"pressure": 3e8, "water_fugacity": 2e8, "melt_fraction": 0.02}
NUMBERS = {
    "activation_volume": 1.5e-5,
    "water_exponent": 0.3,
    "melt_factor": 30.0,
    "kelvin_activation_volume": 6e-6,
    "kelvin_water_exponent": 0.25,
    "kelvin_melt_factor": 15.0,
}
SECOND_NUMBERS = {
    "second_activation_volume": -4e-6,
    "second_water_exponent": 0.2,
    "second_melt_factor": 20.0,
}
HARDENING = {
    **BACKSTRESS,
    "recovery_activation_volume": 1.1e-5,
    "recovery_water_exponent": 0.15,
    "recovery_melt_factor": -12.0,
}
THREE = {
    **THIRD,
    **SECOND_NUMBERS,
    "third_activation_volume": 9e-6,
    "third_water_exponent": -0.1,
    "third_melt_factor": 10.0,
    "third_in_series": 1.0,
}


def without_environment(values: Mapping[str, float]) -> dict[str, float]:
    """The same laws at `PLACE`, with other enthalpies and factors in its stead."""
    fugacity = PLACE["water_fugacity"] / 1e6
    changed = {**values}
    enthalpy = values["activation_enthalpy"] + PLACE["pressure"] * values["activation_volume"]
    log_factor = (
        values["beta"] * values["activation_enthalpy"]
        + values["water_exponent"] * np.log(fugacity)
        + values["melt_factor"] * PLACE["melt_fraction"]
    )
    changed |= {"activation_enthalpy": enthalpy, "beta": log_factor / enthalpy}
    for which, number, reference in (
        ("second", "second_rate", "mechanism_reference_temperature"),
        ("third", "third_rate", "mechanism_reference_temperature"),
        ("kelvin", "kelvin_viscosity", "kelvin_reference_temperature"),
        ("recovery", "recovery_rate", "kelvin_reference_temperature"),
    ):
        if f"{which}_activation_volume" not in values:
            continue
        more = PLACE["pressure"] * values[f"{which}_activation_volume"]
        own = f"{which}_activation_enthalpy"
        changed[own] = values.get(own, 0.0) + more
        changed.setdefault(reference, STANDARD_VALUES[reference])
        log_factor = (
            values[f"{which}_water_exponent"] * np.log(fugacity)
            + values[f"{which}_melt_factor"] * PLACE["melt_fraction"]
            - more / (GAS_CONSTANT * changed[reference])
        )
        changed[number] *= np.exp(-log_factor if which == "kelvin" else log_factor)
    return {
        name: value
        for name, value in changed.items()
        if name not in ALL_ENVIRONMENT_NUMBERS and name not in ENVIRONMENT
    }


def assert_same(test: Experiment, values: Mapping[str, float], columns: tuple[str, ...]) -> None:
    placed = replace(test, environment=PLACE)
    found = simulate(placed, values, solver=EXACT)
    expected = simulate(test, without_environment(values), solver=EXACT)
    alone = simulate(test, values, solver=EXACT)
    differs = False
    for column in columns:
        scale = np.abs(expected[column]).max()
        np.testing.assert_allclose(found[column], expected[column], rtol=0, atol=1e-8 * scale)
        differs |= bool(np.abs(alone[column] - expected[column]).max() > 1e-3 * scale)
    assert differs


@pytest.mark.parametrize(
    "others",
    [
        {},
        {**SECOND, **SECOND_NUMBERS},
        THREE,
        HARDENING,
        {"relaxation_time_decades": 3.0, "relaxation_exponent": 0.4},
    ],
    ids=["one", "two", "three", "backstress", "a band of times"],
)
@pytest.mark.parametrize("name", ["load and unload", "mixed"])
def test_a_history_is_that_of_other_enthalpies_and_factors(
    name: str, others: Mapping[str, float]
) -> None:
    assert_same(history_twin(name, 30), {**TRUTH, **NUMBERS, **others}, ("stress_Pa", "strain"))


def test_other_kinds_are_too(tmp_path: Path) -> None:
    values = {**TRUTH, **NUMBERS}
    assert_same(load_experiment(ICE / "PIL40.toml"), values, ("stress_Pa",))
    both = {**values, **SECOND, **SECOND_NUMBERS}
    linear = {"stress_exponent": 1.0, "second_stress_exponent": 1.0}
    linear |= {"third_stress_exponent": 1.0, "third_in_series": 0.0}
    for some in (both, {**values, **THREE}):
        assert_same(ice_spectrum(tmp_path), {**some, **linear, "beta": -1.5e-4}, ("log_reading",))
    olivine = load_forced_oscillation(ICE.parent / "olivine" / "olivine_twin.toml")
    assert olivine.true_parameters is not None
    frozen = {**olivine.true_parameters, **NUMBERS, "critical_strain_grain_size": 1e9}
    assert_same(with_background(olivine, "removed"), frozen, ("stress_Pa",))


def test_the_flow_rate_the_spectrum_and_the_exported_laws_are_too() -> None:
    values = {**TRUTH, **NUMBERS, **SECOND, **SECOND_NUMBERS, **PLACE}
    plain = without_environment(values)
    at = {"temperature": TEMPERATURE, "grain_size": GRAIN_SIZE}
    expected = flow_rate(plain, 5e6, **at)
    np.testing.assert_allclose(flow_rate(values, 5e6, **at), expected, rtol=1e-10)
    loss, lost = (
        attenuation_spectrum(
            one, [1e-3], [Regime(2e6, 1e6)], temperature=TEMPERATURE, grain_size=GRAIN_SIZE
        )["loss_compliance"]
        for one in (values, plain)
    )
    np.testing.assert_allclose(loss, lost, rtol=1e-9)
    laws = laws_of(given_parameters("ice", values), history_twin("creep", 4))
    names = names_of(values, **at, fabric_factor=1.0, stress=5e6)
    mechanisms = laws["mechanisms"]
    assert isinstance(mechanisms, dict)
    rates = {name: value_of(law, names) for name, law in mechanisms.items()}
    assert value_of(str(laws["flow_law"]), rates) == pytest.approx(float(expected), rel=1e-9)


def test_exported_laws_of_kelvin_part_and_recovery_are_too() -> None:
    hardened = {**TRUTH, **NUMBERS, **HARDENING, **PLACE}
    laws = laws_of(given_parameters("ice", hardened), history_twin("creep", 4))
    state = {"R": GAS_CONSTANT, "temperature": TEMPERATURE, "stress": 5e6, "kelvin_strain": 1e-4}
    state |= {"strain_rate": 3e-5, "backstress": 2e6}
    rate = value_of(str(laws["kelvin_law"]), {**hardened, **state})
    stored = value_of(str(laws["hardening_law"]), {**hardened, **state})
    plain = without_environment(hardened)
    assert rate == pytest.approx(oracle.kelvin_rate(plain, TEMPERATURE, 5e6, 1e-4), rel=1e-9)
    expected_rate = oracle.backstress_rate(plain, TEMPERATURE, 2e6, 3e-5, GRAIN_SIZE)
    assert stored == pytest.approx(expected_rate, rel=1e-9)


def test_gradients_are_slopes_of_the_density(tmp_path: Path) -> None:
    test = replace(history_twin("mixed", 16), environment=PLACE)
    recovery = {name: HARDENING[name] for name in HARDENING if name in ALL_ENVIRONMENT_NUMBERS}
    values = {**NUMBERS, **SECOND_NUMBERS, **recovery}
    free = {
        name: normal(value, abs(value) / 4, PARAMETER_BY_NAME[name].si_unit)
        for name, value in values.items()
    }
    held = {
        name: fixed(value, PARAMETER_BY_NAME[name].si_unit)
        for name, value in {**SECOND, **HARDENING}.items()
        if name not in recovery
    }
    problem = problem_of([test], default_priors("ice").with_(**free, **held))
    assert problem.priors[0]["pressure"].location == PLACE["pressure"]
    assert_gradient_along(problem, values, tmp_path)


TRUE_TABLE = {
    "activation_volume[diffusion]": 8e-6,
    "water_exponent[diffusion]": 0.9,
    "melt_factor[diffusion]": 26.0,
    "activation_volume[dislocation]": 15e-6,
    "water_exponent[dislocation]": 1.3,
    "melt_factor[dislocation]": 40.0,
}


def wet_table() -> RateTable:
    """Rates of wet olivine, solved in NumPy, with a scatter of a tenth."""
    law, data = rate_law("olivine_wet"), conditions("olivine_wet")
    values = {name: prior.location for name, prior in law.priors.priors.items()} | TRUE_TABLE
    rate = np.zeros(data.n_rows)
    for mechanism in law.mechanisms:
        own = {k.split("[")[0]: v for k, v in values.items() if f"[{mechanism.name}]" in k}
        slower = 1 / data.temperature - 1 / law.reference.temperature
        rate += (
            own["mechanism_rate"]
            * (data.stress / law.reference.stress) ** own["stress_exponent"]
            * (data.grain_size / law.reference.grain_size) ** -own["grain_size_exponent"]
            * np.exp(-own["activation_enthalpy"] * slower / GAS_CONSTANT)
            * np.exp(-data.pressure * own["activation_volume"] / (GAS_CONSTANT * data.temperature))
            * (data.water_fugacity / 1e6) ** own["water_exponent"]
            * np.exp(own["melt_factor"] * data.melt_fraction)
        )
    scatter = np.exp(0.1 * np.random.default_rng(6).standard_normal(data.n_rows))
    return replace(data, id="wet", strain_rate=rate * scatter)


def test_a_table_tells_volume_exponent_and_factor(tmp_path: Path) -> None:
    table, law = wet_table(), rate_law("olivine_wet")
    options = replace(TABLE_RUN, draws=400)
    found = fit_rates(table, law, out=tmp_path / "run", options=options)
    assert found.describes_data.value == "yes"
    assert {"along pressure", "along melt fraction"} < {one.name for one in found.checks()}
    dry = fit_rates(table, rate_law("olivine_composite"), out=tmp_path / "dry", options=options)
    outcomes = {one.name: one.outcome for one in dry.checks()}
    assert outcomes["along water fugacity"] is Outcome.NO
    assert outcomes["along stress"] is Outcome.YES
    draws = found.posterior["posterior"].to_dataset()
    for name, truth in TRUE_TABLE.items():
        own = draws[name].to_numpy()
        assert abs(own.mean() - truth) < 3.5 * own.std()
        assert own.std() < 0.6 * law.priors[name].scale
    # Carried to other pressures, the rate of each draw follows the law that is exported.
    mean = {name: float(draws[name].mean()) for name in law.priors.priors if name in draws}
    deep = {"pressure": 9e9, "water_fugacity": 1e9, "melt_fraction": 0.0}
    rates = found.rates_at(1500.0, 1e3, 1e-5, environment=deep)["log_strain_rate"]
    shallow = found.rates_at(1500.0, 1e3, 1e-5, environment={**deep, "pressure": 1e9})
    slower = float((rates - shallow["log_strain_rate"]).mean())
    volume = mean["activation_volume[diffusion]"]
    assert slower == pytest.approx(-8e9 * volume / (GAS_CONSTANT * 1500.0), rel=0.05)
    mechanisms = composite_law(found.law)["mechanisms"]
    assert isinstance(mechanisms, dict)
    expression = mechanisms["diffusion"]
    for one in ("activation_volume[diffusion]", "water_exponent[diffusion]", "melt_fraction"):
        assert one in expression
    # Its mechanisms beside the law of a curve.
    olivine = default_priors("olivine", "constant_rate")
    own = draws["activation_volume[diffusion]"].to_numpy()
    with_one = olivine.with_(**mechanism_priors(found, "diffusion"))
    assert with_one["second_activation_volume"].location == pytest.approx(own.mean())
    with_two = olivine.with_(**mechanism_priors(found, "dislocation", "diffusion"))
    assert with_two["third_activation_volume"] == replace(
        with_one["second_activation_volume"], parameter="third_activation_volume"
    )
    curve = load_experiment(ICE.parent / "dunite" / "dunite_4506.toml")
    laws = [variant_of(priors, curve).record() for priors in (with_one, with_two)]
    assert [law["second_mechanism"] for law in laws] == ["diffusion", "power_law"]
    assert [law["third_mechanism"] for law in laws] == ["none", "diffusion"]
    first, last = found.law.mechanisms
    third = replace(first, name="third", process=3)
    for processes, expected in (
        ((1, 1, 3), ("diffusion", "in_series")),
        ((1, 2, 1), ("in_series", "power_law")),
    ):
        mechanisms = tuple(
            replace(one, process=process)
            for one, process in zip((first, last, third), processes, strict=True)
        )
        changed = replace(found, law=replace(found.law, mechanisms=mechanisms))
        priors = olivine.with_(**mechanism_priors(changed, first.name, last.name))
        record = variant_of(priors, curve).record()
        assert (record["second_mechanism"], record["third_mechanism"]) == expected
    with pytest.raises(InputError, match="in series with a mechanism other than"):
        mechanism_priors(changed, last.name, first.name)
    save_rate_table(found.data, tmp_path)
    again = load_rate_table(tmp_path / "rates.toml")
    np.testing.assert_array_equal(again.water_fugacity, found.data.water_fugacity)
    with pytest.raises(InputError, match="environment: unknown name 'presure'"):
        found.rates_at(1500.0, 1e6, 1e-3, environment={"presure": 1e9})
    with pytest.raises(InputError, match="environment: the pressure is -1 Pa, expected at least 0"):
        found.rates_at(1500.0, 1e6, 1e-3, environment={"pressure": -1.0})


def test_rows_without_what_a_law_needs_are_left_out() -> None:
    table, law = wet_table().rows(np.arange(12)), rate_law("olivine_wet")
    dry = np.where(np.arange(12) < 3, np.nan, table.water_fugacity)
    left = usable_rows(replace(table, water_fugacity=dry), law)
    assert left.n_rows == 9
    assert left.notices[-1] == "wet: 3 rows without water fugacity left out."
    with pytest.raises(InputError, match="wet: no row has a pressure, expected one because"):
        usable_rows(replace(table, pressure=np.full(12, np.nan)), law)
    assert usable_rows(replace(table, pressure=dry), rate_law("olivine_composite")).n_rows == 12
    with pytest.raises(
        InputError, match=r"the melt fraction is 1\.5, expected at least 0 and less than 1"
    ):
        replace(table, melt_fraction=np.full(12, 1.5))
    with pytest.raises(InputError, match="the water fugacity is 0 Pa, expected more than"):
        replace(table, water_fugacity=np.zeros(12))


def test_a_law_with_beta_has_no_volume(tmp_path: Path) -> None:
    text = (ICE.parent / "priors" / "rates" / "ice_flow_law.toml").read_text("utf-8")
    volume = (
        '[mechanisms.parameters.activation_volume]\nfamily = "fixed"\nvalue = 1.0\n'
        'unit = "cm3/mol"\nsource = "made up"\n\n'
    )
    file = tmp_path / "law.toml"
    file.write_text(text.replace("[parameters.rate_scatter]", f"{volume}[parameters.rate_scatter]"))
    with pytest.raises(
        InputError, match="found beta and activation_volume, expected mechanism_rat"
    ):
        load_rate_law(file)


def test_a_prediction_is_of_the_pressure_of_its_own_test(small_problem: Problem) -> None:
    """A fit under no pressure says that another pressure is beyond what was fitted."""
    fitted, deep = small_problem.experiment, replace(small_problem.experiment, environment=PLACE)
    values, _ = parameters_for_other_test({**TRUTH, "pressure": 5e6}, fitted, deep)
    assert "pressure" not in values
    assert with_stated(deep, values)["pressure"] == PLACE["pressure"]
    ranges = {"pressure": (3e8, 3e8)}, {"pressure": (1e7, 1e7)}
    assert outside(ranges[0], [ranges[1]]) == ("pressure 300 MPa (fitted: 10)",)
    assert outside(ranges[0], [{}]) == ("pressure 300 MPa (fitted: not stated)",)
    melt = [{"melt fraction": (share, share)} for share in (0.01, 0.02)]
    assert outside(melt[1], melt[:1]) == ("melt fraction 0.02 (fitted: 0.01)",)


def test_a_file_states_where_its_test_was_made(tmp_path: Path) -> None:
    test = replace(history_twin("creep", 8), environment=PLACE)
    test.to_toml(tmp_path / "test.toml")
    assert dict(load_experiment(tmp_path / "test.toml").environment) == PLACE
    text = (tmp_path / "test.toml").read_text("utf-8")
    (tmp_path / "test.toml").write_text(
        text.replace("water_fugacity_Pa = 2", "water_fugacity_Pa = -2")
    )
    with pytest.raises(InputError, match="water_fugacity_Pa"):
        load_experiment(tmp_path / "test.toml")
    with pytest.raises(InputError, match="with_: unknown parameter 'pressure'"):
        default_priors("ice").with_(pressure=fixed(1.0, "Pa"))
