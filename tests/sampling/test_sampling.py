"""Options and starts of the sampler, and chains that end badly, in processes of their own."""

import json
import math
import os
import shutil
import signal
import subprocess
import sys
import time
from collections.abc import Callable, Iterator
from dataclasses import asdict, replace
from functools import partial
from pathlib import Path
from typing import Any, cast

import numpy as np
import psutil
import pytest
from conftest import SMALL_RUN, Problem, SharedRuns
from pydantic import ValidationError

from pyburgers.common.atomic_files import UNFINISHED, write_json
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.fitting.charts_at_modes import draw_from_prior, programs_of_tests
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.sampling.options import SamplerOptions, options_table, recorded_options
from pyburgers.sampling.run import fingerprint
from pyburgers.sampling.run_directory import RunDirectory

StartFit = Callable[..., subprocess.Popen[str]]

INTERRUPTED = replace(SMALL_RUN, draws=400)
"""Long enough for a signal to hit the sampling."""

INTERRUPTIBLE = """
import signal, sys
signal.signal(signal.SIGINT, signal.default_int_handler)
from pyburgers.cli.main import main
sys.exit(main())
"""
"""The command line, whether or not the tests run where Ctrl-C is ignored: a shell has it ignored by
what it runs in the background, and Python then leaves it so."""


@pytest.fixture(scope="session")
def undisturbed(shared_runs: SharedRuns, small_problem: Problem) -> Fit:
    """What an interrupted run comes to in the end; not to be changed."""
    return shared_runs.finished("undisturbed", lambda out: small_problem.fit(out, INTERRUPTED))


@pytest.fixture
def start_fit(programs: None, small_problem: Problem, tmp_path: Path) -> Iterator[StartFit]:
    """Start `pyburgers fit` on the small problem in a session of its own."""
    started: list[subprocess.Popen[str]] = []

    def start(out: Path, *options: str) -> subprocess.Popen[str]:
        process = subprocess.Popen(
            [
                *(sys.executable, "-c", INTERRUPTIBLE, "fit"),
                *(str(small_problem.experiment_file), "--priors", str(small_problem.priors_file)),
                *("--out", str(out), "--chains", str(INTERRUPTED.chains)),
                *("--warmup", str(INTERRUPTED.warmup), "--draws", str(INTERRUPTED.draws)),
                *("--seed", str(INTERRUPTED.seed), "--adapt-delta", str(INTERRUPTED.adapt_delta)),
                *options,
            ],
            stdout=subprocess.PIPE,
            stderr=subprocess.STDOUT,
            text=True,
            cwd=tmp_path,
            start_new_session=True,
        )
        started.append(process)
        return process

    yield start
    for process in started:
        if process.poll() is None:
            process.kill()
            process.communicate()


def chains_of(process: subprocess.Popen[str]) -> list[psutil.Process]:
    """Return the CmdStan processes of a fit that sample."""
    children = psutil.Process(process.pid).children(recursive=True)
    return [
        child for child in children if f"num_samples={INTERRUPTED.draws}" in _command_line(child)
    ]


def _command_line(process: psutil.Process) -> list[str]:
    try:
        return process.cmdline()
    except psutil.NoSuchProcess:
        return []


def processes_on(folder: Path) -> list[psutil.Process]:
    """Return processes that write to files in a folder."""
    return [
        process
        for process in psutil.process_iter()
        if any(str(folder) in word for word in _command_line(process))
    ]


def wait_until(condition: Callable[[], bool], what: str) -> None:
    end = time.monotonic() + 120.0
    while not condition():
        assert time.monotonic() < end, f"waited 120 s for {what}"
        time.sleep(0.02)


def is_sampling_or_done(process: subprocess.Popen[str]) -> bool:
    return process.poll() is not None or bool(chains_of(process))


def time_written(file: Path) -> int:
    return file.stat().st_mtime_ns if file.is_file() else 0


def is_writing(process: subprocess.Popen[str], run: RunDirectory, before: int) -> bool:
    """Tell whether a fit has come as far as its run directory, which may hold an earlier one."""
    return process.poll() is not None or time_written(run.manifest_file) != before


def wait_for_draws(run: RunDirectory, process: subprocess.Popen[str]) -> None:
    """Wait until every chain has written draws."""

    def sampling() -> bool:
        files = (run.path / ".scratch").glob("*/*.csv")
        sizes = [file.stat().st_size for file in files if file.is_file()]
        return process.poll() is not None or (
            len(sizes) == INTERRUPTED.chains and min(sizes) > 20_000
        )

    wait_until(sampling, "draws")
    assert process.poll() is None


def rows(file: Path) -> list[str]:
    """Header and draws of a chain, without comments."""
    return [line for line in file.read_text(encoding="utf-8").splitlines() if line[0] != "#"]


def assert_same_draws(run: RunDirectory, other: Fit) -> None:
    assert run.finished_chains() == other.directory.finished_chains()
    for chain in run.finished_chains():
        assert rows(run.draws_file(chain)) == rows(other.directory.draws_file(chain))


def assert_whole(run: RunDirectory) -> None:
    """Nothing outside the scratch folder is half-written."""
    for file in run.path.rglob("*"):
        inside = file.relative_to(run.path)
        if inside.parts[0] == ".scratch" or inside.name.startswith(UNFINISHED):
            continue
        if file.suffix == ".json":
            json.loads(file.read_text(encoding="utf-8"))
    for chain in run.finished_chains():
        names = {file.name for file in run.chain_folder(chain).iterdir()}
        assert names == {"draws.csv", "console.txt", "timing.json"}
        assert len(rows(run.draws_file(chain))) == INTERRUPTED.draws + 1


@pytest.mark.parametrize(
    ("name", "make"),
    [
        ("chains", lambda: SamplerOptions(chains=0)),
        ("warmup", lambda: SamplerOptions(warmup=1)),
        ("draws", lambda: SamplerOptions(draws=0)),
        ("seed", lambda: SamplerOptions(seed=-1)),
        ("seed", lambda: SamplerOptions(seed=2**31)),
        ("adapt_delta", lambda: SamplerOptions(adapt_delta=1.0)),
        ("adapt_delta", lambda: SamplerOptions(adapt_delta=float("nan"))),
        ("max_treedepth", lambda: SamplerOptions(max_treedepth=0)),
        *(
            ("chain_timeout", lambda value=value: SamplerOptions(chain_timeout=value))
            for value in (0.0, -1.0, math.nan, math.inf)
        ),
        ("coordinates", lambda: SamplerOptions(coordinates=cast(Any, "polar"))),
    ],
)
def test_options_out_of_range_are_refused(name: str, make: Callable[[], SamplerOptions]) -> None:
    with pytest.raises(InputError, match=name):
        make()


def test_manifests_may_hold_a_retired_option_and_no_unknown_one() -> None:
    recorded = {**asdict(SMALL_RUN), "threads_per_chain": 2}
    assert recorded_options(recorded) == SMALL_RUN
    known = {name: value for name, value in recorded.items() if value is not None}
    options_table(settled=True).model_validate(known)
    for settled, name in ((True, "of_nobody"), (False, "threads_per_chain")):
        with pytest.raises(ValidationError, match=name):
            options_table(settled=settled).model_validate({**known, name: 1})


def test_fingerprint_changes_with_what_decides_the_draws(small_problem: Problem) -> None:
    problem = problem_of([small_problem.experiment], small_problem.priors)
    data = program_data(problem, solver=SolverOptions())
    first = fingerprint(data, SMALL_RUN, "program")
    same = replace(SMALL_RUN, chains=9, chain_timeout=5.0)
    assert first == fingerprint(data, same, "program")
    tighter = program_data(problem, solver=SolverOptions(tolerance=1e-8))
    others = [
        fingerprint(tighter, SMALL_RUN, "program"),
        fingerprint(data, replace(SMALL_RUN, seed=12), "program"),
        fingerprint(data, replace(SMALL_RUN, draws=101), "program"),
        fingerprint(data, SMALL_RUN, "other program"),
    ]
    assert len({first, *others}) == 5


def test_fingerprint_is_the_same_on_another_processor(small_problem: Problem) -> None:
    """Where linear algebra ends in other last digits, but not where an input is another."""
    data = program_data(
        problem_of([small_problem.experiment], small_problem.priors), solver=SolverOptions()
    )
    first = fingerprint(data, SMALL_RUN, "program")

    def off(content: Any, by: float) -> Any:
        if isinstance(content, float):
            return content * (1 + by)
        if isinstance(content, list):
            return [off(part, by) for part in content]
        return content

    for by in (1e-14, -3e-13):
        elsewhere = {name: off(part, by) for name, part in data.items()}
        assert elsewhere != data
        assert fingerprint(elsewhere, SMALL_RUN, "program") == first
    for name in ("response_observed", "temperature", "prior_location"):
        other = {**data, name: off(data[name], 1e-4)}
        assert fingerprint(other, SMALL_RUN, "program") != first


def test_starts_are_prior_draws_that_depend_on_seed_and_chain(
    programs: None, small_problem: Problem
) -> None:
    problem = problem_of([small_problem.experiment], small_problem.priors)
    loaded = programs_of_tests(problem)
    starts = {
        (seed, chain): draw_from_prior(problem, loaded, seed=seed, chain=chain).tolist()
        for seed, chain in [(1, 1), (1, 2), (2, 1)]
    }
    assert starts[1, 1] == draw_from_prior(problem, loaded, seed=1, chain=1).tolist()
    assert len({tuple(start) for start in starts.values()}) == 3
    assert all(np.isfinite(start).all() for start in starts.values())
    assert {len(start) for start in starts.values()} == {len(problem.free)}


def test_an_experiment_without_data_cannot_be_fitted(
    small_problem: Problem, tmp_path: Path
) -> None:
    empty = replace(small_problem.experiment, strain=np.empty(0), stress=np.empty(0))
    with pytest.raises(InputError, match="no data"):
        fit(empty, small_problem.priors, out=tmp_path / "run", options=SMALL_RUN)
    assert not (tmp_path / "run").exists()


def test_an_interrupted_run_and_a_killed_chain_are_told_and_the_next_call_completes_the_run(
    start_fit: StartFit, undisturbed: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    """A terminal sends the signal to the whole group of processes, so to the chains too."""
    run = RunDirectory(tmp_path / "run")
    for send in (os.kill, os.killpg):
        process = start_fit(run.path)
        wait_for_draws(run, process)
        send(process.pid, signal.SIGINT)
        output, _ = process.communicate(timeout=120)
        assert process.returncode == 130
        assert "interrupted" in output
        assert "Traceback" not in output
        assert processes_on(run.path) == []
        assert run.read_manifest()["status"] == "interrupted"
        assert_whole(run)

    process = start_fit(run.path)
    wait_for_draws(run, process)
    victim = next(child for child in chains_of(process) if "id=2" in _command_line(child))
    victim.kill()
    output, _ = process.communicate(timeout=120)
    assert process.returncode == 3
    assert run.finished_chains() == (1,)
    assert "Chain 2 was killed by the system (SIGKILL)" in output
    assert "Iteration:" in output
    assert "run the same command again" in output
    assert "Traceback" not in output
    loaded = Fit.load(run.path)
    verdicts = {check.name: check for check in loaded.checks()}
    assert not verdicts["chains"].passed
    assert "Chain 2 was killed" in verdicts["chains"].sentence
    assert "coordinate" in verdicts["chains"].sentence  # the values that it started from
    assert loaded.posterior["posterior"].sizes["chain"] == 1
    assert run.read_manifest()["status"] == "chains missing"
    assert "SIGKILL" in verdicts["chains"].table["outcome"].iloc[1]
    assert run.failure_file(2).is_file()

    completed = small_problem.fit(run.path, INTERRUPTED)
    assert_same_draws(run, undisturbed)
    assert completed.manifest["status"] == "complete"
    assert completed.checks()[0].passed


def test_chains_out_of_time_are_named_and_can_be_run_again(
    programs: None, small_problem: Problem, tmp_path: Path
) -> None:
    with pytest.raises(SamplingError, match=r"Chain 1 ran into its time limit .*raise the limit"):
        small_problem.fit(tmp_path / "run", replace(SMALL_RUN, draws=100_000, chain_timeout=0.3))
    run = RunDirectory(tmp_path / "run")
    assert run.read_manifest()["status"] == "chains missing"
    assert run.failure_file(1).is_file()
    with pytest.raises(InputError, match="no chain is finished"):
        Fit.load(run.path)


def test_a_chain_that_cannot_start_is_named(
    small_fit: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    """A start from which the solver finds nothing, in a run whose first chain is there."""
    small_fit.save(tmp_path / "run")
    run = RunDirectory(tmp_path / "run")
    shutil.rmtree(run.chain_folder(2))
    start = json.loads(run.initial_values_file(2).read_text(encoding="utf-8"))
    write_json(run.initial_values_file(2), {"coordinate": [1e9] * len(start["coordinate"])})
    result = small_problem.fit(run.path)
    check = result.checks()[0]
    assert not check.passed
    assert "Chain 2 ended with an error at 'before the first iteration'" in check.sentence
    assert "1000000000.0" in check.sentence
    assert "tighten the prior" in check.sentence
    assert run.finished_chains() == (1,)


@pytest.mark.slow
def test_sigkill_at_random_moments_and_then_a_complete_run(
    start_fit: StartFit, undisturbed: Fit, tmp_path: Path
) -> None:
    run = RunDirectory(tmp_path / "run")
    rng = np.random.default_rng(31)
    for moment in [*rng.uniform(0.0, 1.5, 2), None]:
        already = time_written(run.manifest_file)
        process = start_fit(run.path)
        if moment is None:
            wait_until(partial(is_sampling_or_done, process), "a chain")
        else:
            wait_until(partial(is_writing, process, run, already), "a manifest")
            time.sleep(moment)
        process.kill()
        process.communicate()
        assert_whole(run)

    process = start_fit(run.path)
    output, _ = process.communicate(timeout=120)
    assert process.returncode in (0, 3), output
    assert_whole(run)
    assert_same_draws(run, undisturbed)
    assert run.read_manifest()["status"] == "complete"
    assert not list(run.path.rglob(f"{UNFINISHED}*"))
    assert not (run.path / ".scratch").exists()
    # Chains of killed fits end by themselves, at the latest when they report their progress.
    wait_until(lambda: processes_on(run.path) == [], "orphans to end")
