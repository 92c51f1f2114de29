"""Commands of the documents are ones that the command line takes."""

import re
import shlex
from itertools import takewhile
from pathlib import Path

import pytest
from conftest import ICE
from sentences import documents

from pyburgers.cli.main import _parse

ROOT = ICE.parents[1]
BLOCK = re.compile(r"^```(\S*)[^\n]*\n(.*?)^```$", re.DOTALL | re.MULTILINE)


def commands_of(page: Path) -> list[list[str]]:
    """The words of each command of pyburgers in code of a page, up to a file for output."""
    text = page.read_text(encoding="utf-8")
    shell = "".join(block for language, block in BLOCK.findall(text) if language in ("", "shell"))
    lines = re.findall(r"^\S*pyburgers .*$", shell.replace("\\\n", " "), re.MULTILINE)
    words = [shlex.split(line, comments=True) for line in lines]
    own = [line[1:] for line in words if line and Path(line[0]).name == "pyburgers"]
    return [list(takewhile(lambda word: word != ">", line)) for line in own]


COMMANDS = [(page, words) for page in documents() for words in commands_of(page)]


@pytest.mark.parametrize(
    ("page", "words"), COMMANDS, ids=[f"{page.stem}: {' '.join(words)}" for page, words in COMMANDS]
)
def test_the_command_line_takes_a_command_as_it_is_pasted(page: Path, words: list[str]) -> None:
    _parse([re.sub(r"\$\w+", "1", word) for word in words])
    shipped = [word for word in words if word.startswith("data/")]
    assert all((ROOT / word).is_file() for word in shipped)


def test_commands_are_found() -> None:
    assert {"README.md", "start.md", "own_curve.md"} <= {page.name for page, _ in COMMANDS}
