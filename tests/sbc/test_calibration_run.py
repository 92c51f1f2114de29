"""`pyburgers sbc`: many data sets, resumed bit for bit, and errors of one sentence."""

import json
import shutil
import subprocess
import sys
from collections.abc import Iterator
from dataclasses import replace
from pathlib import Path

import numpy as np
import pandas as pd
import pytest
from conftest import ICE, Problem, stay_in_this_process
from refusals import CommandLine

from pyburgers.cli.main import main
from pyburgers.common.toml_files import read_json
from pyburgers.drawing.style import image
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.problem import problem_of
from pyburgers.model.priors import default_priors
from pyburgers.sampling.run_directory import RunDirectory
from pyburgers.sbc.replication import Replication, read_replication_table, replication_table
from pyburgers.sbc.results import (
    calibration_text,
    count_sentences,
    rank_differences,
    verdict_table,
)
from pyburgers.sbc.run import Calibration, CalibrationPlan

TINY = (
    *("--simulations", "3", "--warmup", "40", "--draws", "60", "--ranked-draws", "19"),
    *("--adapt-delta", "0.8"),
)
RESULTS = ("verdicts.csv", "ranks.csv", "ranks.png", "ranks.svg")


def made_up(width: float) -> Calibration:
    """Return a calibration whose truths are `width` times as wide as the posterior."""
    n, rng = 100, np.random.default_rng(6)
    truths = width * rng.standard_normal(n)
    found = (rng.standard_normal((n, 99)) < truths[:, None]).sum(axis=1).tolist()
    right = rng.integers(0, 100, n).tolist()
    done = [
        Replication(
            seed=k,
            ranks={"stress_exponent": found[k], "log_likelihood": right[k]},
            n_draws=99,
            n_unsolvable=int(k == 3),
            n_outside=2 if k == 5 else 0,
            n_refits=int(k < 4),
            n_shortened=2 if k == 7 else 0,
            rhat=1.01,
            least_ess=200.0,
            coordinates="valley",
        )
        for k in range(n - 2)
    ]
    slow = Replication(
        seed=n - 1,
        ranks={},
        n_draws=99,
        n_unsolvable=0,
        n_refits=1,
        failed_checks=("divergences",),
        divergences=2,
        rhat=1.01,
        least_ess=200.0,
        coordinates="valley",
    )
    lost = Replication(seed=n, ranks={}, n_draws=99, n_unsolvable=0, failure="No chain finished.")
    return Calibration(
        problem_of([load_constant_rate(ICE / "PIL40.toml")], default_priors("ice")),
        CalibrationPlan(simulations=n + 1, stress_range=(1e6, 1e8)),
        (*done, slow, lost),
        "pyburgers sbc x",
    )


def test_a_posterior_that_is_too_narrow_fails_and_a_right_one_passes() -> None:
    narrow, right = made_up(1.8), made_up(1.0)
    table = verdict_table(narrow).set_index("quantity")
    assert table["verdict"].to_dict() == {
        "stress_exponent": "not calibrated",
        "log_likelihood": "calibrated",
    }
    assert "too narrow" in table["in_words"]["stress_exponent"]
    assert not narrow.passed
    assert right.passed
    assert set(verdict_table(right)["verdict"]) == {"calibrated"}


def test_lost_fits_unphysical_draws_and_failed_checks_are_shown() -> None:
    calibration = made_up(1.0)
    text = " ".join(count_sentences(calibration))
    assert "100 of 101 data sets like PIL40 are done" in text
    assert "98 of them ranked" in text
    assert "1 of 103 draws from the prior had no finite solution" in text
    assert "Fits without any chain: 1" in text
    assert "4 times as long: 5; still not converged and not ranked: 1 (divergences 1)" in text
    assert "shorter steps because a few trajectories diverged: 1." in text
    assert "outside 1 to 100 MPa: 2;" in text
    page = calibration_text(calibration)
    for sentence in count_sentences(calibration):
        assert sentence in page
    assert "| stress exponent |" in page
    assert "`pyburgers sbc x`" in page
    table = replication_table(calibration.replications, list(calibration.ranks))
    assert table["failure"].notna().sum() == 1
    assert table["stress_exponent"].notna().sum() == 98
    assert table["refits"].sum() == 5
    assert image(rank_differences(calibration), "png").startswith(b"\x89PNG")


def test_a_table_reads_back_also_where_it_does_not_tell_of_shorter_steps(tmp_path: Path) -> None:
    done, file = made_up(1.0).replications, tmp_path / "ranks.csv"
    table = replication_table(done, ["stress_exponent", "log_likelihood"])
    table.to_csv(file, index=False)
    assert read_replication_table(file, 99) == done
    table.drop(columns="shortened").to_csv(file, index=False)
    assert read_replication_table(file, 99) == tuple(
        one.model_copy(update={"n_shortened": 0}) for one in done
    )


def test_too_few_data_sets_to_tell_are_not_passed() -> None:
    done = made_up(1.0).replications
    assert replace(made_up(1.0), replications=done[:20]).passed
    few = replace(made_up(1.0), replications=done[:19])
    assert {verdict.verdict for verdict in few.verdicts.values()} == {"too few data sets"}
    assert not few.passed
    none = replace(made_up(1.0), replications=done[-1:])
    assert not none.passed
    assert verdict_table(none).empty


def command(problem: Problem, out: Path, *options: str) -> list[str]:
    inputs = (str(problem.experiment_file), "--priors", str(problem.priors_file))
    return ["sbc", *inputs, "--out", str(out), "--jobs", "2", *TINY, *options]


@pytest.fixture(scope="module")
def finished(
    programs: None, small_problem: Problem, tmp_path_factory: pytest.TempPathFactory
) -> Path:
    """Folder of a calibration done in one go."""
    out = tmp_path_factory.mktemp("calibration") / "out"
    with pytest.MonkeyPatch.context() as patch:
        stay_in_this_process(patch)
        assert main(command(small_problem, out)) == 3  # three data sets say nothing
    return out


@pytest.fixture
def outcomes(finished: Path) -> Iterator[dict[str, bytes]]:
    """Return the files of the finished calibration, and check that a test leaves them alone."""
    before = contents(finished)
    yield before
    assert contents(finished) == before


def contents(out: Path) -> dict[str, bytes]:
    files = [*(out / "simulations").iterdir(), *(out / name for name in RESULTS)]
    return {file.name: file.read_bytes() for file in files}


def test_every_data_set_is_a_file_and_the_manifest_says_how_to_repeat_it(
    finished: Path, outcomes: dict[str, bytes]
) -> None:
    assert len(outcomes) == 3 + len(RESULTS)
    ranks = pd.read_csv(finished / "ranks.csv")
    assert ranks["seed"].tolist() == [1, 2, 3]
    for record in ranks.to_dict("records"):
        kept = json.loads(outcomes[f"simulation_{record['seed']:06d}.json"])
        for name, rank in kept["ranks"].items():
            assert 0 <= rank <= 19
            assert record[name] == rank
    assert len(set(ranks["reference_stress"])) > 1
    manifest = json.loads((finished / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["status"] == "complete"
    assert manifest["plan"]["sampler"]["draws"] == 60
    assert set(manifest["hashes"]) == {
        f"inputs/tests/{manifest['experiments'][0]}/experiment.csv",
        f"inputs/tests/{manifest['experiments'][0]}/experiment.toml",
        "inputs/priors.toml",
    }
    assert {"cmdstan", "pyburgers"} <= set(manifest["versions"])
    assert "Unphysical draws: 0 of 3" in (finished / "calibration.md").read_text(encoding="utf-8")


@pytest.mark.slow
def test_parts_that_run_at_the_same_time_come_to_the_same_result(
    small_problem: Problem, outcomes: dict[str, bytes], tmp_path: Path
) -> None:
    out = tmp_path / "out"
    main_command = [sys.executable, "-m", "pyburgers"]
    parts = [
        subprocess.Popen([*main_command, *command(small_problem, out, "--part", f"{which}/2")])
        for which in (1, 2)
    ]
    assert [part.wait() for part in parts] == [0, 0]
    assert not (out / "ranks.csv").exists()
    assert main(command(small_problem, out)) == 3
    assert contents(out) == outcomes


def test_an_unfinished_calibration_is_shown_as_far_as_it_has_come(
    finished: Path, outcomes: dict[str, bytes], tmp_path: Path, cli: CommandLine, sketched: None
) -> None:
    part = tmp_path / "part"
    shutil.copytree(finished, part)
    (part / "simulations" / "simulation_000003.json").unlink()
    (part / "ranks.csv").unlink()  # written at the end
    out = tmp_path / "shown"
    said = cli("sbc", "--results-of", part, "--out", out, code=None)
    assert "2 of 3 data sets" in said
    assert f"tables and figure: {out}" in said
    assert pd.read_csv(out / "ranks.csv")["seed"].tolist() == [1, 2]
    whole = tmp_path / "whole"
    cli("sbc", "--results-of", finished, "--out", whole, code=None)
    assert (whole / "ranks.csv").read_bytes() == outcomes["ranks.csv"]
    shutil.rmtree(part / "simulations")
    none = tmp_path / "none"
    assert f"tables: {none}" in cli("sbc", "--results-of", part, "--out", none, code=None)
    assert not (none / "ranks.png").exists()


def test_a_calibration_goes_on_from_its_table(
    small_problem: Problem,
    finished: Path,
    outcomes: dict[str, bytes],
    tmp_path: Path,
    cli: CommandLine,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """What is kept of one are its results; a data set that they have is not fitted again."""
    stay_in_this_process(monkeypatch)
    out = tmp_path / "out"
    shutil.copytree(finished, out)
    table = out / "ranks.csv"
    rows = table.read_text(encoding="utf-8").splitlines(keepends=True)
    table.write_text("".join(rows[:-1]), encoding="utf-8")
    shutil.rmtree(out / "simulations")
    cli("sbc", "--results-of", out, "--out", tmp_path / "report", code=None)
    assert (tmp_path / "report" / "ranks.csv").read_bytes() == table.read_bytes()
    cli(*command(small_problem, out), code=None)
    assert "2 of 3 data sets are there already" in cli.error
    assert contents(out) == outcomes
    shutil.rmtree(out / "simulations")
    table.write_text("seed,ranks\n1,2\n", encoding="utf-8")
    cli.refused(command(small_problem, out), "found no table of data sets")


@pytest.mark.parametrize(
    "option",
    [
        ("--seed", "2"),
        ("--draws", "21"),
        ("--chains", "3"),
        ("--simulations", "4"),
    ],
)
def test_another_configuration_in_the_same_folder_is_refused(
    option: tuple[str, str],
    small_problem: Problem,
    finished: Path,
    outcomes: dict[str, bytes],
    cli: CommandLine,
) -> None:
    cli.refused(
        command(small_problem, finished, *option),
        "holds a run of other inputs",
        "choose another --out",
    )


def test_repetitions_can_be_added_but_not_taken_back(
    small_problem: Problem,
    finished: Path,
    outcomes: dict[str, bytes],
    tmp_path: Path,
    cli: CommandLine,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    """Only fits that had not converged are made again, and the outcome is that of one go."""
    stay_in_this_process(monkeypatch)
    later = tmp_path / "later"
    repeated = pd.read_csv(finished / "ranks.csv").query("refits == 1")["seed"]
    cli(
        *command(small_problem, later, "--refits", "0", "--part", f"{repeated.iloc[0]}/3"),
        code=None,
    )
    (file,) = (later / "simulations").iterdir()
    assert json.loads(file.read_text(encoding="utf-8"))["failed_checks"]
    for other in (finished / "simulations").iterdir():
        if other.name != file.name:
            shutil.copy(other, file.parent)
    cli(*command(small_problem, later), code=None)
    assert contents(later) == outcomes
    cli.refused(
        command(small_problem, finished, "--refits", "0"),
        "calibrated with 1 repetitions",
        "expected no fewer, found 0",
    )


@pytest.mark.parametrize(
    ("name", "old", "new", "word"),
    [
        ("manifest.json", '"n_ranked": 19', '"n_ranked": "x"', "'n_ranked' in [plan]: found 'x'"),
        ("manifest.json", '"draws": 60', '"drows": 60', "unknown key 'drows' in [plan.sampler]"),
        ("manifest.json", '"command"', '"cmd"', "key 'command' is missing"),
        ("inputs/priors.toml", "ice", "ICE", "inputs/priors.toml has changed"),
        ("simulations/simulation_000002.json", '"seed"', '"sead"', "unknown key 'sead'"),
        ("simulations/simulation_000002.json", "{", "", "is not valid JSON"),
    ],
)
def test_what_was_damaged_or_changed_is_told(
    name: str, old: str, new: str, word: str, finished: Path, tmp_path: Path, cli: CommandLine
) -> None:
    out = tmp_path / "out"
    shutil.copytree(finished, out)
    text = (out / name).read_text(encoding="utf-8")
    assert old in text
    (out / name).write_text(text.replace(old, new, 1), encoding="utf-8")
    if name == "manifest.json":
        cli.refused(["sbc", "--results-of", out], "as its seal says")
        RunDirectory(out).write_manifest(read_json(out / name))
    cli.refused(["sbc", "--results-of", out], word)


def test_results_of_another_version_are_refused(cli: CommandLine) -> None:
    folder = Path(__file__).parents[2] / "reports" / "calibration" / "ice"
    word = "If another version of pyburgers wrote the folder, use that version.\n"
    cli.refused(["sbc", "--results-of", folder], word)
