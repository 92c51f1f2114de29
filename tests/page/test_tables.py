from pathlib import Path

import numpy as np
import pytest
from scipy.stats import norm
from synthetic_fit import TRUTH, make_fit, make_prior, uniform, with_problem

from pyburgers.checks.prior_influence import Bound, Influence, Origin, decision_text
from pyburgers.common.draws import value_text
from pyburgers.common.units import duration_text, number, rounded, rounded_to
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.program_data import fixed_in_effect
from pyburgers.model.display import prior_text, shown_quantity, symbol_text, unit_text
from pyburgers.model.parameters import PARAMETER_BY_NAME, PARAMETERS, PROGRAM_PARAMETERS
from pyburgers.model.prior_families import Prior
from pyburgers.model.variants import with_variant
from pyburgers.page import tables
from pyburgers.page.glossary import with_definitions
from pyburgers.page.methods import runs_table


@pytest.fixture(scope="module")
def fit(tmp_path_factory: pytest.TempPathFactory) -> Fit:
    return make_fit(tmp_path_factory.mktemp("run"), chains=2, draws=200, fixed=("beta",))


@pytest.mark.parametrize(
    ("value", "sd", "expected"),
    [
        (3.77912, 0.3012, "3.78"),
        (-0.729, 0.001, "-0.7290"),
        (155.3, 31.4, "155"),
        (12345.6, 300.0, "12346"),
        (0.1007, 0.0996, "0.101"),
        (4.0, 0.0, "4"),
        (4.0, float("nan"), "4"),
    ],
)
def test_numbers_have_the_digits_that_the_sd_supports(
    value: float, sd: float, expected: str
) -> None:
    assert rounded(value, sd) == expected


@pytest.mark.parametrize(
    ("prior", "expected"),
    [
        (uniform("grain_size_exponent", 0.1, 0.7), "U[0.1, 0.7]"),
        (uniform("kelvin_viscosity", 1e9, 5e11), "U[1, 500] GPa s"),
        (uniform("steady_state_grain_size", 10e-6, 200e-6), "U[10, 200] µm"),
        (make_prior("activation_enthalpy", "normal", 65e3, 2e3), "N(65, 2) kJ/mol"),
        (make_prior("maxwell_modulus", "normal", 4e9, 2e9, 0.0), "N(4, 2) GPa, > 0"),
        (make_prior("maxwell_modulus", "normal", 4e9, 2e9, 1e9, 9e9), "N(4, 2) GPa, in [1, 9]"),
        (make_prior("beta", "normal", -7.29e-4, 1e-6), "N(-0.729, 0.001) mol/kJ"),
        (make_prior("stress_noise", "half_normal", 0.0, 4e5, 0.0), "HN(0.4) MPa"),
        (make_prior("kelvin_modulus", "lognormal", 5e9, 0.3, 0.0), "LN(5, 0.3) GPa"),
        (make_prior("kelvin_modulus", "fixed", 5e9, 0.0), "fixed: 5 GPa"),
    ],
)
def test_priors_are_written_in_display_units(prior: Prior, expected: str) -> None:
    assert prior_text(prior) == expected
    bare = prior_text(prior, with_unit=False)
    unit = unit_text(PARAMETER_BY_NAME[prior.parameter])
    assert bare == (expected if unit == "–" else expected.replace(f" {unit}", ""))


def test_every_symbol_can_be_printed_without_mathematics() -> None:
    symbols = [symbol_text(parameter) for parameter in PROGRAM_PARAMETERS]
    assert len(set(symbols)) == len(symbols)
    assert not any(letter in symbol for symbol in symbols for letter in "\\{}$")
    assert symbol_text(shown_quantity("reference_stress")) == "S_0"


def test_the_parameter_table_shows_the_summary_in_display_units(fit: Fit) -> None:
    summary = fit.summary("SI")
    shown = tables.parameter_table(summary, fit.priors, fixed_in_effect(fit)).set_index("quantity")
    row = shown.loc["Kelvin viscosity"]
    sd = summary["sd"]["kelvin_viscosity"] / 1e9
    assert row["mean"] == rounded(summary["mean"]["kelvin_viscosity"] / 1e9, sd)
    assert row["95 %"] == rounded(summary["q95"]["kelvin_viscosity"] / 1e9, sd)
    assert row["unit"] == "GPa s"
    assert row["prior"] == "U[1, 500]"
    assert shown.loc["reference stress", "prior"] == "implied"
    assert shown.loc["pre-exponent ln(A)/Q", "prior"] == "fixed"
    assert shown.loc["pre-exponent ln(A)/Q", "mean"] == "-0.729"
    assert len(shown) == len(PARAMETERS) + 1


def test_a_page_says_what_decides_a_number_and_how_far_it_is_off(fit: Fit) -> None:
    summary, truth = fit.summary("SI"), tables.truth_table(fit)
    assert truth is not None
    shown = tables.result_table(summary, fit.priors, truth)
    assert not set(tables.SAMPLER_COLUMNS) & set(shown)
    rows = {row["quantity"]: row for row in shown.to_dict("records")}
    words = {row["decided by"].split(" (")[0] for row in rows.values()}
    assert words <= {one.value for one in Origin}
    told = summary.loc["kelvin_viscosity"]
    by = decision_text("kelvin_viscosity", str(told["decided_by"]), str(told["by_prior_of"]))
    assert rows["Kelvin viscosity"]["decided by"] == by != ""
    exponent, of_draws = rows["stress exponent"], summary.loc["stress_exponent"]
    distance = (TRUTH["stress_exponent"] - of_draws["mean"]) / of_draws["sd"]
    assert exponent["off by (sd)"] == f"{distance:+.2f}"
    assert float(exponent["truth"]) == pytest.approx(TRUTH["stress_exponent"], rel=0.1)
    assert rows["reference stress"]["truth"] == ""
    assert fit.priors["beta"].is_fixed
    assert "pre-exponent ln(A)/Q" not in rows
    assert "truth" not in tables.result_table(summary, fit.priors, None)


def test_what_to_quote_is_a_limit_at_a_bound_and_a_median_of_a_wide_number(fit: Fit) -> None:
    summary = fit.summary("SI")
    shown = tables.result_table(summary, fit.priors, None)
    rows = {name: k for k, name in enumerate(summary.index)}

    def quoted(name: str, **of_summary: float) -> str:
        bounds = {
            "stress_exponent": Bound("upper", 5.0, 0.4, is_physical=True),
            "grain_size_exponent": Bound("lower", 0.0, 0.4, is_physical=True),
            "maxwell_modulus": Bound("lower", 1e9, 0.4, is_physical=False),
        }
        influences = {name: Influence(name, {}, bound=one) for name, one in bounds.items()}
        changed = summary.astype(dict.fromkeys(of_summary, float))
        for key, value in of_summary.items():
            changed.loc[name, key] = value
        return tables.quoted(fit, changed, shown, influences)[rows[name]]

    cells = {name: shown.iloc[k] for name, k in rows.items()}
    assert quoted("stress_exponent") == f"> {cells['stress_exponent']['5 %']}"
    assert quoted("grain_size_exponent") == f"< {cells['grain_size_exponent']['95 %']}"
    for name in ("maxwell_modulus", "kelvin_viscosity"):
        assert quoted(name) == f"{cells[name]['mean']} ± {cells[name]['sd']}"
    median = float(fit.posterior["posterior"]["kelvin_viscosity"].median()) / 1e9
    wide = {"mean": 2e16, "sd": 8e16, "q5": 2.5e14, "q95": 6.6e16}
    assert (
        quoted("kelvin_viscosity", **wide)
        == f"{number(float(f'{median:.2g}'))} (250000 to 6.6e+07)"
    )
    # A number of either sign has no median in its place, unless a tail makes the width.
    assert "±" in quoted("kelvin_viscosity", **{**wide, "q5": -1e14, "q95": 2e17})
    tail = {"mean": 1.1e14, "sd": 2e13, "q5": 0.97e14, "q95": 1.03e14}
    assert quoted("kelvin_viscosity", **tail).endswith(" (97000 to 103000)")


def test_the_word_prior_or_a_limit_takes_the_place_of_a_number(
    fit: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    at_zero = Bound("lower", 0.0, 0.4, is_physical=True)
    decided = {
        "stress_exponent": Influence("stress_exponent", {"stress_exponent": 1.0}),
        "maxwell_modulus": Influence("maxwell_modulus", {"stress_exponent": 1.0}),
        "grain_size_exponent": Influence("grain_size_exponent", {}, bound=at_zero),
    }
    monkeypatch.setattr(Fit, "decisions", lambda _: decided)
    texts = tables.quoted_or_prior(fit)
    assert texts["stress_exponent"] == "prior"
    assert "±" in texts["maxwell_modulus"]
    assert texts["grain_size_exponent"].startswith("< ")
    assert tables.quoted_or_prior(None) == {}


@pytest.mark.parametrize("middle", [0.54, 0.2, -0.54])
def test_a_few_far_draws_are_not_the_width_of_a_number(middle: float) -> None:
    draws = middle + 0.012 * norm.ppf(np.linspace(0.0005, 0.9995, 1000))
    assert value_text(draws) == f"{middle:.3f} ± 0.012"
    with_tail = np.append(draws, np.full(10, middle + 1.0))
    low, high = np.quantile(with_tail, [0.05, 0.95]).round(3)
    assert value_text(with_tail) == f"{middle:g} ({low:g} to {high:g})"


def test_a_number_that_data_fix_with_a_convention_is_quoted_for_it(fit: Fit) -> None:
    priors = with_variant(fit.priors, fit.experiment, {"kelvin": "andrade"})
    summary = fit.summary("SI")
    shown = tables.result_table(summary, priors, None)
    found = tables.quoted(with_problem(fit, fit.experiment, priors), summary, shown, {})
    texts = dict(zip(summary.index, found, strict=True))
    assert texts["kelvin_viscosity"].endswith(
        f" (at E_K = {priors['kelvin_modulus'].location / 1e9:g} GPa)"
    )
    assert "(" not in texts["maxwell_modulus"]


def test_each_source_of_a_prior_stands_once(fit: Fit) -> None:
    table = tables.prior_table(fit.priors)
    other = table.assign(source=["elsewhere", *table["source"][1:]])
    found = tables.prior_sources([table, table, other])
    assert sorted(found["source"]) == sorted({*table["source"], "elsewhere"})
    assert found.set_index("source").loc["elsewhere", "of"] == table["symbol"][0]


def test_the_truth_is_looked_for_in_each_interval(fit: Fit) -> None:
    truth = tables.truth_table(fit)
    assert truth is not None
    assert list(truth.index) == [name for name in TRUTH if name != "beta"]
    for name, row in truth.iterrows():
        draws = fit.posterior["posterior"][str(name)].to_numpy()
        low, high = np.quantile(draws, [0.05, 0.95])
        assert row["inside_90"] == (low <= TRUTH[str(name)] <= high)
    assert f"{truth['inside_90'].sum()} inside 90 %" in tables.truth_sentence(truth)


def test_a_truth_far_away_is_outside_every_interval(tmp_path: Path) -> None:
    wrong = {**TRUTH, "stress_exponent": 20.0}
    truth = tables.truth_table(make_fit(tmp_path, chains=2, draws=50, true_parameters=wrong))
    assert truth is not None
    row = truth.loc["stress_exponent"]
    assert not row[["inside_50", "inside_90", "inside_95"]].any()


def test_measured_data_have_no_truth_and_a_run_has_its_state_and_the_time_of_its_chains(
    tmp_path: Path,
) -> None:
    fit = make_fit(tmp_path, chains=2, draws=20, kind="measured")
    assert tables.truth_table(fit) is None
    (row,) = runs_table([("A", fit)]).to_dict("records")
    assert (row["fit"], row["state"]) == ("A", fit.manifest["status"])
    assert row["fingerprint"] == fit.manifest["fingerprint"]
    assert row["all chains"] == "2 min"


def test_numbers_and_durations_are_short() -> None:
    assert number(0.1 * 3) == "0.3"
    assert [rounded_to(x) for x in (104.0, 0.00123, 1250.0)] == ["100", "0.0012", "1200"]
    assert [duration_text(s) for s in (5.2, 600.0, 9000.0)] == ["5 s", "10 min", "2.5 h"]


@pytest.mark.parametrize(
    "term",
    [
        "log predictive density",
        "predictive median",
        "replicated data",
        "Maxwell time",
        "Debye peak",
    ],
)
def test_a_technical_word_has_its_meaning_behind_it(term: str) -> None:
    marked = with_definitions(f"The {term}, and the {term} again.")
    assert marked.count(f">{term}</abbr>") == 1
