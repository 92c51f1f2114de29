"""Inputs of a run, copied so that it can be trusted and repeated."""

import logging
import tomllib
from collections.abc import Iterator, Mapping, Sequence
from pathlib import Path

from pyburgers.common.atomic_files import write_text
from pyburgers.common.toml_files import read_tables
from pyburgers.kinds.experiment import Experiment
from pyburgers.model.priors import PriorSet, priors_text
from pyburgers.sampling.run_directory import RunDirectory

logger = logging.getLogger(__name__)


def input_texts(experiments: Sequence[Experiment], priors: PriorSet) -> dict[str, str]:
    """Return the files that a run needs to be trusted and repeated, by their paths in its folder.

    Of the files of a test the TOML file is last: it is what tells that the copy is complete.
    """
    tests = {
        RunDirectory(Path()).test_file(experiment.id).with_name(name).as_posix(): text
        for experiment in experiments
        for name, text in experiment.file_texts().items()
    }
    return {**tests, RunDirectory(Path()).priors_file.as_posix(): priors_text(priors)}


def write_inputs(run: RunDirectory, texts: Mapping[str, str]) -> None:
    """Save `input_texts`; tell which files of tests differ from the copies that they replace."""
    for name, text in texts.items():
        file = run.path / name
        before = file.read_text(encoding="utf-8") if file.is_file() else None
        if text == before:
            continue
        if before is not None and file != run.priors_file:
            logger.info(f"The run has another copy of {different_file(file, text)}: it is renewed.")
        file.parent.mkdir(parents=True, exist_ok=True)
        # A killed process leaves nothing unfinished beside the copies.
        scratch = run.new_scratch()
        write_text(scratch / file.name, text)
        (scratch / file.name).replace(file)
        scratch.rmdir()
    for stale in {*run.inputs.glob("tests/*/experiment*")} - {run.path / name for name in texts}:
        stale.unlink()


def different_file(file: Path, text: str) -> str:
    """Name a file of a test of which a run has another copy, with the keys that differ."""
    if file.suffix != ".toml":
        return f"readings of test {file.parent.name}"
    old, new = read_tables(file) if file.is_file() else {}, tomllib.loads(text)
    keys = [key for key in {**old, **new} if old.get(key) != new.get(key)]
    return f"the file of test {file.parent.name} ({', '.join(keys) or 'its layout'})"


def other_files(run: RunDirectory, inputs: Mapping[str, str]) -> Iterator[str]:
    """Compare the copies of tests and priors with those that the run would have."""
    *tests, (_, priors) = inputs.items()
    for name, text in sorted(tests):
        file = run.path / name
        if not file.is_file() or file.read_text(encoding="utf-8") != text:
            yield different_file(file, text)
    now, before = tomllib.loads(priors), read_tables(run.priors_file)
    ours, theirs = (
        {name: {**prior, "source": "", "read_off": []} for name, prior in one["parameters"].items()}
        for one in (now, before)
    )
    for name in {**ours, **theirs}:
        if ours.get(name) != theirs.get(name):
            yield f"prior of {name}"
    if now.get("flow_law") != before.get("flow_law"):
        yield "prior of the flow law"
