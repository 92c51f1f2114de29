"""Work in processes: outcomes, errors, and an end with the one who asked for it."""

import os
import time
from pathlib import Path

import psutil
import pytest

from pyburgers.common.errors import InputError, SamplingError
from pyburgers.common.processes import completed, number_of_processes


def refuse(word: str) -> None:
    raise InputError(f"{word}: refused.")


def test_every_call_is_done_and_keeps_its_key() -> None:
    calls = {number: (number, 3) for number in range(4)}
    done = dict(completed(pow, calls, processes=2, folder=Path("out")))
    assert done == {number: number**3 for number in range(4)}


def test_an_error_of_a_call_is_raised_as_it_is() -> None:
    with pytest.raises(InputError, match=r"^ice: refused.$"):
        list(completed(refuse, {1: ("ice",)}, processes=1, folder=Path("out")))


def test_a_killed_process_is_told_with_what_to_do() -> None:
    with pytest.raises(SamplingError, match=r"^out: the system killed a process; free memory"):
        list(completed(os._exit, {1: (1,)}, processes=1, folder=Path("out")))


def test_an_interrupt_ends_calls_that_run() -> None:
    calls = {"short": (0,), "long": (600,), "waiting": (600,)}
    done = completed(time.sleep, calls, processes=2, folder=Path("out"))
    assert next(done) == ("short", None)
    started = time.monotonic()
    with pytest.raises(KeyboardInterrupt):
        done.throw(KeyboardInterrupt())
    assert time.monotonic() - started < 60
    assert not [
        one for one in psutil.Process().children() if "spawn_main" in " ".join(one.cmdline())
    ]


def test_processes_are_one_for_each_core_and_no_more_than_calls() -> None:
    cores = os.cpu_count() or 1
    assert number_of_processes(None, 1000) == cores
    assert number_of_processes(3, 2) == 2
    assert number_of_processes(3, 0) == 1
    with pytest.raises(InputError, match=r"^jobs is 0, expected at least 1.$"):
        number_of_processes(0, 2)
