"""A folder that holds another run: what differs is told, and it is replaced where that is asked."""

import json
import logging
from dataclasses import replace
from pathlib import Path
from typing import Any

import pytest
from conftest import SMALL_RUN, Problem, pair_of, with_fixed

from pyburgers.common.errors import InputError
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.sampling.run_directory import RunDirectory


def refused(problem: Problem, run: Fit, **changed: Any) -> str:
    """Why other inputs are refused in the folder of a run, which stays as it is."""
    out = run.directory.path
    before = {file: (file.stat().st_mtime_ns, file.read_bytes()) for file in files_in(out)}
    arguments: dict[str, Any] = {
        "experiments": problem.experiment,
        "priors": problem.priors,
        "options": SMALL_RUN,
        **changed,
    }
    with pytest.raises(InputError) as caught:
        fit(**arguments, out=out)
    assert {file: (file.stat().st_mtime_ns, file.read_bytes()) for file in files_in(out)} == before
    text = str(caught.value)
    assert text.startswith(f"{out}: holds a run of other inputs: ")
    assert ("--overwrite" in text) is ("more_draws" not in changed)
    return text


def files_in(folder: Path) -> list[Path]:
    return [file for file in folder.rglob("*") if file.is_file() and file.name != ".lock"]


def test_other_inputs_are_refused_and_what_differs_is_told(
    small_fit: Fit, joint: Fit, small_problem: Problem
) -> None:
    test, priors = small_problem.experiment, small_problem.priors
    pair = pair_of(small_problem)
    wider = priors.exchanging(replace(priors["maxwell_modulus"], scale=3e9))
    rows: tuple[tuple[dict[str, Any], str], ...] = (
        ({"options": replace(SMALL_RUN, draws=300)}, "draws 300 where the run has 100"),
        ({"options": replace(SMALL_RUN, seed=3)}, "seed 3 where the run has 11"),
        ({"solver": SolverOptions(tolerance=1e-6)}, "tolerance 1e-06 where the run has 1e-05"),
        ({"use_likelihood": False}, "draws of the prior alone"),
        ({"experiments": replace(test, stress=1.001 * test.stress)}, "readings of test PIL40"),
        (
            {"experiments": replace(test, temperature=255.0)},
            "the file of test PIL40 (temperature_K)",
        ),
        ({"experiments": pair}, "tests PIL40+other where the run has PIL40"),
        ({"priors": with_fixed(priors, {"activation_enthalpy": 6e4})}, "prior of activation_ent"),
        ({"priors": wider}, "prior of maxwell_modulus"),
    )
    for changed, words in rows:
        text = refused(small_problem, small_fit, **changed)
        assert words in text
    # More draws are offered if their number alone differs, and is larger.
    longer = replace(SMALL_RUN, draws=300)
    assert "or --more-draws 200 to add" in refused(small_problem, small_fit, options=longer)
    for changed, offered in (
        ({"options": replace(longer, draws=50)}, False),
        ({"options": replace(longer, seed=2)}, False),
        ({"use_likelihood": False}, False),
    ):
        assert ("--more-draws" in refused(small_problem, small_fit, **changed)) is offered
    # Draws are added with the inputs and options of the run alone.
    command = small_fit.manifest["command"]
    for changed in ({"options": longer}, {"experiments": replace(test, temperature=255.0)}):
        text = refused(small_problem, small_fit, **changed, more_draws=50)
        assert f"{command}; for others choose another --out" in text
    pool = {"maxwell_modulus": "separate"}
    assert "pooling" in refused(small_problem, joint, experiments=pair, pool=pool)


def test_overwriting_replaces_the_run_and_nothing_else(
    small_fit: Fit, small_problem: Problem, tmp_path: Path
) -> None:
    out = tmp_path / "run"
    small_fit.save(out)
    (out / "notes.txt").write_text("mine", encoding="utf-8")
    options = replace(SMALL_RUN, draws=20, warmup=60)
    new = small_problem.fit(out, options, overwrite=True)
    assert new.posterior["posterior"].sizes["draw"] == 20
    assert (out / "notes.txt").read_text(encoding="utf-8") == "mine"
    # The same inputs are continued, whatever is said of others.
    kept = new.directory.draws_file(1).read_bytes()
    begun = "2026-01-01T00:00:00+00:00"
    new.directory.update_manifest({"started": begun})
    again = small_problem.fit(out, options, overwrite=True)
    assert again.directory.draws_file(1).read_bytes() == kept
    assert again.manifest["started"] == begun


@pytest.mark.parametrize("manifest", [{"name": "mine"}, {"kind": "pyburgers report", "runs": []}])
def test_a_folder_with_a_manifest_of_something_else_is_never_cleared(
    small_problem: Problem, tmp_path: Path, manifest: dict[str, Any]
) -> None:
    (tmp_path / "inputs").mkdir()
    files = {"manifest.json": json.dumps(manifest), "inputs/notes.txt": "mine", "summary.csv": "a"}
    for name, text in files.items():
        (tmp_path / name).write_text(text, encoding="utf-8")
    with pytest.raises(InputError, match="something else than a fit of tests") as caught:
        small_problem.fit(tmp_path, overwrite=True)
    assert "--overwrite" not in str(caught.value)
    for name, text in files.items():
        assert (tmp_path / name).read_text(encoding="utf-8") == text


def test_a_corrected_origin_of_the_data_is_that_of_the_run(
    small_fit: Fit, small_problem: Problem, tmp_path: Path, caplog: pytest.LogCaptureFixture
) -> None:
    """Draws stay; copy, manifest and labelled draws tell the same, and the command says so."""
    out, test = tmp_path / "run", small_problem.experiment
    small_fit.save(out)
    copies = RunDirectory(out).test_file(test.id).parent
    (copies / "experiment_old.csv").write_text("", encoding="utf-8")
    RunDirectory(out).update_manifest({"hashes": {}})
    caplog.set_level(logging.INFO, "pyburgers.fitting.run_inputs")
    provenance = replace(test.provenance, kind="measured", source="Corrected")
    corrected = replace(test, provenance=provenance, true_parameters=None)
    keys = "provenance, true_parameters"
    told = f"The run has another copy of the file of test PIL40 ({keys}): it is renewed."
    for said in ([told], []):
        caplog.clear()
        again = fit(corrected, small_problem.priors, out=out, options=SMALL_RUN)
        assert caplog.messages == said
        for one in (again, Fit.load(out)):
            assert one.provenance == provenance
            assert one.manifest["data_kind"] == one.posterior.attrs["data_kind"] == "measured"
            assert one.draws_of == "measured"
        assert {file.name for file in copies.iterdir()} == {"experiment.csv", "experiment.toml"}
    same = small_fit.posterior["posterior"].to_dataset()
    assert again.posterior["posterior"].to_dataset().equals(same)
