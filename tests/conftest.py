"""Fixtures shared by all tests: compiled programs, values of Stan functions, small problems.

Fits that several modules look at are made once, whatever the number of processes that run tests.
"""

import gc
import logging
import os

# Tests run side by side on all cores, where threads of linear algebra wait for each other in loops.
os.environ.setdefault("OPENBLAS_NUM_THREADS", "1")

import shutil
import signal
from collections.abc import Callable, Iterator, Mapping
from concurrent.futures import ThreadPoolExecutor
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType
from typing import Any
from weakref import WeakSet

import filelock
import matplotlib as mpl
import numpy as np
import numpy.typing as npt
import pytest
from independent_table import TRUTHS
from matplotlib import pyplot as plt
from matplotlib.figure import Figure
from refusals import CommandLine
from truth_as_mode import at_truth

from pyburgers.cmdstan.compilation import compile_program
from pyburgers.cmdstan.program import load_program
from pyburgers.cmdstan.toolchain import stan_directory
from pyburgers.common.processes import cores
from pyburgers.common.tasks import Workers
from pyburgers.comparison.by_tests import fit_without_tests
from pyburgers.fitting.fit import Fit, fit
from pyburgers.flow_law_tables.fit import RateFit
from pyburgers.flow_law_tables.fit_rates import fit_rates
from pyburgers.flow_law_tables.table_files import load_rate_table
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.constant_rate.likelihood import ConstantRateValley
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forward import simulate_data
from pyburgers.kinds.kind import save_experiment
from pyburgers.kinds.likelihood import likelihoods
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.kinds.valley import ValleyReference
from pyburgers.model.prior_families import Prior
from pyburgers.model.priors import PriorSet, default_priors, load_priors, save_priors
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory

# Commands that tests send signals to inherit them ignored where the runner was started beside a
# script, or without a terminal.
for number, handler in (
    (signal.SIGINT, signal.default_int_handler),
    (signal.SIGHUP, signal.SIG_DFL),
):
    if signal.getsignal(number) is signal.SIG_IGN:
        signal.signal(number, handler)

FloatArray = npt.NDArray[np.float64]
FunctionValues = Callable[[str, Mapping[str, object]], dict[str, FloatArray]]

TESTS = Path(__file__).parent
ICE = TESTS.parent / "data" / "ice"

DUNITE = TESTS.parent / "data" / "dunite"

SMALL_RUN = SamplerOptions(chains=2, warmup=150, draws=100, seed=11, adapt_delta=0.8)
"""With longer steps than by default: three parameters need no more."""

LONG_RUN = replace(SMALL_RUN, warmup=300, draws=800)
"""Long enough to pass all checks."""


TABLE_RUN = SamplerOptions(chains=2, warmup=400, draws=1000, seed=3)
"""Of a table of rates, whose gradient costs microseconds; long enough for all checks."""

POOL = {"stress_noise": "separate"}
"""How the tests of `joint` differ."""


LONGEST_FILES = (
    "contract.py",
    "test_study.py",
    "test_fast_solver.py",
    "test_baseline.py",
    "test_rates.py",
    "test_examples_of_names.py",
    "test_leave_one_test_out.py",
    "test_environment.py",
    "test_exports.py",
    "test_valley_steps.py",
    "test_calibration_run.py",
    "test_report.py",
    "test_fit_rates.py",
    "test_coordinates.py",
    "test_figures.py",
)
"""Those that take more than 15 s; a file runs in one process. Neighbours do not wait for each
other's fits."""


def pytest_collection_modifyitems(items: list[pytest.Item]) -> None:
    """Put the longest files first, so that none of them is left to one process at the end."""
    place = {name: k for k, name in enumerate(LONGEST_FILES)}
    items.sort(key=lambda item: place.get(item.path.name, len(place)))


def pytest_collection_finish() -> None:
    """Spare the garbage collector modules and tests, which stay: an eighth of the time of pages."""
    gc.freeze()


@dataclass(frozen=True)
class Problem:
    """Input files of a fit that takes seconds."""

    experiment_file: Path
    priors_file: Path

    @property
    def experiment(self) -> ConstantRateExperiment:
        return load_constant_rate(self.experiment_file)

    @property
    def priors(self) -> PriorSet:
        return load_priors(self.priors_file)

    def fit(self, out: Path, options: SamplerOptions = SMALL_RUN, **others: Any) -> Fit:
        """Fit the test of the files."""
        return fit(self.experiment, self.priors, out=out, options=options, **others)


def fixed(name: str, value: float) -> Prior:
    """Prior of a parameter that is not inferred."""
    return Prior(name, "fixed", value, 0.0, -np.inf, np.inf, "SI", "test")


def with_priors(priors: PriorSet, changed: Mapping[str, Prior]) -> PriorSet:
    """Exchange some priors of a set."""
    return replace(priors, priors=MappingProxyType({**priors.priors, **changed}))


def with_fixed(priors: PriorSet, values: Mapping[str, float]) -> PriorSet:
    """Fix some parameters of a set of priors."""
    return with_priors(priors, {name: fixed(name, value) for name, value in values.items()})


def resolved_priors(experiment: Experiment) -> PriorSet:
    """Priors of the experiment's material, as a fit of it resolves them."""
    priors = default_priors(experiment.material, experiment.protocol)
    return priors.resolved(float(experiment.largest_stress))


def write_problem(folder: Path, *, free: set[str], max_strain: float, stride: int) -> Problem:
    """Write the first part of a test, thinned, with all but a few parameters fixed at the truth.

    Strains and rate are those of PIL40; of the material, elements and flow law show in that part.
    """
    full = simulate_data(
        load_constant_rate(ICE / "PIL40.toml"),
        TRUTHS["fast"],
        np.random.default_rng(40),
        source="a small problem",
    )
    kept = np.flatnonzero(full.strain <= max_strain)[::stride]
    experiment = replace(
        full, strain=full.strain[kept], stress=full.stress[kept], final_strain=max_strain
    )
    known = {name: value for name, value in TRUTHS["fast"].items() if name not in free}
    folder.mkdir()
    experiment_file = save_experiment(experiment, folder)
    save_priors(with_fixed(default_priors("ice"), known), folder / "priors.toml")
    return Problem(experiment_file, folder / "priors.toml")


def pair_of(problem: Problem) -> list[ConstantRateExperiment]:
    """The small test, and another of the same material whose residuals are mirrored."""
    first = problem.experiment
    smooth = np.poly1d(np.polyfit(first.strain, first.stress, 6))(first.strain)
    return [first, replace(first, id="other", stress=2 * smooth - first.stress)]


def valley_of(experiment: ConstantRateExperiment, priors: PriorSet) -> ValleyReference:
    """Reference of the valley coordinates as a fit sets it up at its mode, save one part.

    The noise exponents are made up, so that only that of the noise itself (the last) is 0.
    """
    test = at_truth(experiment, priors, SolverOptions())
    valley, _ = ConstantRateValley().reference(test)
    return replace(valley, noise_exponent=np.linspace(0.9, 0.0, test.mode.coordinate.size))


OF_OTHERS = {"PYTEST_CURRENT_TEST", "HDF5_PLUGIN_PATH"}
"""Variables that pytest and the import of netCDF4 set."""


def surroundings() -> dict[str, object]:
    """Return what tests of one process share: variables, folder, messages, figures and styles."""
    variables = {name: own for name, own in os.environ.items() if name not in OF_OTHERS}
    return {
        "variables": variables,
        "folder": Path.cwd(),
        "handlers": tuple(logging.getLogger("pyburgers").handlers),
        "figures": tuple(plt.get_fignums()),
        "styles": {name: own for name, own in dict.items(mpl.rcParams) if name != "backend"},
    }


@pytest.fixture(autouse=True)
def same_surroundings() -> Iterator[None]:
    """Undo the level of messages that a script sets, and fail a test that leaves more changed."""
    package = logging.getLogger("pyburgers")
    level, before = package.level, surroundings()
    yield
    package.setLevel(level)
    assert surroundings() == before


@pytest.fixture
def cli(capsys: pytest.CaptureFixture[str]) -> CommandLine:
    """The command line, in this process."""
    return CommandLine(capsys)


@pytest.fixture(scope="session")
def programs() -> None:
    """Compile what the tests need, side by side."""
    sources = [
        *(likelihood.program for likelihood in likelihoods().values()),
        *(
            stan_directory() / f"{name}.stan"
            for name in ("imposed_stress", "stress_cycles", "peaks", "rates")
        ),
        *sorted((TESTS / "stan").glob("*.stan")),
    ]
    with ThreadPoolExecutor(cores()) as pool:
        list(pool.map(compile_program, sources))


@pytest.fixture
def function_values(programs: None) -> FunctionValues:
    """Run a program without parameters from tests/stan once; arrays of what it generates."""

    def values(program: str, data: Mapping[str, object]) -> dict[str, FloatArray]:
        return load_program(TESTS / "stan" / f"{program}.stan").evaluate(data)

    return values


def sketch_pictures(patch: pytest.MonkeyPatch, *, drawn_once: bool = False) -> None:
    """Leave the figures of a page undrawn, or draw each once and coarsely.

    Layout and rendering are most of the work of a page.
    """
    drawn: WeakSet[Figure] = WeakSet()

    def sketch(figure: Figure, kind: str) -> bytes:
        if kind == "png":
            return b"\x89PNG"
        if drawn_once and figure not in drawn:  # it comes again for the file beside the page
            figure.set_layout_engine(None)
            figure.draw_without_rendering()
            drawn.add(figure)
        return b'<svg viewBox="0 0 576 432"></svg>'

    patch.setattr("pyburgers.drawing.style.image", sketch)


def search_little(patch: pytest.MonkeyPatch) -> None:
    """Search for a mode from one start: for fits that are looked at for something else."""
    for name, number in (("N_CANDIDATES", 4), ("N_BEST", 1), ("QUIETER", ())):
        patch.setattr(f"pyburgers.fitting.charts_at_modes.{name}", number)


@pytest.fixture
def little_search(monkeypatch: pytest.MonkeyPatch) -> None:
    """`search_little`, for one test."""
    search_little(monkeypatch)


@pytest.fixture
def sketched(monkeypatch: pytest.MonkeyPatch) -> None:
    """`sketch_pictures`, for tests of what else a page holds."""
    sketch_pictures(monkeypatch)


@pytest.fixture(scope="session")
def small_problem(programs: None, tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """Three parameters and a short curve: a fit takes a second or two."""
    return write_problem(
        tmp_path_factory.mktemp("small") / "inputs",
        free={"maxwell_modulus", "activation_enthalpy", "stress_noise"},
        max_strain=0.02,
        stride=2,
    )


@dataclass(frozen=True)
class SharedRuns:
    """Run directories that one process of a test run fills and all of them read."""

    folder: Path

    def finished(self, name: str, make: Callable[[Path], object]) -> Fit:
        """Load a run, which `once` made."""
        return Fit.load(self.once(name, make))

    def once(self, name: str, make: Callable[[Path], object]) -> Path:
        """Find a run; the first process that asks for it makes it while others wait."""
        run = self.folder / name / "run"
        with filelock.FileLock(self.folder / f"{name}.lock"):
            if not run.is_dir():
                made = self.folder / name / "unfinished"
                make(made)
                made.rename(run)
        return run


@pytest.fixture(scope="session")
def shared_runs(programs: None, tmp_path_factory: pytest.TempPathFactory) -> SharedRuns:
    folder = tmp_path_factory.getbasetemp()
    if "PYTEST_XDIST_WORKER" in os.environ:
        folder = folder.parent  # that of the whole test run, not of one of its processes
    return SharedRuns(folder)


@pytest.fixture(scope="session")
def small_fit(shared_runs: SharedRuns, small_problem: Problem) -> Fit:
    """Finished fit of the small problem; not to be changed (copy its folder instead)."""
    return shared_runs.finished("small_fit", small_problem.fit)


@pytest.fixture(scope="session")
def other_fit(shared_runs: SharedRuns, small_problem: Problem) -> Fit:
    """Finished fit of the other test of `pair_of` with another seed; not to be changed."""

    def make(out: Path) -> Fit:
        _, other = pair_of(small_problem)
        return fit(other, small_problem.priors, out=out, options=replace(SMALL_RUN, seed=5))

    return shared_runs.finished("other_fit", make)


@pytest.fixture(scope="session")
def long_fit(shared_runs: SharedRuns, small_problem: Problem) -> Fit:
    """Finished fit of the small problem that passes all checks; not to be changed."""
    return shared_runs.finished("long_fit", lambda out: small_problem.fit(out, LONG_RUN))


@pytest.fixture(scope="session")
def creep(shared_runs: SharedRuns) -> RateFit:
    """Fit the measured rates of Fan and others by a power law."""

    def make(out: Path) -> RateFit:
        table = load_rate_table(ICE / "rates" / "fan_2020.toml")
        return fit_rates(table, out=out, options=TABLE_RUN)

    return RateFit.load(shared_runs.once("creep", make))


@pytest.fixture(scope="session")
def peaks(shared_runs: SharedRuns) -> RateFit:
    """Finished fit of published peak stresses, softened; passes all checks, not to be changed."""

    def make(out: Path) -> RateFit:
        table = load_rate_table(ICE / "rates" / "qi_goldsby_2021.toml")
        return fit_rates(table, out=out, curve=default_priors("ice"), options=TABLE_RUN)

    return RateFit.load(shared_runs.once("peaks", make))


def stay_in_this_process(patch: pytest.MonkeyPatch) -> None:
    """Do tasks one after the other here: a process of their own imports for two seconds."""
    patch.setattr("pyburgers.common.tasks._own_processes", lambda number: ThreadPoolExecutor(1))


@pytest.fixture
def in_this_process(monkeypatch: pytest.MonkeyPatch) -> None:
    """Do tasks one after the other in this process."""
    stay_in_this_process(monkeypatch)


@pytest.fixture(scope="session")
def joint(shared_runs: SharedRuns, small_problem: Problem) -> Fit:
    """Finished fit of `pair_of` the small problem, which share the material but not the noise.

    Fits without each test are in it. Not to be changed (use `copy_of`).
    """
    return shared_runs.finished("joint", lambda out: fit_pair(small_problem, POOL, out))


@pytest.fixture(scope="session")
def separate_joint(shared_runs: SharedRuns, small_problem: Problem) -> Fit:
    """Like `joint`, of tests that share nothing."""
    return shared_runs.finished(
        "separate_joint", lambda out: fit_pair(small_problem, {"all": "separate"}, out)
    )


def fit_pair(problem: Problem, pool: Mapping[str, str], out: Path) -> None:
    """Fit the small test and the other one together, then without each."""
    joint = fit(pair_of(problem), problem.priors, pool=pool, out=out, options=SMALL_RUN)
    with pytest.MonkeyPatch.context() as patch:
        stay_in_this_process(patch)
        fit_without_tests({"joint": joint}, workers=Workers(), command="test")


def copy_of(fit: Fit, out: Path, *, without: str = "") -> Fit:
    """Copy a fit with its files, without the files and folders of one name; read nothing again."""
    shutil.copytree(fit.directory.path, out, ignore=shutil.ignore_patterns(".*", without))
    return replace(fit, directory=RunDirectory(out))
