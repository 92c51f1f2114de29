"""What pages run: how a command ends is part of the page."""

from pathlib import Path

import execution
import pytest
from execution import ExecutionError, run_python, run_shell, shortened


def test_output_is_told_apart_from_messages(tmp_path: Path) -> None:
    result = run_shell("echo result; echo progress >&2", tmp_path / "page")
    assert (result.output, result.messages) == ("result\n", "progress\n")


def test_commands_of_a_page_share_a_folder(tmp_path: Path) -> None:
    run_python("open('a.txt', 'w').write('left here')", tmp_path)
    assert run_shell("cat a.txt", tmp_path).output == "left here"


def test_an_exit_code_that_the_page_does_not_name_is_an_error(tmp_path: Path) -> None:
    assert run_shell("exit 3", tmp_path, (0, 3)).exit_code == 3
    with pytest.raises(ExecutionError, match="ended with 3, expected 0; it printed:\nwhy"):
        run_shell("echo why; exit 3", tmp_path)


def test_what_takes_too_long_is_ended_with_all_that_it_started(
    tmp_path: Path, monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(execution, "LONGEST_SECONDS", 1)
    with pytest.raises(ExecutionError, match="took longer than 1 s"):
        run_shell("sleep 60 | cat", tmp_path)


def test_the_first_line_that_fails_ends_a_block(tmp_path: Path) -> None:
    with pytest.raises(ExecutionError, match="ended with 1"):
        run_shell("false\necho went on", tmp_path)


def test_long_output_keeps_both_ends() -> None:
    text = "\n".join(str(k) for k in range(100))
    assert shortened(text, 100) == text
    assert shortened(text, 4).splitlines() == ["0", "1", "... 96 lines ...", "98", "99"]
