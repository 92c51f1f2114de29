"""Bad input is refused with one sentence; and text files of input with something replaced."""

import re
from collections.abc import Callable, Mapping, Sequence
from pathlib import Path

import pytest

from pyburgers.cli.main import main
from pyburgers.common.errors import InputError
from pyburgers.kinds.kind import load_experiment


def refusal(path: Path, load: Callable[[Path], object] = load_experiment) -> str:
    """Message of the InputError that reading a file raises: one sentence that names its folder."""
    with pytest.raises(InputError) as caught:
        load(path)
    text = str(caught.value)
    assert "\n" not in text
    assert text.endswith((".", "?"))
    assert str(path.parent) in text
    return text


class CommandLine:
    """Commands in this process; exit code, output and errors are those of the last one."""

    code: int
    out: str
    error: str

    def __init__(self, capsys: pytest.CaptureFixture[str]) -> None:
        self._capsys = capsys

    def __call__(self, *words: object, code: int | None = 0) -> str:
        """Run a command that has to end with an exit code, if one is given; return its output."""
        self._capsys.readouterr()
        self.code = main([str(word) for word in words])
        self.out, self.error = self._capsys.readouterr()
        assert code is None or self.code == code, self.out + self.error
        return self.out

    def refused(self, words: Sequence[object], *told: str) -> None:
        """Run a command that ends with code 2 and one clear sentence on standard error."""
        assert self(*words, code=2) == ""
        assert re.fullmatch(r"pyburgers: [^\n]+[.?]\n", self.error)
        for one in told:
            assert one in self.error


def written(
    path: Path,
    text: str,
    replacements: tuple[tuple[str, str], ...],
    files: Mapping[str, str | None],
) -> Path:
    """Write a TOML file, each replacement made once, and data files beside it that are not None."""
    for old, new in replacements:
        assert old in text
        text = text.replace(old, new, 1)
    for name, content in files.items():
        if content is not None:
            (path.parent / f"{name}.csv").write_text(content, encoding="utf-8")
    path.write_text(text, encoding="utf-8")
    return path
