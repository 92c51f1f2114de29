"""The parts of the study's page beside the fits."""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import ICE, sketch_pictures
from dunite import JOINT_RUN, ONE_RATE, STEPPED, TOGETHER
from growing_page import GrowingPage
from halite import QUICK as HALITE_RUNS
from maor import sections as maor_sections
from maor.attenuation import MICROSTRUCTURE_SENTENCE
from maor.counterparts import counterparts_table
from maor.olivine import background_section
from maor.sections import (
    ELASTIC_MODULUS_SENTENCE,
    ICE_MODULUS,
    SYNTHETIC_SENTENCE,
    ice_attenuation_section,
    study_sections,
)
from olivine_spectra import LAWS, run_name
from page import Page
from study import (
    COMBINED_RUN,
    ICE_RATES,
    ICE_TABLES,
    ICE_TWINS,
    MAIN,
    MAX_MINUTES,
    OLIVINE_RUNS,
    PEAK_STRESS_TABLE,
    Study,
    main,
    main_part,
    study_experiments,
    whole_study,
)
from synthetic_fit import TRUTH, make_fit, with_problem
from synthetic_olivine_fit import make_olivine_fit
from truths import truth_of

from pyburgers.common.draws import all_draws
from pyburgers.drawing.page_parts import PageSection
from pyburgers.fitting.campaign import Task
from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.laws import RateLaw
from pyburgers.flow_law_tables.tables import RateTable
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.experiment import of_kind
from pyburgers.kinds.forced_oscillation.experiment import OscillationExperiment
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.loading_history.experiment import HistoryExperiment
from pyburgers.kinds.problem import Problem
from pyburgers.page.page import write_report
from pyburgers.predictions.attenuation import predict_attenuation, quantile_table
from pyburgers.predictions.evolving import evolving_attenuation
from pyburgers.predictions.measured_attenuation import MeasuredAttenuation
from pyburgers.predictions.stress_cycles import PAPER_REGIMES


@pytest.fixture(scope="module")
def ice(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fit]:
    folder = tmp_path_factory.mktemp("ice")
    return {name: make_fit(folder / name, name=name, draws=50) for name in ("PIL40", "PIL72")}


@pytest.fixture(scope="module")
def olivine(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fit]:
    folder = tmp_path_factory.mktemp("olivine")
    return {
        "removed": make_olivine_fit(folder / "removed", "removed"),
        "kept": make_olivine_fit(folder / "kept", "kept"),
    }


@pytest.fixture(autouse=True, scope="module")
def few_solved_draws() -> Iterator[None]:
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(maor_sections, "PRIOR_DRAWS", {"ice": 60, "olivine": 30})
        patch.setattr("maor.stress_floor.SOLVED_DRAWS", 2)
        patch.setattr(
            "pyburgers.page.attenuation_section.evolving_attenuation",
            partial(evolving_attenuation, max_draws=4),
        )
        yield


FEW_FREE = tuple(name for name in TRUTH if name not in {"stress_exponent", "stress_noise"})
"""Parameters that are fixed in fits whose own sections do not matter here."""


@pytest.fixture(scope="module")
def sections(ice: dict[str, Fit], olivine: dict[str, Fit]) -> tuple[PageSection, ...]:
    return study_sections(ice, olivine)


@pytest.fixture(scope="module")
def folder(sections: tuple[PageSection, ...], tmp_path_factory: pytest.TempPathFactory) -> Path:
    out = tmp_path_factory.mktemp("page")
    fit = make_fit(tmp_path_factory.mktemp("run") / "PIL40", chains=2, draws=300, fixed=FEW_FREE)
    with pytest.MonkeyPatch.context() as patch:
        sketch_pictures(patch)
        write_report([fit], out, title="Study", command="x", extras=sections)
    return out


@pytest.fixture(scope="module")
def page(folder: Path) -> Page:
    return Page((folder / "index.html").read_text(encoding="utf-8"))


def test_the_page_holds_every_part_with_its_files_in_its_place(
    page: Page, sections: tuple[PageSection, ...], folder: Path, ice: dict[str, Fit]
) -> None:
    assert not page.open
    assert len(set(page.ids)) == len(page.ids)
    links = [reference for tag, reference in page.references if tag == "a"]
    for section in sections:
        assert f"#{section.key}" in links
    places = [
        page.ids.index(key) for key in ("page-overview", "statements", "PIL40", "attenuation")
    ]
    assert places == sorted(places)
    for section in sections:
        for figure in section.figures:
            assert any(text.startswith(figure.title) for text in page.alternatives)
            picture = folder / "figures" / f"{section.key}_{figure.name}.png"
            assert picture.read_bytes().startswith(b"\x89PNG")
            assert "<svg" in picture.with_suffix(".svg").read_text(encoding="utf-8")
    names = {s.key: [figure.name for figure in s.figures] for s in sections}
    assert names["preparation"] == ["olivine_removed", "olivine_kept"]
    assert names["model"] == ["circuit", "strain_parts", "mean_solution", "flow_laws"]
    of_attenuation = {"PIL40_spectrum", "PIL72_spectrum", "PIL40_draws", "PIL40_amplitude"}
    assert of_attenuation <= set(names["attenuation"])
    for name, fit in ice.items():
        written = pd.read_csv(folder / "tables" / f"attenuation_{name}_quantiles.csv")
        pd.testing.assert_frame_equal(written, quantile_table(predict_attenuation(fit)))


def test_statements_stand_with_verdict_evidence_and_rule(
    page: Page, sections: tuple[PageSection, ...], folder: Path
) -> None:
    table, grounds = sections[0].tables
    assert len(table.shown) == len(grounds.shown) == 24
    assert grounds.shown["rule"].str.endswith(".").all()
    for row in table.shown.to_dict("records"):
        for cell in row.values():
            assert " ".join(str(cell).split()) in page.text_without_marks
    for one in (table, grounds):
        assert ("a", f"tables/statements_{one.name}.csv") in page.references or not one.in_files
        written = pd.read_csv(folder / "tables" / f"statements_{one.name}.csv")
        pd.testing.assert_frame_equal(written, one.saved)
    assert grounds.in_files


def no_attenuation(*_: object) -> PageSection:
    return PageSection(key="attenuation", title="", paragraphs=())


def test_the_page_says_what_verdicts_on_synthetic_data_mean(
    page: Page, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    assert SYNTHETIC_SENTENCE in page.text
    assert MICROSTRUCTURE_SENTENCE in page.text
    monkeypatch.setattr("maor.sections.ice_attenuation_section", no_attenuation)
    measured = {"PIL40": make_fit(tmp_path / "run", kind="measured", draws=100)}
    without_olivine = study_sections(measured, {})
    keys = [section.key for section in without_olivine]
    assert keys == ["statements", "counterparts", "model", "attenuation"]
    assert SYNTHETIC_SENTENCE not in without_olivine[0].paragraphs
    assert not without_olivine[0].tables[0].shown["statement"].str.contains("olivine").any()


def test_one_modulus_of_ice_leaves_what_kelvin_element_and_dashpot_differ_by(
    page: Page, folder: Path, ice: dict[str, Fit]
) -> None:
    written = pd.read_csv(folder / "tables" / "attenuation_elastic_modulus.csv")
    assert written["sample"].unique().tolist() == list(ice)
    for name, fit in ice.items():
        rows = written[written["sample"] == name]
        given = predict_attenuation(
            fit, rows["frequency_Hz"].tolist(), PAPER_REGIMES[:1], elastic_modulus=ICE_MODULUS
        )["tan_delta"]
        np.testing.assert_allclose(rows["ice_q50"], given.median(("chain", "draw"))[0], rtol=1e-9)
        assert (rows["ice_q50"] > rows["own_q50"]).all()
    assert ELASTIC_MODULUS_SENTENCE in page.text_without_marks


def test_the_page_says_what_removing_the_background_changes(
    sections: tuple[PageSection, ...], olivine: dict[str, Fit]
) -> None:
    background = {section.key: section for section in sections}["background"]
    (table,) = background.tables
    saved, shown = table.saved.set_index("quantity"), table.shown.set_index("quantity")
    for treatment, fit in olivine.items():
        draws = fit.posterior["posterior"]["kelvin_modulus"].to_numpy()
        expected = np.quantile(draws, [0.05, 0.5, 0.95])
        columns = [f"{treatment}_{name}" for name in ("q5", "median", "q95")]
        assert [saved[column]["Kelvin modulus"] for column in columns] == pytest.approx(
            list(expected)
        )
        low, median, high = (end / 1e9 for end in expected.tolist())
        cell = shown.loc["Kelvin modulus", f"background {treatment}"]
        assert cell == f"{median:.3g} [{low:.3g}, {high:.3g}]"
        rates = np.abs(all_draws(fit.posterior["predictions"].to_dataset()["dashpot_rate"]))
        assert saved.loc["largest rate of the dashpot", f"{treatment}_median"] == pytest.approx(
            float(np.median(rates.max(axis=1)))
        )
    assert shown.loc["Kelvin modulus", "true value"] == "25"
    text = " ".join(background.paragraphs)
    prepared = of_kind(olivine["kept"].experiment, OscillationExperiment).prepared
    assert f"oscillates by {prepared.stress_fit.amplitude()[0] / 1e6:.0f} MPa" in text
    # The true state is that of the model at the true parameters.
    experiment = olivine["kept"].experiment
    solution = simulate(experiment, truth_of(experiment))
    assert saved["truth"]["grain size at the end"] == pytest.approx(
        float(solution["grain_size_m"].iloc[-1]), rel=1e-6
    )
    # Without a kept background or truth there is none.
    removed = olivine["removed"]
    for own in (removed.experiment, replace(removed.experiment, true_parameters=None)):
        (table,) = background_section(
            {"removed": with_problem(removed, own, removed.priors)}
        ).tables
        assert table.shown["true value"].tolist()[-2:] == ["", ""]


def test_every_figure_table_and_claim_has_its_place(
    page: Page, sections: tuple[PageSection, ...], ice: dict[str, Fit]
) -> None:
    table = {section.key: section for section in sections}["counterparts"].tables[0].saved
    listed = set(table["paper"])
    figures = {f"Fig. {name}" for name in ("1", "2", "3", "4", "5", "6", "S1", "S2", "S3", "S5")}
    assert figures | {f"Table {name}" for name in ("1", "2", "S2", "S3")} <= listed
    statements = sections[0].tables[0].shown
    claims = table[table["on this page"] == "Statement by statement"]
    assert claims["shows or says"].tolist() == statements["statement"].tolist()
    assert claims["note"].tolist() == statements["verdict"].tolist()
    points = table[table["shows or says"].str.contains("McCarthy")]
    assert points["on this page"].tolist() == ["not on this page"]
    assert "--measured" in points["note"].iloc[0]
    of_ice = counterparts_table(ice, {}, (), has_points=True)
    assert not {"Fig. 5", "Fig. S5", "Table 2", "Table S3"} & set(of_ice["paper"])
    points = of_ice[of_ice["shows or says"].str.contains("McCarthy")]
    assert points["note"].tolist() == ["from the file that was given"]


def test_measured_points_are_drawn_over_the_spectra_of_ice(ice: dict[str, Fit]) -> None:
    one = np.array([1.0])
    points = MeasuredAttenuation(0.01 * one, 0.3 * one, 0.0 * one, ("McCarthy and Cooper",))
    section = ice_attenuation_section({"PIL40": ice["PIL40"]}, points)
    (first, *_) = section.figures
    (legend,) = first.draw().legends
    assert "McCarthy and Cooper" in [text.get_text() for text in legend.get_texts()]


def test_points_that_cannot_be_read_and_parts_of_the_main_job_stop_before_it_fits(
    tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    points = tmp_path / "points.csv"
    assert main(["--out", str(tmp_path / "page"), "--measured", str(points)]) == 2
    assert "points.csv does not exist" in capsys.readouterr().err
    assert not (tmp_path / "page").exists()
    with pytest.raises(SystemExit):
        main(["--main", "--part", "1/2", "--out", str(tmp_path / "p")])
    assert "--part is for the whole study" in capsys.readouterr().err


def test_the_study_fits_every_experiment_and_shows_all_of_it(
    joint: Fit,
    peaks: RateFit,
    sections: tuple[PageSection, ...],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    shown: dict[str, Any] = {}

    def of_paper(ice: Mapping[str, Fit], olivine: Mapping[str, Fit], _: object) -> object:
        assert [*ice, *olivine] == [*ICE_TWINS, *OLIVINE_RUNS]
        return sections

    def of_rates(
        data: RateTable | Sequence[RateTable], law: RateLaw | None = None, **_: object
    ) -> RateFit:
        if isinstance(data, Sequence):  # measured ice, of the material's law
            assert [one.id for one in data] == list(ICE_TABLES)
            assert law is None
            return peaks
        assert law is not None
        assert law.power_law.has_beta
        return replace(peaks, data=data)

    def quickly(tasks: Mapping[str, Task], folder: Path, **_: object) -> dict[str, Fit]:
        return {name: made(task.problem, folder / name) for name, task in tasks.items()}

    def made(problem: Problem, out: Path) -> Fit:
        experiment, priors = problem.experiments[0], problem.given_priors
        assert priors.material == experiment.material
        assert out.parent == tmp_path / "runs" / "quick"
        if len(problem.experiments) > 1:
            assert out.name == JOINT_RUN
            assert [one.id for one in problem.experiments] == list(TOGETHER)
            return joint
        assert out.name == experiment.id
        if isinstance(experiment, AttenuationExperiment | HistoryExperiment):
            return make_fit(out, name=experiment.id, draws=100)
        if isinstance(experiment, OscillationExperiment):
            treatment = experiment.prepared.background
            assert experiment.id == f"olivine_{treatment}"
            return make_olivine_fit(out, treatment)
        fit = make_fit(out, name=experiment.id, draws=100, command=experiment.id)
        return with_problem(fit, fit.experiment, priors.resolved(8e6))

    def written(fits: Sequence[Fit], out: Path, **arguments: object) -> Path:
        shown.update(fits=fits, **arguments)
        return out / "index.html"

    monkeypatch.setattr("study.fit_rates", of_rates)
    monkeypatch.setattr("study.fit_side_by_side", quickly)
    monkeypatch.setattr("growing_page.write_report", written)
    monkeypatch.setattr("study.study_sections", of_paper)
    monkeypatch.setattr("study.predicted_tests", lambda: [load_experiment(ICE / "PIL105.toml")])
    monkeypatch.setattr(
        "study.spectra_section",
        lambda fits: PageSection(key="spectra", title="", paragraphs=tuple(fits)),
    )
    monkeypatch.setattr(
        "study.halite_section",
        lambda fits: PageSection(key="halite", title="", paragraphs=tuple(fits)),
    )
    page = whole_study(Study("quick", tmp_path, "make study"))
    measured = [ONE_RATE, *STEPPED, *joint.tests()]
    names = [*study_experiments(), COMBINED_RUN]
    fits = shown["fits"]
    assert fits[-1].priors.flow_law is not None
    assert all(fit.priors.flow_law is None for fit in fits[:-1])
    assert page == tmp_path / "index.html"
    assert [fit.experiment.id for fit in fits] == [*measured, *names]
    assert shown["joints"] == [joint]
    assert shown["command"] == "make study"
    keys = [section.key for section in shown["extras"]]
    assert keys.pop(0) == ICE_RATES
    assert shown["told"][ICE_RATES] == [peaks]
    of_study = ["statements", "counterparts", "model", "attenuation", "preparation", "background"]
    assert keys[0] == "rate_steps"
    assert keys[1] == "predicted_tests"
    assert keys[2] == "spectra"
    spectra = [run_name(law, without_hottest=part) for law in LAWS for part in (False, True)]
    assert list(shown["extras"][3].paragraphs) == spectra
    assert keys[3] == "halite"
    assert shown["extras"][4].paragraphs == HALITE_RUNS
    everything, _ = shown["told"]["rates"]
    assert everything.data.id == PEAK_STRESS_TABLE
    assert keys[4].startswith("joint_")
    assert keys[5:13] == [*of_study, "stress_floor", "rates"]
    assert names[:-1] == ["PIL40", "PIL72", "PIL105", "olivine_kept", "olivine_removed"]


def test_the_main_part_is_on_its_page_after_each_of_its_fits(
    ice: dict[str, Fit], peaks: RateFit, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    pages: list[tuple[list[str], dict[str, Any]]] = []

    def quickly(
        tasks: Mapping[str, Task], folder: Path, after: Callable[[str, Fit], None], **_: object
    ) -> dict[str, Fit]:
        assert folder == tmp_path / "runs" / "quick"
        assert {task.options.max_minutes for task in tasks.values()} == {MAX_MINUTES}
        found = {name: with_name(ice["PIL40"], name) for name in tasks}
        for name, fit in found.items():
            after(name, fit)
        return found

    def written(fits: Sequence[Fit], out: Path, **parts: Any) -> Path:
        pages.append(([fit.experiment.id for fit in fits], parts))
        return out / "index.html"

    monkeypatch.setattr("study.fit_rates", lambda *_, **__: peaks)
    monkeypatch.setattr("study.fit_side_by_side", quickly)
    monkeypatch.setattr("study.ice_attenuation_section", no_attenuation)
    monkeypatch.setattr("growing_page.write_report", written)
    assert main_part(Study("quick", tmp_path, "make report")) == tmp_path / "index.html"
    for number, (shown, parts) in enumerate(pages, start=1):
        has_ice = MAIN.index("PIL40") < number
        assert shown == list(MAIN[:number])
        rest = [*MAIN[number:], *([] if has_ice else ["the attenuation of ice"])]
        assert list(parts["to_come"]) == rest
        keys = [section.key for section in parts["extras"]]
        assert keys == [ICE_RATES, *["attenuation"] * has_ice]
        assert parts["told"] == {ICE_RATES: [peaks]}
    assert len(pages) == len(MAIN)


def with_name(fit: Fit, name: str) -> Fit:
    return with_problem(fit, replace(fit.experiment, id=name), fit.priors)


def test_a_growing_page_says_what_is_to_come_and_draws_pictures_once(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    runs = tmp_path / "runs"
    fits = {
        name: make_fit(runs / name, name=name, chains=2, draws=50, fixed=FEW_FREE)
        for name in ("PIL40", "PIL72")
    }
    drawn: list[str] = []

    def sketched(_: object, file: Path) -> str:
        drawn.append(file.name)
        return '<svg viewBox="0 0 576 432"></svg>'

    monkeypatch.setattr("pyburgers.page.illustrations.write_page_images", sketched)
    names = dict.fromkeys((*fits, "told"), "")
    growing = GrowingPage(tmp_path / "page", "T", "x", names, tuple(fits), "the end")
    rests = {"PIL40": "PIL72, told, the end", "PIL72": "told, the end", "told": "the end"}
    for name, rest in rests.items():
        growing.add(name, fits.get(name, fits["PIL40"]))
        page = Page((tmp_path / "page" / "index.html").read_text(encoding="utf-8"))
        assert f"Not finished. Still to come: {rest}." in page.unfolded
        assert [one for one in fits if one in page.ids] == [one for one in fits if one <= name]
    assert len(drawn) == len(set(drawn)) > 2 * len(fits)
    last = growing.write(list(fits.values()))
    assert "Not finished" not in last.read_text(encoding="utf-8")
