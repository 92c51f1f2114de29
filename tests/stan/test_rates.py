"""Composite flow laws from tables of rates: published laws, densities, twins, hand-over, runs."""

import json
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path
from typing import Any

import numpy as np
import pytest
import xarray as xr
from conftest import ICE, TABLE_RUN
from rate_oracle import (
    GAS_CONSTANT,
    GOLDSBY_KOHLSTEDT_2001,
    GOLDSBY_KOHLSTEDT_2001_WARM,
    HIRTH_KOHLSTEDT_2003,
    PowerLaw,
    composite_rate,
)
from scipy import stats

from pyburgers.checks.fit_checks import Outcome
from pyburgers.cmdstan.program import Program, load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.array_types import FloatArray
from pyburgers.common.draws import all_draws
from pyburgers.common.errors import InputError
from pyburgers.drawing.style import image
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.fit_rates import fit_rates
from pyburgers.flow_law_tables.laws import (
    SCATTER,
    SOURCE_SPREADS,
    TABLE_PARAMETERS,
    RateLaw,
    rate_law,
)
from pyburgers.flow_law_tables.program_data import rate_data, start_of_chain
from pyburgers.flow_law_tables.table_files import load_rate_table
from pyburgers.flow_law_tables.tables import RateTable
from pyburgers.kinds.experiment import Provenance
from pyburgers.page.rate_section import law_figure, law_table, rate_section, residual_figure

FAN = ICE / "rates" / "fan_2020.toml"

TRUTH = {
    "mechanism_rate[dislocation]": 3e-8,
    "stress_exponent[dislocation]": 4.1,
    "activation_enthalpy[dislocation]": 64e3,
    "premelting_enthalpy[dislocation]": 150e3,
    "mechanism_rate[sliding]": 6e-9,
    "stress_exponent[sliding]": 1.9,
    "grain_size_exponent[sliding]": 1.3,
    "activation_enthalpy[sliding]": 52e3,
    "premelting_enthalpy[sliding]": 120e3,
    "rate_scatter": 0.2,
    "source_rate_spread": 0.2,
    "source_temperature_spread": 0.2,
    "source_scatter_spread": 0.2,
}

NO_COORDINATES: dict[str, list[float]] = {
    f"{name}coordinate": [] for name in ("", "rate_", "temperature_", "scatter_", "softening_")
}
"""Position of a law of which nothing is inferred, for one source."""


@pytest.fixture(scope="module")
def program() -> Program:
    return load_program(stan_directory() / "rates.stan")


def conditions(n_rows: int, seed: int, n_sources: int = 3) -> RateTable:
    """Rows at all kinds of conditions of ice; what was read is still to be made."""
    rng = np.random.default_rng(seed)
    stress_is_imposed = np.arange(n_rows) % 3 > 0
    steady = np.arange(n_rows) % 7 == 0
    unknown = np.full(n_rows, np.nan)
    return RateTable(
        id="made-up",
        material="ice",
        temperature=rng.uniform(225, 270, n_rows),
        stress=np.exp(rng.uniform(np.log(2e5), np.log(1.2e7), n_rows)),
        strain_rate=np.exp(rng.uniform(np.log(1e-8), np.log(1e-4), n_rows)),
        grain_size=np.exp(rng.uniform(np.log(5e-6), np.log(3e-3), n_rows)),
        pressure=unknown,
        water_fugacity=unknown,
        melt_fraction=unknown,
        reading_error=np.full(n_rows, 0.05),
        temperature_error=np.full(n_rows, 0.2),
        grain_size_error=np.full(n_rows, 0.1),
        imposed=np.where(stress_is_imposed, "stress", "strain_rate"),
        regime=np.where(steady, "steady", np.where(stress_is_imposed, "minimum", "peak")),
        geometry=np.where(np.arange(n_rows) % 2, "shear", "compression"),
        source=np.array([f"paper-{k % n_sources}" for k in range(n_rows)]),
        provenance=Provenance("synthetic", "made for a test"),
    )


def twin(program: Program, n_rows: int, seed: int) -> RateTable:
    """Rows of `TRUTH`, read with scatter, biases of sources and errors."""
    n_sources = 3
    data = conditions(n_rows, seed, n_sources)
    law = rate_law("ice_composite").at(**TRUTH)
    rng = np.random.default_rng([seed, 1])
    position = {
        f"{name}_coordinate": rng.standard_normal(n_sources).tolist()
        for name in ("rate", "temperature", "scatter")
    }
    stan_data = {
        **rate_data(data, law),
        "centring": [0.0] * n_sources,
        "temperature": (
            data.temperature + data.temperature_error * rng.standard_normal(n_rows)
        ).tolist(),
        "grain_size": (
            data.grain_size * np.exp(data.grain_size_error * rng.standard_normal(n_rows))
        ).tolist(),
        "temperature_error": [0.0] * n_rows,
        "grain_size_error": [0.0] * n_rows,
    }
    made = program.evaluate(
        stan_data, {"coordinate": [], "softening_coordinate": [], **position}, seed=seed
    )
    read = np.exp(made["log_read_replicated"])
    return replace(
        data,
        stress=np.where(data.stress_is_imposed, data.stress, read),
        strain_rate=np.where(data.stress_is_imposed, read, data.strain_rate),
    )


def published(law: RateLaw, laws: Mapping[str, PowerLaw]) -> RateLaw:
    """Fix a law at a paper's numbers."""
    at = law.reference
    values: dict[str, float] = {}
    for name, one in laws.items():
        rate = one.rate(*(np.array(x) for x in (at.stress, at.grain_size, at.temperature)))
        values |= {
            f"mechanism_rate[{name}]": float(rate),
            f"stress_exponent[{name}]": one.n,
            f"grain_size_exponent[{name}]": one.p,
            f"activation_enthalpy[{name}]": one.q,
        }
    flat = [replace(mechanism, premelting_temperature=0.0) for mechanism in law.mechanisms]
    return replace(law, mechanisms=tuple(flat)).at(**values)


@pytest.mark.parametrize(
    ("name", "laws", "in_series", "temperatures", "sizes"),
    [
        ("ice_composite", GOLDSBY_KOHLSTEDT_2001, True, (180, 255), (1e-6, 1e-2)),
        ("ice_composite", GOLDSBY_KOHLSTEDT_2001_WARM, True, (258, 273), (1e-6, 1e-2)),
        ("olivine_composite", HIRTH_KOHLSTEDT_2003, False, (1373, 1523), (1e-6, 1e-2)),
    ],
    ids=["ice, cold", "ice, warm", "olivine"],
)
def test_rates_of_published_laws(
    program: Program,
    name: str,
    laws: Mapping[str, PowerLaw],
    in_series: bool,
    temperatures: tuple[float, float],
    sizes: tuple[float, float],
) -> None:
    stress, size, temperature = (
        axis.ravel()
        for axis in np.meshgrid(
            np.geomspace(1e4, 1e9, 11), np.geomspace(*sizes, 9), np.linspace(*temperatures, 7)
        )
    )
    data = rate_data(conditions(3, 1, n_sources=1), published(rate_law(name), laws))
    grid = {"grid_stress": stress, "grid_grain_size": size, "grid_temperature": temperature}
    found = program.evaluate(
        {**data, "n_grid": stress.size, **{k: v.tolist() for k, v in grid.items()}},
        NO_COORDINATES,
    )["grid_log_rate"]
    pairs = [("sliding", "basal_slip")] if in_series else []
    expected = np.log(composite_rate(laws, pairs, stress, size, temperature))
    # Files of draws have as many digits as a double.
    np.testing.assert_allclose(found, expected, rtol=0, atol=1e-10)


def oracle_log_likelihood(data: RateTable, values: Mapping[str, Any]) -> FloatArray:
    """Log density of what was read: the law by numbers, its slopes by finite differences."""
    law = rate_law("ice_composite")
    at = law.reference

    def log_rate(stress: FloatArray, size: FloatArray, temperature: FloatArray) -> FloatArray:
        rates = {}
        for mechanism in law.mechanisms:
            one = {
                key.split("[")[0]: value
                for key, value in values.items()
                if key.endswith(f"[{mechanism.name}]")
            }
            kink = mechanism.premelting_temperature or np.inf
            arrhenius = np.where(
                temperature < kink,
                one["activation_enthalpy"] * (1 / temperature - 1 / at.temperature),
                one["activation_enthalpy"] * (1 / kink - 1 / at.temperature)
                + one.get("premelting_enthalpy", 0.0) * (1 / temperature - 1 / kink),
            )
            rates[mechanism.name] = (
                one["mechanism_rate"]
                * (stress / at.stress) ** one["stress_exponent"]
                * (size / at.grain_size) ** -one["grain_size_exponent"]
                * np.exp(-arrhenius / GAS_CONSTANT)
            )
        slip = 1 / (1 / rates["sliding"] + 1 / rates["basal_slip"])
        return np.asarray(np.log(rates["dislocation"] + slip))

    source = [data.sources.index(one) for one in data.source]
    temperature = data.temperature + values["source_temperature"][source]
    places = (data.stress, data.grain_size, temperature)
    step = 1e-6
    slopes = [
        (
            log_rate(*(x * np.exp(step * (k == j)) for j, x in enumerate(places)))
            - log_rate(*(x * np.exp(-step * (k == j)) for j, x in enumerate(places)))
        )
        / (2 * step)
        for k in range(3)
    ]
    enhancement = np.array(
        [1.0, *(values[f"tertiary_enhancement[{k}]"] for k in ("axial", "shear"))]
    )
    residual = (
        np.log(data.strain_rate)
        - log_rate(*places)
        - values["source_rate"][source]
        - np.log(enhancement[data.enhancement_place])
    )
    slope = np.where(data.stress_is_imposed, 1.0, slopes[0])
    # An error of T by its stated value; the slope by ln(T) at the true temperature.
    by_temperature = slopes[2] * temperature / data.temperature**2
    deviation = np.sqrt(
        values["source_scatter"][source] ** 2
        + (data.reading_error * slope) ** 2
        + (data.grain_size_error * slopes[1]) ** 2
        + (data.temperature_error * by_temperature) ** 2
    )
    return np.asarray(stats.norm.logpdf(residual, 0, deviation) + np.log(slope))


def test_the_likelihood_is_that_of_an_independent_law(program: Program) -> None:
    data, law = conditions(30, 5), rate_law("ice_composite")
    stan_data = rate_data(data, law)
    found = program.evaluate(stan_data, start_of_chain(stan_data, seed=2, chain=1))
    values: dict[str, Any] = dict(
        zip([p.name for p in law.parameters], found["parameter"], strict=True)
    )
    values |= {
        name: found[name] for name in ("source_rate", "source_temperature", "source_scatter")
    }
    expected = oracle_log_likelihood(data, values)
    np.testing.assert_allclose(found["log_lik"], expected, rtol=1e-5, atol=1e-6)
    prior = sum(
        float(law.priors[name].distribution().logpdf(values[name])) for name in law.priors.free
    )
    assert found["lprior"] == pytest.approx(prior, rel=1e-8)


def test_fan_s_tests_ask_for_a_larger_enthalpy_than_the_prior_of_curves(creep: RateFit) -> None:
    draws = creep.posterior["posterior"].to_dataset()
    n, q = (
        all_draws(draws[f"{name}[creep]"]) for name in ("stress_exponent", "activation_enthalpy")
    )
    ratio = q / n
    # Least squares of the read stress on 1/T.
    table = creep.data
    x = 1 / (GAS_CONSTANT * table.temperature)
    slope = np.polyfit(x, np.log(table.stress) - np.log(table.strain_rate) / n.mean(), 1)[0]
    assert ratio.mean() == pytest.approx(slope, rel=0.05)
    assert creep.sampled_well is Outcome.YES
    along = {check.name: check.outcome for check in creep.checks()}
    assert along["along temperature"] is Outcome.YES
    # One grain size says nothing about the law along it.
    assert "along grain size" not in along
    assert creep.describes_data is Outcome.YES


def test_a_run_is_read_again_and_shown(creep: RateFit) -> None:
    again = RateFit.load(creep.directory.path)
    first, second = (one.posterior["posterior"].to_dataset() for one in (again, creep))
    assert first.equals(second)
    assert creep.held_out_table().empty
    assert {"stress_exponent[creep]", "reference_flow_rate"} <= set(creep.summary().index)
    assert "stress exponent, creep" in law_table(creep)["quantity"].tolist()
    assert image(law_figure(creep), "png")
    assert image(residual_figure(creep), "png")
    assert rate_section(creep).title == "Flow law of ice from steady rates"


def test_a_law_of_two_exponents_is_told_from_one(program: Program, tmp_path: Path) -> None:
    """Rates that follow stress to the first and fourth power are no power law."""
    data = conditions(60, 2, n_sources=1)
    law = rate_law("ice_power_law")
    stress = data.stress / 1e6
    rng = np.random.default_rng(3)
    rate = 1e-8 * (stress + stress**4 / 8) * np.exp(0.1 * rng.standard_normal(60))
    data = replace(
        data,
        temperature=np.full(60, 255.0),
        strain_rate=rate,
        imposed=np.full(60, "stress"),
        regime=np.full(60, "minimum"),
        grain_size=np.full(60, 1e-3),
    )
    fit = fit_rates(data, law, out=tmp_path / "run", options=TABLE_RUN)
    outcome = {check.name: check.outcome for check in fit.checks()}
    assert outcome["along stress"] is Outcome.NO
    assert fit.describes_data is Outcome.NO


def covered(fit: RateFit) -> dict[str, bool]:
    """Whether the 90 % interval of each free parameter holds its truth."""
    draws = fit.posterior["posterior"].to_dataset()
    found = {}
    for name, truth in TRUTH.items():
        low, high = np.quantile(all_draws(draws[name]), (0.05, 0.95))
        found[name] = bool(low <= truth <= high)
    return found


def test_a_composite_twin_is_recovered_and_a_held_out_source_predicted(
    program: Program, tmp_path: Path
) -> None:
    data = twin(program, 120, seed=1)
    fit = fit_rates(
        data,
        rate_law("ice_composite"),
        out=tmp_path / "run",
        held_out=["paper-2"],
        options=replace(TABLE_RUN, draws=300),
    )
    assert fit.used.n_rows == 80
    # Rows keep the places that they have in the program's data.
    stan_data = json.loads(fit.directory.stan_data_file.read_text(encoding="utf-8"))
    assert fit.data.stress == pytest.approx(stan_data["stress"], rel=1e-12)
    assert sum(covered(fit).values()) >= 9
    summary = fit.summary("SI")
    assert summary["sd"]["stress_exponent[dislocation]"] < 0.25
    # Sliding is the slower step in these rows, which tell at most that basal slip is faster: half
    # of a normal prior is 0.6 as wide as the whole.
    assert summary["width_beside_prior"]["mechanism_rate[basal_slip]"] > 0.5
    predicted = fit.held_out_table()
    assert predicted["rows"]["paper-2"] == 40
    assert predicted["inside_90"]["paper-2"] > 0.75
    assert np.isfinite(predicted["log_density"]["paper-2"])


def test_rows_without_a_grain_size_are_left_out_where_the_law_needs_it(tmp_path: Path) -> None:
    rates = load_rate_table(FAN)
    unknown = replace(rates, grain_size=np.full(rates.n_rows, np.nan))
    with pytest.raises(InputError, match="no row has a grain size"):
        fit_rates(unknown, out=tmp_path / "run")
    with pytest.raises(InputError, match="held out"):
        fit_rates(rates, out=tmp_path / "run", held_out=["fan_2020"])
    other = replace(unknown, id="other", source=np.full(rates.n_rows, "other"))
    for one in ("other", "fan_2020"):
        with pytest.raises(InputError, match="all of fan_2020, of which the law can take rows"):
            fit_rates([rates, other], out=tmp_path / "run", held_out=[one])
    known = np.where(np.arange(rates.n_rows) < 2, rates.grain_size, np.nan)
    with pytest.raises(InputError, match="found 2 rows to fit, expected at least 3"):
        fit_rates(replace(rates, grain_size=known), out=tmp_path / "run")


def test_a_published_law_is_judged_and_one_without_a_free_number_refused(tmp_path: Path) -> None:
    """The rate at the mean conditions is then a constant, of which chains need not agree."""
    law, rates = rate_law("ice_power_law"), load_rate_table(FAN)
    published = law.at(**dict.fromkeys((SCATTER, *SOURCE_SPREADS), 0.1)).priors.priors
    scatter = {**published, **{name: law.priors[name] for name in TABLE_PARAMETERS}}
    laws = (replace(law, priors=replace(law.priors, priors=one)) for one in (published, scatter))
    with pytest.raises(InputError, match=r"every parameter fixed.*rate_scatter"):
        fit_rates(rates, next(laws), out=tmp_path / "run")
    with pytest.raises(InputError, match="rate_scatter: found a fixed 0"):
        fit_rates(rates, law.at(), out=tmp_path / "run")
    fit = fit_rates(rates, next(laws), out=tmp_path / "run", options=TABLE_RUN)
    assert fit.sampled_well is Outcome.YES
    assert fit.summary().index.tolist() == ["rate_scatter"]
    assert law_table(fit)["quantity"].size == 5


def test_steady_rates_that_are_held_out_are_predicted_with_the_prior_of_their_excess(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    """If no fitted row is steady, E is unknown."""
    least = load_rate_table(FAN)
    steady = replace(
        least,
        id="steady",
        source=np.full(least.n_rows, "steady"),
        regime=np.full(least.n_rows, "steady"),
    )
    options = replace(TABLE_RUN, max_minutes=0.0)
    fit = fit_rates([least, steady], out=tmp_path / "run", held_out=["steady"], options=options)
    excess = np.log(
        all_draws(fit.posterior["posterior"].to_dataset()["tertiary_enhancement[axial]"])
    )
    prior = fit.law.priors["tertiary_enhancement[axial]"]
    assert excess.mean() == pytest.approx(np.log(prior.location), abs=0.15)
    assert excess.std() == pytest.approx(prior.scale, rel=0.15)
    residual = fit.held_out_table()["mean_residual"]["steady"]
    slope = all_draws(fit.posterior["posterior"].to_dataset()["stress_exponent[creep]"]).mean()
    assert residual == pytest.approx(np.log(prior.location) / slope, abs=0.15)
    draws = fit.posterior["posterior"].to_dataset()
    draws["tertiary_enhancement[axial]"].attrs["fixed"] = 1
    groups = xr.DataTree.from_dict({**fit.posterior.to_dict(), "/posterior": draws})
    monkeypatch.setattr("pyburgers.flow_law_tables.fit.load_posterior", lambda *_: groups)
    with pytest.raises(InputError, match="takes steady rates that are held out as least rates"):
        RateFit.load(tmp_path / "run")


@pytest.mark.slow
def test_truths_of_a_hundred_twins_are_covered_as_often_as_they_should(
    program: Program, tmp_path: Path
) -> None:
    options = replace(TABLE_RUN, warmup=400, draws=500, max_minutes=0.0)
    law, drawn = rate_law("ice_composite"), []
    for seed in range(100):
        data = twin(program, 60, seed=seed)
        fit = fit_rates(data, law, out=tmp_path / str(seed), options=options)
        drawn.append(covered(fit))
    for name in ("stress_exponent[dislocation]", "activation_enthalpy[dislocation]"):
        share = np.mean([one[name] for one in drawn])
        assert share > 0.8, name
