"""Commands on tiny problems that are killed (`killing`): every one that fits."""

import shutil
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from functools import partial
from pathlib import Path

from fake_cmdstan import BUILD, release_archive

from pyburgers.cmdstan.installation import GITHUB_VERSION

KILLS = {
    "fit": 80,
    "sbc": 40,
    "campaign": 40,
    "compare": 30,
    "report": 30,
    "predict": 30,
    "compile": 40,
    "study": 10,
    "install": 40,
}
"""How often each command is killed."""

MAIN = ("-m", "pyburgers")
SAMPLER = ("--chains", "2", "--warmup", "150", "--draws", "200")

PREDICTED = ("--test", "PIL40")

TINY_STUDY = f"""
import sys
sys.path.insert(0, {str(Path(__file__).parents[2] / "reports")!r})
import study
from pyburgers import SamplerOptions

tiny = SamplerOptions(chains=2, warmup=40, draws=20)
study.PRESETS = dict.fromkeys(study.PRESETS, tiny)
sys.exit(study.main(["--out", sys.argv[1]]))
"""
"""`make study` with chains that are far too short to say anything."""

TINY_PROGRAM = """
import os, sys
from pathlib import Path
out = Path(sys.argv[1])
os.environ["PYBURGERS_CACHE"] = str(out / "cache")
from pyburgers.cmdstan.program import load_program
source = out / "tiny.stan"
source.write_text("transformed data { real x = 2; } generated quantities { real y = x * x; }")
(out / "summary.csv").write_text(repr(load_program(source).evaluate({})))
"""
"""A program that is compiled into a new cache and runs."""

SLOW_BUILD = BUILD.replace("\tcp ", "\tsleep 1\n\tcp ")

INSTALLATION = """
import hashlib, io, os, sys, time, urllib.request
from pathlib import Path
out, archive = map(Path, sys.argv[1:])
os.environ["HOME"] = str(out)
os.environ.pop("CMDSTAN", None)
from pyburgers.cli.main import main
from pyburgers.cmdstan import installation

class SlowAnswer(io.BytesIO):
    def read(self, size=-1):
        time.sleep(0.1)
        return super().read(100)

digest = hashlib.sha256(archive.read_bytes()).hexdigest()
installation.GITHUB_SHA256 = dict.fromkeys(installation.GITHUB_SHA256, digest)
urllib.request.urlopen = lambda *_, **__: SlowAnswer(archive.read_bytes())
code = main(["install-cmdstan", "--source", "github"])
if code == 0:
    files = [file for file in (out / ".cmdstan").glob("*-*/**/*") if file.is_file()]
    texts = {file.relative_to(out): file.read_text().replace(str(out), "HOME") for file in files}
    (out / "summary.csv").write_text("\\n".join(f"{f} {texts[f]!r}" for f in sorted(texts)))
sys.exit(code)
"""
"""An installation of an archive, by the command but without GitHub."""

PLAN = """
id = "killed"
seeds = [1, 2, 3]
tests.alone = ["{experiment}"]
priors.own = "{priors}"
sampler = {{ chains = 2, warmup = 150, draws = 100 }}
"""


@dataclass(frozen=True)
class KilledCommand:
    """Arguments of Python with ``OUT`` for the folder that it writes, and what makes the folder."""

    arguments: tuple[str, ...]
    prepare: Callable[[Path], None] = Path.mkdir


def fit_command(experiment: Path, priors: Path) -> KilledCommand:
    """Return `fit` of one test."""
    inputs = (str(experiment), "--priors", str(priors))
    return KilledCommand((*MAIN, "fit", *inputs, *SAMPLER, "--out", "OUT"))


def killed_commands(
    experiment: Path, priors: Path, joint: Path, inputs: Path
) -> Mapping[str, KilledCommand]:
    """Return the commands by name; files that they read are written to the folder `inputs`."""
    plan = inputs / "plan.toml"
    plan.write_text(PLAN.format(experiment=experiment, priors=priors), encoding="utf-8")
    archive = release_archive(inputs, GITHUB_VERSION, SLOW_BUILD)
    numbers = ("--simulations", "4", "--warmup", "60", "--draws", "40", "--ranked-draws", "19")
    files = (str(experiment), "--priors", str(priors))
    left_out = ("OUT/joint", "--leave-out", "tests", "--out", "OUT/compared")
    return {
        "fit": fit_command(experiment, priors),
        "sbc": KilledCommand((*MAIN, "sbc", *files, *numbers, "--out", "OUT")),
        "campaign": KilledCommand((*MAIN, "campaign", str(plan), "--out", "OUT")),
        "compare": KilledCommand((*MAIN, "compare", *left_out), partial(_copy_run, joint)),
        "report": KilledCommand((*MAIN, "report", str(joint), "--out", "OUT/page")),
        "predict": KilledCommand(
            (*MAIN, "predict", "attenuation", str(joint), *PREDICTED, "--out", "OUT/table.csv")
        ),
        "compile": KilledCommand(("-c", TINY_PROGRAM, "OUT")),
        "install": KilledCommand(("-c", INSTALLATION, "OUT", str(archive))),
        "study": KilledCommand(("-c", TINY_STUDY, "OUT")),
    }


def _copy_run(joint: Path, out: Path) -> None:
    """Copy a joint fit of which no test has been left out."""
    shutil.copytree(joint, out / "joint", ignore=shutil.ignore_patterns(".*", "leave_out"))
