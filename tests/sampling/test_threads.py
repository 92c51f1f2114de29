"""Threads within a chain: which fits can have them, and what they change."""

from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import SMALL_RUN
from oscillation_pair import TWIN_FILE

from pyburgers.cmdstan.program import Program, shares_work
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.priors import default_priors
from pyburgers.sampling import chains
from pyburgers.sampling.changes import refusal, wanted_record

TWO = replace(SMALL_RUN, threads_per_chain=2)


def test_threads_share_tests_at_constant_rate_and_no_others(tmp_path: Path) -> None:
    programs = ("constant_rate", "loading_history", "forced_oscillation", "attenuation")
    shared = [name for name in programs if shares_work(stan_directory() / f"{name}.stan")]
    assert shared == ["constant_rate"]
    twin = load_experiment(TWIN_FILE)
    with pytest.raises(InputError, match=r"threads_per_chain is 2, expected 1: .*oscillation"):
        fit(
            [twin, replace(twin, id="other")],
            default_priors("olivine"),
            out=tmp_path / "run",
            options=TWO,
        )
    assert not (tmp_path / "run").exists()


def test_there_are_at_most_as_many_threads_as_tests() -> None:
    assert [TWO.threads_for(n) for n in (1, 2, 8)] == [1, 2, 2]


def test_one_thread_and_several_are_different_runs(joint: Fit) -> None:
    """Rounding differs; how many threads there are beyond one does not matter."""

    def told(threads: int) -> str:
        options = replace(SMALL_RUN, threads_per_chain=threads)
        wanted = wanted_record(joint.problem, options, SolverOptions(), use_likelihood=True)
        return refusal(joint.directory, wanted, joint.problem)

    assert "threads" not in told(1)
    assert "threads_per_chain 2 or more where the run has 1;" in told(2)


def test_chains_leave_cores_to_the_threads_of_others(
    joint: Fit, monkeypatch: pytest.MonkeyPatch
) -> None:
    seen: list[int] = []

    @contextmanager
    def no_looks(*_: Any, at_once: int, **__: Any) -> Iterator[tuple[()]]:
        seen.append(at_once)
        yield ()

    monkeypatch.setattr(chains, "cores", lambda: 8)
    monkeypatch.setattr(chains, "closing", lambda looks: looks)
    monkeypatch.setattr(chains, "side_by_side", no_looks)
    options = SMALL_RUN.suited_to(joint.problem.likelihood)
    for threads in (1, 3, 9):
        chains.run_side_by_side(Program(Path("program"), threads), joint.directory, [1, 2], options)
    assert seen == [8, 2, 1]
