"""The run that is asked for: its record, its inputs, and what differs from the one in a folder."""

import re
from collections.abc import Iterator, Mapping, Sequence
from dataclasses import asdict
from typing import Any

from pyburgers.common.atomic_files import sha256_of_file, write_atomically
from pyburgers.common.errors import InputError
from pyburgers.common.scratch import scratch_folder
from pyburgers.kinds.kind import save_experiment
from pyburgers.kinds.problem import Problem
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.priors import load_priors, save_priors
from pyburgers.model.variants import variant_of
from pyburgers.sampling.manifest import FitManifest
from pyburgers.sampling.options import INDECISIVE, SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory

MAX_TOLD = 6
"""Differences that are told; there are as many as parameters where all priors differ."""


def problem_record(problem: Problem) -> dict[str, Any]:
    """Note what is fitted: tests, pooling, variant of the model, another source of the flow law."""
    priors = problem.given_priors
    return {
        "experiments": [experiment.id for experiment in problem.experiments],
        "pooling": problem.pooling.record(),
        "variant": variant_of(problem.priors[0], problem.experiments[0]).record(),
        "priors_from": None if priors.flow_law is None else priors.flow_law.source,
    }


def wanted_record(
    problem: Problem, options: SamplerOptions, solver: SolverOptions, *, use_likelihood: bool
) -> dict[str, Any]:
    """Note what is asked for, as the manifest of a run has it; options are settled ones."""
    return {
        **problem_record(problem),
        "sampler": asdict(options),
        "solver": asdict(solver),
        "use_likelihood": use_likelihood,
    }


def write_inputs(run: RunDirectory, problem: Problem) -> None:
    """Save what a run needs to be trusted and repeated; written once, before sampling."""
    for experiment in problem.experiments:
        file = run.test_file(experiment.id)
        if file.is_file():
            continue
        scratch = run.new_scratch()
        save_experiment(experiment, scratch)
        file.parent.mkdir(parents=True, exist_ok=True)
        # The TOML file goes last: it is what tells that the copy is complete.
        for written in sorted(scratch.iterdir(), key=lambda file: file.suffix == ".toml"):
            written.replace(file.parent / written.name)
    # As given: they are resolved for each test by itself.
    write_atomically(run.priors_file, lambda path: save_priors(problem.given_priors, path))


def refusal(run: RunDirectory, wanted: Mapping[str, Any], problem: Problem) -> str:
    """Say what is other in the run that a folder holds than in a `wanted_record`; what to do."""
    try:
        manifest = run.read_manifest(FitManifest)
        found = list(_differences(run, manifest, wanted, problem))
    except (InputError, OSError):  # damaged, or of another kind
        found = ["it is no finished fit of tests"]
    if not found:
        found = ["Stan programs, CmdStan or the compiler are others now"]
    more = [f"and {len(found) - MAX_TOLD} more"] if len(found) > MAX_TOLD else []
    longer = ""
    if len(found) == 1 and re.match(r"draws \d", found[0]):
        longer = ", or --more-draws N to add draws to its chains"
    return (
        f"{run.path}: holds a run of other inputs: {'; '.join([*found[:MAX_TOLD], *more])}; "
        f"choose another --out, or --overwrite to replace it{longer}."
    )


def _differences(
    run: RunDirectory, manifest: Mapping[str, Any], wanted: Mapping[str, Any], problem: Problem
) -> Iterator[str]:
    """Return what is asked for and what the run has, where they differ."""
    ours, theirs = (_decisive(record, problem.free) for record in (wanted, manifest))
    different = [name for name in ours if ours[name] != theirs.get(name)]
    for name in different[:1] if "tests" in different else different:
        yield f"{name} {ours[name]} where the run has {theirs.get(name)}"
    if "tests" not in different:
        yield from _other_files(run, problem)


def _decisive(record: Mapping[str, Any], free: Sequence[str]) -> dict[str, Any]:
    """Return what decides the draws of a run by its name in messages, the tests first."""
    tests, sampler = record["experiments"], record["sampler"]
    # The tolerance that was asked for; what follows from the draws tightens it.
    tightened = [*record.get("noisy", []), *record.get("refits", []), record["solver"]]
    decisive = {
        "tests": "+".join(tests),
        **{name: value for name, value in sampler.items() if name not in INDECISIVE},
        "draws of": "data and prior" if record["use_likelihood"] else "the prior alone",
        "tolerance": f"{tightened[0]['tolerance']:g}",
        **record.get("variant", {}),
    }
    if len(tests) > 1:
        threads = sampler.get("threads_per_chain", 1)
        decisive["threads_per_chain"] = "2 or more" if threads > 1 else "1"
        pooled = record["pooling"]["kinds"]
        decisive |= {f"pooling of {name}": pooled.get(name) for name in free}
    return decisive


def _other_files(run: RunDirectory, problem: Problem) -> Iterator[str]:
    """Compare the copies of tests and priors with those that the run would have."""
    with scratch_folder() as folder:
        copy = RunDirectory(folder)
        copy.inputs.mkdir()
        write_inputs(copy, problem)
        for experiment in problem.experiments:
            files = sorted(copy.test_file(experiment.id).parent.iterdir())
            for name, digest in copy.hashes(files).items():
                there = run.path / name
                if not there.is_file() or sha256_of_file(there) != digest:
                    what = "the file" if name.endswith(".toml") else "readings"
                    yield f"{what} of test {experiment.id}"
        now, before = load_priors(copy.priors_file), load_priors(run.priors_file)
    for name in dict.fromkeys([*now.priors, *before.priors]):
        ours, theirs = now.priors.get(name), before.priors.get(name)
        numbers = [None if one is None else (one.family, one.numbers()) for one in (ours, theirs)]
        if numbers[0] != numbers[1]:
            yield f"prior of {name}"
    if now.flow_law != before.flow_law:
        yield "prior of the flow law"
