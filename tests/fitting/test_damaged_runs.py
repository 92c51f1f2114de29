"""Run directories that were damaged or changed after the run: told in a sentence, never used."""

import errno
import json
import os
import re
import shutil
from collections.abc import Callable, Iterator
from functools import reduce
from operator import getitem
from pathlib import Path
from typing import IO, Any, Self

import numpy as np
import pytest
from conftest import SMALL_RUN, Problem, copy_of
from refusals import CommandLine
from same_contents import assert_equal, contents

from pyburgers.cli.main import main
from pyburgers.common.atomic_files import write_json
from pyburgers.common.errors import InputError
from pyburgers.common.netcdf_files import read_netcdf, write_netcdf
from pyburgers.fitting.fit import Fit, fit
from pyburgers.sampling.manifest import FORMAT, SEAL, FitManifest
from pyburgers.sampling.run_directory import RunDirectory

Damage = Callable[[Path], None]
GONE = object()


def text(content: str) -> Damage:
    """Give a file another content."""

    def damage(file: Path) -> None:
        file.write_text(content, encoding="utf-8")

    return damage


def longer(file: Path) -> None:
    """Add an empty line."""
    file.write_bytes(file.read_bytes() + b"\n")


def cut(file: Path) -> None:
    """Leave the first half of a file."""
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])


def a_folder(file: Path) -> None:
    """Put a folder where a file was."""
    file.unlink()
    file.mkdir()


def entry(path: str, value: object = GONE) -> Damage:
    """Change an entry of a JSON file, or take it out."""
    *outer, name = path.split("/")

    def damage(file: Path) -> None:
        content = json.loads(file.read_text(encoding="utf-8"))
        table = reduce(getitem, outer, content)
        if value is GONE:
            del table[name]
        else:
            table[name] = value
        if file.name == "manifest.json":  # as one that nobody edited
            RunDirectory(file.parent).write_manifest(content)
        else:
            file.write_text(json.dumps(content), encoding="utf-8")

    return damage


def other_draws(file: Path) -> None:
    """Move all draws of a parameter in the labelled ones."""
    tree = read_netcdf(file)
    tree["posterior"]["maxwell_modulus"] *= 1.01
    write_netcdf(file, tree)


DRAWS, TIMING = "chains/chain_2/draws.csv", "chains/chain_2/timing.json"
DATA, TEST = "inputs/tests/PIL40/experiment.csv", "inputs/tests/PIL40/experiment.toml"
HASHED = (DRAWS, DATA, TEST, "inputs/priors.toml", "stan_data.json", "metric.json", "posterior.nc")
"""Files whose hashes the manifest has."""

OF_HASHED: dict[str, tuple[Damage, str]] = {
    "empty": (text(""), "{} has changed since the run"),
    "cut": (cut, "{} has changed since the run"),
    "longer": (longer, "{} has changed since the run"),
    "missing": (Path.unlink, "{} is missing"),
    "a folder": (a_folder, "{} is missing"),
}
OF_JSON: dict[str, tuple[Damage, str]] = {
    "empty": (text(""), "{} is not valid JSON"),
    "cut": (cut, "{} is not valid JSON"),
    "deep": (text("[" * 100_000), "{} is not valid JSON"),
    "text": (text('"run"'), "{} found str"),
}
OTHER_HASH = entry("sha256", 64 * "0")
DAMAGES: dict[str, tuple[dict[str, Damage], str]] = {
    **{
        f"{name} {what}": ({name: damage}, "run: " + words.format(name))
        for name in HASHED
        for what, (damage, words) in OF_HASHED.items()
        if words != "{} is missing" or name != "posterior.nc"  # it is gathered again
    },
    **{
        f"{name} {what}": ({name: damage}, words.format(f"{name}:"))
        for name in (TIMING, "manifest.json")
        for what, (damage, words) in OF_JSON.items()
    },
    **{
        f"{name} a folder": ({name: a_folder}, f"run: {name} has become a folder since")
        for name in ("posterior.nc", "summary.csv", "checks.json")
    },
    "labelled draws": ({"posterior.nc": other_draws}, "run: posterior.nc has changed"),
    "timing without hash": ({TIMING: entry("sha256")}, "key 'sha256' is missing"),
    "no timing": ({TIMING: Path.unlink}, "timing.json does not exist; put back what the run wrote"),
    "hash in timing": ({TIMING: OTHER_HASH}, f"run: {TIMING} has changed since"),
    "hash in manifest": (
        {"manifest.json": entry("chains/2/sha256", 64 * "0")},
        f"run: the hash of {DRAWS} in manifest.json has changed since",
    ),
    # As of a run that was killed before it noted its chains.
    "no hash in manifest": (
        {"manifest.json": entry("chains", {}), DRAWS: cut},
        f"run: {DRAWS} or {TIMING} has changed",
    ),
    "two files": ({DRAWS: cut, DATA: cut}, f"{DATA} has changed, {DRAWS} has changed"),
    "no tests": ({"manifest.json": entry("experiments")}, "is not a fit of tests"),
    **{
        f"no {name}": ({"manifest.json": entry(name)}, f"key '{name}' is missing, expected")
        for name in (
            *("fingerprint", "status", "command", "versions", "sampler", "use_likelihood"),
            *("failures", "refits", "solver", "coordinates", "pooling", "data_kind", "started"),
            "variant",
        )
    },
    **{
        f"{path} {value!r}": ({"manifest.json": entry(path, value)}, words.format(repr(value)))
        for path, value, words in (
            ("data_kind", "guessed", "key 'data_kind': found {}"),
            ("status", "finished", "key 'status': found {}"),
            ("started", 7, "key 'started': found {}"),
            ("priors_from", 7, "key 'priors_from': found {}"),
            ("chains", "two", "key 'chains': found {}"),
            ("sampler", "fast", "key 'sampler': found {}"),
            ("sampler", {}, "'chains' in [sampler] is missing"),
            ("sampler/chains", 10**30, "'chains' in [sampler]: found {}"),
            ("hashes", {"a": 1}, "in [hashes]: found 1"),
            ("experiments", [1], "'experiments', entry 1"),
            ("failures", [{}], "in [[failures]] number 1"),
        )
    },
}


@pytest.fixture
def copy(small_fit: Fit, tmp_path: Path) -> Path:
    """A copy of the run, to be damaged."""
    return copy_of(small_fit, tmp_path / "run").directory.path


@pytest.mark.parametrize(("damages", "words"), DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_run_is_refused_in_one_sentence_by_all_that_reads_it(
    damages: dict[str, Damage], words: str, copy: Path, small_problem: Problem, cli: CommandLine
) -> None:
    for name, damage in damages.items():
        damage(copy / name)
    before = contents(copy)
    with pytest.raises(InputError) as refused:
        Fit.load(copy)
    assert words in str(refused.value)
    page, table = (("--out", str(copy.parent / name)) for name in ("page", "table.csv"))
    commands = [["check"], ["report", *page], ["predict", "attenuation", *table]]
    for command in commands if cut in damages.values() else commands[:1]:
        cli.refused([*command, copy], words)
    assert contents(copy.parent) == before
    if longer in damages.values():
        with pytest.raises(InputError, match=re.escape(words)):
            fit(small_problem.experiment, small_problem.priors, out=copy, options=SMALL_RUN)
        assert {file: own for file, own in contents(copy).items() if file in before} == before


def test_a_report_shows_the_other_runs_and_names_the_damaged_one(
    copy: Path, other_fit: Fit, sketched: None, cli: CommandLine
) -> None:
    cut(copy / DRAWS)
    page = copy.parent / "page"
    runs = (copy, other_fit.directory.path)
    assert "The page is" in cli("report", *runs, "--out", page, code=2)
    assert f"run: {DRAWS} has changed" in cli.error
    assert "The page is about the other runs." in cli.error
    shown = json.loads((page / "manifest.json").read_text(encoding="utf-8"))["runs"]
    assert [one["id"] for one in shown] == [other_fit.directory.path.name]


@pytest.mark.parametrize("name", ["chains", "."])
def test_a_folder_that_cannot_be_read_is_not_an_empty_one(
    name: str, copy: Path, small_problem: Problem, monkeypatch: pytest.MonkeyPatch
) -> None:
    """Permissions do not keep the superuser out."""

    def refuse(folder: Path) -> Iterator[Path]:
        raise PermissionError(errno.EACCES, os.strerror(errno.EACCES), str(folder))

    iterates, locked = Path.iterdir, copy / name
    monkeypatch.setattr(Path, "iterdir", lambda at: (refuse if at == locked else iterates)(at))
    before = contents(copy)
    if name == ".":
        (copy / "manifest.json").unlink()
        before = contents(copy)
    with pytest.raises(InputError, match=r"cannot be read|not a run directory"):
        Fit.load(copy)
    with pytest.raises(InputError, match="cannot be read"):
        fit(small_problem.experiment, small_problem.priors, out=copy, options=SMALL_RUN)
    assert {file: own for file, own in contents(copy).items() if file in before} == before


@pytest.mark.parametrize("damage", [text(""), cut, text("old numbers"), Path.unlink])
def test_a_check_writes_tables_again_that_are_not_those_of_the_draws(
    damage: Damage, copy: Path, cli: CommandLine
) -> None:
    before = contents(copy)
    out, code = cli("check", copy, code=None), cli.code
    assert contents(copy) == before
    assert cli.error == ""
    both = ["summary.csv", "checks.json"]
    for names in ([name] for name in both) if damage is cut else [both]:
        for name in names:
            damage(copy / name)
        assert cli("check", copy, code=code) == out
        assert contents(copy) == before
        why = "is missing;" if damage is Path.unlink else "differs from what the installed"
        for name, note in zip(names, cli.error.splitlines(), strict=True):
            assert f"run: {name} {why}" in note


def test_a_run_that_can_only_be_read_is_checked(
    copy: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    out, code = cli("check", copy, code=None), cli.code

    def refuse(file: Path, _: str) -> None:
        raise OSError(errno.EROFS, os.strerror(errno.EROFS), str(file))

    monkeypatch.setattr("pyburgers.fitting.sampled_fit.write_text", refuse)
    (copy / "summary.csv").write_text("of other versions", encoding="utf-8")
    assert cli("check", copy, code=code) == out
    assert "summary.csv: Read-only file system; the file stays as it is" in cli.error


def test_a_check_leaves_tables_to_a_run_that_has_not_written_them(copy: Path) -> None:
    entry("status", "sampling")(copy / "manifest.json")
    for name in ("summary.csv", "checks.json"):
        (copy / name).unlink()
    before = contents(copy)
    main(["check", str(copy)])
    assert contents(copy) == before


def test_what_is_no_chain_is_passed_over(copy: Path) -> None:
    shutil.copytree(copy / "chains" / "chain_2", copy / "chains" / "chain_2 (copy)")
    assert list(Fit.load(copy).manifest["chains"]) == ["1", "2"]


@pytest.mark.parametrize("damage", [cut, Path.unlink])
def test_labelled_draws_that_were_not_noted_or_are_gone_are_gathered_again(
    damage: Damage, copy: Path, small_fit: Fit
) -> None:
    """A killed process may have written them without noting their hash."""
    if damage is cut:
        entry("posterior_sha256", None)(copy / "manifest.json")
    damage(copy / "posterior.nc")
    for _ in range(2):
        loaded = Fit.load(copy)
        for name in ("posterior", "predictions", "sample_stats", "posterior_predictive"):
            again, first = (fit.posterior[name].to_dataset() for fit in (loaded, small_fit))
            assert again.equals(first)
        assert (copy / "posterior.nc").is_file()


def edits(value: object) -> Iterator[object]:
    """Change a value plausibly, at one place at a time."""
    match value:
        case dict():
            for name, part in value.items():
                yield {key: own for key, own in value.items() if key != name}
                yield from ({**value, name: other} for other in edits(part))
        case list():
            yield [*value, *value[:1]] if value else [1]
            yield from ([other, *value[1:]] for part in value[:1] for other in edits(part))
        case bool():
            yield not value
        case int() | float():
            yield value * 10 + 1
        case _:
            yield {"measured": "synthetic", "shared": "separate"}.get(str(value), f"{value} ")


@pytest.mark.parametrize("name", FitManifest.model_fields)
def test_every_edit_of_a_manifest_is_noticed_and_nothing_is_written(
    name: str, copy: Path, cli: CommandLine
) -> None:
    run = RunDirectory(copy)
    manifest = run.read_manifest()
    edited = [{**manifest, name: other} for other in edits(manifest.get(name, []))]
    if name in manifest:
        edited.append({key: value for key, value in manifest.items() if key != name})
    for content in edited:
        write_json(run.manifest_file, content)
        with pytest.raises(InputError, match="has changed since the run, as its seal says"):
            run.read_manifest()
        with pytest.raises(InputError, match="as its seal says"):
            run.update_manifest({"status": "complete"})
    before = contents(copy)
    cli.refused(["check", copy], "as its seal says; put back")
    assert contents(copy) == before


@pytest.mark.parametrize(
    ("missing", "said"), [(SEAL, "as its missing seal says"), (FORMAT, "as its seal says")]
)
def test_a_manifest_that_lost_its_seal_is_refused(
    missing: str, said: str, copy: Path, cli: CommandLine
) -> None:
    run = RunDirectory(copy)
    manifest = run.read_manifest()
    write_json(run.manifest_file, {name: manifest[name] for name in manifest.keys() - {missing}})
    before = contents(copy)
    cli.refused(["check", copy], said)
    assert contents(copy) == before


def test_a_run_of_a_version_without_a_seal_is_read_and_sealed_when_it_goes_on(copy: Path) -> None:
    run = RunDirectory(copy)
    manifest = run.read_manifest()
    write_json(
        run.manifest_file, {name: manifest[name] for name in manifest.keys() - {SEAL, FORMAT}}
    )
    assert Fit.load(copy).manifest["status"] == "complete"
    run.update_manifest({})
    assert run.read_manifest() == manifest


class ExchangedWhenClosed:
    """A file that another one replaces as soon as it has been read for the first time."""

    def __init__(self, opened: IO[Any], exchange: Callable[[], None]) -> None:
        self._opened, self._exchange = opened, exchange

    def __getattr__(self, name: str) -> Any:
        return getattr(self._opened, name)

    def __iter__(self) -> Iterator[Any]:
        return iter(self._opened)

    def __enter__(self) -> Self:
        return self

    def __exit__(self, *raised: object) -> None:
        self._opened.close()
        self._exchange()


@pytest.mark.parametrize("gathered", [True, False], ids=["with labelled draws", "chains alone"])
@pytest.mark.parametrize(
    "name",
    [
        *("inputs/tests/PIL40/experiment.toml", "inputs/tests/PIL40/experiment.csv"),
        *("inputs/priors.toml", "stan_data.json", "chains/chain_1/draws.csv", "posterior.nc"),
    ],
)
def test_what_comes_into_a_run_after_its_hash_was_compared_is_never_read(
    name: str,
    gathered: bool,
    copy: Path,
    small_fit: Fit,
    other_fit: Fit,
    monkeypatch: pytest.MonkeyPatch,
) -> None:
    stranger = other_fit.directory.path / name.replace("PIL40", "other")
    content = stranger.read_bytes() + b"\n# of another run\n" * name.endswith(".toml")
    assert content != (copy / name).read_bytes() or name == "inputs/priors.toml"
    if not gathered:
        entry("posterior_sha256", None)(copy / "manifest.json")
    exchanged, open_as_before = list[str](), Path.open

    def exchange() -> None:
        (copy / name).unlink()
        (copy / name).write_bytes(content)
        exchanged.append(name)

    def open_once(file: Path, mode: str = "r", *args: Any, **options: Any) -> Any:
        opened = open_as_before(file, mode, *args, **options)
        if file != copy / name or mode.startswith("w") or exchanged:
            return opened
        return ExchangedWhenClosed(opened, exchange)

    monkeypatch.setattr(Path, "open", open_once)
    refused: str | None = None
    try:
        loaded = Fit.load(copy)
    except InputError as error:
        refused = str(error)
    if refused is not None:
        assert f"{name} has changed" in refused
    else:
        assert_equal(loaded.experiment, small_fit.experiment)
        assert loaded.priors == small_fit.priors
        for group in ("posterior", "log_likelihood", "predictions"):
            again, first = (fit.posterior[group].to_dataset() for fit in (loaded, small_fit))
            assert again.equals(first)
    assert exchanged or (name == "posterior.nc" and not gathered)


LAST_WRITTEN = (
    *("posterior.nc", "summary.csv", "checks.json", "manifest.json", "stan_data.json"),
    *("metric.json", DRAWS, TIMING),
)


@pytest.mark.parametrize("name", LAST_WRITTEN)
def test_a_file_that_was_cut_anywhere_is_refused_or_written_again(
    name: str, copy: Path, small_fit: Fit, cli: CommandLine
) -> None:
    """As a machine that stops leaves it, which had not written all of its files to the disk."""
    rng = np.random.default_rng(LAST_WRITTEN.index(name))
    whole = contents(copy)
    content = (copy / name).read_bytes()
    for size in (0, len(content) - 2, *rng.integers(1, len(content) - 2, 2)):
        (copy / name).write_bytes(content[:size])
        cut_short = contents(copy)
        said = cli("check", copy, code=None) + cli.error
        if cli.code == 2:
            assert contents(copy) == cut_short
        else:
            assert name in ("summary.csv", "checks.json")
            assert contents(copy) == whole
        assert name in said
        (copy / name).write_bytes(content)
    draws = Fit.load(copy).posterior["posterior"].to_dataset()
    assert draws.equals(small_fit.posterior["posterior"].to_dataset())
