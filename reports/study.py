"""The whole study in one call: fits of the shipped experiments and the page about them.

    python reports/study.py --main --out report
    python reports/study.py --preset paper --out report

The page is there after the first fit and is written again after each; what is about several fits
comes last. The same command continues where a call stopped.
"""

import argparse
import logging
import shlex
import sys
from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from pathlib import Path
from typing import Literal, cast

from common import DATA, tell_progress
from dunite import JOINT_RUN, ONE_RATE, STEPPED, dunite_tasks, rate_steps_section
from dunite_predictions import predicted_tests, predictions_section
from growing_page import GrowingPage
from halite import QUICK as HALITE_RUNS
from halite import halite_section, halite_tasks
from maor.sections import ice_attenuation_section, study_sections
from olivine_spectra import run_name, spectra_section, spectra_tasks

import pyburgers
from pyburgers import Fit, PageSection, RateFit, SamplerOptions, Task, fit_rates, fit_side_by_side

logger = logging.getLogger("pyburgers.study")

PRESETS: Mapping[str, SamplerOptions] = {
    "quick": SamplerOptions(chains=4, warmup=200, draws=500, seed=1),
    "paper": SamplerOptions(chains=5, warmup=500, draws=3000, seed=1),
}
"""Sampler settings: `paper` has the chains and draws of the paper's Methods. Oscillating tests
and spectra warm up as long as their kind needs."""

MAX_MINUTES = 10.0
"""Minutes of sampling of a fit: the draws of the quick preset just do for most fits."""

ICE_TWINS = ("PIL40", "PIL72", "PIL105")

OLIVINE_RUNS: Mapping[Literal["kept", "removed"], str] = {
    "kept": "olivine_kept",
    "removed": "olivine_removed",
}
"""Names of the fits of the olivine record by treatment of its background, the paper's last."""

COMBINED_TWIN, COMBINED_RUN = "PIL40", "PIL40_with_peak_stress"
"""Test that is fitted once more with the flow law of the peak stresses as prior, and that fit,
which is compared by standard deviations alone and therefore short under every preset."""

ICE_TABLES, ICE_RATES = ("fan_2020", "qi_2017", "qi_goldsby_2021"), "measured_ice"
"""Tables of measured rates of ice that creeps by dislocations, and the fit of their power law."""

PEAK_STRESS_TABLE = "qi_goldsby_2021"
HANDED_ON_RUN = f"{PEAK_STRESS_TABLE}_handed_on"
"""Fit of the same table without that test, whose flow law that test gets."""

MAIN = (ONE_RATE, "PIL40", OLIVINE_RUNS["kept"])
"""Fits of the main part, as they begin: measured rock, then ice, whose attenuation is predicted
while the last fit runs. The treatment of the olivine record is that of its file; with the
background removed, as in the paper, the fit takes three times as long."""

QUICK_DRAWS = {OLIVINE_RUNS["kept"]: 300}
"""Draws of each chain of the quick preset for fits that need fewer: with 500 draws a chain, every
quantity of this one has 1180 independent draws, and 400 are wanted."""

LONGEST_FIRST = (
    JOINT_RUN,
    "olivine_removed",
    *STEPPED,
    *HALITE_RUNS,
    "PIL40",
    "PIL72",
    COMBINED_RUN,
    "PIL105",
    "olivine_kept",
    run_name("band"),
    run_name("band", without_hottest=True),
    ONE_RATE,
    run_name("one element"),
    run_name("one element", without_hottest=True),
)
"""Order in which the fits begin, so that none is left over for one core at the end."""


ALL_HERE = pyburgers.Workers()


@dataclass(frozen=True)
class Study:
    """What a call does.

    `preset`: a key of `PRESETS`.
    `out`: folder of the page; the runs go into its subfolder ``runs``, where a call for the whole
        study finds those of its main part.
    `command`: regenerates the page, for the manifests.
    `measured`: points to draw over the spectra of ice, such as those of the paper's Fig. 6, which
        are not public.
    """

    preset: str
    out: Path
    command: str
    workers: pyburgers.Workers = ALL_HERE
    measured: pyburgers.MeasuredAttenuation | None = None

    @property
    def runs(self) -> Path:
        """Folder of the runs."""
        return self.out / "runs" / self.preset

    def page(
        self, materials: str, tasks: Mapping[str, Task], shown: Sequence[str], at_the_end: str
    ) -> GrowingPage:
        """Return the page, which names what is still to come."""
        title = f"Nonlinear Burgers fits of {materials} ({self.preset} preset)"
        tests = {name: task.problem.name for name, task in tasks.items()}
        return GrowingPage(self.out, title, self.command, tests, shown, at_the_end)

    def fit_all(
        self,
        tasks: Mapping[str, Task],
        after: Callable[[str, Fit], None] = lambda _name, _fit: None,
    ) -> dict[str, Fit]:
        """Do fits in their order; `after` receives each when it is done."""
        begun = {
            name: replace(task, options=replace(task.options, max_minutes=MAX_MINUTES))
            for name, task in tasks.items()
        }
        return fit_side_by_side(
            begun, self.runs, workers=self.workers, command=self.command, after=after
        )

    def fit_measured_ice(self) -> tuple[PageSection, RateFit]:
        """Fit a power law to measured rates of ice; return its part of the page, which is first."""
        logger.info(f"Fitting measured rates of ice: {', '.join(ICE_TABLES)}.")
        tables = [
            pyburgers.load_rate_table(DATA / "ice" / "rates" / f"{name}.toml")
            for name in ICE_TABLES
        ]
        fit = fit_rates(tables, out=self.runs / ICE_RATES, command=self.command)
        return replace(pyburgers.rate_section(fit, ICE_RATES), after_fits=False), fit

    def fit_peak_stresses(self) -> tuple[RateFit, RateFit]:
        """Fit all measured peak stresses, and those whose flow law is handed on."""
        found = []
        curve = pyburgers.priors("ice")
        for name, (data, law) in peak_stress_problems().items():
            about = f"{data.n_rows} measured peak stresses: {law.priors.title}"
            logger.info(f"Fitting the flow law of {about}.")
            out = self.runs / name
            found.append(fit_rates(data, law, curve=curve, out=out, command=self.command))
        everything, handed_on = found
        return everything, handed_on


def study_experiments() -> dict[str, pyburgers.Experiment]:
    """Read the shipped twins of the paper's tests, by the names of their runs."""
    ice = {name: pyburgers.load_experiment(DATA / "ice" / f"{name}.toml") for name in ICE_TWINS}
    record = cast(
        pyburgers.OscillationExperiment,
        pyburgers.load_experiment(DATA / "olivine" / "olivine_twin.toml"),
    )
    olivine = {
        name: replace(pyburgers.with_background(record, background), id=name)
        for background, name in OLIVINE_RUNS.items()
    }
    return {**ice, **olivine}


def twin_tasks(preset: str) -> dict[str, Task]:
    """Return the fits of the twins, by the names of their runs, in the order of the page."""
    options = PRESETS[preset]
    settled = replace(options, warmup=None)
    fewer = QUICK_DRAWS if preset == "quick" else {}
    return {
        name: pyburgers.task_of(
            [one],
            pyburgers.priors(one.material),
            replace(
                options if name in ICE_TWINS else settled, draws=fewer.get(name, options.draws)
            ),
        )
        for name, one in study_experiments().items()
    }


def main_part(study: Study) -> Path:
    """Fit measured ice and the tests of `MAIN`, predict attenuation of ice, return the page."""
    every = {**twin_tasks(study.preset), **dunite_tasks(PRESETS[study.preset])}
    tasks = {name: every[name] for name in MAIN}
    page = study.page("dunite, ice and olivine", tasks, MAIN, "the attenuation of ice")
    of_ice, rates = study.fit_measured_ice()
    page.extras, page.told = [of_ice], {of_ice.key: [rates]}

    def add(name: str, fit: Fit) -> None:
        if name in ICE_TWINS:
            logger.info("Predicting attenuation.")
            page.extras = [of_ice, ice_attenuation_section({name: fit}, study.measured)]
            page.at_the_end = ""
        page.add(name, fit)

    study.fit_all(tasks, add)
    return page.file


def whole_study(study: Study) -> Path:
    """Do all fits, show what several of them say together, and return the page.

    The page has measured rates of ice, then the fits, those of measured dunite first and with them
    which law describes steps of the strain rate and what two tests predict of others, measured
    attenuation of olivine and what two laws make of it, measured creep of rock salt and where each
    law misses it, attenuation as the ice fits predict it, what the treatment of the olivine record
    changes, the paper's statements, the flow law of measured peak stresses, and what that adds to
    one of the curves.
    """
    of_ice, rates = study.fit_measured_ice()
    peak_stress, handed_on = study.fit_peak_stresses()
    twins = {**twin_tasks(study.preset), COMBINED_RUN: combined_task(handed_on)}
    dunite, spectra, halite = _measured_tasks(study.preset)
    every = {**twins, **dunite, **spectra, **halite}
    tasks = {name: every[name] for name in LONGEST_FIRST}
    page = study.page(
        "dunite, olivine, halite and ice",
        tasks,
        [name for name in (*dunite, *twins) if name != JOINT_RUN],
        "what several fits say together",
    )
    found = study.fit_all(tasks, page.add)
    joint = found[JOINT_RUN]
    alone = [found[name] for name in dunite if name != JOINT_RUN]
    fits = [*alone, *joint.tests().values(), *(found[name] for name in twins)]
    of_spectra = spectra_section({name: found[name] for name in spectra})
    of_halite = halite_section({name: found[name] for name in halite})
    of_peaks = pyburgers.rate_section(peak_stress)
    return page.write(
        fits,
        joints=[joint],
        extras=(
            of_ice,
            rate_steps_section({name: found[name] for name in STEPPED}),
            predictions_section(joint, predicted_tests()),
            of_spectra,
            of_halite,
            *pyburgers.joint_sections([joint], alone),
            *study_sections(
                {name: found[name] for name in ICE_TWINS},
                {background: found[name] for background, name in OLIVINE_RUNS.items()},
                study.measured,
            ),
            of_peaks,
            *pyburgers.comparison_sections([joint, *fits]),
        ),
        told={
            of_ice.key: [rates],
            of_spectra.key: [found[name] for name in spectra],
            of_halite.key: [found[name] for name in halite],
            of_peaks.key: [peak_stress, handed_on],
        },
        jobs=None,
    )


def fit_part(study: Study) -> None:
    """Do a part of the fits of the whole study, which a call without ``--part`` then finds.

    The first part also does the fits of peak stresses, and the one that needs them.
    """
    dunite, spectra, halite = _measured_tasks(study.preset)
    tasks = {**twin_tasks(study.preset), **dunite, **spectra, **halite}
    mine = study.workers.mine({name: tasks[name] for name in LONGEST_FIRST if name in tasks})
    if study.workers.part is None or study.workers.part[0] == 1:
        _, handed_on = study.fit_peak_stresses()
        mine[COMBINED_RUN] = combined_task(handed_on)
    replace(study, workers=replace(study.workers, part=None)).fit_all(mine)


def _measured_tasks(preset: str) -> tuple[dict[str, Task], dict[str, Task], dict[str, Task]]:
    """Return the fits of measured dunite, spectra and rock salt, by the names of their runs."""
    options, halite = PRESETS[preset], halite_tasks()
    quick = {name: halite[name] for name in HALITE_RUNS}
    return dunite_tasks(options), spectra_tasks(options), quick


def peak_stress_problems() -> dict[str, tuple[pyburgers.RateTable, pyburgers.RateLaw]]:
    """Tables and laws of the two fits, by the names of their runs: the second is handed on.

    It has the priors of the curve that gets it, and not the row that may be this curve itself.
    """
    table = pyburgers.load_rate_table(DATA / "ice" / "rates" / f"{PEAK_STRESS_TABLE}.toml")
    others = pyburgers.without_test(
        table, pyburgers.load_experiment(DATA / "ice" / f"{COMBINED_TWIN}.toml")
    )
    weak = pyburgers.rate_law("ice_flow_law")
    return {
        PEAK_STRESS_TABLE: (table, weak),
        HANDED_ON_RUN: (others, pyburgers.with_curve_flow_law(weak, pyburgers.priors("ice"))),
    }


def combined_task(handed_on: RateFit) -> Task:
    """Return the fit of one of the curves that gets its flow law from peak stresses."""
    twin = study_experiments()[COMBINED_TWIN]
    priors = pyburgers.with_flow_law(
        pyburgers.priors(twin.material), pyburgers.flow_law_prior(handed_on), HANDED_ON_RUN
    )
    return pyburgers.task_of([replace(twin, id=COMBINED_RUN)], priors, PRESETS["quick"])


def part_of(text: str) -> tuple[int, int]:
    """Parse one part of several, such as 1/8."""
    which, _, number = text.partition("/")
    if not (which.isdecimal() and number.isdecimal()):
        raise argparse.ArgumentTypeError(f"found {text!r}, expected I/N such as 1/8")
    return int(which), int(number)


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line; return its exit code: 0 done, 2 bad input, 1 another error."""
    parser = argparse.ArgumentParser(description=(__doc__ or "").splitlines()[0])
    parser.add_argument(
        "--preset", choices=sorted(PRESETS), default="quick", help="how long chains are"
    )
    parser.add_argument(
        "--out", type=Path, default=Path("report"), metavar="DIR", help="folder of page and runs"
    )
    parser.add_argument(
        "--main",
        action="store_true",
        help="only the main part: measured rates of ice, a test of measured dunite, one curve "
        "of ice, the olivine oscillation, and the attenuation of ice",
    )
    parser.add_argument(
        "--measured",
        type=Path,
        metavar="POINTS.csv",
        help="measured attenuation of ice to draw over the predicted: columns frequency_Hz, "
        "tan_delta and, if you like, tan_delta_sd and series",
    )
    parser.add_argument("--jobs", type=int, metavar="N", help="fits at the same time")
    parser.add_argument(
        "--part",
        type=part_of,
        metavar="I/N",
        help="do the I-th of N parts of the fits of the whole study and nothing else, such as in a "
        "job array; the same command without it then gathers the results",
    )
    options = parser.parse_args(arguments)
    if options.main and options.part is not None:
        parser.error("--part is for the whole study; leave out --part or --main.")
    tell_progress()
    typed = sys.argv if arguments is None else ["reports/study.py", *arguments]
    try:
        measured = options.measured and pyburgers.load_measured_attenuation(options.measured)
        workers = pyburgers.Workers(jobs=options.jobs, part=options.part)
        study = Study(
            options.preset, options.out, shlex.join(["python", *typed]), workers, measured
        )
        if options.part is not None:
            fit_part(study)
            print("The fits of part {}/{} are done.".format(*options.part))
        else:
            print(f"The page is {main_part(study) if options.main else whole_study(study)}")
    except pyburgers.PyburgersError as error:
        print(f"error: {error}", file=sys.stderr)
        return 2 if isinstance(error, pyburgers.InputError) else 1
    return 0


if __name__ == "__main__":
    sys.exit(main())
