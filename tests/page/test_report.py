import hashlib
import json
import shutil
from collections.abc import Sequence
from dataclasses import replace
from importlib import resources
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import sketch_pictures
from page import Page, html_of, page_of
from same_contents import contents
from synthetic_fit import make_fit, make_prior, with_problem
from synthetic_olivine_fit import make_olivine_fit, oscillating, redrawn

from pyburgers.checks.fit_checks import CheckKind, CheckResult, Outcome
from pyburgers.checks.prior_influence import (
    CONFLICT_MEANING,
    Origin,
    prior_influence,
)
from pyburgers.checks.verdicts import ANSWERS, Verdict, verdicts
from pyburgers.common.errors import InputError
from pyburgers.drawing.page_parts import PageSection
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.experiment import Provenance
from pyburgers.kinds.forced_oscillation.preparation import Background
from pyburgers.model import display
from pyburgers.page import overview
from pyburgers.page.glossary import DEFINITIONS, ORIGIN_RULES, SHARE_TEXT, with_definitions
from pyburgers.page.page import report, write_report
from pyburgers.page.posterior_figures import figures_for

FEW = (
    "maxwell_modulus",
    "kelvin_viscosity",
    "kelvin_modulus",
    "grain_size_exponent",
    "activation_enthalpy",
    "beta",
    "steady_state_grain_size",
    "steady_state_fabric_factor",
    "critical_strain_fabric",
)
HOSTILE = "<script>alert('data')</script> & \"quotes\""
BACKGROUNDS: tuple[Background, Background] = ("removed", "kept")
TEXT_COLUMNS = {"decided_by": str, "by_prior_of": str}
COMMAND = "pyburgers report runs/A runs/B --out page"


def write(fits: Sequence[Fit], out: Path) -> Page:
    return page_of(fits, out, title="Two tests", command=COMMAND)


def small_fit(path: Path, name: str = "A", **changes: Any) -> Fit:
    arguments: dict[str, Any] = {"chains": 2, "draws": 300, "fixed": FEW, **changes}
    return make_fit(path, name=name, **arguments)


@pytest.fixture(scope="module")
def folder(tmp_path_factory: pytest.TempPathFactory) -> Path:
    return tmp_path_factory.mktemp("report")


@pytest.fixture(scope="module")
def fits(folder: Path) -> list[Fit]:
    """A synthetic test whose checks fail and a measured one that passes."""
    failing = small_fit(folder / "runs" / "A", divergences=5, apart=3.0)
    hostile = Provenance("measured", HOSTILE, doi='10.1/x" onload="y', notes=f"{HOSTILE} \u202e")
    passing = small_fit(
        folder / "runs" / "B",
        "B",
        kind="measured",
        segments=((0.0, 1e-4), (0.05, 1e-5)),
        provenance=hostile,
        notices=(HOSTILE,),
        material=HOSTILE,
        metadata={HOSTILE: HOSTILE},
        command=HOSTILE,
        draws=600,
    )
    return [failing, passing]


@pytest.fixture(scope="module")
def page(folder: Path, fits: list[Fit]) -> Page:
    return write(fits, folder / "page")


@pytest.fixture(scope="module")
def passing_page(fits: list[Fit], tmp_path_factory: pytest.TempPathFactory) -> Page:
    """Page about the measured test alone."""
    with pytest.MonkeyPatch.context() as patch:
        sketch_pictures(patch)
        return write([fits[1]], tmp_path_factory.mktemp("passing"))


def test_the_page_is_well_formed_and_needs_nothing_but_itself(page: Page) -> None:
    assert not page.open
    assert len(set(page.ids)) == len(page.ids)
    for tag, reference in page.references:
        if tag == "a" and reference.startswith("#"):
            assert reference[1:] in page.ids
    assert not {"link", "iframe", "object", "img"} & set(page.tags)
    assert page.tags.count("script") == 1
    for tag, reference in page.references:
        linked = ("#", "https://doi.org/", "tables/", "figures/")
        allowed = linked if tag == "a" else ("#", "data:image/png;")
        assert reference.startswith(allowed), reference


def test_every_figure_is_on_the_page_with_a_text_alternative_and_in_files(
    page: Page, folder: Path, fits: list[Fit]
) -> None:
    expected = [
        f"{recipe.title}, {name}: {recipe.result}"
        for name, fit in (("B", fits[1]), ("A", fits[0]))  # measured first
        for recipe in figures_for(fit)
    ]
    assert page.alternatives == expected
    assert len(set(expected)) == len(expected)
    for recipe in figures_for(fits[0]):
        base = folder / "page" / "figures" / f"A_{recipe.name}"
        assert base.with_suffix(".png").read_bytes().startswith(b"\x89PNG")
        assert "<svg" in base.with_suffix(".svg").read_text(encoding="utf-8")


def test_figures_have_numbers_and_later_ones_lead_to_the_same_caption(
    page: Page, fits: list[Fit]
) -> None:
    shown = list(zip(figures_for(fits[1]), figures_for(fits[0]), strict=True))
    for number, (first, later) in enumerate(shown, start=1):
        assert page.text_without_marks.count(first.caption) == 1
        assert f"figure-A_{later.name}" in page.ids
        if first.caption == later.caption:
            assert ("a", f"#figure-B_{first.name}") in page.references
            assert f"Legend: Figure {number} ." in page.text
    # Only one of the tests changes its rate.
    differ = [(first, later) for first, later in shown if first.caption != later.caption]
    assert [first.name for first, _ in differ] == ["stress_strain"]
    assert ["Dotted vertical lines" in one.caption for one in differ[0]] == [True, False]
    for number in range(1, 2 * len(shown) + 1):
        assert page.text.count(f"Figure {number}.") == 1
    assert shown[0][0].caption in page.unfolded


def test_strings_from_files_are_escaped(folder: Path, page: Page) -> None:
    raw = (folder / "page" / "index.html").read_text(encoding="utf-8")
    assert raw.count("<script>") == 1
    assert HOSTILE not in raw
    assert "\u202e" not in raw
    assert r"\u202e" in raw
    assert 'onload="y' not in raw
    assert page.text.count(HOSTILE) >= 5


def test_measured_data_come_first_and_synthetic_data_are_announced_by_name(
    page: Page, passing_page: Page
) -> None:
    assert page.ids.index("B") < page.ids.index("A")
    overview = page.text.rindex("Overview")
    assert page.text.index("B measured", overview) < page.text.index("A synthetic", overview)
    banner = page.text.index("SYNTHETIC DATA: A")
    assert banner < page.text.rindex("Overview")
    assert "say nothing about nature" in page.text
    assert "page-synthetic-data" in page.ids
    assert "SYNTHETIC DATA: A , B" not in page.text
    assert "page-synthetic-data" not in passing_page.ids
    assert "SYNTHETIC DATA" not in passing_page.text
    assert "MEASURED DATA" in passing_page.text


def test_failed_checks_cannot_be_overlooked(page: Page, fits: list[Fit]) -> None:
    failed = [check for check in fits[0].checks() if not check.passed]
    assert {"R-hat", "divergences"} <= {check.name for check in failed}
    told = page.text.index("✗ Was the posterior sampled well? Yes in 1 of 2 fits. NO : A .")
    assert told < page.text.index("Overview", told)
    names = [check.name for check in failed if check.check.kind is CheckKind.SAMPLING]
    assert f"NO: {', '.join(names)}" in page.text
    for check in failed:
        if check.check.kind is CheckKind.SAMPLING:
            name = check.name[0].upper() + check.name[1:]
            assert f"{name}: {check.meaning}" in page.text_without_marks
        if check.remedy:  # among the remedies, and in the fold of the fit
            assert page.text_without_marks.count(f"{check.remedy}.") == 2
    for fit in fits:
        passed = [check for check in fit.checks() if check.passed]
        mark = "✓" if len(passed) == len(fit.checks()) else "✗"
        assert f"{mark} {len(passed)} of {len(fit.checks())} checks passed" in page.text
        for check in passed:
            assert f"{check.name}passed{check.sentence}" in page.text_without_marks
        for kind in CheckKind:
            made = [check.name for check in fit.checks() if check.check.kind is kind]
            assert page.text_without_marks.count(f"{kind.value} {', '.join(made)}") == 1


def test_a_page_without_failures_says_so(fits: list[Fit], passing_page: Page) -> None:
    assert all(check.passed for check in fits[1].checks())
    for kind in CheckKind:
        assert f"✓ {ANSWERS[kind][Outcome.YES]}" in passing_page.unfolded
    assert "FAILED" not in passing_page.text


def test_the_page_of_one_fit_begins_with_its_figure_and_three_answers(
    fits: list[Fit], passing_page: Page, sketched: None, tmp_path: Path
) -> None:
    assert "page-overview" not in passing_page.ids
    answers = [f"✓ {ANSWERS[kind][Outcome.YES]}" for kind in CheckKind]
    short = [f"✓ {kind.value} Yes." for kind in CheckKind]
    words = [*short, "constant rate, 260 K", "Figure 1.", "The data decide", *answers, "decided by"]
    places = [passing_page.unfolded.index(text) for text in words]
    assert places == sorted(places)
    by_data = fits[1].summary().query("decided_by == 'data'")
    told = passing_page.unfolded.partition("The data decide")[2].partition("Data and priors")[0]
    assert told.count("±") == len(by_data) > 0
    # Numbers of draws that do not serve are not quoted.
    failed = write([fits[0]], tmp_path)
    assert "The data decide" not in failed.unfolded
    told = "NO: A. Do not use numbers of this fit before you have read why."
    assert failed.unfolded.index(told) < failed.unfolded.index("Figure 1.")


def test_findings_of_a_study_stand_in_a_table_above_its_folded_fits(
    fits: list[Fit], sketched: None, tmp_path: Path
) -> None:
    parts = (
        PageSection("study", "A study", ("Ice creeps.", "More.")),
        PageSection("behind", "Behind", ("Last.",), after_fits=True),
    )
    page = page_of(fits, tmp_path, extras=parts)
    assert "Overviewpartfound" + "AstudyIcecreeps.All2fits" in "".join(page.unfolded.split())
    assert page.text.count("Last.") == 1
    assert "stress exponent n" in page.text
    assert "in 90 % band" not in page.unfolded


def test_what_cannot_be_told_is_no_finding(sketched: None, tmp_path: Path) -> None:
    few = small_fit(tmp_path / "runs" / "few", draws=12)
    assert {verdict.outcome for verdict in few.verdicts().values()} == {Outcome.CANNOT_TELL}
    text = write([few], tmp_path / "page").text
    for kind in CheckKind:
        assert f"? {ANSWERS[kind][Outcome.CANNOT_TELL]}" in text
    assert "Intervals of this fit may leave out what the model misses." in text


def test_a_no_and_a_doubt_have_their_own_consequences(
    fits: list[Fit], sketched: None, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    kind = CheckKind.DESCRIPTION

    def a_yes_is_a_no(checks: Sequence[CheckResult]) -> dict[CheckKind, Verdict]:
        found = verdicts(checks)
        if found[kind].outcome is Outcome.YES:
            found[kind] = replace(found[kind], outcome=Outcome.NO)
        return found

    monkeypatch.setattr(overview, "verdicts", a_yes_is_a_no)
    few = small_fit(tmp_path / "runs" / "few", draws=12)
    page = write([few, fits[1]], tmp_path / "page")
    told = "NO: B. Intervals of this fit leave out what the model misses."
    doubt = "Cannot tell: few. Intervals of this fit may leave out what the model misses."
    assert f"{told} {doubt}" in page.text_without_marks


def test_both_answers_stand_in_the_contents_and_in_the_section(page: Page, fits: list[Fit]) -> None:
    for fit in fits:
        for kind, verdict in fit.verdicts().items():
            assert f"{kind.value} {verdict.outcome.value}" in page.labels
            if verdict.outcome is Outcome.YES:
                notes = [one.note for one in fit.checks() if one.check.kind is kind and one.note]
                told = "; ".join([ANSWERS[kind][verdict.outcome], *notes])
                assert f"{told}." in page.text_without_marks


def test_conflicts_of_prior_and_data_stand_at_the_top(
    fits: list[Fit], sketched: None, tmp_path: Path
) -> None:
    far = make_prior("stress_exponent", "normal", 40.0, 1.0)
    priors = fits[1].priors
    moved = replace(priors, priors=MappingProxyType({**priors.priors, "stress_exponent": far}))
    fit = with_problem(fits[1], fits[1].experiment, moved)
    (conflict,) = fit.prior_conflicts()
    assert "stress exponent (-" in conflict
    page = write([fit], tmp_path / "page")
    told = f"! Prior and data disagree in B : {CONFLICT_MEANING}."
    assert page.text.index(told) < page.text.index("constant rate, 260 K")
    assert page.text.count(CONFLICT_MEANING) == 1
    named = conflict.removeprefix("B: ").removesuffix(f": {CONFLICT_MEANING}.")
    assert f"{named}." in page.text_without_marks


def test_parts_have_their_alarms_and_the_verdicts_of_their_fits_at_the_top(
    fits: list[Fit], sketched: None, tmp_path: Path
) -> None:
    alarms = ("This must not be missed.",)
    parts = [
        PageSection("part", "A part", (), alarms=alarms, details=("Alike.", "one")),
        PageSection("other", "Another", (), details=("Alike.", "two")),
    ]
    page = page_of([fits[1]], tmp_path, extras=parts, told={"part": [fits[0]]})
    assert page.text.index(alarms[0]) < page.text.rindex("Overview")
    name = fits[0].directory.path.name
    # Contents, verdicts and overview lead to the reasons, which stand in the part.
    assert page.references.count(("a", f"#verdicts-{name}")) >= 3
    assert f"verdicts-{name}" in page.ids
    assert page.text.rindex("Both verdicts, fit by fit") < page.text.rindex(name)
    runs = json.loads((tmp_path / "manifest.json").read_text())["runs"]
    assert [run["directory"] for run in runs] == [fits[1].directory.path.name, name]
    # What parts tell alike stands once.
    assert page.text.count("Alike.") == 1
    assert ("a", "#part-found") in page.references


def test_a_fit_without_likelihood_says_so(sketched: None, tmp_path: Path) -> None:
    fit = small_fit(tmp_path / "run")
    fit.manifest["use_likelihood"] = False
    text = write([fit], tmp_path / "page").text
    assert "Fitted without the data." in text
    assert "decided by" not in text


def test_what_was_not_good_enough_to_sample_with_is_told(sketched: None, tmp_path: Path) -> None:
    fit = small_fit(tmp_path / "run")
    told_of = {
        "noisy": [{"tolerance": 1e-5, "noise": 5.6}],
        "refits": [{"tolerance": 1e-6, "pareto_k": 0.9, "chains": "superseded/tolerance_1e-06"}],
        "shortened": [
            {"divergences": 3, "chains": "superseded/longer_steps_1", "step_sizes": {"1": 0.1}}
        ],
        "more_draws": [50, 70],
    }
    fit = replace(fit, manifest={**fit.manifest, **told_of})
    text = write([fit], tmp_path / "page").text
    for told in (
        "At tolerance 1e-05 of the solver the log density jumped by 5.6 from point to point",
        "A first run at tolerance 1e-06 was put aside (superseded/tolerance_1e-06)",
        "Chains with 3 divergences were put aside (superseded/longer_steps_1)",
        f"{fit.manifest['sampler']['draws']} + 50 + 70 draws, seed",
    ):
        assert told in text


def test_the_page_says_what_prior_and_data_decide(
    folder: Path, page: Page, fits: list[Fit], sketched: None, tmp_path: Path
) -> None:
    # Of each fit a table of what the data say, and a folded one of everything.
    # One more tells what the words mean.
    assert page.text.count("decided by") == 2 * len(fits) + 1
    # Definitions of words stand apart in the text.
    squeezed = "".join(page.text.split())
    for text in (SHARE_TEXT, *(rule for told in ORIGIN_RULES.values() for rule in told)):
        assert squeezed.count("".join(text.split())) == 1
    for fit in fits:
        file = folder / "page" / "tables" / f"{fit.experiment.id}_influence.csv"
        written = pd.read_csv(file, index_col=0, dtype=TEXT_COLUMNS)
        influences = prior_influence(fit.posterior, fit.priors)
        assert written["prior_share"].to_dict() == {
            name: pytest.approx(one.prior_share) for name, one in influences.items()
        }
        decided = fit.summary()[["decided_by", "by_prior_of"]]
        assert written[["decided_by", "by_prior_of"]].fillna("").equals(decided)
    # A posterior that data have not touched: as wide as its prior, and moved by nothing.
    untouched = small_fit(tmp_path / "run")
    shape = untouched.posterior["posterior"]["stress_exponent"].shape
    values = untouched.priors["stress_exponent"].distribution().rvs(shape, random_state=1)
    drawn = redrawn(untouched, stress_exponent=np.asarray(values))
    html = html_of([drawn], tmp_path / "p")
    told = [line for line in html.splitlines() if 'bad">' in line]
    assert any("stress exponent" in line and 'class="words bad">prior<' in line for line in told)


def test_columns_are_explained_where_a_table_has_them(page: Page, passing_page: Page) -> None:
    for one, has_truth in ((page, True), (passing_page, False)):
        assert ("off by (sd)" in one.text) is has_truth
        assert ("“off by” is truth less mean" in one.text) is has_truth
    before, found, _ = page.text.partition(next(iter(ORIGIN_RULES.values()))[0])
    assert found
    assert "Who decided this number" in before
    assert set(ORIGIN_RULES) == set(Origin)


def test_the_page_says_how_to_make_everything_again(page: Page, fits: list[Fit]) -> None:
    assert COMMAND in page.text
    manifest = fits[0].manifest
    for text in (manifest["command"], manifest["fingerprint"]):
        assert text in page.text
    assert f"seed {manifest['sampler']['seed']}" in page.text


def test_how_fits_were_made_is_told_of_all_that_were_made_alike(
    sketched: None, tmp_path: Path
) -> None:
    twins = [small_fit(tmp_path / name) for name in ("first", "second")]
    for seed, times in ((twins[0].manifest["sampler"]["seed"], 1), (77, 2)):
        twins[1].manifest["sampler"]["seed"] = seed
        page = write(twins, tmp_path / "page")
        text = page.text
        assert text.count("iterations of warm-up") == times
        assert f"seed {seed}" in text
    assert {"first", "second"} <= set(page.ids)
    assert (tmp_path / "page" / "tables" / "second_summary.csv").is_file()


def test_tables_hold_the_summary_at_full_precision(folder: Path, fits: list[Fit]) -> None:
    for fit in fits:
        key = fit.experiment.id
        file = folder / "page" / "tables" / f"{key}_summary.csv"
        written = pd.read_csv(file, index_col=0, dtype=TEXT_COLUMNS).fillna({"by_prior_of": ""})
        pd.testing.assert_frame_equal(
            written, fit.summary("SI"), check_exact=True, check_dtype=False
        )
        checks = pd.read_csv(folder / "page" / "tables" / f"{key}_checks.csv")
        assert (checks["verdict"] == "passed").tolist() == [c.passed for c in fit.checks()]
        assert checks["sentence"].tolist() == [c.sentence for c in fit.checks()]
    assert (folder / "page" / "tables" / "A_truth.csv").is_file()
    assert not (folder / "page" / "tables" / "B_truth.csv").exists()


def test_the_manifest_pins_the_runs(folder: Path, fits: list[Fit]) -> None:
    manifest = json.loads((folder / "page" / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["command"] == COMMAND
    assert manifest["versions"]["matplotlib"]
    for run, fit in zip(manifest["runs"], fits, strict=True):
        content = fit.directory.manifest_file.read_bytes()
        assert run["manifest_sha256"] == hashlib.sha256(content).hexdigest()


def test_a_report_replaces_an_earlier_one_and_leaves_no_scraps(
    folder: Path, page: Page, fits: list[Fit], sketched: None, tmp_path: Path
) -> None:
    assert "Two tests" in page.text
    copy = shutil.copytree(folder / "page", tmp_path / "page")
    assert "A" not in write([fits[1]], copy).ids
    assert not [path for path in copy.rglob("*") if path.name.startswith(".")]


def test_what_is_no_earlier_page_is_not_overwritten(fits: list[Fit], tmp_path: Path) -> None:
    run = fits[0].directory
    page, file, data = tmp_path / "page", tmp_path / "file", tmp_path / "data"
    for own, name in ((page, "index.html"), (data, "readings.csv")):
        own.mkdir()
        (own / name).write_text("mine", encoding="utf-8")
    file.write_text("", encoding="utf-8")
    for what, out, words in (
        (fits, run.path, "something else than a report"),
        (fits, page, "something else than a report"),
        (fits, data, "something else than a report"),
        (fits, file / "page", "cannot be written"),
        ([], tmp_path / "new", "at least one run"),
    ):
        before = contents(out)
        with pytest.raises(InputError, match=words):
            write(what, out)
        assert contents(out) == before


def test_a_figure_that_fails_ends_the_report(tmp_path: Path) -> None:
    fit = small_fit(tmp_path / "run")
    del fit.posterior["predictions"]
    with pytest.raises(KeyError):
        write([fit], tmp_path / "page")
    assert not (tmp_path / "page" / "index.html").exists()


def test_processes_write_the_same_pictures(folder: Path, fits: list[Fit], page: Page) -> None:
    out = folder / "by_processes"
    write_report([fits[1]], out, title="x", command="x", jobs=2)
    pictures = sorted((out / "figures").glob("*.png"))
    assert len(pictures) == len(figures_for(fits[1]))
    for picture in pictures:
        assert picture.read_bytes() == (folder / "page" / "figures" / picture.name).read_bytes()
        assert picture.with_suffix(".svg").is_file()


@pytest.fixture(scope="module")
def oscillations(tmp_path_factory: pytest.TempPathFactory) -> Path:
    """Page of a curve and of both treatments; the one with background kept misses the phase."""
    path = tmp_path_factory.mktemp("oscillation")
    removed, kept = (
        make_olivine_fit(path / "runs" / background, background, chains=2, draws=60)
        for background in BACKGROUNDS
    )
    shifted = oscillating(kept, amplitude_sd=0.01, phase_sd=0.01, phase_shift=0.3)
    curve = small_fit(path / "runs" / "B", "B", kind="measured", draws=60)
    with pytest.MonkeyPatch.context() as patch:
        sketch_pictures(patch)
        write([curve, removed, shifted], path / "page")
    return path / "page"


@pytest.fixture(scope="module")
def shown(oscillations: Path) -> Page:
    return Page((oscillations / "index.html").read_text(encoding="utf-8"))


def test_an_oscillation_says_what_was_done_to_the_record(shown: Page) -> None:
    assert not shown.open
    assert "SYNTHETIC DATA: removed , kept" in shown.text
    assert shown.text.count("Period 300 s") == 2
    assert shown.text.count("Strain amplitude 0.2 %") == 2
    assert shown.text.count("on record, 2 of spin-up ahead of it") == 2
    assert "Background removed: polynomial trends" in shown.text
    assert "Background kept: the rate of the strain's trend" in shown.text
    assert shown.text.count("The reference flow rate") == 1
    # The curve on the same page has its own.
    assert shown.text.count("Strain rate 1.69 × 10") == 1
    assert shown.text.count("The reference stress S") == 1
    # True under laws with a threshold or a backstress too.
    assert shown.text.count("by its power law alone") == 2


def test_amplitude_and_lag_stand_beside_those_of_replicated_data(
    shown: Page, oscillations: Path
) -> None:
    inside, outside = (
        pd.read_csv(oscillations / "tables" / f"{background}_response.csv", index_col=0)
        for background in BACKGROUNDS
    )
    assert inside["inside"].tolist() == [True, True]
    assert outside["inside"].tolist() == [True, False]
    assert shown.text.count("are inside the central 90 % of those of the replicated data") == 1
    assert shown.text.count("The record is outside the central 90 %") == 1


def test_copied_tables_know_every_letter_of_symbols_and_units() -> None:
    script = resources.files("pyburgers") / "templates" / "report.js"
    marks = next(
        line for line in script.read_text(encoding="utf-8").splitlines() if "const marks" in line
    )
    for letters in (*display._GREEK.values(), *"".join(display._UNIT_TEXT.values())):
        assert letters.isascii() or f'"{letters}": "$' in marks or letters == "–"


def test_a_page_of_one_fit_is_called_after_its_test(
    fits: list[Fit], sketched: None, tmp_path: Path
) -> None:
    for some, title in (([fits[0]], "A: ice, constant rate"), (fits, "Nonlinear Burgers fits")):
        page = report(some, tmp_path / str(len(some)))
        assert f"<title>{title}</title>" in page.read_text(encoding="utf-8")


def test_options_of_commands_are_marked_and_stay_on_a_line() -> None:
    told = with_definitions("add draws (--more-draws 8), or --variant kelvin=extended <draws>")
    assert str(told) == (
        f'add <abbr title="{DEFINITIONS["draws"]}">draws</abbr> (<code class="whole">--more-draws '
        '8</code>), or <code class="whole">--variant kelvin=extended</code> &lt;draws&gt;'
    )
