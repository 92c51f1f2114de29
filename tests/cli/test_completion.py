"""Completion in a shell: what it offers, and that it does not load the command's module again."""

import argparse
import os
import subprocess
import sys
from pathlib import Path

import pytest

from pyburgers.cli import completion
from pyburgers.cli.completion import add_arguments
from pyburgers.cli.main import COMMANDS


def offered(parser: argparse.ArgumentParser) -> list[object]:
    """What is offered for each argument."""
    found: list[object] = []
    for action in parser._actions:
        completer = vars(action).get("completer")
        below = isinstance(action, argparse._SubParsersAction)
        found += [action.option_strings, action.nargs if not below else None]
        found.append([] if completer is None else list(completer()))
        if isinstance(action, argparse._SubParsersAction):
            found += [(name, offered(one)) for name, one in action.choices.items()]
        else:
            found.append(None if action.choices is None else [*map(str, action.choices)])
    return found


@pytest.mark.parametrize("name", COMMANDS)
def test_kept_arguments_are_those_of_the_command(
    name: str, tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setenv("PYBURGERS_CACHE", str(tmp_path))
    module = f"pyburgers.cli.{name.replace('-', '_')}"
    first, second, third = (argparse.ArgumentParser(prog=f"pyburgers {name}") for _ in range(3))
    add_arguments(first, module)
    with monkeypatch.context() as patch:
        patch.setattr(completion, "import_module", None)
        add_arguments(second, module)
    assert offered(first) == offered(second)
    monkeypatch.setattr(completion, "_state_of_package", lambda: [0.0, 0.0])
    add_arguments(third, module)
    assert offered(third) == offered(first)


def test_damaged_keepings_are_made_anew(tmp_path: Path, monkeypatch: pytest.MonkeyPatch) -> None:
    monkeypatch.setenv("PYBURGERS_CACHE", str(tmp_path))
    for text in ("", "[]", '{"package": 1}'):
        (tmp_path / "completion").mkdir(exist_ok=True)
        (tmp_path / "completion" / "pyburgers.cli.export.json").write_text(text, encoding="utf-8")
        parser = argparse.ArgumentParser(prog="pyburgers export")
        add_arguments(parser, "pyburgers.cli.export")
        assert "--format" in parser._option_string_actions


def test_a_shell_is_answered(tmp_path: Path) -> None:
    line = "pyburgers export --form"
    environment = {
        **os.environ,
        "PYBURGERS_CACHE": str(tmp_path),
        "_ARGCOMPLETE": "1",
        "_ARGCOMPLETE_STDOUT_FILENAME": str(tmp_path / "answer"),
        "COMP_LINE": line,
        "COMP_POINT": str(len(line)),
    }
    for _ in range(2):  # from the module, then from what was kept
        subprocess.run(
            [sys.executable, "-m", "pyburgers"], env=environment, check=True, timeout=120
        )
        assert (tmp_path / "answer").read_text(encoding="utf-8").strip() == "--format"
        (tmp_path / "answer").unlink()
