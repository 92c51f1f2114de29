"""Kill every command that fits, again and again.

    PYTHONPATH=tests:tests/support:. python benchmarks/kills.py --out runs/kills

A command on a tiny problem is started and killed at a random time (the command, one of its
processes, all of them; or terminated, or interrupted) until it ends by itself; it has to end with
the results of a command that nobody killed (`tests/support/killing.py` says what is compared). Each
attempt is written when it is done and seeded by its number: the same command continues. What went
wrong stays in its folder.
"""

import argparse
import shutil
import signal
from collections.abc import Sequence
from pathlib import Path

import numpy as np
import pandas as pd
from conftest import POOL, SMALL_RUN, Problem, pair_of, write_problem
from killed_commands import KILLS, KilledCommand, killed_commands
from killing import attempt, command_in, results
from tables import markdown

from pyburgers.common.atomic_files import write_json
from pyburgers.common.toml_files import read_json
from pyburgers.fitting.fit import fit

AT_MOST = 6
"""Kills of one attempt."""


def main(arguments: Sequence[str] | None = None) -> None:
    """Kill until every command has had its kills; print what was done."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("--out", type=Path, required=True)
    parser.add_argument("--command", choices=KILLS, action="append", help="default: all")
    options = parser.parse_args(arguments)
    # A shell's background job ignores interrupts, and so would the commands, which inherit that.
    signal.signal(signal.SIGINT, signal.default_int_handler)
    commands = _commands(options.out.resolve())
    for name in options.command or KILLS:
        _kill(name, commands[name], options.out.resolve() / name)
    print(_table(options.out))


def _commands(out: Path) -> dict[str, KilledCommand]:
    """Make what the commands read, once."""
    inputs, joint = out / "inputs", out / "joint"
    out.mkdir(parents=True, exist_ok=True)
    if not inputs.exists():
        free = {"maxwell_modulus", "activation_enthalpy", "stress_noise"}
        write_problem(inputs, free=free, max_strain=0.02, stride=2)
    problem = Problem(inputs / "experiment.toml", inputs / "priors.toml")
    fit(pair_of(problem), problem.priors, pool=POOL, out=joint, options=SMALL_RUN)
    return dict(killed_commands(problem.experiment_file, problem.priors_file, joint, inputs))


def _kill(name: str, command: KilledCommand, folder: Path) -> None:
    """Make the attempts that are missing."""
    folder.mkdir(exist_ok=True)
    whole = folder / "whole"
    if not (folder / "whole.json").exists():
        shutil.rmtree(whole, ignore_errors=True)
        command.prepare(whole)
        seconds = command_in(command.arguments, whole).finish()
        write_json(folder / "whole.json", {"seconds": seconds})
    expected = results(whole)
    seconds = read_json(folder / "whole.json")["seconds"]
    number = done = 0
    while done < KILLS[name]:
        number += 1
        record = folder / f"attempt_{number}.json"
        if not record.exists():
            one = command_in(command.arguments, folder / f"attempt_{number}")
            shutil.rmtree(one.out, ignore_errors=True)
            command.prepare(one.out)
            rng = np.random.default_rng([list(KILLS).index(name), number])
            failure = None
            try:
                attempt(one, expected, seconds=seconds, at_most=AT_MOST, rng=rng)
                shutil.rmtree(one.out)
            except AssertionError as error:
                failure = str(error)
            write_json(record, {"kills": one.done, "failure": failure})
        done += len(read_json(record)["kills"])


def _table(out: Path) -> str:
    """Count kills and attempts that ended as they should."""
    rows = []
    for name in KILLS:
        records = [read_json(file) for file in (out / name).glob("attempt_*.json")]
        rows.append(
            {
                "command": name,
                "kills": str(sum(len(one["kills"]) for one in records)),
                "attempts": str(len(records)),
                "ended wrongly": str(sum(one["failure"] is not None for one in records)),
            }
        )
    return markdown(pd.DataFrame(rows))


if __name__ == "__main__":
    main()
