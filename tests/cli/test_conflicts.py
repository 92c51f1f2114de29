"""What prior and data disagree about is told in the terminal."""

import pytest

from pyburgers.cli.terminal import print_checks


def test_conflicts_have_a_block_of_their_own(capsys: pytest.CaptureFixture[str]) -> None:
    without = print_checks([])
    assert "Do prior and data agree?" not in capsys.readouterr().out
    sentences = ("A: Prior and data disagree about this.", "B: Prior and data disagree about that.")
    assert print_checks([], sentences) == without
    printed = capsys.readouterr().out
    assert printed.endswith("\nDo prior and data agree? NO\n" + "\n".join(sentences) + "\n")


def test_numbers_that_the_data_do_not_decide_have_one_too(
    capsys: pytest.CaptureFixture[str],
) -> None:
    without = print_checks([])
    capsys.readouterr()
    assert print_checks([], (), ("n is decided by the prior of Q.",)) == without
    printed = capsys.readouterr().out
    assert printed.endswith(
        "\nNumbers that the data alone do not decide\nn is decided by the prior of Q.\n"
    )
