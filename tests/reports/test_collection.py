"""The open collection: which fits it has, what is shipped of them, and what its page says."""

import json
import zipfile
from collections.abc import Mapping
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from collection import (
    BEFORE,
    DRAWS,
    HALITE,
    MATERIALS,
    OPTIONS,
    ROCK_PHYSICS,
    ROCKS,
    contests_of,
    experiment_of,
    halves_of,
    main,
    runs_of,
    write_records,
)
from league import (
    Contest,
    draw_league,
    last_part_sentence,
    league_sentence,
    league_table,
)
from posterior_database import whole_program, write_posterior
from synthetic_fit import make_fit, with_problem

import pyburgers
from pyburgers import Fit, InputError, SamplingError, Task
from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.checks.verdicts import Verdict
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.fitting.sampled_fit import SampledFit
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.model.variants import variant_of, with_variant
from pyburgers.predictions.collection import LAWS
from pyburgers.predictions.exported import wide_notes
from pyburgers.predictions.stated_laws import laws_of

DATA = pyburgers.shipped_folder("data")
SHIPPED = DATA / "collection"
LIMIT = 2_000_000
"""Bytes of all that is shipped, and of the page."""


def test_every_measured_test_is_in_the_collection() -> None:
    files = [*DATA.glob("dunite/*.toml"), *DATA.glob("halite/*.toml"), *DATA.glob("olivine/*.toml")]
    measured = {
        file.relative_to(DATA).as_posix()
        for file in files
        if pyburgers.load_experiment(file).provenance.kind != "synthetic"
    }
    assert {rock.file for rock in ROCKS.values()} == measured


@pytest.mark.parametrize("name", ROCKS)
def test_each_test_is_fitted_by_each_of_its_laws(name: str) -> None:
    tasks = runs_of(name, OPTIONS)
    laws = ROCKS[name].laws
    assert {run.removesuffix(BEFORE) for run in tasks} == {f"{name}-{law}" for law in laws}
    whole = experiment_of(name)
    for run, task in tasks.items():
        (test,) = task.problem.experiments
        record = variant_of(task.problem.given_priors, test).record()
        choices = laws[run.removesuffix(BEFORE).removeprefix(f"{name}-")]
        assert {part: record[part] for part in choices} == choices
        assert (test.n_points < whole.n_points) is run.endswith(BEFORE)
        assert task.options.max_minutes == OPTIONS.max_minutes
        assert task.options.chain_timeout == OPTIONS.chain_timeout


def test_laws_that_take_long_come_last(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    asked: list[str] = []

    def noted(tasks: Mapping[str, Task], *_: object) -> None:
        asked.extend(tasks)
        raise InterruptedError

    monkeypatch.setattr("collection.fit_all", noted)
    with pytest.raises(InterruptedError):
        main(["--out", str(tmp_path)])
    first = [f"{name}-{next(iter(rock.laws))}" for name, rock in ROCKS.items()]
    assert asked[: len(ROCKS)] == first
    assert set(asked) == {run for name in ROCKS for run in runs_of(name, OPTIONS)}
    assert asked[-1].split("-")[1] == "dislocations"


def test_a_test_is_parted_into_its_readings_before_the_last_part_and_in_it() -> None:
    found = {name: halves_of(experiment_of(name)) for name in ROCKS}
    assert [name for name, halves in found.items() if halves is None] == [
        "dunite_4506",
        "halite_z3",
    ]
    for name, halves in found.items():
        if halves is None:
            continue
        whole, (before, last) = experiment_of(name), halves
        assert before.n_points + last.n_points == whole.n_points
        assert set(before.response) | set(last.response) == set(whole.response)
        if isinstance(whole, ConstantRateExperiment):
            assert isinstance(before, ConstantRateExperiment)
            assert isinstance(last, ConstantRateExperiment)
            step = whole.segments[-1].start_strain
            assert before.strain.max() <= step <= last.strain.min()
            assert before.segments == whole.segments[:-1]
            assert before.final_strain == step
            assert last.segments == whole.segments
            assert set(last.reading_segment[last.strain > step]) == {len(whole.segments) - 1}
        else:
            assert isinstance(last, AttenuationExperiment)
            assert isinstance(before, AttenuationExperiment)
            temperatures = before.conditions.temperature
            assert last.conditions.temperature.min() > temperatures.max()


@pytest.fixture(scope="module")
def fits(tmp_path_factory: pytest.TempPathFactory) -> dict[str, Fit]:
    """Two fits of the same readings, the second with correlated residuals."""
    folder = tmp_path_factory.mktemp("runs")
    found = {}
    for law, choices in (
        ("standard", {}),
        ("autocorrelated", {"residuals": "autocorrelated"}),
    ):
        fit = make_fit(folder / law, name="A", kind="measured", draws=100)
        priors = with_variant(fit.priors, fit.experiment, choices)
        found[law] = with_problem(fit, fit.experiment, priors.resolved(8e6))
        draws = fit.posterior["posterior"].to_dataset()
        spread = draws["stress_noise"] / draws["stress_noise"].mean()
        correlated = {"residual_correlation_strain": 0.01, "residual_correlated_share": 0.5}
        own = {name: mean * spread for name, mean in correlated.items() if choices}
        fit.posterior["posterior"] = draws.assign(own)
    return found


def answer(
    monkeypatch: pytest.MonkeyPatch, by_model: Mapping[str, tuple[Outcome, Outcome]]
) -> None:
    """Decide both verdicts on fits by their model."""

    def told(fit: SampledFit) -> dict[CheckKind, Verdict]:
        assert isinstance(fit, Fit)
        outcomes = by_model[fit.variant.residuals]
        return {
            kind: Verdict(kind, outcome, f"Because {outcome.value}.")
            for kind, outcome in zip(CheckKind, outcomes, strict=True)
        }

    monkeypatch.setattr(SampledFit, "verdicts", told)


YES, NO, UNSURE = Outcome.YES, Outcome.NO, Outcome.CANNOT_TELL


@pytest.mark.parametrize(
    ("standard", "correlated", "sentence", "chosen"),
    [
        ((YES, YES), (YES, NO), "some law describes 1 (dunite_4506).", "standard"),
        (
            (YES, NO),
            (YES, YES),
            "some law describes 1 (dunite_4506). Only with correlated residuals 1 (dunite_4506).",
            "autocorrelated",
        ),
        (
            (YES, NO),
            (NO, YES),
            "some law describes none. No law that was sampled well describes 1 "
            "(dunite_4506). Not sampled well, and counted for nothing: 1 of 2 fits.",
            "standard",
        ),
        (
            (YES, NO),
            (YES, UNSURE),
            "some law describes none. It cannot be told whether any law describes 1 (dunite_4506).",
            None,
        ),
        (
            (NO, NO),
            (NO, YES),
            "some law describes none. It cannot be told whether any law describes 1 "
            "(dunite_4506). Not sampled well, and counted for nothing: 2 of 2 fits.",
            None,
        ),
        (
            (YES, NO),
            (YES, NO),
            "some law describes none. No law that was sampled well describes 1 (dunite_4506).",
            None,
        ),
    ],
)
def test_the_sentence_and_the_chosen_law_follow_both_verdicts(
    fits: dict[str, Fit],
    monkeypatch: pytest.MonkeyPatch,
    standard: tuple[Outcome, Outcome],
    correlated: tuple[Outcome, Outcome],
    sentence: str,
    chosen: str | None,
) -> None:
    answer(monkeypatch, {"independent": standard, "autocorrelated": correlated})
    contest = Contest.of("dunite_4506", fits, {}, None)
    assert league_sentence([contest]) == f"Of 1 measured tests, {sentence}"
    assert contest.chosen == (chosen or contest.best_first[0])


def test_the_league_has_a_row_for_each_law_and_a_figure(fits: dict[str, Fit]) -> None:
    table = league_table([Contest.of("dunite_4506", fits, {}, None)])
    assert set(table["law"]) == set(fits)
    assert table["elpd_difference"].iloc[0] == 0
    for law, fit in fits.items():
        row = table.set_index("law").loc[law]
        assert row["sampled_well"] == fit.sampled_well.value
        assert row["describes_data"] == fit.describes_data.value
        ratios = np.concatenate(
            [
                check.table["found"] / check.table["at_most"]
                for check in fit.checks()
                if "at_most" in check.table
            ]
        )
        assert row["found"] / row["at_most"] == pytest.approx(ratios.max())
        assert row["misfit"]
        assert isinstance(row["misfit"], str)
        seconds = [chain["wall_seconds"] for chain in fit.manifest["chains"].values()]
        assert row["chain_minutes"] == pytest.approx(sum(seconds) / 60)
    assert last_part_sentence(table).startswith("No fit without the last part of its test")


def test_tests_with_the_same_laws_share_a_panel_of_the_figure(fits: dict[str, Fit]) -> None:
    own = league_table([Contest.of("dunite_4506", fits, {}, None)])
    fewer = own.assign(test="halite_z3").iloc[:1]
    figure = draw_league(pd.concat([own, own.assign(test="dunite_4581"), fewer]))
    found = [
        [
            [label.get_text() for label in axis.get_ticklabels()]
            for axis in (panel.yaxis, panel.xaxis)
        ]
        for panel in figure.axes
    ]
    assert found == [
        [["dunite_4506", "dunite_4581"], list(own["law"])],
        [["halite_z3"], [own["law"][0]]],
    ]


def test_the_last_part_is_scored_by_what_its_draws_expect(
    long_fit: Fit, fits: dict[str, Fit], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr("league.PREDICTED_DRAWS", 100)
    test = long_fit.experiment
    assert isinstance(test, ConstantRateExperiment)
    wrong = replace(test, stress=test.stress + 5e6)
    for last, as_expected in ((test, "yes"), (wrong, "no")):
        contest = Contest.of("dunite_4506", fits, {"standard": long_fit}, last)
        table = league_table([contest]).set_index("law")
        assert table.loc["standard", "last_as_expected"] == as_expected
        assert table.loc["autocorrelated", "last_as_expected"] == ""
        score = pyburgers.score_table(long_fit.predict(last, draws=100))["found"]
        assert table.loc["standard", "last_in_band"] == score["coverage of the 90 % band"]
    said = last_part_sentence(table.reset_index())
    assert "Of 1 such predictions, by fits that were sampled well, 0 are as good" in said
    assert said.endswith("standard (dunite_4506).")


def test_what_is_written_of_a_test_is_read_back(
    fits: dict[str, Fit], tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    contest = Contest.of("dunite_4506", fits, {}, None)
    write_records([contest], tmp_path / "data" / "collection", "make it")
    monkeypatch.setattr(
        "pyburgers.predictions.collection.shipped_folder", lambda name: tmp_path / name
    )
    assert pyburgers.collection_names() == ("dunite_4506",)
    rock = pyburgers.collection("dunite_4506")
    fit = fits[contest.chosen]
    (text,) = pyburgers.export(fit, "json", draws=DRAWS)
    exported = json.loads(text)
    assert rock.variant == fit.variant.short_text
    assert list(rock.names) == exported["names"]
    assert rock.mean.tolist() == exported["mean"]
    assert rock.covariance.tolist() == exported["covariance"]
    assert rock.draws.tolist() == exported["sample"]
    assert rock.laws["flow_law"] == exported["flow_law"]
    assert (rock.sampled_well, rock.describes_data) == (fit.sampled_well, fit.describes_data)
    assert rock.source == fit.provenance.source
    index = json.loads((tmp_path / "data" / "collection" / "index.json").read_text("utf-8"))
    assert index["sentence"] == league_sentence([contest])
    assert index["command"] == "make it"
    assert index["tests"][0]["hashes"] == fit.manifest["hashes"]


def test_a_fit_that_cannot_be_done_is_named_and_the_others_are_shown(
    fits: dict[str, Fit], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sketched: None
) -> None:
    monkeypatch.setattr("collection.ROCKS", {"dunite_4506": ROCKS["dunite_4506"]})

    def quickly(tasks: Mapping[str, Task], folder: Path, *, command: str) -> dict[str, Fit]:
        (run,) = tasks
        assert folder == tmp_path / "runs"
        assert command == "python reports/collection.py --draws 100"
        law = run.removeprefix("dunite_4506-")
        if law not in fits:
            raise SamplingError("no chain finished")
        return {run: fits[law]}

    monkeypatch.setattr("collection.fit_side_by_side", quickly)
    places = {name: tmp_path / "shown" / name for name in ("records", "page")}
    options = [text for name, path in places.items() for text in (f"--{name}", str(path))]
    main(["--out", str(tmp_path), "--draws", "100", *options])
    page = (places["page"] / "index.html").read_text(encoding="utf-8")
    assert "dunite_4506-threshold_stress is missing: no chain finished" in page
    assert "Of 1 measured tests" in page
    assert "made up for a test" in page
    assert sorted(file.name for file in places["records"].iterdir()) == [
        "dunite_4506.json",
        "index.json",
    ]


def test_only_complete_fits_are_shown_on_request(
    fits: dict[str, Fit], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, sketched: None
) -> None:
    asked: list[str] = []

    def load(folder: Path) -> Fit:
        asked.append(folder.name)
        return fits["standard"]

    monkeypatch.setattr(Fit, "load", load)
    complete = tmp_path / "runs" / "dunite_4506-standard"
    complete.mkdir(parents=True)
    (complete / "checks.json").touch()
    (tmp_path / "runs" / "dunite_4506-autocorrelated").mkdir()
    places = ["--records", str(tmp_path / "records"), "--page", str(tmp_path / "shown")]
    main(["--out", str(tmp_path), "--finished", *places])
    assert asked == ["dunite_4506-standard"]


def test_fits_are_put_together_by_test(fits: dict[str, Fit]) -> None:
    found = contests_of({"dunite_4506-standard": fits["standard"]})
    assert [(one.name, list(one.fits), one.comparison) for one in found] == [
        ("dunite_4506", ["standard"], None)
    ]


@pytest.mark.parametrize("name", pyburgers.collection_names())
def test_a_shipped_law_is_whole(name: str) -> None:
    rock = pyburgers.collection(name)
    n = len(rock.names)
    assert rock.mean.shape == (n,)
    assert len(rock.units) == len(rock.decided_by) == n
    assert rock.draws.shape == (DRAWS, n)
    free = np.diag(rock.covariance) > 0
    np.testing.assert_array_equal(rock.covariance, rock.covariance.T)
    scale = np.sqrt(np.diag(rock.covariance)[free])
    correlation = rock.covariance[np.ix_(free, free)] / np.outer(scale, scale)
    assert np.linalg.eigvalsh(correlation).min() > -1e-9
    # Chosen without replacement, from at least 400 independent draws.
    distance = np.abs(rock.draws.mean(axis=0) - rock.mean)[free] / scale
    assert distance.max() < 5 / np.sqrt(DRAWS / 2)
    np.testing.assert_array_equal(rock.draws[:, ~free], np.tile(rock.mean[~free], (DRAWS, 1)))
    told = wide_notes(rock.names, rock.mean, rock.covariance)
    assert {*told} == {note for note in rock.record["notes"] if "use draws" in note}
    assert bool(told) is (name != HALITE)
    origin = experiment_of(name).provenance
    assert (rock.source, rock.doi, rock.licence) == (origin.source, origin.doi, origin.licence)
    about = rock.record["collection"]
    assert (about["terms"]["material"], about["terms"]["kind"]) == ROCKS[name].terms
    assert about["law"] in {row["law"] for row in about["league"]} <= set(ROCKS[name].laws)
    chosen = next(row for row in about["league"] if row["law"] == about["law"])
    assert chosen["sampled_well"] == rock.sampled_well.value
    assert chosen["describes_data"] == rock.describes_data.value
    describing = [
        row["law"]
        for row in about["league"]
        if (row["sampled_well"], row["describes_data"]) == ("yes", "yes")
    ]
    assert not describing or about["law"] == describing[0]
    assert about["manifest"]["command"] == "python reports/collection.py"


@pytest.mark.parametrize(
    "choices", [{}, {"hardening": "backstress"}, {"second_mechanism": "diffusion"}]
)
def test_every_law_that_an_export_states_is_read(choices: Mapping[str, str]) -> None:
    test = experiment_of("dunite_4581")
    priors = with_variant(pyburgers.priors("dunite"), test, choices)
    assert {*laws_of(priors, test)} <= {*LAWS}


def test_the_collection_is_small_and_in_the_order_of_its_page() -> None:
    names = pyburgers.collection_names()
    assert list(names) == [name for name in ROCKS if name in names]
    page = Path(__file__).parents[2] / "reports" / "collection"
    files = [file for folder in (SHIPPED, page) for file in folder.iterdir()]
    assert {file.stem for file in SHIPPED.iterdir()} == {"index", *names}
    assert sum(file.stat().st_size for file in files) < LIMIT
    for rock in ROCKS.values():
        material, kind = rock.terms
        assert material.startswith(MATERIALS)
        assert kind.startswith(ROCK_PHYSICS)


def test_another_name_is_refused_with_the_nearest() -> None:
    with pytest.raises(InputError, match="no test 'dunite_4506x', did you mean 'dunite_4506'"):
        pyburgers.collection("dunite_4506x")


def test_draws_are_written_in_the_form_of_posteriordb(small_fit: Fit, tmp_path: Path) -> None:
    write_posterior(small_fit, "PIL40", tmp_path)
    (posterior,) = (tmp_path / "posteriors").iterdir()
    about = json.loads(posterior.read_text("utf-8"))
    name, model = about["reference_posterior_name"], about["model_name"]
    reference = tmp_path / "reference_posteriors" / "draws"
    with zipfile.ZipFile(reference / "draws" / f"{name}.json.zip") as archive:
        chains = json.loads(archive.read(f"{name}.json"))
    sizes = small_fit.posterior["posterior"].sizes
    assert len(chains) == sizes["chain"]
    assert all(len(values) == sizes["draw"] for chain in chains for values in chain.values())
    assert list(chains[0]) == [f"coordinate[{k + 1}]" for k in range(3)]
    assert about["dimensions"] == {"coordinate": 3}
    info = json.loads((reference / "info" / f"{name}.info.json").read_text("utf-8"))
    assert info["diagnostics"]["ndraws"] == sizes["chain"] * sizes["draw"]
    assert info["checks_made"]["ndraws_is_10k"] is False
    assert min(info["diagnostics"]["effective_sample_size_bulk"]) > 10
    with zipfile.ZipFile(tmp_path / "data" / "data" / "PIL40.json.zip") as archive:
        data = json.loads(archive.read("PIL40.json"))
    recorded = json.loads((small_fit.directory.path / "stan_data.json").read_text("utf-8"))
    assert data == recorded | {"solver": 0}
    code = (tmp_path / "models" / "stan" / f"{model}.stan").read_text("utf-8")
    assert code == whole_program(small_fit.problem.likelihood.program)
    assert "#include" not in code
    assert (stan_directory() / "physics" / "flow_law.stan").read_text("utf-8").strip() in code


@pytest.mark.slow
def test_the_collection_is_made(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, programs: None, sketched: None
) -> None:
    rock = ROCKS["dunite_4581"]
    few = replace(rock, laws={law: rock.laws[law] for law in ("standard", "autocorrelated")})
    monkeypatch.setattr("collection.ROCKS", {"dunite_4581": few})
    places = ["--records", str(tmp_path / "data" / "collection"), "--page", str(tmp_path / "page")]
    main(["--out", str(tmp_path / "out"), "--draws", "100", *places])
    monkeypatch.setattr(
        "pyburgers.predictions.collection.shipped_folder", lambda name: tmp_path / name
    )
    rock_read = pyburgers.collection("dunite_4581")
    assert rock_read.draws.shape == (DRAWS, len(rock_read.names))
    league = rock_read.record["collection"]["league"]
    assert {row["law"] for row in league} == set(few.laws)
    assert all(0 <= row["last_in_band"] <= 1 for row in league)
    page = (tmp_path / "page" / "index.html").read_text(encoding="utf-8")
    assert "Of 1 measured tests" in page
    model = next((tmp_path / "out" / "posteriordb" / "models" / "stan").iterdir())
    assert pyburgers.load_program(model).executable.is_file()
