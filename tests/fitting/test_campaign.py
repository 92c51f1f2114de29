"""`pyburgers campaign`: every combination of a plan, in parts, continued, refused, on one page."""

import json
import logging
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path

import pandas as pd
import pytest
import xarray as xr
from conftest import SMALL_RUN, Problem, copy_of
from refusals import CommandLine
from same_contents import contents

from pyburgers.cli.main import main
from pyburgers.fitting.campaign import load_campaign, task_of
from pyburgers.fitting.fit import Fit
from pyburgers.kinds.kind import save_experiment
from pyburgers.model.priors import save_priors

pytestmark = pytest.mark.usefixtures("in_this_process")

PLAN = f"""
id = "small"
seeds = [{SMALL_RUN.seed}, 12]

[tests]
alone = ["inputs/PIL40.toml"]

[priors]
own = "inputs/priors.toml"

[sampler]
chains = {SMALL_RUN.chains}
warmup = {SMALL_RUN.warmup}
draws = {SMALL_RUN.draws}
adapt_delta = {SMALL_RUN.adapt_delta}
"""

NAMES = [f"alone-standard-own-seed{seed}" for seed in (SMALL_RUN.seed, 12)]

DAMAGED = {
    **dict.fromkeys(("manifest.json", "chains/chain_1/timing.json"), "damaged"),
    **dict.fromkeys(("chains/chain_1/draws.csv", "posterior.nc", "stan_data.json"), "complete"),
}
"""Files and the status of a run with such a file damaged: hashes are compared when it is read."""

MakePlan = Callable[..., Path]


@pytest.fixture
def make_plan(small_problem: Problem, tmp_path: Path) -> MakePlan:
    """Write a plan beside the small problem, with some of its text exchanged."""

    def make(*exchanged: tuple[str, str]) -> Path:
        folder = tmp_path / "inputs"
        folder.mkdir(exist_ok=True)
        save_experiment(small_problem.experiment, folder).rename(folder / "PIL40.toml")
        save_priors(small_problem.priors, folder / "priors.toml")
        text = PLAN
        for old, new in exchanged:
            assert old in text
            text = text.replace(old, new)
        plan = tmp_path / "plan.toml"
        plan.write_text(text, encoding="utf-8")
        return plan

    return make


def test_parts_do_their_fits_and_the_whole_gathers_them_on_a_page(
    make_plan: MakePlan, small_fit: Fit, tmp_path: Path, sketched: None, cli: CommandLine
) -> None:
    plan, out = make_plan(), tmp_path / "out"
    assert cli("campaign", plan, "--out", out, "--status").count("not begun") == 2
    assert not out.exists()
    for part, done in (("2/2", {NAMES[1]}), ("1/2", set(NAMES))):
        cli("campaign", plan, "--out", out, "--part", part, code=None)
        assert {folder.name for folder in (out / "runs").iterdir()} == done
        assert not (out / "report").exists()
    before = {file: file.read_bytes() for file in (out / "runs").glob("*/chains/*/*")}
    code = main(["campaign", str(plan), "--out", str(out)])
    assert {file: file.read_bytes() for file in (out / "runs").glob("*/chains/*/*")} == before
    table = pd.read_csv(out / "status.csv", index_col="run")
    assert table.index.tolist() == NAMES
    assert set(table["status"]) == {"complete"}
    assert table["chains"].tolist() == [2, 2]
    assert code == (0 if set(table["sampled_well"]) == {"yes"} else 3)
    page = (out / "report" / "index.html").read_text(encoding="utf-8")
    assert "2 of 2 fits are complete." in page
    models = pd.read_csv(next((out / "report" / "tables").glob("*models*.csv")))
    assert models["seeds"].tolist() == [f"{SMALL_RUN.seed} 12"]
    assert 0 < models["between_seeds"][0] < 0.5
    found = Fit.load(out / "runs" / NAMES[0]).posterior["posterior"].to_dataset()
    same = small_fit.posterior["posterior"].to_dataset()
    xr.testing.assert_identical(found.drop_attrs(), same.drop_attrs())


def test_a_fit_that_cannot_be_done_leaves_the_others_alone(
    make_plan: MakePlan, tmp_path: Path, cli: CommandLine
) -> None:
    plan, out = make_plan(), tmp_path / "out"
    stranger = out / "runs" / NAMES[0]
    stranger.mkdir(parents=True)
    (stranger / "notes.txt").write_text("mine", encoding="utf-8")
    said = cli("campaign", plan, "--out", out, "--part", "1/1", code=1)
    assert f"{NAMES[0]}: could not be done: {stranger}: has files (notes.txt)" in said
    manifest = json.loads((out / "runs" / NAMES[1] / "manifest.json").read_text(encoding="utf-8"))
    assert manifest["status"] == "complete"


def test_a_damaged_run_does_not_hide_the_others(
    make_plan: MakePlan, small_fit: Fit, tmp_path: Path, sketched: None, cli: CommandLine
) -> None:
    """The first run is whole, and of each other one a file is damaged."""
    tests = [f"test{k}" for k in range(1 + len(DAMAGED))]
    plan = make_plan(
        (f"seeds = [{SMALL_RUN.seed}, 12]", f"seeds = [{SMALL_RUN.seed}]"),
        ('alone = ["inputs/PIL40.toml"]', "".join(f'{t} = ["inputs/PIL40.toml"]\n' for t in tests)),
    )
    whole, *damaged = (
        copy_of(small_fit, tmp_path / "out" / "runs" / f"{test}-standard-own-seed{SMALL_RUN.seed}")
        for test in tests
    )
    folders = [one.directory.path for one in damaged]
    for folder, name in zip(folders, DAMAGED, strict=True):
        (folder / name).write_text("damaged", encoding="utf-8")
    before = [contents(folder) for folder in folders]
    campaign = ["campaign", str(plan), "--out", str(tmp_path / "out")]
    lines = cli(*campaign, "--status").splitlines()
    said = {whole.directory.path.name: "complete"}
    said |= {folder.name: status for folder, status in zip(folders, DAMAGED.values(), strict=True)}
    for run, word in said.items():
        assert word in next(line for line in lines if line.startswith(run))
    out = cli(*campaign, code=1)
    assert all(f"{folder.name}: could not be done: " in out for folder in folders)
    page = (tmp_path / "out" / "report" / "index.html").read_text(encoding="utf-8")
    assert f"1 of {len(tests)} fits are complete." in page
    assert "damaged" in page
    for folder in folders:
        (folder / ".lock").unlink(missing_ok=True)
    assert [contents(folder) for folder in folders] == before


@pytest.mark.parametrize(
    ("file", "old", "new", "is_same"),
    [
        ("inputs/PIL40.toml", 'source = "', 'source = "My own. ', True),
        ("inputs/PIL40.toml", "temperature_K = 26", "temperature_K = 25", False),
        ("plan.toml", f"draws = {SMALL_RUN.draws}", f"draws = {SMALL_RUN.draws + 1}", False),
    ],
)
def test_a_run_of_other_inputs_is_no_fit_of_the_plan(
    file: str,
    old: str,
    new: str,
    is_same: bool,
    make_plan: MakePlan,
    small_fit: Fit,
    tmp_path: Path,
    cli: CommandLine,
) -> None:
    """What decides the draws is changed after the run, or what does not."""
    plan, out = make_plan((f"seeds = [{SMALL_RUN.seed}, 12]", "seeds = [11]")), tmp_path / "out"
    folder = out / "runs" / NAMES[0]
    copy_of(small_fit, folder)
    before = contents(folder)
    text = (tmp_path / file).read_text(encoding="utf-8")
    assert old in text
    (tmp_path / file).write_text(text.replace(old, new), encoding="utf-8")
    campaign = ["campaign", str(plan), "--out", str(out)]
    said = cli(*campaign, "--status")
    assert ("complete" in said, "of other inputs" in said) == (is_same, not is_same)
    if is_same:
        return
    (out / "report").mkdir()
    (out / "report" / "index.html").write_text("earlier", encoding="utf-8")
    said = " ".join(cli(*campaign, code=1).split())
    assert f"{folder}: holds a run of other inputs: " in said
    assert "; remove the folder, or choose another --out." in said
    (row,) = pd.read_csv(out / "status.csv").to_dict("records")
    assert (row["status"], row["chains"], row["of_chains"]) == ("of other inputs", 0, 2)
    assert pd.isna(row["sampled_well"])
    # The page of the earlier plan is marked as such.
    assert {file.name for file in (out / "report").iterdir()} == {"outdated.html"}
    assert "No fit is complete now: the earlier page is " in said
    assert contents(folder) == before


def test_a_plan_is_every_combination(make_plan: MakePlan) -> None:
    laws = (
        '[variants]\nstandard = {}\nfrozen = { grain_size = "constant" }\n\n[priors]\nd = "default"'
    )
    tests = '[tests]\nother = ["inputs/PIL40.toml"]'
    tasks = load_campaign(make_plan(("[priors]", laws), ("[tests]", tests))).tasks
    assert len(tasks) == 2 * 2 * 2 * 2
    assert next(iter(tasks)).name == f"other-standard-d-seed{SMALL_RUN.seed}"
    assert {task.options.seed for task in tasks.values()} == {SMALL_RUN.seed, 12}
    assert {task.options.draws for task in tasks.values()} == {SMALL_RUN.draws}


def test_doubts_about_priors_are_told_once(
    make_plan: MakePlan, small_problem: Problem, caplog: pytest.LogCaptureFixture
) -> None:
    caplog.set_level(logging.INFO, "pyburgers")
    odd = replace(small_problem.priors, material="olivine")
    plan = make_plan()
    save_priors(odd, plan.parent / "inputs" / "priors.toml")
    load_campaign(plan)
    task_of(small_problem.experiment, odd, SMALL_RUN)
    said = [one for one in caplog.messages if "are priors of olivine" in one]
    assert len(said) == 2


@pytest.mark.parametrize(
    ("old", "new", "word"),
    [
        ("PIL40.toml", "none.toml", "none.toml does not exist"),
        ("alone =", '"a/b" =', "a/b"),
        ("chains =", "chain =", "unknown key 'chain' in [sampler]"),
        ("draws = 100", "draws = 1", "alone-standard-own-seed11: draws is 1"),
        ("[priors]", '[variants]\nx = { kelvin = "y" }\n[priors]', "kelvin"),
        (
            "[priors]",
            '[variants]\na = {}\na-own = {}\n[priors]\nown-own = "default"',
            "2 fits would have the name alone-a-own-own-seed11",
        ),
        (
            "[priors]\nown",
            f"[variants]\n{'v' * 99} = {{}}\n[priors]\n{'p' * 99}",
            "letters, expected at most 200",
        ),
    ],
)
def test_wrong_plans_are_told_in_a_sentence(
    old: str, new: str, word: str, make_plan: MakePlan, tmp_path: Path, cli: CommandLine
) -> None:
    out = tmp_path / "out"
    cli.refused(["campaign", make_plan((old, new)), "--out", out], word)
    assert not out.exists()
