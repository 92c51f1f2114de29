"""The order of files that `stan/README.md` states."""

import re

from pyburgers.cmdstan.toolchain import stan_directory

COMMENT = re.compile(r"/\*.*?\*/|//[^\n]*", re.DOTALL)
DEFINED = re.compile(r"^\S.*?\b(\w+)\(", re.MULTILINE)
"""Functions begin at the first column."""

CALLED = re.compile(r"(\w+)\(")


def test_every_file_of_physics_needs_at_most_those_before_it() -> None:
    readme = (stan_directory() / "README.md").read_text(encoding="utf-8")
    (stated,) = re.findall(r"in this order\..*?\n\n", readme, re.DOTALL)
    order = re.findall(r"`(\w+\.stan)`", stated)
    folder = stan_directory() / "physics"
    assert sorted(order) == sorted(one.name for one in folder.iterdir())
    texts = [COMMENT.sub("", (folder / name).read_text(encoding="utf-8")) for name in order]
    defined = [set(DEFINED.findall(text)) for text in texts]
    every = set().union(*defined)
    assert all(defined)
    for k, text in enumerate(texts):
        missing = set(CALLED.findall(text)) & every - set().union(*defined[: k + 1])
        assert not missing, f"{order[k]} needs {sorted(missing)}"
