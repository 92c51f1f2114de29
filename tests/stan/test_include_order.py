"""The order of files that `stan/README.md` states."""

import re
from pathlib import Path

from pyburgers.cmdstan.toolchain import find_cmdstan, run_tool, stan_directory


def test_every_file_of_physics_needs_at_most_those_before_it(tmp_path: Path) -> None:
    readme = (stan_directory() / "README.md").read_text(encoding="utf-8")
    (stated,) = re.findall(r"in this order\..*?\n\n", readme, re.DOTALL)
    order = re.findall(r"`(\w+\.stan)`", stated)
    assert sorted(order) == sorted(one.name for one in (stan_directory() / "physics").iterdir())
    cmdstan = find_cmdstan()
    assert cmdstan is not None
    for n_files in range(1, len(order) + 1):
        included = "\n".join(f"#include physics/{name}" for name in order[:n_files])
        program = tmp_path / "included.stan"
        program.write_text(f"functions {{\n{included}\n}}\n", encoding="utf-8")
        said = run_tool(
            [cmdstan / "bin" / "stanc", f"--include-paths={stan_directory()}", program],
            cwd=tmp_path,
        )
        assert said.returncode == 0, f"{order[n_files - 1]}: {said.stdout}"
