"""Parts of a page about several runs of the same data, and about the flow law of a table."""

import json
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from page import Page, page_of
from refusals import CommandLine
from synthetic_fit import make_fit, with_problem

from pyburgers.common.draws import all_draws
from pyburgers.comparison.by_points import compare
from pyburgers.comparison.conclusions import comparison_table, sentences
from pyburgers.drawing.page_parts import PageSection
from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.softening import least_squares
from pyburgers.kinds.experiment import DataKind
from pyburgers.model.flow_law_prior import PRIOR_QUANTITIES, Conditions, FlowLawPrior
from pyburgers.model.priors import FLOW_LAW, with_flow_law
from pyburgers.model.variants import with_variant
from pyburgers.page.comparison_sections import (
    LOG_RATE,
    comparison_sections,
    flow_law_source_section,
)
from pyburgers.page.rate_section import least_squares_table, rate_section

LAW = FlowLawPrior(
    quantities=PRIOR_QUANTITIES,
    mean=np.array([3.6, 0.5, -9.2, -7.29e-4]),
    covariance=np.diag([0.1, 0.1, 0.05, 1e-6]) ** 2,
    conditions=Conditions(263.5, 6e6, 3e-4),
    material="ice",
    source="the other source",
)


FEW = (
    "kelvin_viscosity",
    "kelvin_modulus",
    "steady_state_grain_size",
    "steady_state_fabric_factor",
    "critical_strain_grain_size",
    "critical_strain_fabric",
)


def pair(folder: Path, kind: DataKind = "synthetic") -> list[Fit]:
    """Fits of the same data whose draws differ, the second with a flow law from elsewhere."""
    alone, other = (
        make_fit(folder / name, name="A", kind=kind, draws=100, fixed=FEW, apart=apart)
        for name, apart in (("alone", 0.0), ("both", 0.5))
    )
    both = with_problem(other, other.experiment, with_flow_law(alone.priors, LAW, "test"))
    return [alone, both]


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> list[Fit]:
    return pair(tmp_path_factory.mktemp("pair"))


@pytest.fixture(scope="module")
def sections(fits: list[Fit]) -> tuple[PageSection, ...]:
    return comparison_sections(fits)


def test_one_fit_of_each_data_set_leaves_nothing_to_relate(fits: list[Fit], tmp_path: Path) -> None:
    other = make_fit(tmp_path / "other", name="B", draws=100, seed=9)
    assert comparison_sections([fits[0], other]) == ()
    without_data = replace(fits[1], manifest={**fits[1].manifest, "use_likelihood": False})
    assert comparison_sections([fits[0], without_data]) == ()


def test_fits_of_the_same_data_are_compared(
    fits: list[Fit], sections: tuple[PageSection, ...]
) -> None:
    section = sections[0]
    assert section.key == "comparison_alone"
    comparison = compare({"alone": fits[0], "both": fits[1]})
    assert section.paragraphs == sentences(comparison)
    (table,) = section.tables
    pd.testing.assert_frame_equal(table.saved, comparison_table(comparison).reset_index())
    assert table.shown["fit"].tolist() == list(comparison.results)
    assert table.shown["difference"].tolist()[0] == "0.0"
    # Points that want a fit of their own are told with the command.
    high = sum(int(one.unreliable.sum()) for one in comparison.results.values())
    told = [text for text in section.details if text.startswith("To fit again")]
    assert len(told) == (high > 0)
    for text in told:
        assert "pyburgers compare" in text
        assert f"without {high} point" in text
        assert all(str(fit.directory.path) in text for fit in fits)


def test_the_sources_of_a_flow_law_stand_side_by_side(
    fits: list[Fit], sections: tuple[PageSection, ...]
) -> None:
    section = sections[1]
    assert section.key == "flow_law_both"
    saved = section.tables[0].saved.set_index("quantity")
    assert saved.index.tolist() == [*FLOW_LAW, LOG_RATE]
    for source, fit in zip(("curve alone", "both"), fits, strict=True):
        draws = all_draws(fit.posterior["posterior"].to_dataset()["stress_exponent"])
        assert saved[f"{source} mean"]["stress_exponent"] == pytest.approx(draws.mean())
        assert saved[f"{source} sd"]["stress_exponent"] == pytest.approx(draws.std(ddof=1))
    # A few hundred draws of the joint prior.
    assert saved["other source alone sd"]["stress_exponent"] == pytest.approx(0.1, rel=0.2)
    assert saved["other source alone mean"][LOG_RATE] == pytest.approx(-9.2, abs=0.02)
    shown = section.tables[0].shown.set_index("quantity")
    ratio = saved["both sd"]["stress_exponent"] / saved["curve alone sd"]["stress_exponent"]
    assert shown["sd both / curve alone"]["stress exponent"] == f"{ratio:.2f}"


def test_sources_that_disagree_are_said_to(fits: list[Fit]) -> None:
    for shift, expected in ((0.0, "agree on the flow rate"), (20.0, "disagree on the flow rate")):
        alone = fits[0].posterior["posterior"].to_dataset()
        of_curve = LAW.log_flow_rate({name: alone[name].to_numpy() for name in FLOW_LAW})
        mean = LAW.mean.copy()
        mean[2] = of_curve.mean() + shift * of_curve.std()
        law = replace(LAW, mean=mean)
        both = with_problem(fits[1], fits[1].experiment, with_flow_law(fits[0].priors, law, "test"))
        text = " ".join(comparison_sections([fits[0], both])[1].paragraphs)
        assert f"The two sources {expected}" in text


@pytest.mark.parametrize("maxwell", ["hyperbolic_sine", "threshold_stress"])
@pytest.mark.parametrize("which", ["alone", "both"])
def test_sources_are_compared_under_the_same_power_law_alone(
    fits: list[Fit], maxwell: str, which: str
) -> None:
    alone, both = fits
    other = with_problem(
        alone, alone.experiment, with_variant(alone.priors, alone.experiment, {"maxwell": maxwell})
    )
    with_law = with_problem(both, both.experiment, with_flow_law(other.priors, LAW, "test"))
    found = {"other": other, "both": both} if which == "alone" else {"a": other, "b": with_law}
    assert flow_law_source_section(found, {name: name for name in found}) == ()
    # Later fits of the group may have the same law.
    found |= {"alone": alone, "with": both}
    (section,) = flow_law_source_section(found, {name: name for name in found})
    assert section.title.startswith("Flow law of alone,")


def test_a_source_that_was_read_off_the_curve_does_not_agree_with_it(fits: list[Fit]) -> None:
    law = replace(LAW, read_off=(fits[1].experiment.id,))
    both = with_problem(fits[1], fits[1].experiment, with_flow_law(fits[0].priors, law, "test"))
    text = " ".join(comparison_sections([fits[0], both])[1].paragraphs)
    assert "agreement of prior and data means nothing" in text
    assert "The two sources" not in text


def test_a_synthetic_curve_with_another_source_says_nothing_about_nature(
    sections: tuple[PageSection, ...], tmp_path: Path
) -> None:
    assert "says nothing about nature" in " ".join(sections[1].paragraphs)
    measured = comparison_sections(pair(tmp_path, "measured"))
    assert "nature" not in " ".join(measured[1].paragraphs)


def test_least_squares_of_the_measured_table_regress_what_was_measured(peaks: RateFit) -> None:
    # Of ln(rate), which was imposed, on the others it would be 3.54 and 0.58.
    table = least_squares_table(peaks)
    for name, (value, error) in {
        "stress_exponent": (3.635, 0.136),
        "grain_size_exponent": (0.578, 0.089),
    }.items():
        assert table["least_squares"][name] == pytest.approx(value, abs=0.005)
        assert table["standard_error"][name] == pytest.approx(error, abs=0.005)
        # How softening changes with the conditions is not known from the table.
        assert table["sd"][name] > error


def test_least_squares_leave_out_a_grain_size_that_never_changes(peaks: RateFit) -> None:
    data = peaks.data
    same = replace(data, grain_size=np.full(data.n_rows, 2.3e-4))
    assert set(least_squares(same)) == {"stress_exponent"}
    few = replace(data.rows(np.arange(3)), grain_size=np.array([2e-4, 2e-4, 9e-4]))
    assert least_squares(few) == {}
    assert least_squares(replace(data, strain_rate=np.full(data.n_rows, 1e-5))) == {}
    exact = replace(data, stress=(data.strain_rate * data.grain_size**0.5 * 1e25) ** (1 / 3))
    found = least_squares(exact)
    assert found["stress_exponent"] == pytest.approx((3.0, 0.0), abs=1e-10)
    assert found["grain_size_exponent"] == pytest.approx((0.5, 0.0), abs=1e-10)


def test_all_parts_are_on_the_page_and_in_files(
    fits: list[Fit],
    sections: tuple[PageSection, ...],
    peaks: RateFit,
    sketched: None,
    tmp_path: Path,
) -> None:
    extras = (rate_section(peaks), *sections)
    page = page_of(fits, tmp_path, extras=extras)
    assert not page.open
    for extra in extras:
        assert extra.key in page.ids
        for figure in extra.figures:
            assert any(text.startswith(figure.title) for text in page.alternatives)
            assert (tmp_path / "figures" / f"{extra.key}_{figure.name}.svg").is_file()
        for table in extra.tables:
            assert (tmp_path / "tables" / f"{extra.key}_{table.name}.csv").is_file()
    assert "flow law from the other source" in page.text
    assert "are a joint one from another source." in page.text
    assert "23 tests of 1 source (measured data" in page.text
    assert "Peaks are stated at 3.0 ± 1.0 % strain" in page.text
    assert "The tests were at 263.10 to 264.05 K." in page.text
    assert "for another single one" in page.text


def test_the_report_of_two_runs_of_one_experiment_compares_them(
    small_fit: Fit, long_fit: Fit, sketched: None, tmp_path: Path, cli: CommandLine
) -> None:
    runs = [str(one.directory.path) for one in (small_fit, long_fit)]
    assert str(tmp_path / "page" / "index.html") in cli("report", *runs, "--out", tmp_path / "page")
    page = Page((tmp_path / "page" / "index.html").read_text(encoding="utf-8"))
    names = ("small fit run", "long fit run")  # the folders are called run
    assert "comparison_small_fit_run" in page.ids
    assert any(
        f"Cannot tell which of {one} and {other} predicts these data better" in page.text
        for one, other in (names, names[::-1])
    )
    manifest = json.loads((tmp_path / "page" / "manifest.json").read_text(encoding="utf-8"))
    assert len(manifest["runs"]) == 2
