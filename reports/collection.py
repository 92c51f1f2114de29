"""The open collection: each measured test that comes with the package, fitted by several laws.

    python reports/collection.py

This fits what is missing, then writes the shipped laws (`data/collection`) and the page with the
league of laws (`reports/collection`). The same command continues where a call stopped.
"""

import argparse
import json
import logging
import shutil
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace
from itertools import zip_longest
from pathlib import Path
from typing import Any

import pandas as pd
from common import DATA, bad_verdicts, shown_verdicts, tell_progress, write_json
from halite import LAWS as HALITE_LAWS
from halite import halite_tasks
from league import Contest, league_section, league_sentence
from posterior_database import write_posterior

import pyburgers
from pyburgers import Experiment, Fit, PageSection, PageTable, SamplerOptions, fit_side_by_side

logger = logging.getLogger("pyburgers.collection")

OPTIONS = SamplerOptions(max_minutes=10.0, chain_timeout=900.0)
"""Sampler settings of the fits. A chain that is not done in a quarter of an hour is given up."""

COMMAND = "python reports/collection.py"
"""Makes the collection again."""

Choices = Mapping[str, Mapping[str, str]]
"""Laws by name: what is not the standard law."""

OF_CURVES: Choices = {
    "standard": {},
    "autocorrelated": {"residuals": "autocorrelated"},
    "kelvin_power_law": {"kelvin": "power_law"},
    "threshold_stress": {"maxwell": "threshold_stress"},
    "backstress": {"hardening": "backstress"},
    "dislocations": {"hardening": "dislocations"},
}

OF_SPECTRA: Choices = {
    "one_element": {"kelvin": "linear"},
    "extended": {"kelvin": "extended"},
    "andrade": {"kelvin": "andrade"},
    "two_elements": {"kelvin": "two_elements"},
}

MATERIALS = "https://epos-msl.uu.nl/voc/materials/1.3/"
PERIDOTITE = f"{MATERIALS}igneous_rock_-_intrusive-ultrabasic_intrusive-peridotite-"
AHEIM_DUNITE, ANITA_BAY_DUNITE = (f"{PERIDOTITE}{name}_dunite" for name in ("aheim", "anita_bay"))
OLIVINE = f"{MATERIALS}minerals-silicate_minerals-nesosilicates-olivine"
ROCK_SALT = f"{MATERIALS}sedimentary_rock-evaporite-rock_salt"
ROCK_PHYSICS = "https://epos-msl.uu.nl/voc/rockphysics/1.3/"
TRIAXIAL = (
    f"{ROCK_PHYSICS}apparatus-deformation_testing-compression_testing-"
    "triaxial_compression_apparatus"
)
CREEP = f"{ROCK_PHYSICS}measured_property-strain_rate_-_creep_constant_stress"
ATTENUATION = f"{ROCK_PHYSICS}measured_property-elasticity-modulus_attenuation"
"""Terms of the vocabularies of the EPOS multi-scale laboratories, version 1.3."""


@dataclass(frozen=True)
class Rock:
    """A published test: its file below `data`, what it is fitted with, and its terms.

    `laws`: those of `Choices`; of rock salt the fits of the study of salt.
    `terms`: URIs of the material and of the kind of test.
    """

    file: str
    laws: Choices
    terms: tuple[str, str]


HALITE = "halite_z3"

ROCKS: Mapping[str, Rock] = {
    "dunite_4506": Rock("dunite/dunite_4506.toml", OF_CURVES, (AHEIM_DUNITE, TRIAXIAL)),
    "dunite_4581": Rock("dunite/dunite_4581.toml", OF_CURVES, (AHEIM_DUNITE, TRIAXIAL)),
    "dunite_4580": Rock("dunite/dunite_4580.toml", OF_CURVES, (ANITA_BAY_DUNITE, TRIAXIAL)),
    "dunite_4469": Rock("dunite/dunite_4469.toml", OF_CURVES, (ANITA_BAY_DUNITE, TRIAXIAL)),
    "olivine_A1802": Rock("olivine/attenuation_A1802.toml", OF_SPECTRA, (OLIVINE, ATTENUATION)),
    "olivine_A1906": Rock("olivine/attenuation_A1906.toml", OF_SPECTRA, (OLIVINE, ATTENUATION)),
    HALITE: Rock(
        "halite/halite_z3.toml",
        {name.removeprefix("halite_"): {} for name in HALITE_LAWS},
        (ROCK_SALT, CREEP),
    ),
}
"""Tests by name, and the laws that each is fitted with."""

BEFORE = "-before"
"""Ends the name of a fit without the last part of a test, which the fit then predicts."""

DRAWS = 200
"""Draws of each law that are shipped."""

POSTERIORS = ("dunite_4581", HALITE)
"""Tests whose draws are written in the form of posteriordb."""

OF_A_RUN = ("fingerprint", "command", "started", "sampler", "solver", "coordinates", "hashes")
"""Entries of the manifest of a run that are shipped, with the versions."""


def experiment_of(name: str) -> Experiment:
    """Read a test, under its name in the collection."""
    return replace(pyburgers.load_experiment(DATA / ROCKS[name].file), id=name)


def halves_of(test: Experiment) -> tuple[Experiment, Experiment] | None:
    """Return a test without its last segment, or its hottest spectrum, and that alone.

    The second has the whole history, and the readings of the last segment alone. None of a test
    that has no such parts.
    """
    if isinstance(test, pyburgers.AttenuationExperiment):
        hottest = next(iter(test.parts))
        return test.without_part(hottest), test.only_part(hottest)
    if not isinstance(test, pyburgers.ConstantRateExperiment) or len(test.segments) < 2:
        return None
    last = test.reading_segment == len(test.segments) - 1
    before = replace(
        test,
        segments=test.segments[:-1],
        strain=test.strain[~last],
        stress=test.stress[~last],
        final_strain=test.segments[-1].start_strain,
    )
    return before, replace(test, strain=test.strain[last], stress=test.stress[last])


def runs_of(name: str, options: SamplerOptions) -> dict[str, pyburgers.Task]:
    """Return the fits of a test by the names of their runs, in the order of its laws.

    Beside each fit stands one without the last part of the test, if the test has such parts.
    """
    if name == HALITE:
        return _halite_runs(options)
    whole = experiment_of(name)
    halves = halves_of(whole)
    tests = {"": whole, **({BEFORE: halves[0]} if halves else {})}
    priors = pyburgers.priors(whole.material, whole.protocol)
    return {
        f"{name}-{law}{end}": pyburgers.task_of(
            [test], pyburgers.with_variant(priors, test, choices), options
        )
        for law, choices in ROCKS[name].laws.items()
        for end, test in tests.items()
    }


def _halite_runs(options: SamplerOptions) -> dict[str, pyburgers.Task]:
    """Return the fits of the study of salt, in the time and with at most the draws of options."""
    return {
        f"{HALITE}-{name.removeprefix('halite_')}": replace(
            task,
            options=replace(
                task.options,
                draws=min(options.draws, task.options.draws),
                max_minutes=options.max_minutes,
                chain_timeout=options.chain_timeout,
            ),
        )
        for name, task in halite_tasks().items()
    }


def fit_all(
    tasks: Mapping[str, pyburgers.Task], folder: Path, command: str
) -> tuple[dict[str, Fit], dict[str, str]]:
    """Do fits one after the other, and return them, and why the others could not be done."""
    fits, failed = dict[str, Fit](), dict[str, str]()
    for run, task in tasks.items():
        try:
            fits |= fit_side_by_side({run: task}, folder, command=command)
        except pyburgers.SamplingError as error:
            failed[run] = str(error)
            logger.info(f"{run} could not be done: {error}")
    return fits, failed


def contests_of(fits: Mapping[str, Fit]) -> list[Contest]:
    """Compare the fits of each test that has some, by the names of their runs."""
    found = []
    for name, rock in ROCKS.items():
        whole, before = (
            {law: fits[run] for law in rock.laws if (run := f"{name}-{law}{end}") in fits}
            for end in ("", BEFORE)
        )
        halves = halves_of(experiment_of(name))
        if whole:
            found.append(Contest.of(name, whole, before, halves and halves[1]))
    return found


def record_of(contest: Contest) -> dict[str, Any]:
    """Return what is shipped of a test: the export of the chosen law, and where it is from."""
    fit = contest.fits[contest.chosen]
    sizes = fit.posterior["posterior"].sizes
    (text,) = pyburgers.export(fit, "json", draws=min(DRAWS, sizes["chain"] * sizes["draw"]))
    origin, (material, kind) = fit.provenance, ROCKS[contest.name].terms
    return {
        **json.loads(text),
        "test": contest.name,
        "collection": {
            "kind": fit.experiment.protocol,
            "law": contest.chosen,
            "source": origin.source,
            "doi": origin.doi,
            "licence": origin.licence,
            "notes": origin.notes,
            "verdicts": [verdict.sentence for verdict in fit.verdicts().values()],
            "terms": {"material": material, "kind": kind},
            "league": [
                {name: None if value != value else value for name, value in row.items()}
                for row in contest.rows()
            ],
            "manifest": {name: fit.manifest[name] for name in (*OF_A_RUN, "versions")},
        },
    }


def write_records(contests: Sequence[Contest], folder: Path, command: str) -> None:
    """Write a file for each test, and the index of all."""
    tests = []
    for contest in contests:
        record = record_of(contest)
        about = record["collection"]
        manifest = about["manifest"]
        write_json(folder / f"{contest.name}.json", record, indent=1, allow_nan=False)
        tests.append(
            {
                "name": contest.name,
                "file": f"{contest.name}.json",
                "material": record["material"],
                **{key: about[key] for key in ("kind", "source", "doi", "licence", "law", "terms")},
                "sampled_well": record["sampled_well"],
                "describes_data": record["describes_data"],
                **{key: manifest[key] for key in ("command", "hashes", "versions")},
            }
        )
    said = {"sentence": league_sentence(contests), "command": command}
    write_json(folder / "index.json", {**said, "tests": tests}, indent=1, allow_nan=False)


def tests_section(contests: Sequence[Contest]) -> PageSection:
    """Return the part of the page about the tests, and what is shipped of each."""
    fits = {one.name: one.fits[one.chosen] for one in contests}
    origins = [fit.provenance for fit in fits.values()]
    table = pd.DataFrame(
        {
            "test": list(fits),
            "material": [fit.experiment.material for fit in fits.values()],
            "law": [one.chosen for one in contests],
            "sampled_well": [fit.sampled_well.value for fit in fits.values()],
            "describes_data": [fit.describes_data.value for fit in fits.values()],
            "source": [origin.source for origin in origins],
            "doi": [origin.doi or "" for origin in origins],
            "licence": [origin.licence or "not stated" for origin in origins],
        }
    )
    answers = shown_verdicts(table)
    shown = {**table[["test", "law"]], **answers, **table[["source", "doi", "licence"]]}
    return PageSection(
        key="tests",
        title="Tests and the laws that are shipped",
        paragraphs=(
            "The law of a test predicts left-out readings best among the laws that describe the "
            "data. If no law describes the data, it is the best of those that were sampled well.",
        ),
        details=(
            "data/collection/NAME.json has parameters with covariance and draws; "
            'pyburgers.collection("NAME") reads it.',
        ),
        tables=(
            PageTable(
                "tests",
                "Tests",
                pd.DataFrame(shown),
                table,
                words=("test", "law", *answers, "doi", "licence"),
                sentences=("source",),
                bad=bad_verdicts(table),
            ),
        ),
    )


def write_page(
    contests: Sequence[Contest], missing: Mapping[str, str], out: Path, command: str
) -> Path:
    """Write the page with the league; both verdicts on every fit stand at its top."""
    section = league_section(contests, missing)
    return pyburgers.write_report(
        [],
        out,
        title="An open collection of fitted rocks",
        command=command,
        extras=[tests_section(contests), section],
        told={section.key: [fit for one in contests for fit in one.fits.values()]},
    )


def main(arguments: Sequence[str] | None = None) -> None:
    """Fit what is missing, then write the records, the page and the draws of two posteriors."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("collection"), help="folder of the runs")
    parser.add_argument("--records", type=Path, default=DATA / "collection", metavar="DIR")
    parser.add_argument("--page", type=Path, default=Path(__file__).parent / "collection")
    parser.add_argument("--draws", type=int, default=OPTIONS.draws, help="of each chain")
    parser.add_argument(
        "--finished", action="store_true", help="fit nothing: show the fits that are complete"
    )
    options = parser.parse_args(arguments)
    tell_progress()
    command, runs = COMMAND, options.out / "runs"
    if options.draws != OPTIONS.draws:
        command += f" --draws {options.draws}"
    settings = replace(OPTIONS, draws=options.draws)
    # The first law of each test, then the second: laws that take long come last.
    rounds = zip_longest(*(runs_of(name, settings).items() for name in ROCKS))
    tasks = dict(one for some in rounds for one in some if one is not None)
    if options.finished:
        done = [run for run in tasks if (runs / run / "checks.json").is_file()]
        fits = {run: Fit.load(runs / run) for run in done}
        missing = {run: "it is not complete" for run in tasks if run not in fits}
    else:
        fits, missing = fit_all(tasks, runs, command)
    contests = contests_of(fits)
    write_records(contests, options.records, command)
    print(write_page(contests, missing, options.out / "page", command))
    for name in (
        "index.html",
        "manifest.json",
        "tables/league_laws.csv",
        "figures/league_laws.csv",
    ):
        (options.page / name).parent.mkdir(parents=True, exist_ok=True)
        shutil.copy(options.out / "page" / name, options.page / name)
    for contest in contests:
        if contest.name in POSTERIORS:
            write_posterior(contest.fits[contest.chosen], contest.name, options.out / "posteriordb")


if __name__ == "__main__":
    main()
