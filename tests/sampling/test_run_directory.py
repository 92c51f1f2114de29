"""The run directory: atomic writing, claiming, refusing, what a kill leaves behind."""

import errno
import json
import os
import re
import signal
import socket
import subprocess
import sys
import time
from contextlib import suppress
from pathlib import Path
from uuid import uuid4

import pytest

from pyburgers.common.atomic_files import (
    UNFINISHED,
    sha256_of_json,
    write_atomically,
    write_json,
    write_text,
)
from pyburgers.common.errors import InputError
from pyburgers.common.locks import process_lock
from pyburgers.sampling.run_directory import RunDirectory


def names(folder: Path) -> set[str]:
    return {path.name for path in folder.iterdir()}


def unwritable(tmp_path: Path) -> Path:
    """Return a folder in which nothing can be made, whoever runs the tests."""
    if os.geteuid() == 0:
        return Path("/proc")
    folder = tmp_path / "locked"
    folder.mkdir(mode=0o555, parents=True)
    return folder


def test_a_write_that_fails_leaves_the_old_file(tmp_path: Path) -> None:
    path = tmp_path / "file.json"
    write_json(path, {"old": 1})

    def fail(temporary: Path) -> None:
        temporary.write_text('{"new": ', encoding="utf-8")
        raise RuntimeError("disk full")

    with pytest.raises(RuntimeError, match="disk full"):
        write_atomically(path, fail)
    assert json.loads(path.read_text(encoding="utf-8")) == {"old": 1}
    assert names(tmp_path) == {"file.json"}


def test_a_written_file_replaces_the_old_one_and_keeps_its_suffix_meanwhile(
    tmp_path: Path,
) -> None:
    path = tmp_path / "table.csv"
    write_text(path, "old")
    seen = []

    def write(temporary: Path) -> None:
        seen.append(temporary)
        temporary.write_text("new", encoding="utf-8")

    write_atomically(path, write)
    assert path.read_text(encoding="utf-8") == "new"
    assert seen[0].suffix == ".csv"
    assert seen[0].name.startswith(UNFINISHED)
    assert names(tmp_path) == {"table.csv"}


def test_json_keeps_every_digit_and_infinity(tmp_path: Path) -> None:
    content = {"third": 1 / 3, "bound": float("inf")}
    write_json(tmp_path / "a.json", content)
    assert json.loads((tmp_path / "a.json").read_text(encoding="utf-8")) == content
    # A hash does not depend on the order of keys.
    assert sha256_of_json({"a": 1, "b": [2.5]}) == sha256_of_json({"b": [2.5], "a": 1})
    assert sha256_of_json({"a": 1}) != sha256_of_json({"a": 2})


def test_a_new_directory_is_claimed_with_its_parents(tmp_path: Path) -> None:
    run = RunDirectory(tmp_path / "deep" / "run")
    with run.claimed("abc"):
        assert run.read_manifest()["fingerprint"] == "abc"
        assert run.inputs.is_dir()
        assert run.finished_chains() == ()


def test_the_same_inputs_may_come_back_and_find_what_was_finished(tmp_path: Path) -> None:
    run = RunDirectory(tmp_path / "run")
    with run.claimed("abc"):
        for chain in (10, 2):
            folder = run.new_scratch()
            (folder / "draws.csv").write_text(str(chain), encoding="utf-8")
            run.keep_chain(chain, folder, wall_seconds=1.5)
    with run.claimed("abc"):
        assert run.finished_chains() == (2, 10)
        assert run.draws_file(10).read_text(encoding="utf-8") == "10"


def test_a_place_that_can_hold_no_run_is_refused_and_left_alone(tmp_path: Path) -> None:
    thesis, file = tmp_path / "mine" / "thesis.txt", tmp_path / "file"
    thesis.parent.mkdir()
    for own in (thesis, file):
        own.write_text("precious", encoding="utf-8")
    before = sorted(tmp_path.rglob("*"))
    for path, words in (
        (thesis.parent, r"thesis\.txt"),
        *((tmp_path / name, "line break or a zero byte") for name in ("a\nb", "a\rb", "a\0b")),
        (file, "cannot be written"),
        (file / "run", "cannot be written"),
        (unwritable(tmp_path / "new") / "pyburgers-run", "cannot be written"),
    ):
        with pytest.raises(InputError, match=words), RunDirectory(path).claimed("abc"):
            pass
    assert [own for own in sorted(tmp_path.rglob("*")) if "new" not in own.parts] == before
    assert file.read_text(encoding="utf-8") == "precious"


def test_the_folder_of_half_files_goes_with_the_claim(tmp_path: Path) -> None:
    run = RunDirectory(tmp_path / "run")
    with run.claimed("abc"):
        run.new_scratch()
    with suppress(KeyboardInterrupt), run.claimed("abc"):
        run.new_scratch()
        raise KeyboardInterrupt
    assert not (run.path / ".scratch").exists()


def test_a_file_that_was_noted_later_is_looked_at_too(tmp_path: Path) -> None:
    run = RunDirectory(tmp_path / "run")
    file = run.path / "law.json"
    with run.claimed("abc"):
        write_json(file, {"n": 3})
        run.note_hash(file)
    run.require_unchanged()
    write_json(file, {"n": 4})
    with pytest.raises(InputError, match=r"run: law\.json has changed since the run"):
        run.require_unchanged()
    file.unlink()
    with pytest.raises(InputError, match=r"law\.json is missing"), run.claimed("abc"):
        pass


def test_a_second_process_is_kept_out_until_the_first_is_gone(tmp_path: Path) -> None:
    run = RunDirectory(tmp_path / "run")
    code = (
        "import sys, time\n"
        "from pathlib import Path\n"
        "from pyburgers.sampling.run_directory import RunDirectory\n"
        "with RunDirectory(Path(sys.argv[1])).claimed('abc'):\n"
        "    print('claimed', flush=True)\n"
        "    time.sleep(600)\n"
    )
    holder = subprocess.Popen(
        [sys.executable, "-c", code, str(run.path)],
        stdout=subprocess.PIPE,
        text=True,
        start_new_session=True,
    )
    assert holder.stdout is not None
    with holder, holder.stdout:
        assert holder.stdout.readline() == "claimed\n"
        with pytest.raises(InputError, match="another process"), run.claimed("abc"):
            pass
        holder.send_signal(signal.SIGKILL)
        holder.wait(timeout=30)
    with run.claimed("abc"):
        pass


def test_what_a_kill_left_behind_is_removed(tmp_path: Path) -> None:
    run = RunDirectory(tmp_path / "run")
    # Killed while the very first file was being written.
    run.path.mkdir()
    (run.path / ".lock").touch()
    (run.path / f"{UNFINISHED}{uuid4().hex}.json").write_text('{"finger', encoding="utf-8")
    with run.claimed("abc"):
        assert not list(run.path.rglob(f"{UNFINISHED}*"))
        (run.new_scratch() / "draws.csv").write_text("half", encoding="utf-8")
        (run.inputs / f"{UNFINISHED}{uuid4().hex}.csv").write_text("half", encoding="utf-8")
    with run.claimed("abc"):
        leftovers = [p for p in run.path.rglob("*") if p.is_file() and p.name != ".lock"]
        assert leftovers == [run.manifest_file]


def test_a_run_removes_only_what_it_made(tmp_path: Path) -> None:
    run = RunDirectory(tmp_path / "run")
    with run.claimed("abc"):
        pass
    made_by_others = [
        *(run.path / name for name in (f"{UNFINISHED}notes", f"mine/{UNFINISHED}{uuid4().hex}")),
        *(run.inputs / f"{UNFINISHED}{name}" for name in ("thesis.tex", "0123.csv")),
    ]
    for file in made_by_others:
        file.parent.mkdir(exist_ok=True)
        file.touch()
    with run.claimed("abc"):
        assert all(file.is_file() for file in made_by_others)
    run.clear("def")
    assert [file for file in made_by_others if file.is_file()] == made_by_others[:2]


HOLDER = """
import sys, time
from pathlib import Path
from pyburgers.common.locks import process_lock
with process_lock(Path(sys.argv[1]), "held"):
    print("held", flush=True)
    time.sleep(600)
"""


def test_a_lock_names_its_file_its_holder_and_the_host(
    tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    lock = tmp_path / ".lock"
    command = [sys.executable, "-c", HOLDER, str(lock)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, text=True) as holder:
        assert holder.stdout is not None
        assert holder.stdout.readline() == "held\n"
        known = f"process {holder.pid} on {socket.gethostname()} holds {lock}"
        with (
            caplog.at_level("INFO"),
            pytest.raises(InputError) as refused,
            process_lock(lock, "Another one works here", "wait", patience=0.1),
        ):
            pass
        holder.kill()
    assert str(refused.value) == f"Another one works here: {known}; wait."
    assert caplog.messages == [f"Another one works here: waiting for {known}."]
    with process_lock(lock, "", "", patience=0):
        assert lock.read_text(encoding="utf-8").split() == [str(os.getpid()), socket.gethostname()]


@pytest.mark.filterwarnings("ignore:flock not supported")
def test_a_stale_lock_of_another_host_is_explained_where_there_is_no_flock(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    def refuse(descriptor: int, operation: int) -> None:
        raise OSError(errno.ENOSYS, "no flock here")

    monkeypatch.setattr("fcntl.flock", refuse)
    run = RunDirectory(tmp_path / "run")
    with run.claimed("abc"), pytest.raises(InputError, match=f"process {os.getpid()} on "):
        run.clear("abc")
    lock = run.path / ".lock"
    lock.write_text("77\nfar-away\n", encoding="utf-8")
    words = re.escape(f"process 77 on far-away holds {lock}; delete {lock} if none runs there;")
    with pytest.raises(InputError, match=words), run.claimed("abc"):
        pass
    lock.unlink()
    with run.claimed("abc"):
        pass


def test_no_reader_ever_sees_half_a_file(tmp_path: Path) -> None:
    """Kill processes that rewrite a file all the time, at several moments."""
    code = (
        "import sys\n"
        "from pathlib import Path\n"
        "from pyburgers.sampling.run_directory import write_json\n"
        "while True:\n"
        "    write_json(Path(sys.argv[1]), list(range(100_000)))\n"
    )
    paths = [tmp_path / f"{number}.json" for number in range(3)]
    writers = [
        subprocess.Popen([sys.executable, "-c", code, str(path)], start_new_session=True)
        for path in paths
    ]
    for path, writer, wait_s in zip(paths, writers, (0.05, 0.1, 0.17), strict=True):
        while not path.is_file() and writer.poll() is None:
            time.sleep(0.01)
        time.sleep(wait_s)
        writer.kill()
        writer.wait(timeout=30)
        assert json.loads(path.read_text(encoding="utf-8"))[-1] == 99_999
