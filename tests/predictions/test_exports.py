"""Exports for other codes: readers of each syntax, with the code's own formula, give our rate."""

import io
import json
import re
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import ICE
from flow_codes import READERS
from linear_bodies import LAWS
from matplotlib.mathtext import MathTextParser
from oracle import GAS_CONSTANT, dashpot_rate
from refusals import CommandLine
from synthetic_fit import make_fit

import pyburgers
from pyburgers.common.array_types import FloatArray, IntArray
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.fit_rates import fit_rates
from pyburgers.kinds.problem import problem_of
from pyburgers.model.display import symbol_text
from pyburgers.model.laws import DASHPOT_LAWS, KELVIN_LAWS, MECHANISMS
from pyburgers.model.parameters import PARAMETER_BY_NAME, Parameter
from pyburgers.model.variants import with_variant
from pyburgers.page.rate_section import rate_section
from pyburgers.posterior.labelled_draws import own_name
from pyburgers.predictions.exports import FORMATS, export
from pyburgers.predictions.stress_cycles import Regime
from pyburgers.sampling.options import SamplerOptions

pytestmark = pytest.mark.usefixtures("programs")

STRESS, TEMPERATURES = 2.1e6, (243.0, 260.0, 268.5)
POWER_LAWS = [name for name, law in DASHPOT_LAWS.items() if not law.own_stress]
OTHER_LAWS = [name for name in DASHPOT_LAWS if name not in POWER_LAWS]
REGIME = Regime(1e6, 0.3e6)
SHEAR: dict[str, Any] = {"regime": REGIME, "poisson_ratio": 0.3}
N_DRAWS = 12
"""Of 120 that are exported."""

NOTHING: Mapping[str, float] = {}
FROZEN: Mapping[str, Any] = {"grain_size": "constant", "fabric": "constant"}
CHANGES: Mapping[str, float] = {
    "breakdown_stress": 2e6,
    "threshold_stress": 1e5,
    "kelvin_stress_exponent": 2.0,
}


@pytest.fixture(scope="module")
def made(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    """Made-up fit of 4 chains of 30 draws."""
    return make_fit(tmp_path_factory.mktemp("made") / "run", draws=30)


def fit_of(made: Fit, changes: Mapping[str, float] = NOTHING, **laws: str) -> Fit:
    """The fit with other laws, whose parameters take the values of their priors, or others."""
    priors = with_variant(made.priors, made.experiment, laws)
    draws = made.posterior["posterior"].to_dataset()
    values: dict[str, Any] = {}
    for name, prior in priors.priors.items():
        if prior.is_fixed or name not in draws:
            values[name] = CHANGES.get(name, prior.location)
    if laws.get("maxwell") == "linear":
        energy, exponent = draws["activation_enthalpy"], draws["stress_exponent"]
        moved = draws["beta"] + (exponent - 1) * np.log(1e6) / energy
        values["beta"] = moved.assign_attrs(draws["beta"].attrs)
    values |= changes
    full = {
        name: one if isinstance(one, xr.DataArray) else xr.full_like(draws["beta"], one)
        for name, one in values.items()
    }
    groups = {**made.posterior.to_dict(), "/posterior": draws.assign(full)}
    return replace(
        made,
        posterior=xr.DataTree.from_dict(groups),
        problem=problem_of([made.experiment], priors),
    )


def columns(fit: Fit) -> dict[str, FloatArray]:
    return {
        str(name): one.to_numpy().ravel()
        for name, one in fit.posterior["posterior"].to_dataset().data_vars.items()
    }


def chosen(fit: Fit, n: int, seed: int) -> IntArray:
    return np.sort(np.random.default_rng(seed).choice(120, n, replace=False))


def rates(fit: Fit, temperature: float, grain_size: FloatArray, fabric: FloatArray) -> FloatArray:
    """The program's rate of axial compression, as second invariants."""
    known, axial = columns(fit), np.sqrt(3) * STRESS
    rate = pyburgers.flow_rate(
        known, axial, temperature=temperature, grain_size=grain_size, fabric_factor=fabric
    )
    return np.asarray(rate * (np.sqrt(3) / 2))


STATES: Mapping[str, Mapping[str, Any]] = {
    "frozen": {},
    "initial": {"microstructure": "initial"},
    "steady": {"microstructure": "steady_state"},
    "given": {"grain_size": 1e-3, "fabric_factor": 0.7},
    "no grain size": {"microstructure": "initial"},
}


@pytest.mark.parametrize("state", STATES)
@pytest.mark.parametrize("law", POWER_LAWS)
def test_each_code_gives_the_rate_of_the_program(law: str, state: str, made: Fit) -> None:
    frozen: Mapping[str, Any] = FROZEN if state == "frozen" else {}
    without = {"grain_size_exponent": 0.0} if state == "no grain size" else {}
    fit = fit_of(made, without, maxwell=law, **frozen)
    known = columns(fit)
    size, fabric = np.full(120, fit.experiment.initial_grain_size), np.ones(120)
    if state == "steady":
        size, fabric = known["steady_state_grain_size"], known["steady_state_fabric_factor"]
    if state == "given":
        size, fabric = np.full(120, 1e-3), np.full(120, 0.7)
    expected = {one: rates(fit, one, size, fabric) for one in TEMPERATURES}
    for code, read in READERS.items():
        at: dict[str, Any] = {"temperatures": TEMPERATURES} if code == "icepack" else {}
        mean, *texts = map(read, export(fit, code, draws=N_DRAWS, seed=3, **STATES[state], **at))
        assert len(texts) == N_DRAWS
        for temperature, of_all in expected.items():
            kept = of_all[chosen(fit, N_DRAWS, 3)]
            found = [rate(STRESS, own, temperature) for rate, own in zip(texts, kept, strict=True)]
            np.testing.assert_allclose(found, kept, rtol=1e-10, err_msg=code)
            typical = float(np.exp(np.log(of_all).mean()))
            assert mean(STRESS, typical, temperature) == pytest.approx(typical, rel=1e-10)


def test_without_effect_of_grains_no_code_asks_for_their_size(made: Fit, creep: RateFit) -> None:
    fit = fit_of(made, {"grain_size_exponent": 0.0}, fabric="constant")
    draws = creep.posterior["posterior"].to_dataset()
    name = own_name("grain_size_exponent", creep.law.power_law.name)
    groups = creep.posterior.to_dict()
    groups["/posterior"] = draws.assign({name: xr.zeros_like(draws[name])})
    table = replace(creep, posterior=xr.DataTree.from_dict(groups))
    for code in READERS:
        at: dict[str, Any] = {"temperatures": [255.0]} if code == "icepack" else {}
        for one in (fit, table):
            (text,) = export(one, code, **at)
            assert "p = 0: the grain size has no effect." in text
            assert "d = " not in text
            assert "State of the material: initial microstructure, grain" not in text
            known = columns(fit) if one is fit else table.power_law()
            every = pyburgers.flow_rate(
                known, np.sqrt(3) * STRESS, temperature=255.0, grain_size=1e-3
            )
            typical = float(np.exp(np.log(every).mean()) * np.sqrt(3) / 2)
            assert READERS[code](text)(STRESS, typical, 255.0) == pytest.approx(typical, rel=1e-10)


def test_invariants_are_those_of_tensors() -> None:
    """The factor of second invariants, from the tensors of axial compression."""
    stress = np.diag([-1.0, 0.0, 0.0])
    deviator = stress - np.trace(stress) / 3 * np.eye(3)
    rate = np.diag([-1.0, 0.5, 0.5])
    both = [np.sqrt(np.sum(one * one) / 2) for one in (deviator, rate)]
    np.testing.assert_allclose(both, [1 / np.sqrt(3), np.sqrt(3) / 2], rtol=1e-15)


@pytest.mark.parametrize("law", OTHER_LAWS)
def test_a_law_that_codes_lack_is_refused(law: str, made: Fit) -> None:
    fit = fit_of(made, maxwell=law)
    for code in READERS:
        with pytest.raises(InputError, match=f"cannot express the dashpot '{law}'.*power law"):
            export(fit, code, microstructure="initial")


@pytest.mark.parametrize("law", [law for law in MECHANISMS["second"] if law != "none"])
def test_codes_refuse_a_second_mechanism_and_compliances_have_it(law: str, made: Fit) -> None:
    linear = {**FROZEN, "maxwell": "linear"}
    fit = fit_of(made, **linear, second_mechanism=law)
    for code in READERS:
        with pytest.raises(InputError, match="cannot express several mechanisms of the dashpot"):
            export(fit, code, microstructure="initial")
    without: dict[str, Any] = {"poisson_ratio": 0.3}
    if law != "diffusion":
        message = "compliance of this dashpot depends on the stress"
        with pytest.raises(InputError, match=message):
            export(fit, "tidalpy", **without)
    if law == "in_series":
        with pytest.raises(InputError, match="expected mechanisms side by side"):
            export(fit, "tidalpy", **SHEAR)
        return
    stated = without if law == "diffusion" else SHEAR
    found, alone = (export(one, "tidalpy", **stated) for one in (fit, fit_of(made, **linear)))
    assert found != alone


@pytest.mark.parametrize(
    ("laws", "evolving"),
    [
        ({}, "grain size and fabric"),
        ({"fabric": "constant"}, "grain size"),
        ({"grain_size": "constant"}, "fabric"),
    ],
)
def test_a_microstructure_that_evolves_is_refused(
    laws: Mapping[str, Any], evolving: str, made: Fit
) -> None:
    fit = fit_of(made, **laws)
    for code in (*READERS, "tidalpy", "specfem"):
        with pytest.raises(InputError, match=f"evolving {evolving} of the fit, expected one state"):
            export(fit, code, **({} if code in READERS else SHEAR))


def table(text: str) -> pd.DataFrame:
    return pd.read_csv(io.StringIO(text), comment="#")


def compliances(text: str) -> FloatArray:
    read = table(text)
    return np.asarray(1 / (read["G1_Pa"] + 1j * read["G2_Pa"]))


@pytest.mark.parametrize("maxwell", [law for law in DASHPOT_LAWS if DASHPOT_LAWS[law].closed_form])
@pytest.mark.parametrize("kelvin", [law for law in KELVIN_LAWS if KELVIN_LAWS[law].closed_form])
def test_tables_in_shear_have_the_compliances_of_the_program(
    kelvin: str, maxwell: str, made: Fit
) -> None:
    fit = fit_of(made, LAWS[kelvin], maxwell=maxwell, **FROZEN)
    frequencies = [1e-5, 1e-3, 0.1]
    given: dict[str, Any] = {**SHEAR, "frequencies": frequencies, "temperatures": [250.0]}
    given |= {"draws": N_DRAWS, "seed": 3}
    mean, *texts = export(fit, "tidalpy", **given)
    q_of_mean, *q_texts = export(fit, "specfem", **given)
    spectrum = pyburgers.predict_attenuation(fit, frequencies, [REGIME], temperature=250.0)
    axial = (spectrum["storage_compliance"] - 1j * spectrum["loss_compliance"]).to_numpy()
    spring = 1 / columns(fit)["maxwell_modulus"][:, np.newaxis]
    shear = 2 * 1.3 * spring + 3 * (axial.reshape(120, 3) - spring)
    kept = shear[chosen(fit, N_DRAWS, 3)]
    np.testing.assert_allclose([compliances(text) for text in texts], kept, rtol=1e-10)
    read = table(texts[7])
    np.testing.assert_allclose(read["J1_per_Pa"] - 1j * read["J2_per_Pa"], kept[7], rtol=1e-10)
    assert (read["G2_Pa"] > 0).all()
    np.testing.assert_allclose(compliances(mean), shear.mean(axis=0), rtol=1e-10)
    quality = kept.real / -kept.imag
    np.testing.assert_allclose([table(one)["Q_mu"] for one in q_texts], quality, rtol=1e-10)
    moduli = [table(one)["shear_modulus_Pa"] for one in q_texts]
    np.testing.assert_allclose(moduli, (1 / kept).real, rtol=1e-10)
    np.testing.assert_allclose(table(q_of_mean)["frequency_Hz"], frequencies, rtol=1e-15)


def test_a_linear_body_is_the_burgers_model_in_shear_of_tidal_codes(made: Fit) -> None:
    """Their formula has the sign exp(+i omega t), and needs no stress."""
    fit = fit_of(made, maxwell="linear", **FROZEN)
    _, text = export(fit, "tidalpy", draws=1, seed=4, poisson_ratio=0.25)
    (k,) = chosen(fit, 1, 4)
    one = {name: float(values[k]) for name, values in columns(fit).items()}
    state = (np.array(1e6), np.array(fit.experiment.initial_grain_size), np.array(1.0))
    fluidity = float(dashpot_rate(one, fit.experiment.temperature, *state)) / 1e6
    mu, viscosity = one["maxwell_modulus"] / 2.5, 1 / (3 * fluidity)
    mu_2, viscosity_2 = one["kelvin_modulus"] / 3, one["kelvin_viscosity"] / 3
    read = table(text)
    s = 2j * np.pi * read["frequency_Hz"].to_numpy()
    modulus = (mu * s * (s + mu_2 / viscosity_2)) / (
        s**2
        + s * (mu / viscosity + (mu + mu_2) / viscosity_2)
        + mu * mu_2 / (viscosity * viscosity_2)
    )
    np.testing.assert_allclose(read["G1_Pa"] + 1j * read["G2_Pa"], modulus, rtol=1e-9)


@pytest.mark.parametrize("code", ["tidalpy", "specfem"])
@pytest.mark.parametrize(
    ("laws", "reason"),
    [
        ({"maxwell": "threshold_stress"}, "threshold_stress: .*no closed form"),
        ({"kelvin": "power_law"}, "kelvin_stress_exponent: .*linear Kelvin part"),
    ],
)
def test_laws_without_compliances_are_refused(
    code: str, laws: Mapping[str, Any], reason: str, made: Fit
) -> None:
    with pytest.raises(InputError, match=reason):
        export(fit_of(made, **laws, **FROZEN), code, **SHEAR)


def test_grains_and_fabric_of_constant_laws_stay_where_they_are_put(made: Fit) -> None:
    fit = fit_of(made, **FROZEN)
    for state in ("initial", "steady_state"):
        spectrum = pyburgers.predict_attenuation(
            fit, [1e-3], [REGIME], microstructure=state, grain_size=3e-5, fabric_factor=0.5
        )
        assert np.isinf(spectrum["critical_strain"]).all()
        assert (spectrum["fabric_factor"] == 0.5).all()


def test_another_elastic_modulus_leaves_the_delayed_strain(made: Fit) -> None:
    fit = fit_of(made, {"peak_strength": 0.2}, kelvin="two_elements")
    fitted, given = (
        pyburgers.predict_attenuation(fit, [1e-3, 1.0], [REGIME], elastic_modulus=modulus)
        for modulus in (None, 30e9)
    )
    for own in (fitted, given):
        own["delayed"] = own["storage_compliance"] - own["elastic_compliance"]
    np.testing.assert_allclose(given["elastic_compliance"], 1 / 30e9, rtol=1e-12)
    for name in ("delayed", "loss_compliance"):
        np.testing.assert_allclose(given[name], fitted[name], rtol=1e-9)
    with pytest.raises(
        InputError, match=r"elastic_modulus_sd: found 1e\+09 Pa without elastic_mod"
    ):
        pyburgers.predict_attenuation(fit, [1e-3], [REGIME], elastic_modulus_sd=1e9)


def test_comments_say_what_was_not_fitted_and_what_state_it_is(made: Fit) -> None:
    size = np.float64(1e-3)
    far: dict[str, Any] = {
        "grain_size": size,
        "fabric_factor": 1.0,
        "frequencies": [1e-9],
        "temperatures": [300.0],
    }
    (text,) = export(made, "tidalpy", regime=Regime(5e9, 1e9), poisson_ratio=0.3, **far)
    beyond = next(line for line in text.splitlines() if "Beyond what was fitted" in line)
    for condition in (
        "temperature 300 K",
        "initial grain size 1000 um",
        "stress",
        "strain rate",
    ):
        assert condition in beyond
    for told in (
        "Ice at 300 K is molten",
        "6 GPa is unlikely in ice",
        "kelvin_viscosity",
        "Cycles of",
    ):
        assert told in text
    (text,) = export(made, "aspect", microstructure="steady_state")
    assert "steady_state_fabric_factor" in text
    (text,) = export(made, "aspect", grain_size=size, fabric_factor=0.7)
    assert "State of the material: grain size 1000 µm, fabric factor 0.7." in text


@pytest.mark.parametrize(
    ("changed", "message"),
    [
        ({"beta": None}, "parameters: 'beta' is missing"),
        ({"temperature": 0.0}, "temperature: found 0, expected a positive number"),
        ({"grain_size": -1e-3}, "grain_size: found -0.001, expected a positive number"),
        ({"grain_size": 230.0}, "grain_size: found 230 m, expected metres below 1"),
        ({"fabric_factor": -1.0}, "fabric_factor: found -1, expected a positive number"),
    ],
)
def test_a_flow_rate_is_of_a_whole_law_and_a_possible_state(
    changed: Mapping[str, float | None], message: str
) -> None:
    law = {"stress_exponent": 4.0, "grain_size_exponent": 0.4, "activation_enthalpy": 62e3}
    given: dict[str, Any] = {
        **law,
        "beta": -7.29e-4,
        "temperature": 263.0,
        "grain_size": 1e-3,
        **changed,
    }
    state = {name: given.pop(name) for name in given.keys() - {*law, "beta"}}
    values = {name: value for name, value in given.items() if value is not None}
    with pytest.raises(InputError, match=re.escape(message)):
        pyburgers.flow_rate(values, 1e6, **state)


def test_a_mistyped_format_is_guessed(made: Fit) -> None:
    with pytest.raises(InputError, match="did you mean 'aspect'"):
        export(made, "aspec")


def test_a_prefactor_that_no_number_holds_is_refused(made: Fit) -> None:
    fit = fit_of(made, {"beta": -0.02}, **FROZEN)
    with pytest.raises(InputError, match=r"found exp\(-1\d{3}\)"):
        export(fit, "aspect")


@pytest.mark.parametrize("code", sorted({*FORMATS} - {"json", "csv", "latex"}))
def test_comments_say_how_far_to_trust_the_numbers(code: str, made: Fit) -> None:
    fit = fit_of(made, **FROZEN)
    given: dict[str, Any] = {} if code in READERS else SHEAR
    if "temperatures" in FORMATS[code].uses:
        given = {**given, "temperatures": [230.0]}
    mean, draw = export(fit, code, draws=1, **given)
    if code == "underworld":
        (record,) = json.loads(mean).values()
        comments = "\n".join(record["notes"])
    else:
        mark = "!" if code == "elmer" else "#"
        comments = "\n".join(line for line in mean.splitlines() if line.startswith(f"{mark} "))
    verdicts = f"Sampled well: {fit.sampled_well.value}. Describes the data: "
    assert verdicts + f"{fit.describes_data.value}." in comments
    decided = fit.influences()["PIL40"]["stress_exponent"].origin.value
    assert re.search(rf"stress_exponent 3\.\d+ \+- 0\.\d+ \({decided}", comments)
    assert not re.search(r"\d( 1| fraction| ) \(", comments)
    for note in (*fit.prior_conflicts(), *fit.prior_decisions()):
        assert note in comments
    assert (
        "Conditions of the fitted tests: temperature 260 K; initial grain size 230 um" in comments
    )
    assert ("Beyond what was fitted: temperature 230 K" in comments) == bool(
        given.get("temperatures")
    )
    assert "Mean of the posterior" in comments
    assert "of 120." in draw


def test_json_holds_the_same_draws(made: Fit) -> None:
    fit = fit_of(made, **FROZEN)
    content = json.loads(*export(fit, "json", draws=5, seed=3))
    sample = np.array(content["sample"])
    known, kept = columns(fit), chosen(fit, 5, 3)
    for name in ("stress_exponent", "beta"):
        expected = known[name][kept]
        np.testing.assert_array_equal(sample[:, content["names"].index(name)], expected)
    assert "sample" not in json.loads(*export(fit, "json"))


def test_softened_tests_have_a_law_of_undeformed_material(peaks: RateFit) -> None:
    with pytest.raises(InputError, match="no grain size of undeformed material"):
        export(peaks, "geoparams")
    with pytest.raises(InputError, match=r"'steady_state', of which .* tells nothing"):
        export(peaks, "geoparams", grain_size=1e-3, microstructure="steady_state")
    with pytest.raises(InputError, match="no temperature"):
        export(peaks, "icepack", grain_size=1e-3)
    with pytest.raises(InputError, match="fit of a table"):
        export(peaks, "tidalpy", **SHEAR)
    known = peaks.power_law()
    axial = np.sqrt(3) * STRESS
    expected = pyburgers.flow_rate(known, axial, temperature=255.0, grain_size=1e-3)
    typical = float(np.exp(np.log(expected).mean()) * np.sqrt(3) / 2)
    for code in ("geoparams", "icepack"):
        given: dict[str, Any] = {"temperatures": [255.0]} if code == "icepack" else {}
        (text,) = export(peaks, code, grain_size=1e-3, **given)
        assert READERS[code](text)(STRESS, typical, 255.0) == pytest.approx(typical, rel=1e-10)
        assert "Conditions of the fitted tests: temperature" in text


def test_steady_rates_are_told_from_the_least_ones_of_the_law(
    creep: RateFit, tmp_path: Path
) -> None:
    table = pyburgers.load_rate_table(ICE / "rates" / "jacka_li_1994.toml")
    options = SamplerOptions(chains=1, warmup=150, draws=60, seed=1)
    steady = fit_rates(table, out=tmp_path / "run", options=options)
    excess, told = "tertiary_enhancement[axial]", "of the tests at their least rates"
    for fit, is_steady in ((steady, True), (creep, False)):
        content = json.loads(*export(fit, "json"))
        assert (excess in content["names"]) is is_steady
        sentence = f"Steady rates of tests are {excess} times their least rates."
        (text,) = export(fit, "pism", grain_size=2e-3)
        assert [sentence in content["notes"], sentence in text, told in text] == [is_steady] * 3
        (figure,) = (one for one in rate_section(fit).figures if one.name == "flow_law")
        assert ("points of steady rates are divided by E" in figure.caption) is is_steady


def test_exports_of_tables_state_pressure_water_and_melt_of_the_tests(creep: RateFit) -> None:
    known, unknown = np.full(creep.data.n_rows, 3e8), np.full(creep.data.n_rows, np.nan)
    partly = np.where(np.arange(creep.data.n_rows) == 0, 0.02, unknown)
    fit = replace(creep, data=replace(creep.data, pressure=known, melt_fraction=partly))
    (text,) = export(fit, "pism", grain_size=1e-3)
    assert "MPa; pressure 300 MPa; melt fraction 0.02. The law extrapolates" in text
    assert "water fugacity" not in text


def evaluated(content: dict[str, Any], draw: int, conditions: dict[str, float]) -> float:
    """ln(rate s) of the law that an export in JSON states in words, at one draw of its sample."""

    def readable(expression: str) -> str:
        return expression.replace("[", "_").replace("]", "").replace("^", "**")

    known = {
        readable(name): value
        for name, value in zip(content["names"], content["sample"][draw], strict=True)
    }
    known |= {**conditions, "R": GAS_CONSTANT, "exp": np.exp, "min": min}
    for name, expression in content["mechanisms"].items():
        known[name] = eval(readable(expression), {}, known)
    law = content["flow_law"].removeprefix("strain_rate = ")
    return float(np.log(eval(readable(law), {}, known)))


def test_laws_of_mechanisms_are_exported_as_expressions(creep: RateFit, tmp_path: Path) -> None:
    options = SamplerOptions(chains=1, warmup=150, draws=60, seed=1)
    composite = fit_rates(
        pyburgers.load_rate_table(ICE / "rates" / "goldsby_kohlstedt_1997.toml"),
        pyburgers.rate_law("ice_composite"),
        out=tmp_path / "run",
        options=options,
    )
    for fit in (creep, composite):
        n_draws = len(all_draws(fit.posterior["posterior"].to_dataset()["rate_scatter"]))
        (text,) = export(fit, "json", draws=n_draws)
        content = json.loads(text)
        assert np.shape(content["covariance"]) == (len(content["names"]),) * 2
        for temperature in (240.0, 262.0):  # the second is above the premelting temperatures
            rates = fit.rates_at(temperature, 2e6, 3e-4)["log_strain_rate"].to_numpy()[:, 0]
            at = {"temperature": temperature, "stress": 2e6, "grain_size": 3e-4}
            first = evaluated(content, 0, at)
            assert first == pytest.approx(rates[0], rel=1e-8)
        # Draws of mean and covariance have rates: logarithms are there in their place.
        of_rates = [name for name in content["names"] if "mechanism_rate" in name]
        assert of_rates == [f"ln_mechanism_rate[{one.name}]" for one in fit.law.mechanisms]
        assert r"$\ln \dot\epsilon_1[" in "".join(export(fit, "latex"))
    with pytest.raises(InputError, match=r"cannot express 'Ice, .*expected a power law"):
        export(composite, "aspect", grain_size=1e-3)
    (text,) = export(creep, "aspect", grain_size=1e-3)
    assert "of the tests, grain size 1000" in text
    assert "dislocation" in export(composite, "latex")[0]


@pytest.mark.parametrize("parameter", PARAMETER_BY_NAME.values(), ids=[*PARAMETER_BY_NAME])
def test_tex_reads_every_symbol(parameter: Parameter) -> None:
    """Tables in LaTeX and figures have it; one that TeX cannot read stops both."""
    MathTextParser("path").parse(f"${parameter.symbol}$")
    assert "\\" not in symbol_text(parameter)


def test_the_command_writes_the_mean_and_each_draw(
    small_fit: Fit, tmp_path: Path, cli: CommandLine
) -> None:
    run, out = str(small_fit.directory.path), tmp_path / "ice.prm"
    state = ["--microstructure", "steady-state", "--draws", "2", "--seed", "5"]
    arguments = ["export", run, "--format", "aspect", "--out", str(out), *state]
    for _ in range(2):  # an export may be written over
        printed = cli(*arguments).splitlines()
        assert [Path(line).name for line in printed] == ["ice.prm", "ice_1.prm", "ice_2.prm"]
    texts = pyburgers.export(small_fit, "aspect", microstructure="steady_state", draws=2, seed=5)
    for name, text in zip(printed, texts, strict=True):
        assert (tmp_path / Path(name).name).read_text(encoding="utf-8") == text
    (tmp_path / "ice_2.prm").write_text("mine", encoding="utf-8")
    cli.refused(arguments, "ice_2.prm", "holds something else")
    table_arguments = ["export", run, "--format", "tidalpy", "--microstructure", "initial"]
    cycles = ["--median-stress-MPa", "1", "--poisson-ratio", "0.3"]
    cli(*table_arguments, *cycles, "--amplitude-MPa", "0.3")
    (text,) = export(small_fit, "tidalpy", microstructure="initial", **SHEAR)
    assert table(cli.out)["frequency_Hz"].size == 60
    assert compliances(text).size == 60


def test_the_fabric_factor_that_is_told_gives_the_prefactor(made: Fit) -> None:
    (text,) = export(made, "aspect", microstructure="steady_state")
    (fabric,) = re.findall(r"with the fabric factor F = (\S+)\.$", text, re.MULTILINE)
    ((size, p),) = re.findall(r"d = (\S+) m, p = (\S+)\. ", text)
    (prefactor,) = re.findall(r"Prefactors for dislocation creep = (\S+)", text)
    known = columns(made)
    assert np.ptp(known["steady_state_fabric_factor"]) > 0
    n, axial = known["stress_exponent"].mean(), known["beta"] * known["activation_enthalpy"]
    factor = 3 ** ((n + 1) / 2) / 2 * np.exp(axial.mean()) * float(size) ** -float(p)
    assert float(prefactor) * float(fabric) ** n == pytest.approx(factor, rel=1e-10, abs=0.0)
