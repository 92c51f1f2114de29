"""Measured rock salt in the study: its fits, and where the page says that laws miss it."""

from dataclasses import replace
from pathlib import Path

import arviz as az
import numpy as np
import pandas as pd
import pytest
import xarray as xr
from conftest import DUNITE
from halite import (
    LAWS,
    PARTS,
    POWER_LAW,
    POWER_LAW_HARDENING,
    QUICK,
    RECORD,
    SINE,
    SINE_HARDENING,
    halite_section,
    halite_tasks,
    left_over,
    parts_of_readings,
)
from synthetic_fit import make_fit, with_problem

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.checks.verdicts import Verdict
from pyburgers.drawing.style import image
from pyburgers.fitting.campaign import fit_side_by_side
from pyburgers.fitting.sampled_fit import SampledFit
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.loading_history.files import load_loading_history
from pyburgers.model.priors import load_priors, shipped_prior_file
from pyburgers.model.variants import variant_of

HALITE = DUNITE.parent / "halite"


@pytest.fixture(scope="module")
def record() -> HistoryExperiment:
    return load_loading_history(HALITE / f"{RECORD}.toml")


def test_laws_are_fitted_to_the_same_readings() -> None:
    tasks = halite_tasks()
    assert list(tasks) == list(LAWS)
    laws = {}
    for name, task in tasks.items():
        (test,), priors = task.problem.experiments, task.problem.given_priors
        assert test.id == name
        assert test.provenance.kind == "measured"
        assert np.array_equal(test.position, tasks[POWER_LAW].problem.experiments[0].position)
        record = variant_of(priors, test).record()
        assert record["grain_size"] == "constant"
        laws[name] = (record["maxwell"], record["fabric"], record["residuals"])
    assert laws == {
        POWER_LAW: ("power_law", "constant", "autocorrelated"),
        SINE: ("hyperbolic_sine", "constant", "autocorrelated"),
        POWER_LAW_HARDENING: ("power_law", "evolving", "autocorrelated"),
        SINE_HARDENING: ("hyperbolic_sine", "evolving", "independent"),
    }
    for name in (POWER_LAW, POWER_LAW_HARDENING):
        priors = tasks[name].problem.given_priors
        # Shorter than a load, so that residuals cannot take over what drifts for weeks.
        assert priors["residual_correlation_time"].distribution().ppf(0.95) < 4 * 86400
        shipped = load_priors(shipped_prior_file("halite"))
        for exponent, share in (("grain_size_exponent", 0.1), ("stress_exponent", 1.0)):
            assert priors[exponent].scale == pytest.approx(
                share * shipped[exponent].scale, rel=0.01
            )
            assert priors[exponent].location == pytest.approx(shipped[exponent].location, rel=0.01)
    for name in (POWER_LAW_HARDENING, SINE_HARDENING):
        factor = tasks[name].problem.given_priors["steady_state_fabric_factor"]
        assert factor.upper == np.inf


@pytest.mark.slow
def test_the_closest_law_beats_a_least_squares_fit_of_a_power_law_that_hardens(
    record: HistoryExperiment, tmp_path: Path
) -> None:
    """It leaves 2.8e-4; laws without hardening leave 4.4e-4."""
    task = halite_tasks()[SINE_HARDENING]
    few = replace(task, options=replace(task.options, draws=200))
    (law,) = fit_side_by_side({SINE_HARDENING: few}, tmp_path, command="a test").values()
    draws = law.posterior["posterior"].to_dataset()
    assert not law.posterior["sample_stats"]["diverging"].any()
    for name in law.problem.free:
        assert float(az.rhat(draws[name].to_numpy())) < 1.05, name
    # Climbs end at a stiff Kelvin element, too, with a 4500th of the probability.
    assert float(draws["kelvin_modulus"].max()) < 20e9
    (stiff,) = law.manifest["other_modes"]
    (values,) = stiff["values"].values()
    assert values["kelvin_modulus"] > 100e9
    assert stiff["log_weight"] == pytest.approx(-8.2, abs=1)
    model = law.posterior["model_response"]["response"].median(("chain", "draw")).to_numpy()
    rms = left_over(record, record.response - model)["rms"]
    assert rms["all"] < 1.6e-4
    assert rms["unloading"] < 1.5e-4


def test_parts_of_the_history(record: HistoryExperiment) -> None:
    part = parts_of_readings(record)
    hours = record.time / 3600 + 3.167
    assert set(part) == set(PARTS)
    for name, first, last in (
        ("loading", 4.0, 8.0),
        ("first day under load", 9.0, 31.0),
        ("later under load", 34.0, 103.0),
        ("unloading", 105.0, 109.0),
        ("unloaded", 111.0, 157.0),
        ("loading", 475.0, 481.0),
        ("first day under load", 646.0, 668.0),
        ("unloaded", 753.0, 790.0),
    ):
        inside = (hours > first) & (hours < last)
        assert inside.sum() >= 3
        assert set(part[inside]) == {name}


def test_what_is_left_over_is_told_by_part(record: HistoryExperiment) -> None:
    part = parts_of_readings(record)
    residual = np.where(part == "unloading", -3e-4, 1e-4)
    table = left_over(record, residual)
    assert table.loc["unloading", "mean"] == pytest.approx(-3e-4)
    assert table.loc["loading", "rms"] == pytest.approx(1e-4)
    assert table.loc["all", "readings"] == record.n_points
    assert table.loc["all", "largest"] == pytest.approx(-3e-4)
    assert table.drop(index="all")["readings"].sum() == record.n_points
    # A part without readings has no row.
    early = record.time < 3600
    few = replace(
        record,
        time=record.time[early],
        reading=record.reading[early],
        reading_stage=record.reading_stage[early],
    )
    assert list(left_over(few, np.ones(few.n_points)).index) == ["loading", "all"]


def test_the_document_has_what_the_committed_page_says_is_left_over() -> None:
    saved = pd.read_csv(DUNITE.parents[1] / "reports/study/tables/measured_creep_left_over.csv")
    rms = dict(zip(saved["part"], saved["rms"].to_numpy(np.float64), strict=True))
    loading, first_day, unloading, all_of_it = (
        f"{1e4 * rms[part]:.1f}e-4"
        for part in ("loading", "first day under load", "unloading", "all")
    )
    told = f"leave {all_of_it} at the median (loading {loading}, first day of a load {first_day}, "
    text = (DUNITE.parents[1] / "docs/loading_history.md").read_text(encoding="utf-8")
    assert f"{told}unloading {unloading})" in " ".join(text.split())


def test_the_page_says_how_much_is_left_over_and_where(
    record: HistoryExperiment, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    verdicts = {
        kind: Verdict(kind, Outcome.NO, f"The answer about {kind.value}.") for kind in CheckKind
    }
    monkeypatch.setattr(SampledFit, "verdicts", lambda fit: verdicts)
    # The draws are a substitute of another protocol, which the checks of this one cannot read.
    monkeypatch.setattr(SampledFit, "checks", lambda fit: ())
    response = likelihood_of(record).response.name
    fits = {}
    for times, (name, task) in enumerate(reversed(halite_tasks().items()), start=1):
        made = make_fit(tmp_path / name, chains=2, draws=50)
        fit = with_problem(made, record, task.problem.given_priors)
        missed = times * np.where(parts_of_readings(record) == "unloading", 4e-4, 1e-4)
        model = np.broadcast_to(record.response - missed, (2, 50, record.n_points))
        fit.posterior["model_response"] = xr.Dataset(
            {response: (("chain", "draw", "point"), model)}
        )
        # `compare` asks where the points lie on the clock of the test.
        points = fit.posterior["constant_data"].to_dataset()
        fit.posterior["constant_data"] = points.rename(strain=likelihood_of(record).clock.name)
        fits[name] = fit
    section = halite_section(fits)
    told = " ".join((*section.paragraphs, *section.details))
    assert "Honorio" in told
    assert "CC BY 4.0" in told
    assert f"the {LAWS[SINE_HARDENING]} leaves least over" in told
    assert "the part 'unloading': 0.00040, on the mean 0.00040." in told
    assert "Sampled well: none of them. Describes the data: none of them." in told
    for kind in CheckKind:
        assert told.count(f"The answer about {kind.value}.") == len(LAWS)
    laws, parts = section.tables
    unloading = laws.saved.set_index("fit")["unloading"]
    assert unloading[POWER_LAW] == pytest.approx(4 * unloading[SINE_HARDENING])
    assert laws.shown.set_index("law").loc[LAWS[SINE_HARDENING], "sampled well?"] == "NO"
    assert parts.saved["part"].tolist() == [*PARTS, "all"]
    assert parts.shown.set_index("part").loc["unloading", "rms (1e-4)"] == "4.0"
    assert "Not fitted here" not in told
    assert "no measure of how close a law comes" in told
    # As `compare` has it (`pointwise_log_density`), where residuals correlate.
    assert "of each reading given all others" in told
    (figure,) = section.figures
    assert image(figure.draw(), "png")
    quick = halite_section({name: fits[name] for name in QUICK})
    missing = " and ".join(f"a {law}" for name, law in LAWS.items() if name not in QUICK)
    assert f"Not fitted here: {missing}." in quick.details
