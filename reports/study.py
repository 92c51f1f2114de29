"""The whole study in one call: fits of the shipped experiments and the page about them."""

import logging
from collections.abc import Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

from pyburgers.cmdstan.program import compile_programs
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.shipped_files import shipped_folder
from pyburgers.common.tasks import ALL_HERE, Workers
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.side_by_side import Task, fit_side_by_side, task_of
from pyburgers.flow_law_tables.fit import PeakStressFit, fit_peak_stress, flow_law_prior
from pyburgers.flow_law_tables.inputs import (
    PeakStressData,
    default_peak_stress_priors,
    load_peak_stress,
    with_curve_flow_law,
    without_test,
)
from pyburgers.model.priors import PriorSet, default_priors, with_flow_law
from pyburgers.predictions.attenuation import predict_attenuation
from pyburgers.predictions.measured_attenuation import MeasuredAttenuation
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.forced_oscillation.experiment import (
    load_forced_oscillation,
    with_background,
)
from pyburgers.protocols.forced_oscillation.preparation import Background
from pyburgers.protocols.protocol import load_experiment
from pyburgers.report.comparison_sections import comparison_sections
from pyburgers.report.joint_section import joint_sections
from pyburgers.report.page import GrowingPage
from pyburgers.report.peak_stress_section import PEAK_STRESS_KEY, peak_stress_section
from pyburgers.sampling.options import SamplerOptions
from pyburgers.studies.dunite import (
    JOINT_RUN,
    ONE_RATE,
    STEPPED,
    dunite_tasks,
    rate_steps_section,
)
from pyburgers.studies.dunite_predictions import predicted_tests, predictions_section
from pyburgers.studies.halite import QUICK as HALITE_RUNS
from pyburgers.studies.halite import halite_section, halite_tasks
from pyburgers.studies.maor.sections import attenuation_section, study_sections
from pyburgers.studies.olivine_spectra import run_name, spectra_section, spectra_tasks

logger = logging.getLogger(__name__)

PRESETS: Mapping[str, SamplerOptions] = MappingProxyType(
    {
        "quick": SamplerOptions(chains=4, warmup=200, draws=500, seed=1),
        "paper": SamplerOptions(chains=5, warmup=500, draws=3000, seed=1),
    }
)
"""Sampler settings: `paper` has the chains and draws of the paper's Methods. Oscillating tests
and spectra warm up as long as their protocol needs."""

EXTENSIONS = 1
"""How often the chains of a fit go on whose draws turn out too few: those of the quick preset just
do for most fits."""

PROGRAMS = ("peaks", "peak_stress", "imposed_stress")
"""Stan programs of the study other than those of the fits, which compile them themselves, each
while another one runs already."""

ICE_TWINS = ("PIL40", "PIL72", "PIL105")

OLIVINE_RUNS: Mapping[Background, str] = MappingProxyType(
    {"kept": "olivine_kept", "removed": "olivine_removed"}
)
"""Names of the fits of the olivine record by treatment of its background, the paper's last."""


COMBINED_TWIN, COMBINED_RUN = "PIL40", "PIL40_with_peak_stress"
"""Test that is fitted once more with the flow law of the peak stresses as prior, and that fit,
which is compared by standard deviations alone and therefore short under every preset."""

PEAK_STRESS_TABLE = "peak_stress_qi_goldsby_2021"
HANDED_ON_RUN = f"{PEAK_STRESS_TABLE}_handed_on"
"""Fit of the same table without that test, whose flow law that test gets."""


MAIN = (ONE_RATE, OLIVINE_RUNS["kept"], "PIL40")
"""Fits of the main part, as they begin: one of measured rock, which is sampled well in a minute and
describes its data, then the one that takes longest. The treatment of the olivine record is that of
its file; with the background removed, as in the paper, the fit takes three times as long."""

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


@dataclass(frozen=True, eq=False)
class Outcome:
    """What `reproduce` made.

    Attributes
    ----------
    page : Path
        The HTML page.
    fits : tuple of Fit
        The fits it shows, of single tests and of the tests of the joint fit.
    peak_stress : PeakStressFit or None
        The flow law that the page of the whole study shows.
    """

    page: Path
    fits: tuple[Fit, ...]
    peak_stress: PeakStressFit | None = None


def study_experiments() -> dict[str, Experiment]:
    """Read the shipped experiments of the study, by the names of their runs."""
    data = shipped_folder("data")
    ice = {name: load_experiment(data / "ice" / f"{name}.toml") for name in ICE_TWINS}
    record = load_forced_oscillation(data / "olivine" / "olivine_twin.toml")
    olivine = {
        name: replace(with_background(record, background), id=name)
        for background, name in OLIVINE_RUNS.items()
    }
    return {**ice, **olivine}


def reproduce(
    preset: str,
    out: Path,
    *,
    main: bool = False,
    workers: Workers = ALL_HERE,
    command: str,
    measured: MeasuredAttenuation | None = None,
) -> Outcome:
    """Fit the experiments of the study and write the page; continue where a call stopped.

    The page is there after the first fit and is written again after each; what is about several
    fits comes last. It has the fits, those of measured dunite first and with them which law
    describes steps of the strain rate and what two tests predict of others, measured attenuation of
    olivine and what two laws make of it, measured creep of rock salt and where each law misses it,
    attenuation as the ice fits predict it, what the treatment of the olivine record changes, the
    paper's statements, the flow law of measured peak stresses, and what that adds to one of the
    curves.

    Parameters
    ----------
    preset : str
        A key of `PRESETS`.
    out : Path
        Folder of the page; the runs go into its subfolder ``runs``, where a call for the whole
        study finds those of its main part.
    main : bool
        Whether only the fits of `MAIN` are done, and attenuation is predicted from that of ice.
    workers : Workers
        Who does the fits, all of them.
    command : str
        Command that regenerates the page, for the manifests.
    measured : MeasuredAttenuation, optional
        Points to draw over the spectra of ice, such as those of the paper's Fig. 6, which are not
        public.
    """
    do = _main_part if main else _whole_study
    return do(preset, out, workers, command, measured)


def _main_part(
    preset: str, out: Path, workers: Workers, command: str, measured: MeasuredAttenuation | None
) -> Outcome:
    """Fit one test of each kind of the study, and predict attenuation from the one of ice."""
    every = {**_problems(preset), **_measured_dunite(preset)}
    page = GrowingPage(
        out,
        f"Nonlinear Burgers fits of dunite, ice and olivine ({preset} preset)",
        command,
        names=MAIN,
        shown=MAIN,
        at_the_end="the attenuation of ice",
    )
    found = _fit_all({name: every[name] for name in MAIN}, page, _runs(out, preset), workers)
    ice = {name: found[name] for name in MAIN if name in ICE_TWINS}
    logger.info("Predicting attenuation.")
    spectra = {name: predict_attenuation(fit) for name, fit in ice.items()}
    fits = tuple(found.values())
    return Outcome(page.finish(fits, extras=[attenuation_section(ice, spectra, measured)]), fits)


def _whole_study(
    preset: str, out: Path, workers: Workers, command: str, measured: MeasuredAttenuation | None
) -> Outcome:
    """Do all fits, and show what several of them say together."""
    runs = _runs(out, preset)
    compile_programs([stan_directory() / f"{name}.stan" for name in PROGRAMS])
    peak_stress, handed_on = _fit_peak_stresses(runs, command)
    problems = {**_problems(preset), COMBINED_RUN: _combined(handed_on)}
    of_dunite, of_spectra = _measured_dunite(preset), _measured_spectra(preset)
    tasks = {**problems, **of_dunite, **of_spectra, **_measured_halite()}
    page = GrowingPage(
        out,
        f"Nonlinear Burgers fits of dunite, olivine, halite and ice ({preset} preset)",
        command,
        names=LONGEST_FIRST,
        shown=[name for name in (*of_dunite, *problems) if name != JOINT_RUN],
        at_the_end="what several fits say together",
    )
    found = _fit_all({name: tasks[name] for name in LONGEST_FIRST}, page, runs, workers)
    joint = found[JOINT_RUN]
    alone = {name: found[name] for name in of_dunite if name != JOINT_RUN}
    fits = [*alone.values(), *joint.tests().values(), *(found[name] for name in problems)]
    ice_fits = {name: found[name] for name in ICE_TWINS}
    olivine_fits: dict[str, Fit] = {
        background: found[name] for background, name in OLIVINE_RUNS.items()
    }
    spectra = spectra_section({name: found[name] for name in of_spectra})
    halite = halite_section({name: found[name] for name in HALITE_RUNS})
    written = page.finish(
        fits,
        joints=[joint],
        extras=(
            rate_steps_section({name: found[name] for name in STEPPED}),
            predictions_section(joint, predicted_tests(shipped_folder("data") / "dunite")),
            spectra,
            halite,
            *joint_sections([joint], list(alone.values())),
            *study_sections(ice_fits, olivine_fits, measured),
            peak_stress_section(peak_stress),
            *comparison_sections([joint, *fits]),
        ),
        told={
            spectra.key: [found[name] for name in of_spectra],
            halite.key: [found[name] for name in HALITE_RUNS],
            PEAK_STRESS_KEY: [peak_stress, handed_on],
        },
    )
    return Outcome(written, tuple(fits), peak_stress)


def _fit_all(
    tasks: Mapping[str, Task], page: GrowingPage, runs: Path, workers: Workers
) -> dict[str, Fit]:
    """Do fits in their order, and add each to the page when it is done."""
    begun = {name: replace(task, extensions=EXTENSIONS) for name, task in tasks.items()}
    return fit_side_by_side(begun, runs, workers=workers, command=page.command, after=page.add)


def fit_part(preset: str, out: Path, *, workers: Workers, command: str) -> None:
    """Do a part of the study's fits, which `reproduce` then finds.

    Parameters
    ----------
    preset, out, workers, command
        As for `reproduce`. The first part also does the fits of peak stresses, and the one that
        needs them.
    """
    runs = _runs(out, preset)
    tasks = {
        **_problems(preset),
        **_measured_dunite(preset),
        **_measured_spectra(preset),
        **_measured_halite(),
    }
    mine = workers.mine({name: tasks[name] for name in LONGEST_FIRST if name in tasks})
    if workers.part is None or workers.part[0] == 1:
        _, handed_on = _fit_peak_stresses(runs, command)
        mine[COMBINED_RUN] = _combined(handed_on)
    mine = {name: replace(task, extensions=EXTENSIONS) for name, task in mine.items()}
    fit_side_by_side(mine, runs, workers=replace(workers, part=None), command=command)


def _runs(out: Path, preset: str) -> Path:
    """Folder of the fits below that of the page."""
    return out / "runs" / preset


def _fit_peak_stresses(runs: Path, command: str) -> tuple[PeakStressFit, PeakStressFit]:
    """Fit all measured peak stresses, and those whose flow law is handed on."""
    everything, handed_on = (
        _fit_peak_stress(runs / name, data, priors, command=command)
        for name, (data, priors) in _peak_stress_problems().items()
    )
    return everything, handed_on


def _peak_stress_problems() -> dict[str, tuple[PeakStressData, PriorSet]]:
    """Tables and priors of the two fits, by the names of their runs: the second is handed on.

    It has the priors of the curve that gets it, and not the row that may be this curve itself.
    """
    folder = shipped_folder("data") / "ice"
    table = load_peak_stress(folder / f"{PEAK_STRESS_TABLE}.toml")
    others = without_test(table, load_experiment(folder / f"{COMBINED_TWIN}.toml"))
    weak = default_peak_stress_priors("ice")
    return {
        PEAK_STRESS_TABLE: (table, weak),
        HANDED_ON_RUN: (others, with_curve_flow_law(weak, default_priors("ice"))),
    }


def _fit_peak_stress(
    out: Path, data: PeakStressData, priors: PriorSet, *, command: str
) -> PeakStressFit:
    logger.info(f"Fitting the flow law of {data.n_points} measured peak stresses: {priors.title}.")
    return fit_peak_stress(data, priors, out=out, command=command)


def _problems(preset: str) -> dict[str, Task]:
    """Fits of the study's tests, by the names of their runs, in the order of the page."""
    return {
        name: task_of([one], default_priors(one.material), _options(preset, name))
        for name, one in study_experiments().items()
    }


def _measured_dunite(preset: str) -> dict[str, Task]:
    """Fits of measured dunite, by the names of their runs."""
    return dunite_tasks(shipped_folder("data") / "dunite", PRESETS[preset])


def _measured_spectra(preset: str) -> dict[str, Task]:
    """Fits of measured attenuation of olivine, by the names of their runs."""
    return spectra_tasks(shipped_folder("data") / "olivine", PRESETS[preset])


def _measured_halite() -> dict[str, Task]:
    """Fits of measured creep of rock salt, by the names of their runs."""
    tasks = halite_tasks(shipped_folder("data") / "halite")
    return {name: tasks[name] for name in HALITE_RUNS}


def _combined(handed_on: PeakStressFit) -> Task:
    """Fit of one of the curves that gets its flow law from peak stresses."""
    twin = study_experiments()[COMBINED_TWIN]
    priors = with_flow_law(default_priors(twin.material), flow_law_prior(handed_on), HANDED_ON_RUN)
    return task_of([replace(twin, id=COMBINED_RUN)], priors, PRESETS["quick"])


def _options(preset: str, name: str) -> SamplerOptions:
    options = PRESETS[preset]
    return options if name in ICE_TWINS else replace(options, warmup=None)
