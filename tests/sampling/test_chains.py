"""Chains as processes: beside others in threads, with files that are cut short, or not at all."""

import logging
import re
import sys
from concurrent.futures import ThreadPoolExecutor
from dataclasses import replace
from pathlib import Path

import pytest
import xarray as xr
from conftest import SMALL_RUN, Problem

from pyburgers.cmdstan.program import Program
from pyburgers.common.errors import SystemFailureError
from pyburgers.common.processes import start
from pyburgers.fitting.fit import Fit, fit
from pyburgers.sampling.chains import ConsoleFile, _Chain, _keep_chain, _start_chain
from pyburgers.sampling.run_directory import RunDirectory


def test_fits_in_threads_are_like_any_other_and_leave_the_streams_alone(
    small_problem: Problem,
    small_fit: Fit,
    tmp_path: Path,
    capfd: pytest.CaptureFixture[str],
    caplog: pytest.LogCaptureFixture,
) -> None:
    caplog.set_level(logging.INFO, "pyburgers")
    experiment, priors = small_problem.experiment, small_problem.priors
    options = replace(SMALL_RUN, parallel_chains=1)
    with ThreadPoolExecutor(2) as pool:
        waiting = [
            pool.submit(fit, experiment, priors, out=tmp_path / name, options=options)
            for name in ("one", "other")
        ]
        print("mine")
        found = [one.result() for one in waiting]
    assert capfd.readouterr() == ("mine\n", "")
    assert caplog.messages.count("100% of 2 chains of 250 iterations (sampling)") == 2
    expected = small_fit.posterior["posterior"].to_dataset().drop_attrs()
    for one in found:
        draws = one.posterior["posterior"].to_dataset().drop_attrs()
        xr.testing.assert_identical(draws, expected)


def test_draws_that_were_cut_short_are_not_kept(small_fit: Fit, tmp_path: Path) -> None:
    """A full disk does that, and the process ends well all the same."""
    small_fit.save(tmp_path / "run")
    run = RunDirectory(tmp_path / "run")
    whole = run.draws_file(2).read_text(encoding="utf-8").splitlines(keepends=True)
    scratch = run.new_scratch()
    (scratch / "draws.csv").write_text("".join(whole[:-40]), encoding="utf-8")
    ended = start([sys.executable, "-c", ""], scratch / "draws.txt")
    ended.wait()
    failure = _keep_chain(run, _Chain(2, ended, ConsoleFile(ended.console)), SMALL_RUN.draws)
    assert failure is not None
    assert "Chain 2 left incomplete draws" in failure.reason
    assert "free disk space" in failure.reason
    assert run.failure_file(2).is_file()


def test_a_program_that_does_not_start_is_named(small_fit: Fit, tmp_path: Path) -> None:
    small_fit.save(tmp_path / "run")
    run = RunDirectory(tmp_path / "run")
    with pytest.raises(SystemFailureError, match=r"nowhere: could not be started"):
        _start_chain(Program(tmp_path / "nowhere"), run, 1, SMALL_RUN)


def test_most_of_a_short_warm_up_is_left_to_the_metric(small_fit: Fit) -> None:
    """Stan's own first phase takes 75 iterations however few there are."""
    text = small_fit.directory.draws_file(1).read_text(encoding="utf-8")
    first, last = (
        int(found[1])
        for name in ("init_buffer", "term_buffer")
        if (found := re.search(rf"{name} = (\d+)", text))
    )
    assert 0 < first < last
    assert first + last <= SMALL_RUN.warmup_iterations / 2
