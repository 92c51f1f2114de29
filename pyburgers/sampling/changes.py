"""What differs between the run in a folder and the one that is asked for, in words."""

import tempfile
from collections.abc import Iterator
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any

from pyburgers.common.errors import InputError
from pyburgers.model.priors import load_priors, save_priors
from pyburgers.model.variants import variant_of
from pyburgers.protocols.problem import Problem
from pyburgers.protocols.protocol import save_experiment
from pyburgers.protocols.stan_data import SolverOptions
from pyburgers.sampling.manifest import FitManifest
from pyburgers.sampling.options import INDECISIVE, SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory

MOST_TOLD = 6
"""Differences that are told; there are as many as parameters where all priors differ."""


@dataclass(frozen=True)
class Wanted:
    """A run that is asked for.

    Attributes
    ----------
    problem : Problem
        What is fitted.
    options : SamplerOptions
        Settled settings of the sampler.
    solver : SolverOptions
        Settings of the solver.
    use_likelihood : bool
        Whether data take part.
    """

    problem: Problem
    options: SamplerOptions
    solver: SolverOptions
    use_likelihood: bool


def refusal(run: RunDirectory, wanted: Wanted) -> str:
    """Say what is other in the run that a folder holds, and what can be done.

    Parameters
    ----------
    run : RunDirectory
        With a manifest.
    wanted : Wanted
        Another run.
    """
    try:
        found = list(differences(run, wanted))
    except (InputError, OSError):  # damaged, or of another kind
        found = ["it is no finished fit of tests"]
    if not found:
        found = ["Stan programs, CmdStan or the compiler are others now"]
    more = [f"and {len(found) - MOST_TOLD} more"] if len(found) > MOST_TOLD else []
    longer = ""
    if len(found) == 1 and found[0].startswith("draws "):
        longer = ", or --more-draws N to add draws to its chains"
    return (
        f"{run.path}: holds a run of other inputs: {'; '.join([*found[:MOST_TOLD], *more])}; "
        f"choose another --out, or --overwrite to replace it{longer}."
    )


def differences(run: RunDirectory, wanted: Wanted) -> Iterator[str]:
    """Return what is asked for and what the run in a folder has, where they differ.

    Raises
    ------
    InputError
        If the folder holds no such run.
    """
    manifest = run.read_manifest(FitManifest)
    problem = wanted.problem
    names = [experiment.id for experiment in problem.experiments]
    if names != manifest["experiments"]:
        yield _told("tests", "+".join(names), "+".join(manifest["experiments"]))
        return
    for name, value in asdict(wanted.options).items():
        if name not in INDECISIVE and value != manifest["sampler"][name]:
            yield _told(name, value, manifest["sampler"][name])
    threads = wanted.options.threads_per_chain, manifest["sampler"].get("threads_per_chain", 1)
    if len(names) > 1 and (threads[0] > 1) != (threads[1] > 1):
        yield _told("threads_per_chain", *threads)
    if wanted.use_likelihood != manifest["use_likelihood"]:
        kinds = {True: "data and prior", False: "the prior alone"}
        yield _told("draws of", kinds[wanted.use_likelihood], kinds[manifest["use_likelihood"]])
    tightened = [*manifest.get("noisy", []), *manifest["refits"]]
    tolerance = (*tightened, manifest["solver"])[0]["tolerance"]
    if wanted.solver.tolerance != tolerance:
        yield _told("tolerance", f"{wanted.solver.tolerance:g}", f"{tolerance:g}")
    before = manifest.get("variant", {})
    for part, law in variant_of(problem.priors[0], problem.experiments[0]).record().items():
        if law != before.get(part):
            yield _told(part, law, before.get(part))
    pooled = problem.pooling.record()["kinds"]
    for name in problem.free if len(names) > 1 else ():
        if pooled.get(name) != manifest["pooling"]["kinds"].get(name):
            yield _told(
                f"pooling of {name}", pooled.get(name), manifest["pooling"]["kinds"].get(name)
            )
    with tempfile.TemporaryDirectory() as folder:
        yield from _other_files(run, problem, Path(folder))


def _other_files(run: RunDirectory, problem: Problem, scratch: Path) -> Iterator[str]:
    """Compare the copies of tests and priors with those that the run would have."""
    for experiment in problem.experiments:
        folder = scratch / experiment.id
        folder.mkdir()
        save_experiment(experiment, folder)
        there = run.test_file(experiment.id).parent
        for file in sorted(folder.iterdir()):
            other = there / file.name
            if not other.is_file() or other.read_bytes() != file.read_bytes():
                what = "the file" if file.suffix == ".toml" else "readings"
                yield f"{what} of test {experiment.id}"
    save_priors(problem.given_priors, scratch / "priors.toml")
    now, before = load_priors(scratch / "priors.toml"), load_priors(run.priors_file)
    for name in dict.fromkeys([*now.priors, *before.priors]):
        ours, theirs = now.priors.get(name), before.priors.get(name)
        numbers = [None if one is None else (one.family, one.numbers()) for one in (ours, theirs)]
        if numbers[0] != numbers[1]:
            yield f"prior of {name}"
    if now.flow_law != before.flow_law:
        yield "prior of the flow law"


def _told(name: str, ours: Any, theirs: Any) -> str:
    return f"{name} {ours} where the run has {theirs}"
