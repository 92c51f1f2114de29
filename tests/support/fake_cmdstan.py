"""A release of CmdStan that is made up: small, and built in no time."""

import shutil
from pathlib import Path

TOOLS = ("stansummary", "diagnose")
"""Built by `make build`, and needed by no program."""

BUILD = "\n".join(
    [
        "CMDSTAN_VERSION := 2.27.0",
        "build:",
        "\techo $(TBB_BIN_ABSOLUTE_PATH) > library_folder",
        "\tcp bin/linux-stanc bin/stanc && chmod +x bin/stanc",
        "\ttouch src/cmdstan/main.o",
        f"build: {' '.join(f'bin/{tool}' for tool in TOOLS)}",
        *(f"bin/{tool}:\n\ttouch bin/{tool}" for tool in TOOLS),
        "",
    ]
)


def release_archive(folder: Path, version: str, makefile: str = BUILD) -> Path:
    """Return the archive of a release with a makefile, made in a folder."""
    tree = folder / "release" / f"cmdstan-{version}"
    for name, text in {
        "makefile": makefile.replace("2.27.0", version),
        "bin/linux-stanc": "#!/bin/sh\n",
        "src/cmdstan/main.cpp": "int main() {}",
    }.items():
        (tree / name).parent.mkdir(parents=True, exist_ok=True)
        (tree / name).write_text(text)
    return Path(shutil.make_archive(str(folder / "cmdstan"), "gztar", tree.parent))
