"""Kill a command again and again, somewhere, and see that it ends where it would have anyway."""

import csv
import os
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Sequence
from dataclasses import dataclass, field
from hashlib import sha256
from pathlib import Path

import numpy as np
import psutil

from pyburgers.cmdstan.installation import BUILDING
from pyburgers.common.atomic_files import UNFINISHED
from pyburgers.common.netcdf_files import read_netcdf
from pyburgers.common.scratch import LEAST_AGE, PREFIX

ORPHANS_END_WITHIN = 10.0
"""Seconds."""

LONGEST_RUN = 3600.0
"""Seconds after which a command hangs."""

TO_PARENT = {
    "parent killed": (signal.SIGKILL,),
    "terminated": (signal.SIGTERM,),
    "hung up": (signal.SIGHUP,),
    "parent interrupted": (signal.SIGINT,),
    "interrupted twice": (signal.SIGINT, signal.SIGINT),
}
"""Signals to the command alone, by what is done."""

TO_ALL = {"all killed": signal.SIGKILL, "interrupted": signal.SIGINT, "all ended": signal.SIGTERM}
"""Signals to all processes of the group of the command."""

ONE = "one of its processes killed"

HOW = (*TO_PARENT, *TO_ALL, ONE)

RESULTS = (
    *("draws.csv", "summary.csv", "checks.json", "simulation_*.json", "ranks.csv", "verdicts.csv"),
    *("comparison.csv", "left_out_tests.csv", "tables/*.csv", "table.csv"),
)
"""Files that are the same however often a command was killed, but for comments and wall times."""

WALL_TIMES = ("chain_seconds", "wall time (s)")
"""Columns of tables."""


@dataclass
class Command:
    """Arguments of Python that write the folder `out`; `done` says how it was killed so far."""

    arguments: Sequence[str]
    out: Path
    done: list[str] = field(default_factory=list)

    @property
    def temporary(self) -> Path:
        """Folder of its temporary files, beside what it writes."""
        return self.out.with_name(f"{self.out.name}_temporary")

    def start(self) -> subprocess.Popen[bytes]:
        """Start it in a session of its own, where each signal counts even if it does not here."""
        self.temporary.mkdir(exist_ok=True)
        return subprocess.Popen(
            [sys.executable, *self.arguments],
            env={**os.environ, "TMPDIR": str(self.temporary)},
            stdout=subprocess.DEVNULL,
            stderr=subprocess.PIPE,
            start_new_session=True,
            preexec_fn=_hear_signals,
        )

    def finish(self) -> float:
        """Run it to its end; return how long that took (s)."""
        started = time.monotonic()
        process = self.start()
        _, error = process.communicate(timeout=LONGEST_RUN)
        assert process.returncode in (0, 3, 4), error.decode()
        return time.monotonic() - started

    def killed(self, after: float, how: str, rng: np.random.Generator) -> bool:
        """Start it and kill it after some seconds; tell whether it was still running then."""
        before = finished_chains(self.out)
        process = self.start()
        try:
            process.communicate(timeout=after)
            hit = False
        except subprocess.TimeoutExpired:
            hit = True
            self.done.append(f"{how} after {after:.1f} s")
            _kill(process, how, rng)
            if how == ONE:  # the others may go on
                process.communicate(timeout=LONGEST_RUN)
        end = time.monotonic() + ORPHANS_END_WITHIN
        while left := in_session(process.pid):
            assert time.monotonic() < end, f"{self.done[-1]}: {left} are left"
            time.sleep(0.05)
        process.communicate()
        now = finished_chains(self.out)
        assert {file: now.get(file) for file in before} == before, self.done
        return hit


def _hear_signals() -> None:
    """Undo what a shell in the background or `nohup` left to its processes."""
    for one in (signal.SIGINT, signal.SIGHUP):
        signal.signal(one, signal.SIG_DFL)


def make_old(*folders: Path) -> None:
    """Have folders look as if nothing had changed in them for longer than `LEAST_AGE`."""
    long_ago = time.time() - 2 * LEAST_AGE
    for folder in folders:
        os.utime(folder, (long_ago, long_ago))


def _kill(process: subprocess.Popen[bytes], how: str, rng: np.random.Generator) -> None:
    """Do it; what has ended in the meantime is left in peace."""
    for number in TO_PARENT.get(how, ()):
        process.send_signal(number)
        time.sleep(float(rng.uniform(0.0, 0.3)))
    if how in TO_ALL:
        os.killpg(process.pid, TO_ALL[how])
    elif how == ONE and (children := psutil.Process(process.pid).children(recursive=True)):
        chosen = children[int(rng.integers(len(children)))]
        try:
            chosen.kill()
        except psutil.NoSuchProcess:
            return


def in_session(session: int) -> list[psutil.Process]:
    """Processes of a session that run."""
    found = []
    for one in psutil.process_iter():
        try:
            if os.getsid(one.pid) == session and one.status() != psutil.STATUS_ZOMBIE:
                found.append(one)
        except (ProcessLookupError, psutil.NoSuchProcess):
            continue
    return found


def finished_chains(out: Path) -> dict[Path, bytes]:
    """Draws of all finished chains below a folder that is kept, byte for byte."""
    files = [file for file in out.rglob("draws.csv") if not _is_scratch(file.relative_to(out))]
    return {file.relative_to(out): file.read_bytes() for file in files}


def _is_scratch(file: Path) -> bool:
    return any(part.startswith(".") for part in file.parts)


def results(out: Path) -> dict[Path, list[str]]:
    """Lines of `RESULTS` below a folder, without comments, and hashes of all labelled draws."""
    draws = {
        file.relative_to(out): [
            f"{group.path}/{name} {sha256(values.to_numpy().tobytes()).hexdigest()}"
            for group in read_netcdf(file).subtree
            for name, values in group.data_vars.items()
        ]
        for file in sorted(out.rglob("posterior.nc"))
    }
    return draws | {
        file.relative_to(out): _lines_without_times(file)
        for pattern in RESULTS
        for file in sorted(out.rglob(pattern))
    }


def _lines_without_times(file: Path) -> list[str]:
    """Lines of a file without comments, of a table without columns of wall times."""
    text = file.read_text(encoding="utf-8")
    lines = [line for line in text.splitlines() if not line.startswith("#")]
    names = next(csv.reader(lines[:1]), [])
    times = [place for place, name in enumerate(names) if name in WALL_TIMES]
    if file.suffix != ".csv" or not times:
        return lines
    rows = csv.reader(lines)
    return [repr([cell for place, cell in enumerate(row) if place not in times]) for row in rows]


def leftovers(out: Path) -> list[Path]:
    """What a finished command has no use for; its locks stay."""
    return [
        file
        for file in out.rglob("*")
        if file.name.startswith((".scratch", ".simulation", BUILDING, UNFINISHED))
        or file.name.endswith(".partial")
    ]


def command_in(arguments: Sequence[str], folder: Path) -> Command:
    """Return a command that writes a folder, which its arguments call ``OUT``."""
    return Command([one.replace("OUT", str(folder)) for one in arguments], folder)


def attempt(
    one: Command,
    expected: dict[Path, list[str]],
    *,
    seconds: float,
    at_most: int,
    rng: np.random.Generator,
) -> None:
    """Kill a command until it ends by itself, or that many times; then look at what it left.

    `expected` are its `results` where nobody kills it, which takes so many seconds.
    """
    hit = True
    while hit and len(one.done) < at_most:
        how = HOW[int(rng.integers(len(HOW)))]
        hit = one.killed(float(rng.uniform(0.0, seconds)), how, rng)
    make_old(*one.temporary.glob(f"{PREFIX}*"), *one.out.rglob(f"{BUILDING}*"))
    one.finish()
    assert results(one.out) == expected, one.done
    assert leftovers(one.out) == [], one.done
    # Of a script that uses the package, cmdstanpy leaves an empty folder of its own.
    left = [file for file in one.temporary.rglob("*") if file.is_file() or PREFIX in file.name]
    assert left == [], one.done


def assert_survives(
    arguments: Sequence[str],
    out: Path,
    *,
    kills: int,
    seed: int,
    prepare: Callable[[Path], None] = Path.mkdir,
) -> list[str]:
    """Kill a command so many times, on its way to the same results; return how.

    Its arguments are those of `command_in`. A command that has ended begins anew in another folder,
    which `prepare` makes.
    """
    rng = np.random.default_rng(seed)

    def command(name: str) -> Command:
        prepare(out / name)
        return command_in(arguments, out / name)

    whole = command("whole")
    seconds = whole.finish()
    expected = results(whole.out)
    assert expected
    done: list[str] = []
    number = 0
    while len(done) < kills:
        number += 1
        one = command(f"killed_{number}")
        attempt(one, expected, seconds=seconds, at_most=kills - len(done), rng=rng)
        done += one.done
    return done
