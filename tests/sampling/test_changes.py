"""A folder that holds another run: what differs is told, and it is replaced where that is asked."""

from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import SMALL_RUN, Problem, pair_of, with_fixed

from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.stan_data import SolverOptions


def told(problem: Problem, out: Path, **changed: Any) -> str:
    arguments: dict[str, Any] = {
        "experiments": problem.experiment,
        "priors": problem.priors,
        "options": SMALL_RUN,
        **changed,
    }
    with pytest.raises(InputError) as caught:
        fit(**arguments, out=out)
    text = str(caught.value)
    assert text.startswith(f"{out}: holds a run of other inputs: ")
    assert "--overwrite" in text
    return text


def test_what_differs_is_told(small_fit: Fit, small_problem: Problem) -> None:
    out = small_fit.directory.path
    test, priors = small_problem.experiment, small_problem.priors
    for changed, words in (
        ({"options": replace(SMALL_RUN, draws=300)}, ("draws 300 where the run has 100",)),
        ({"options": replace(SMALL_RUN, seed=3)}, ("seed 3 where the run has 11",)),
        ({"solver": SolverOptions(tolerance=1e-6)}, ("tolerance 1e-06 where the run has 1e-05",)),
        ({"use_likelihood": False}, ("draws of the prior alone",)),
        (
            {"experiments": replace(test, stress=1.1 * test.stress)},
            ("readings of test PIL40",),
        ),
        ({"experiments": replace(test, temperature=255.0)}, ("the file of test PIL40",)),
        (
            {"experiments": pair_of(small_problem)},
            ("tests PIL40+other where the run has PIL40",),
        ),
        (
            {"priors": with_fixed(priors, {"activation_enthalpy": 6e4})},
            ("prior of activation_enthalpy",),
        ),
    ):
        text = told(small_problem, out, **changed)
        assert all(word in text for word in words), text


def test_more_draws_are_offered_where_only_their_number_differs(
    small_fit: Fit, small_problem: Problem
) -> None:
    out = small_fit.directory.path
    longer = told(small_problem, out, options=replace(SMALL_RUN, draws=300))
    assert "--more-draws" in longer
    other = told(small_problem, out, options=replace(SMALL_RUN, draws=300, seed=2))
    assert "--more-draws" not in other


def test_overwriting_replaces_the_run_and_nothing_else(
    small_fit: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    small_fit.save(out)
    (out / "notes.txt").write_text("mine", encoding="utf-8")
    options = replace(SMALL_RUN, draws=20, warmup=60)
    new = fit(
        small_problem.experiment, small_problem.priors, out=out, options=options, overwrite=True
    )
    assert new.posterior["posterior"].sizes["draw"] == 20
    assert (out / "notes.txt").read_text(encoding="utf-8") == "mine"
    # The same inputs are continued, whatever is said of others.
    kept = new.directory.draws_file(1).read_bytes()
    begun = "2026-01-01T00:00:00+00:00"
    new.directory.update_manifest({"started": begun})
    again = fit(
        small_problem.experiment, small_problem.priors, out=out, options=options, overwrite=True
    )
    assert again.directory.draws_file(1).read_bytes() == kept
    assert again.manifest["started"] == begun
