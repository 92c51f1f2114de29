"""Completion in a shell: what the printed script offers."""

import subprocess
from pathlib import Path

import pytest
from refusals import CommandLine

from pyburgers.cli.completion import SHELLS
from pyburgers.cli.main import COMMANDS
from pyburgers.model.laws import DASHPOT_LAWS
from pyburgers.sampling.options import COORDINATES

ASK = """
source {script}
COMP_WORDS=({words}); COMP_CWORD=$((${{#COMP_WORDS[@]}} - 1))
_shtab_pyburgers
printf "%s\\n" "${{COMPREPLY[@]}}"
"""

OFFERED = {
    "pyburgers fi": {"fit", "fit-rates"},
    "pyburgers sbc --re": {"--refits", "--results-of"},
    "pyburgers export --form": {"--format"},
    "pyburgers fit --coordinates ''": set(COORDINATES),
    "pyburgers fit --variant maxwell": {f"maxwell={law}" for law in DASHPOT_LAWS},
    "pyburgers fit some_f": {"some_file.toml"},
}


def test_bash_offers_commands_options_choices_and_files(tmp_path: Path, cli: CommandLine) -> None:
    script = tmp_path / "script"
    script.write_text(cli("completion", "bash"), encoding="utf-8")
    (tmp_path / "some_file.toml").touch()
    for words, offered in OFFERED.items():
        asked = subprocess.run(
            ["bash", "-c", ASK.format(script=script, words=words)],
            cwd=tmp_path,
            capture_output=True,
            text=True,
            check=True,
        )
        assert set(asked.stdout.split()) == offered, words


@pytest.mark.parametrize("shell", SHELLS)
def test_every_shell_gets_a_script_about_every_command(shell: str, cli: CommandLine) -> None:
    script = cli("completion", shell)
    assert all(name in script for name in COMMANDS)
