"""Joint fits through the run directory: what is written, continued, refused and shown."""

import logging
import re
import shutil
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
from conftest import POOL, SMALL_RUN, Problem, pair_of
from figure_texts import legend_texts
from matplotlib.colors import rgb_to_hsv, to_hex, to_rgb
from page import Page, html_of

import pyburgers
from pyburgers.common.errors import InputError
from pyburgers.comparison.same_data import fits_alone
from pyburgers.drawing.page_parts import PageFigure
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.problem import problem_of
from pyburgers.model.display import axis_label, shown_quantity
from pyburgers.page.joint_section import (
    INTERVALS_CAPTION,
    intervals,
    joint_section,
    pooling_table,
    sd_ratios,
    shared_figures,
    shown_pooling_table,
)
from pyburgers.page.names import joint_key, page_keys, page_names
from pyburgers.page.posterior_figures import agreement, figures_for
from pyburgers.page.tables import quoted_or_prior


def test_manifest_names_tests_pooling_and_inputs(joint: Fit) -> None:
    manifest = joint.manifest
    assert manifest["experiments"] == ["PIL40", "other"]
    assert manifest["pooling"]["kinds"]["maxwell_modulus"] == "shared"
    for name in ("tests/PIL40/experiment.csv", "tests/other/experiment.toml", "priors.toml"):
        assert f"inputs/{name}" in manifest["hashes"]


def test_shared_draws_are_the_same_in_all_tests(joint: Fit) -> None:
    first, other = (fit.posterior["posterior"].to_dataset() for fit in joint.tests().values())
    np.testing.assert_array_equal(first["maxwell_modulus"], other["maxwell_modulus"])
    assert not np.array_equal(first["stress_noise"], other["stress_noise"])
    assert "stress_noise[other]" in joint.summary("SI").index
    assert joint.summary("SI").index.is_unique


def test_every_number_of_a_joint_fit_says_who_decides_it(joint: Fit) -> None:
    summary = joint.summary("SI")
    assert (summary["decided_by"] != "").all()
    # Priors are named as rows are, with the test that has them.
    assert {*"; ".join(summary["by_prior_of"]).split("; ")} <= {"", *summary.index}
    table = pooling_table(joint)
    for row in table.to_dict("records"):
        name, test = row["quantity"], row["test"]
        key = name if name in summary.index else f"{name}[{test}]"
        assert row["decided_by"] == summary["decided_by"][key]
    shown = shown_pooling_table(table)
    assert (shown["decided by"] != "").all()
    # A number stands as it does where a fit of one test is shown.
    for name, one in joint.tests().items():
        told = quoted_or_prior(one)
        of_test = table[table["test"] == name].set_index("quantity")["quoted"]
        assert of_test.to_dict() == {quantity: told[quantity] for quantity in of_test.index}
    assert shown["PIL40"].tolist() == table[table["test"] == "PIL40"]["quoted"].tolist()


def test_loading_gives_the_same_fit(joint: Fit) -> None:
    again = Fit.load(joint.directory.path)
    assert again.summary("SI").equals(joint.summary("SI"))
    assert again.problem.pooling == joint.problem.pooling
    assert {one.posterior.attrs["protocol"] for one in again.tests().values()} == {"constant_rate"}


def test_only_missing_chains_are_run(
    joint: Fit, small_problem: Problem, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    run = tmp_path / "run"
    shutil.copytree(joint.directory.path, run)
    kept = (run / "chains" / "chain_1" / "draws.csv").read_bytes()
    shutil.rmtree(run / "chains" / "chain_2")
    caplog.set_level(logging.INFO, "pyburgers")
    again = fit(pair_of(small_problem), small_problem.priors, pool=POOL, out=run, options=SMALL_RUN)
    assert "1 of 2 chains are there already." in caplog.messages
    assert (run / "chains" / "chain_1" / "draws.csv").read_bytes() == kept
    assert again.summary("SI")["mean"].equals(joint.summary("SI")["mean"])


def test_kinds_of_runs_are_told_apart(joint: Fit, small_fit: Fit) -> None:
    assert joint.is_joint
    assert not small_fit.is_joint
    for name in ("experiment", "priors"):
        with pytest.raises(InputError, match=r"is a joint fit of PIL40\+other.*: --test PIL40, or"):
            getattr(joint, name)
    assert joint["other"].experiment.id == "other"
    assert joint["other"].is_part
    assert small_fit["PIL40"] is small_fit
    with pytest.raises(InputError, match="has no test 'PIL72'"):
        joint["PIL72"]


def test_what_was_fitted_is_told_of_all_tests(joint: Fit) -> None:
    first, other = joint.problem.experiments
    hotter = replace(other, temperature=first.temperature + 10.0)
    test = replace(joint, problem=replace(joint.problem, experiments=(first, hotter)))["PIL40"]
    exported = "\n".join(pyburgers.export(test, "aspect", microstructure="initial"))
    assert f"temperature {first.temperature:g} to {hotter.temperature:g} K" in exported
    for warmer, is_beyond in ((10.0, False), (15.0, True)):
        given = first.temperature + warmer
        cautions = pyburgers.predict_attenuation(test, [0.01], temperature=given).attrs["cautions"]
        assert (f"Beyond what was fitted: temperature {given:g} K" in cautions) == is_beyond


def test_page_shows_joint_and_separate_fits(
    joint: Fit, small_fit: Fit, other_fit: Fit, sketched: None, tmp_path: Path
) -> None:
    separate = [small_fit, other_fit]
    table = pooling_table(joint, separate)
    # Together they know a modulus as well as the precisions of both add up to.
    alone = table[table["quantity"] == "maxwell_modulus"]["separate_sd"].to_numpy(dtype=np.float64)
    together = 1 / np.sqrt(np.sum(alone**-2.0))
    assert sd_ratios(table)["maxwell_modulus"] == pytest.approx(together / alone.mean(), rel=0.3)
    (key,), (name,) = page_keys([joint]), page_names([joint])
    page = html_of(
        [*joint.tests().values(), *separate],
        tmp_path / "report",
        joints=[joint],
        extras=[joint_section(joint_key(key), name, joint, separate)],
    )
    assert f"Joint fit {name}" in page
    assert "Standard deviation of each shared parameter" in page
    assert f"{name}, all tests together" in page
    assert page.count(f'href="#joint_{key}"') >= 2
    assert (tmp_path / "report" / "tables" / f"joint_{key}_pooling.csv").is_file()
    for figure in ("curves", "intervals", "prior_posterior", "pairs", "rank"):
        assert (tmp_path / "report" / "figures" / f"joint_{key}_{figure}.svg").is_file()


def test_shared_parameters_have_panels_once(joint: Fit) -> None:
    def panels(figures: Sequence[PageFigure], name: str) -> list[str]:
        (figure,) = (one.draw() for one in figures if one.name == name)
        return [axes.get_xlabel() or axes.get_title("left") for axes in figure.axes]

    test, shared = joint["other"], joint.problem.shared
    whole, own, once = figures_for(test), figures_for(test, shared), shared_figures(joint)
    for name in ("prior_posterior", "rank"):
        assert sorted(panels(once, name) + panels(own, name)) == sorted(panels(whole, name))
    labels = [axis_label(shown_quantity(name)) for name in shared]
    assert panels(once, "prior_posterior") == labels
    # A test shows how what it has alone goes with what it shares.
    assert [len(panels(some, "pairs")) for some in (whole, own, once)] == [3, 2, 1]


def test_panels_are_left_out_only_beside_the_part_about_the_joint_fit(
    joint: Fit, sketched: None, tmp_path: Path
) -> None:
    def told(fit: Fit) -> list[str]:
        page = pyburgers.report([fit], tmp_path / "page")
        found = Page(page.read_text(encoding="utf-8")).alternatives
        return [text for text in found if text.startswith("Agreement of the chains")]

    def of(text: str) -> str:
        return text.rpartition("of ")[2].rstrip(".")

    shared = joint.problem.shared
    first, *of_tests = map(of, told(joint))
    assert first in shared
    assert not set(of_tests) & set(shared)
    assert len(of_tests) == 2
    assert told(joint["other"])[0].endswith(agreement(joint["other"]))


def test_intervals_show_fits_of_single_tests_where_there_are_some(
    joint: Fit, small_fit: Fit
) -> None:
    assert legend_texts(intervals(joint, [])) == ["joint fit"]
    figure = intervals(joint, [small_fit])
    assert legend_texts(figure) == ["joint fit", "test alone"]
    # Three parameters and the reference stress; a shared one is a band across the tests.
    panels = [axes for axes in figure.axes if axes.get_xlabel()]
    assert len(panels) == 4
    assert [len(axes.patches) for axes in panels] == [2, 2, 0, 0]


HUES = {"red": (0, 15), "orange": (15, 45), "green": (90, 170), "blue": (190, 250)}
"""Degrees of hue that a reader calls by these names."""


def colour_word(colour: str) -> str:
    hue = 360 * rgb_to_hsv(to_rgb(colour))[0]
    (word,) = (name for name, (low, high) in HUES.items() if low <= hue < high)
    return word


def test_the_caption_names_the_colours_of_the_intervals(joint: Fit, small_fit: Fit) -> None:
    words = re.findall(r"in the (joint fit|fit of the test alone) \((\w+)\)", INTERVALS_CAPTION)
    (legend,) = intervals(joint, [small_fit]).legends
    drawn = [colour_word(str(line.get_color())) for line in legend.get_lines()]
    assert drawn == [word for _, word in words]
    alone, together = (
        {
            to_hex(tuple(colour))
            for axes in intervals(joint, fits).axes
            for bars in axes.collections
            for colour in np.atleast_2d(np.asarray(bars.get_edgecolor()))
        }
        for fits in ([small_fit], [])
    )
    assert {colour_word(colour) for colour in together} == {drawn[0]}
    assert {colour_word(colour) for colour in alone - together} == {drawn[1]}


def test_fits_alone_are_those_of_the_same_data_and_laws(joint: Fit, small_fit: Fit) -> None:
    assert fits_alone(joint, [small_fit]) == {"PIL40": small_fit, "other": None}
    test = small_fit.experiment
    priors = pyburgers.with_variant(small_fit.priors, test, {"residuals": "autocorrelated"})
    problem = problem_of([test], priors)
    assert problem.variant != joint.variant
    assert set(fits_alone(joint, [replace(small_fit, problem=problem)]).values()) == {None}
