"""The command line where the machine is not as it should be: a sentence and an exit code."""

import logging
import os
import re
import shlex
import shutil
import signal
import subprocess
import sys
from collections.abc import Mapping
from pathlib import Path

import pandas as pd
import pytest
from conftest import ICE
from refusals import CommandLine

from pyburgers.cli.terminal import print_lines, print_table
from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import InputError

PREAMBLE = "import resource, os, sys; from pyburgers.cli.main import main\n"
TEST = str(ICE / "PIL40.toml")


def ended(
    code: str, *, environment: Mapping[str, str] | None = None, **streams: int
) -> tuple[int, str]:
    """Run a program in a process of its own; return its exit code and what it says of errors."""
    done = subprocess.run(
        [sys.executable, "-c", PREAMBLE + code],
        env={**os.environ, "PYTHONDONTWRITEBYTECODE": "1", **(environment or {})},
        stdout=streams.get("stdout", subprocess.DEVNULL),
        stderr=subprocess.PIPE,
        text=True,
        check=False,
        timeout=120,
    )
    return done.returncode, done.stderr


INTERRUPTED = "pyburgers: interrupted; the same command continues with what is missing.\n"

HEARING = """
import signal, time
from pyburgers.cli import main as command_line
import pyburgers.cli.doctor as command
signal.signal(signal.SIGINT, signal.default_int_handler)

def send(*numbers):
    for number in numbers:
        os.kill(os.getpid(), number)
"""

DURING_IMPORT = """
def interrupted_import(name, load=command_line.import_module):
    try:
        send({number})
        module = load(name)
    except KeyboardInterrupt:
        raise ImportError("initialization failed") from None
    return module

command_line.import_module = interrupted_import
"""
"""A signal while the command's modules are imported, one of which makes another error of it."""

DURING_WORK = """
def work(_):
    try:
        send({number})
        time.sleep(600)
    finally:
        print("stopped", file=sys.stderr)
command.run = work
"""

TWICE = DURING_WORK.replace('print("stopped", file=sys.stderr)', "send({number}); time.sleep(600)")


@pytest.mark.parametrize("number", [signal.SIGINT, signal.SIGTERM, signal.SIGHUP])
@pytest.mark.parametrize(
    ("when", "said"), [(DURING_IMPORT, ""), (DURING_WORK, "stopped\n"), (TWICE, "")]
)
def test_a_signal_ends_a_command_at_any_moment(when: str, said: str, number: int) -> None:
    code = HEARING + when.format(number=number) + "sys.exit(main(['doctor']))"
    assert ended(code) == (128 + number, said + INTERRUPTED)


def test_signals_that_are_ignored_stay_so_and_handlers_come_back() -> None:
    code, error = ended(
        HEARING + "signal.signal(signal.SIGHUP, signal.SIG_IGN)\n"
        "command.run = lambda _: send(signal.SIGHUP) or 0\n"
        "code = main(['doctor'])\n"
        "assert signal.getsignal(signal.SIGINT) is signal.default_int_handler\n"
        "assert signal.getsignal(signal.SIGTERM) is signal.SIG_DFL\n"
        "sys.exit(code)"
    )
    assert (code, error) == (0, "")


@pytest.mark.parametrize(
    "error", ["ZeroDivisionError()", "KeyError('x')", "ValueError('two\\nlines')", "Exception()"]
)
def test_an_error_that_nobody_expects_is_a_sentence_and_a_file(error: str, tmp_path: Path) -> None:
    code, said = ended(
        f"import pyburgers.cli.doctor as command\ndef run(_):\n    raise {error}\n"
        "command.run = run\nsys.exit(main(['doctor']))",
        environment={"TMPDIR": str(tmp_path)},
    )
    (file,) = tmp_path.iterdir()
    assert code == 1
    assert said.startswith(f"pyburgers: the program has a fault ({error.split('(')[0]}")
    assert said.endswith(f"please report it with its traceback, which is in {file}.\n")
    assert "Traceback" not in said
    assert "in run" in file.read_text(encoding="utf-8")


CONTROLS = "\x1b[2J\x07\r\x9b\u202e\x00"


def test_control_characters_of_files_and_arguments_are_escaped(
    tmp_path: Path, cli: CommandLine, monkeypatch: pytest.MonkeyPatch
) -> None:
    """On both streams, whoever prints; lines and colours of the program itself stay."""
    monkeypatch.chdir(tmp_path)
    file = tmp_path / f"test{CONTROLS[:-1]}.toml"
    text = (ICE / "PIL40.toml").read_text(encoding="utf-8").replace("PIL40.csv", "no\\u001b[2J")
    file.write_text(text, encoding="utf-8")

    def run(_: object) -> int:
        print(f"bare {CONTROLS}")
        print_lines([f"line {CONTROLS}"])
        print_table(pd.DataFrame({"quantity": [f"cell {CONTROLS}"]}), ["quantity"])
        logging.getLogger("pyburgers").info(f"note {CONTROLS}")
        raise InputError(f"error {CONTROLS}")

    for command in (["fit", str(file)], ["check-file", str(file)], ["doctor"]):
        if command == ["doctor"]:
            monkeypatch.setattr("pyburgers.cli.doctor.run", run)
        said = cli(*command, code=2) + cli.error
        assert not set(said) & (set(CONTROLS) - set("[2J"))
        assert "\\x1b[2J" in said
    for word in ("bare", "line", "cell", "note", "error"):
        assert f"{word} \\x1b[2J\\x07\\r\\x9b\\u202e" in said


def test_a_long_cell_does_not_fill_the_terminal(tmp_path: Path, cli: CommandLine) -> None:
    shutil.copy(ICE / "PIL40.toml", tmp_path)
    lines = (ICE / "PIL40.csv").read_text(encoding="utf-8").splitlines()
    lines[5] = f"0.01,{'9x' * 50_000}"
    (tmp_path / "PIL40.csv").write_text("\n".join(lines), encoding="utf-8")
    cli("fit", tmp_path / "PIL40.toml", code=2)
    assert "letters left out" in cli.error
    assert "expected a number" in cli.error
    assert len(cli.error) < 5000


@pytest.fixture
def full() -> int:
    """A device that is always full."""
    return os.open("/dev/full", os.O_WRONLY)


@pytest.mark.skipif(not Path("/dev/full").exists(), reason="this system has no full device")
@pytest.mark.parametrize("command", ["['doctor']", "['doctor', '--help']"])
def test_a_full_standard_output_is_told(full: int, command: str) -> None:
    code, error = ended(f"sys.exit(main({command}))", stdout=full)
    os.close(full)
    assert code in (0, 1)  # argparse does not mind that its help is lost
    assert "Traceback" not in error
    assert "Exception ignored" not in error
    if code == 1:
        assert error.startswith("pyburgers: standard output or a file: No space left on device;")


@pytest.mark.parametrize(
    ("closed", "command"),
    [((1,), ["fitt"]), ((2,), ["fitt"]), ((0, 1, 2), ["check", "/nowhere"])],
)
def test_closed_streams_change_nothing_else(closed: tuple[int, ...], command: list[str]) -> None:
    closing = f"[os.close(number) for number in {closed}]"
    # Python itself has to find them closed.
    code = f"{closing}; os.execv({sys.executable!r}, [{sys.executable!r}, '-c', {PREAMBLE!r} + "
    code += f"{f'sys.exit(main({command}))'!r}])"
    assert ended(code)[0] == 2


def test_a_reader_that_has_left_is_nobody_to_talk_to() -> None:
    reading, writing = os.pipe()
    os.close(reading)
    code, error = ended("sys.exit(main(['doctor']))", stdout=writing)
    os.close(writing)
    assert (code, error) == (1, "")


def test_letters_that_an_encoding_lacks_are_escaped(tmp_path: Path) -> None:
    out = tmp_path / "out.txt"
    with out.open("wb") as file:
        code, error = ended(
            "import pyburgers.cli.doctor as command\n"
            "command.run = lambda _: print('η of the Kelvin element') or 0\n"
            "sys.exit(main(['doctor']))",
            environment={"PYTHONIOENCODING": "ascii"},
            stdout=file.fileno(),
        )
    assert (code, error) == (0, "")
    assert out.read_text(encoding="ascii") == "\\u03b7 of the Kelvin element\n"


def test_a_deleted_working_directory_is_told(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    monkeypatch.chdir(gone)
    gone.rmdir()
    for command in (["check", "nowhere"], ["doctor"]):
        cli(*command, code=None)
        assert cli.code in (0, 1, 2)
        assert cli.error.startswith("pyburgers: ") or not cli.error


@pytest.mark.parametrize("home", ["file", "/proc/nowhere"])
def test_a_home_that_holds_no_cache_is_told(home: str, tmp_path: Path) -> None:
    (tmp_path / "file").touch()
    environment = {"HOME": str(tmp_path / home)}
    for command in (["check", "/nowhere"], ["export", "/nowhere"]):
        code, error = ended(f"sys.exit(main({command}))", environment=environment)
        assert code == 2
        assert re.fullmatch(
            rf"pyburgers: \S*{home}/\.cache could not be made \(.*\), but libraries keep files "
            "there; set HOME, or XDG_CACHE_HOME, to a folder that you can write to.\n",
            error,
        )
    for argument, expected in (("doctor", 1), ("--help", 0)):
        code, error = ended(f"sys.exit(main(['{argument}']))", environment=environment)
        assert (code, error) == (expected, "")


def test_a_full_disk_is_told_and_what_was_there_stays(tmp_path: Path) -> None:
    out = tmp_path / "text.txt"
    write_text(out, "old")
    code, error = ended(
        "import pyburgers.cli.doctor as command\n"
        "from pathlib import Path\n"
        "from pyburgers.common.atomic_files import write_text\n"
        "resource.setrlimit(resource.RLIMIT_FSIZE, (100, 100))\n"
        f"command.run = lambda _: write_text(Path({str(out)!r}), 'x' * 1000)\n"
        "sys.exit(main(['doctor']))"
    )
    assert code == 1
    assert error.startswith(f"pyburgers: {out}: File too large; ")
    assert [file.name for file in tmp_path.iterdir()] == ["text.txt"]
    assert out.read_text(encoding="utf-8") == "old"


def test_too_little_memory_is_told_and_not_waited_for() -> None:
    code, error = ended(
        "resource.setrlimit(resource.RLIMIT_AS, (300_000_000, resource.RLIM_INFINITY))\n"
        f"sys.exit(main(['fit', {TEST!r}]))"
    )
    assert (code, error) == (
        2,
        "pyburgers: memory is limited to 300 MB, expected at least 600 MB; raise the limit "
        "(ulimit -v).\n",
    )


def test_bytes_that_are_no_text_are_escaped() -> None:
    code, error = ended(r"sys.exit(main(['doctor', '\udcff']))")
    assert (code, "\\udcff" in error) == (2, True)


NEW = shlex.split("--material ice --temperature-K 263 --grain-size-m 1e-3 --strain-rate-per-s 1e-5")


def test_a_name_of_a_file_that_is_no_text_is_refused_where_it_would_be_written(
    tmp_path: Path, cli: CommandLine
) -> None:
    path = os.fsencode(tmp_path) + b"/curve\xff.csv"
    Path(os.fsdecode(path)).write_text("strain,stress\n0.001,2\n0.02,3\n", encoding="utf-8")
    out = str(tmp_path / "curve.toml")
    cli("new", os.fsdecode(path), *NEW, "--out", out, code=2)
    assert cli.error.count("\n") == 1
    assert "found bytes that are no text in its name" in cli.error
    cli.refused(["new", os.fsdecode(path), *NEW, "--id", "\udcff"])


LONG = "x" * 5000


@pytest.mark.parametrize(
    "arguments",
    [
        ["fit", "a\0b.toml"],
        ["fit", LONG],
        ["fit", TEST, "--priors", LONG],
        ["fit", TEST, "--priors-from", LONG],
        ["check", LONG],
        ["report", LONG, "--out", "page"],
        ["simulate", TEST, "--parameters", LONG, "--out", "out.csv"],
        ["fit", "/dev/zero"],
        ["fit", TEST, "--priors", "/dev/zero"],
        ["simulate", TEST, "--parameters", "/dev/zero", "--out", "out.csv"],
        ["check", "/dev"],
    ],
    ids=lambda arguments: " ".join(arguments)[:40].replace("\0", "0"),
)
def test_names_and_files_that_cannot_be_are_refused(
    arguments: list[str], tmp_path: Path, monkeypatch: pytest.MonkeyPatch, cli: CommandLine
) -> None:
    monkeypatch.chdir(tmp_path)
    cli.refused(arguments)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["/proc/kmsg", "/proc/self/environ", "/proc/self/pagemap", "link"])
def test_files_of_the_system_are_refused_like_devices(
    name: str, tmp_path: Path, cli: CommandLine
) -> None:
    (tmp_path / "link").symlink_to("/proc/self/environ")
    text = (ICE / "PIL40.toml").read_text(encoding="utf-8").replace("PIL40.csv", name)
    (tmp_path / "test.toml").write_text(text, encoding="utf-8")
    for command in ("fit", "check-file"):
        said = cli(command, tmp_path / "test.toml", code=2) + cli.error
        assert f"{name} is a device or a pipe; expected a file" in said
    cli.refused(["fit", tmp_path / name], "is a device or a pipe")


SECRETS = [
    "root:x:0:0:root:/root",
    "machine a login b password hunter2",
    "hunter2",
    "a,b\n1,hunter2",
]


@pytest.mark.parametrize("secret", SECRETS)
@pytest.mark.parametrize(
    ("old", "new"),
    [
        ("", ""),
        ('","', '"whitespace"'),
        ("header = true", "header = false"),
        ('"stress_MPa"', '"b"'),
    ],
)
def test_no_line_of_a_file_is_shown_that_a_strange_experiment_file_names(
    old: str, new: str, secret: str, tmp_path: Path, cli: CommandLine
) -> None:
    (tmp_path / ".netrc").write_text(f"{secret}\n" * 3, encoding="utf-8")
    folder = tmp_path / "downloaded"
    folder.mkdir()
    text = (ICE / "PIL40.toml").read_text(encoding="utf-8").replace("PIL40.csv", "../.netrc")
    (folder / "test.toml").write_text(text.replace(old, new), encoding="utf-8")
    for command in ("fit", "check-file"):
        said = cli(command, folder / "test.toml", code=2) + cli.error
        assert not any(word in said for word in ("root:x", "hunter2", "machine", "login"))
        assert "its content is not shown" in said


def test_a_python_that_optimises_runs_commands_that_check_no_draws() -> None:
    """It drops assertions, and docstrings, which commands that check draws cannot do without."""
    commands = [["doctor"], ["check-file", TEST], ["fit", "--help"]]
    code, error = ended(
        f"sys.exit([main(command) for command in {commands}] != [0, 0, 1])",
        environment={"PYTHONOPTIMIZE": "2"},
    )
    assert code == 0
    (refused,) = error.splitlines()
    assert "unset PYTHONOPTIMIZE" in refused


def test_a_pipe_is_not_waited_for(tmp_path: Path, cli: CommandLine) -> None:
    os.mkfifo(tmp_path / "pipe.toml")
    cli.refused(["fit", tmp_path / "pipe.toml"], "is a device or a pipe")


TOO_MUCH = {
    "a deep key": "a" + ".a" * 100_000 + " = 1",
    "a deep quoted key": '"a"' + ' . "a"' * 100_000 + " = 1",
    "a deep table": "[a" + ".a" * 100_000 + "]",
    "a deep inline table": "x = {a" + ".a" * 100_000 + " = 1}",
    "a deep list": "x = " + "[" * 100_000,
    "a huge number": "x = 1" + "0" * 5000,
    "a large number": "temperature_K = 1" + "0" * 4000,
    "a large date": "x = 9999-99-99",
}


@pytest.mark.parametrize("text", TOO_MUCH.values(), ids=TOO_MUCH)
def test_toml_that_asks_too_much_is_refused(text: str, tmp_path: Path, cli: CommandLine) -> None:
    file = tmp_path / "test.toml"
    file.write_text(
        text + '\nid = "x"\nmaterial = "ice"\nprotocol = "constant_rate"\n', encoding="utf-8"
    )
    cli.refused(["fit", file], "test.toml")
