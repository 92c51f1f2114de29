"""Run directories that were damaged or changed after the run: told in a sentence, never used."""

import json
import shutil
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import IO, Any, Self

import pytest
from conftest import SMALL_RUN, Problem, copy_of
from refusals import assert_refused
from same_contents import assert_equal

from pyburgers.cli.main import main
from pyburgers.common.errors import InputError
from pyburgers.common.netcdf_files import read_netcdf, write_netcdf
from pyburgers.fitting.fit import Fit, fit

Damage = Callable[[Path], None]


def text(content: str) -> Damage:
    """Give a file another content."""

    def damage(file: Path) -> None:
        file.write_text(content, encoding="utf-8")

    return damage


def cut(file: Path) -> None:
    """Leave the first half of a file."""
    content = file.read_bytes()
    file.write_bytes(content[: len(content) // 2])


def replaced(old: str, new: str) -> Damage:
    """Replace a text, once."""

    def damage(file: Path) -> None:
        content = file.read_text(encoding="utf-8")
        assert old in content
        file.write_text(content.replace(old, new, 1), encoding="utf-8")

    return damage


def entry(name: str, value: object) -> Damage:
    """Change an entry of a JSON file."""

    def damage(file: Path) -> None:
        content = json.loads(file.read_text(encoding="utf-8"))
        file.write_text(json.dumps({**content, name: value}), encoding="utf-8")

    return damage


def sampler(name: str, value: object) -> Damage:
    """Change a setting of the sampler that a manifest notes."""

    def damage(file: Path) -> None:
        content = json.loads(file.read_text(encoding="utf-8"))
        content["sampler"][name] = value
        file.write_text(json.dumps(content), encoding="utf-8")

    return damage


def without(name: str) -> Damage:
    """Take an entry out of a JSON file."""

    def damage(file: Path) -> None:
        content = json.loads(file.read_text(encoding="utf-8"))
        del content[name]
        file.write_text(json.dumps(content), encoding="utf-8")

    return damage


def other_draws(file: Path) -> None:
    """Move all draws of a parameter in the labelled ones."""
    tree = read_netcdf(file)
    tree["posterior"]["maxwell_modulus"] *= 1.01
    write_netcdf(file, tree)


def other_hash(file: Path) -> None:
    """Change a digit of the hash that a file notes of the draws of the second chain."""
    content = json.loads(file.read_text(encoding="utf-8"))
    noted = content.get("chains", {"2": content})["2"]
    noted["sha256"] = ("1" if noted["sha256"][0] == "0" else "0") + noted["sha256"][1:]
    file.write_text(json.dumps(content), encoding="utf-8")


def a_folder(file: Path) -> None:
    """Put a folder where a file was."""
    file.unlink()
    file.mkdir()


DRAWS, TIMING = "chains/chain_2/draws.csv", "chains/chain_2/timing.json"
DATA, TEST = "inputs/tests/PIL40/experiment.csv", "inputs/tests/PIL40/experiment.toml"
DAMAGES: dict[str, tuple[str, Damage, str]] = {
    "timing empty": (TIMING, text(""), "timing.json: is not valid JSON"),
    "timing cut": (TIMING, cut, "timing.json: is not valid JSON"),
    "timing of another kind": (TIMING, text("[1, 2]"), "timing.json: found list, expected"),
    "timing without hash": (TIMING, without("sha256"), "key 'sha256' is missing"),
    "no timing": (TIMING, Path.unlink, "timing.json does not exist; put back what the run wrote"),
    "hash in timing": (TIMING, other_hash, f"run: {TIMING} has changed since"),
    "hash in manifest": (
        "manifest.json",
        other_hash,
        f"run: the hash of {DRAWS} in manifest.json has changed since",
    ),
    "draws cut": (DRAWS, cut, f"{DRAWS} has changed"),
    "draws with text": (DRAWS, replaced("0.", "zero."), f"{DRAWS} has changed"),
    "draws renamed": (DRAWS, replaced("log_jacobian", "jacobian"), f"{DRAWS} has changed"),
    "no draws": (DRAWS, Path.unlink, f"{DRAWS} is missing"),
    "Stan data cut": ("stan_data.json", cut, "stan_data.json has changed"),
    "Stan data changed": ("stan_data.json", entry("tolerance", 1e-3), "stan_data.json has changed"),
    "metric changed": ("metric.json", text("{}"), "metric.json has changed"),
    "posterior changed": ("posterior.nc", other_draws, "posterior.nc has changed"),
    **{
        f"{name} a folder": (name, a_folder, f"run: {name} has become a folder since")
        for name in ("posterior.nc", "summary.csv", "checks.json")
    },
    "posterior cut": ("posterior.nc", cut, "posterior.nc has changed"),
    "data changed": (DATA, replaced("1", "2"), f"{DATA} has changed"),
    "test changed": (TEST, replaced("id", "id "), f"{TEST} has changed"),
    "priors gone": ("inputs/priors.toml", Path.unlink, "inputs/priors.toml is missing"),
    "manifest empty": ("manifest.json", text(""), "manifest.json: is not valid JSON"),
    "manifest cut": ("manifest.json", cut, "manifest.json: is not valid JSON"),
    "manifest of text": ("manifest.json", text('"run"'), "manifest.json: found str"),
    "manifest deep": ("manifest.json", text("[" * 100_000), "manifest.json: is not valid JSON"),
    "chains of text": ("manifest.json", entry("chains", "two"), "key 'chains': found 'two'"),
    "hashes of numbers": ("manifest.json", entry("hashes", {"a": 1}), "in [hashes]: found 1"),
    "tests of numbers": ("manifest.json", entry("experiments", [1]), "'experiments', entry 1"),
    "no tests": ("manifest.json", without("experiments"), "is not a fit of tests"),
    **{
        f"no {name}": ("manifest.json", without(name), f"key '{name}' is missing, expected")
        for name in (
            *("fingerprint", "status", "command", "versions", "sampler", "use_likelihood"),
            *("failures", "refits", "solver", "coordinates", "pooling", "data_kind", "started"),
        )
    },
    **{
        f"{name} wrong": ("manifest.json", entry(name, value), f"key '{name}': found {value!r}")
        for name, value in {
            "data_kind": "guessed",
            "status": "finished",
            "started": 7,
            "priors_from": 7,
        }.items()
    },
    "sampler of text": ("manifest.json", entry("sampler", "fast"), "key 'sampler': found 'fast'"),
    "chains without end": (
        "manifest.json",
        sampler("chains", 10**30),
        f"'chains' in [sampler]: found {10**30}",
    ),
    "sampler empty": (
        "manifest.json",
        entry("sampler", {}),
        "'chains' in [sampler] is missing",
    ),
    "failures wrong": (
        "manifest.json",
        entry("failures", [{}]),
        "in [[failures]] number 1",
    ),
}


@pytest.fixture
def copy(small_fit: Fit, tmp_path: Path) -> Path:
    """A copy of the run, to be damaged."""
    return copy_of(small_fit, tmp_path / "run").directory.path


def contents(folder: Path) -> dict[Path, bytes]:
    return {file: file.read_bytes() for file in folder.rglob("*") if file.is_file()}


@pytest.mark.parametrize(("name", "damage", "word"), DAMAGES.values(), ids=DAMAGES)
def test_a_damaged_run_is_one_sentence(
    name: str, damage: Damage, word: str, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    damage(copy / name)
    before = contents(copy)
    capsys.readouterr()
    for command in (["check"], ["report", "--out", str(copy.parent / "page")]):
        assert_refused(main([command[0], str(copy), *command[1:]]), capsys, word)
    assert contents(copy.parent) == before


def note(log: str) -> str:
    """What a check says of the tables that it wrote again, after the name of the run."""
    (line,) = log.splitlines()
    return line.split("run: ", 1)[1]


@pytest.mark.parametrize("damage", [text(""), cut, text("old numbers"), Path.unlink])
def test_a_check_writes_tables_again_that_are_not_those_of_the_draws(
    damage: Damage, copy: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    before = contents(copy)
    code = main(["check", str(copy)])
    assert contents(copy) == before
    out, log = capsys.readouterr()
    assert log == ""
    for names in (["summary.csv"], ["checks.json"], ["summary.csv", "checks.json"]):
        for name in names:
            damage(copy / name)
        assert main(["check", str(copy)]) == code
        assert contents(copy) == before
        again, log = capsys.readouterr()
        assert again == out
        assert note(log).startswith(f"{' and '.join(names)} did not agree with the draws")


def test_a_check_leaves_tables_to_a_run_that_has_not_written_them(copy: Path) -> None:
    entry("status", "sampling")(copy / "manifest.json")
    for name in ("summary.csv", "checks.json"):
        (copy / name).unlink()
    before = contents(copy)
    main(["check", str(copy)])
    assert contents(copy) == before


@pytest.mark.parametrize("name", [DRAWS, DATA, "stan_data.json", "posterior.nc"])
def test_a_changed_run_is_not_continued(name: str, copy: Path, small_problem: Problem) -> None:
    with (copy / name).open("ab") as file:
        file.write(b"\n")
    before = contents(copy)
    with pytest.raises(InputError, match=f"run: {name} has changed since the run"):
        fit(small_problem.experiment, small_problem.priors, out=copy, options=SMALL_RUN)
    assert {file: content for file, content in contents(copy).items() if file in before} == before


def test_of_draws_whose_hash_the_manifest_lacks_either_file_may_be_to_blame(copy: Path) -> None:
    """As of a run that was killed before it noted its chains."""
    entry("chains", {})(copy / "manifest.json")
    cut(copy / DRAWS)
    with pytest.raises(InputError, match=f"run: {DRAWS} or {TIMING} has changed"):
        Fit.load(copy)


def test_all_that_has_changed_is_said(copy: Path) -> None:
    for name in (DRAWS, DATA):
        cut(copy / name)
    with pytest.raises(InputError, match=f"{DATA} has changed, {DRAWS} has changed"):
        Fit.load(copy)


def test_what_is_no_chain_is_passed_over(copy: Path) -> None:
    shutil.copytree(copy / "chains" / "chain_2", copy / "chains" / "chain_2 (copy)")
    assert list(Fit.load(copy).manifest["chains"]) == ["1", "2"]


def test_labelled_draws_that_were_not_noted_are_gathered_again(copy: Path, small_fit: Fit) -> None:
    """A killed process may have written them without noting their hash."""
    entry("posterior_sha256", None)(copy / "manifest.json")
    cut(copy / "posterior.nc")
    for _ in range(2):
        loaded = Fit.load(copy)
        for name in ("posterior", "sample_stats"):
            again, first = (fit.posterior[name].to_dataset() for fit in (loaded, small_fit))
            assert again.equals(first)


@pytest.mark.usefixtures("sketched")
def test_a_folder_of_another_kind_is_told(
    small_fit: Fit, tmp_path: Path, capsys: pytest.CaptureFixture[str]
) -> None:
    page = tmp_path / "page"
    assert main(["report", str(small_fit.directory.path), "--out", str(page)]) == 0
    capsys.readouterr()
    for command in (["check"], ["report", "--out", str(tmp_path / "other")]):
        assert_refused(
            main([command[0], str(page), *command[1:]]), capsys, "page: is not a fit of tests"
        )


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
