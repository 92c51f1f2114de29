"""Fixtures shared by all tests: compiled programs, values of Stan functions, small problems."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, replace
from pathlib import Path
from types import MappingProxyType

import numpy as np
import numpy.typing as npt
import pytest

from pyburgers.cmdstan.program import compile_programs, load_program, stan_directory
from pyburgers.fitting.fit import Fit, fit
from pyburgers.model.priors import Prior, PriorSet, default_priors, load_priors, save_priors
from pyburgers.protocols.chart import Mode
from pyburgers.protocols.constant_rate.experiment import ConstantRateExperiment, load_constant_rate
from pyburgers.protocols.constant_rate.valley import find_valley
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.registry import protocol_of, save_experiment
from pyburgers.protocols.stan_data import SolverOptions, ValleyReference, program_data
from pyburgers.sampling.charts import ModeOfTest
from pyburgers.sampling.mode import find_mode
from pyburgers.sampling.options import SamplerOptions

FloatArray = npt.NDArray[np.float64]
FunctionValues = Callable[[str, Mapping[str, object]], dict[str, FloatArray]]

TESTS = Path(__file__).parent
ICE = TESTS.parent / "data" / "ice"

MEASURED = TESTS.parents[1] / "shared" / "data" / "chopra_paterson_1984_dunite"
needs_measured = pytest.mark.skipif(
    not MEASURED.is_dir(), reason="the measured columns are not in ../shared/data on this machine"
)

SMALL_RUN = SamplerOptions(chains=2, warmup=150, draws=100, seed=11)
LONG_RUN = replace(SMALL_RUN, warmup=300, draws=1200)
"""Long enough to pass all checks, and for a signal to hit the sampling."""


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
    return default_priors(experiment.material).resolved(float(experiment.largest_stress))


def write_problem(folder: Path, *, free: set[str], max_strain: float, stride: int) -> Problem:
    """Write the first part of PIL40, thinned, with all but a few parameters fixed at the truth."""
    full = load_constant_rate(ICE / "PIL40.toml")
    assert full.true_parameters is not None
    kept = np.flatnonzero(full.strain <= max_strain)[::stride]
    experiment = replace(
        full, strain=full.strain[kept], stress=full.stress[kept], final_strain=max_strain
    )
    known = {name: value for name, value in full.true_parameters.items() if name not in free}
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
    """Reference of the valley coordinates as a fit with seed 1 sets it up, save one part.

    The noise exponents are made up, so that only that of the noise itself (the last) is 0.
    """
    solver = SolverOptions()
    mode = find_mode(experiment, priors, seed=1, solver=solver)
    valley = find_valley(at_mode(experiment, priors, mode, solver))
    return replace(valley, noise_exponent=np.linspace(0.9, 0.0, mode.coordinate.size))


def at_mode(
    experiment: Experiment, priors: PriorSet, mode: Mode, solver: SolverOptions
) -> ModeOfTest:
    """A test at its mode, as charts are given it."""
    model = load_program(protocol_of(experiment).program)
    data = program_data(experiment, priors, solver=solver)
    return ModeOfTest(model, data, experiment, priors, mode, solver)


@pytest.fixture(scope="session")
def programs() -> None:
    """Compile what the tests need, side by side."""
    compile_programs(
        [
            *(
                stan_directory() / f"{name}.stan"
                for name in ("constant_rate", "forced_oscillation", "imposed_stress", "peak_stress")
            ),
            *sorted((stan_directory() / "reference").glob("*.stan")),
            *sorted((TESTS / "stan").glob("*.stan")),
        ]
    )


@pytest.fixture
def function_values(programs: None) -> FunctionValues:
    """Run a program without parameters from tests/stan once; arrays of what it generates."""

    def values(program: str, data: Mapping[str, object]) -> dict[str, FloatArray]:
        return load_program(TESTS / "stan" / f"{program}.stan").evaluate(data)

    return values


@pytest.fixture(scope="session")
def small_problem(tmp_path_factory: pytest.TempPathFactory) -> Problem:
    """Three parameters and a short curve: a fit takes a second or two."""
    return write_problem(
        tmp_path_factory.mktemp("small") / "inputs",
        free={"maxwell_modulus", "activation_enthalpy", "stress_noise"},
        max_strain=0.02,
        stride=2,
    )


@pytest.fixture(scope="session")
def small_fit(
    programs: None, small_problem: Problem, tmp_path_factory: pytest.TempPathFactory
) -> Fit:
    """Finished fit of the small problem; not to be changed (copy its folder instead)."""
    return fit(
        small_problem.experiment,
        small_problem.priors,
        out=tmp_path_factory.mktemp("fit") / "run",
        options=SMALL_RUN,
    )


@pytest.fixture(scope="session")
def long_fit(
    programs: None, small_problem: Problem, tmp_path_factory: pytest.TempPathFactory
) -> Fit:
    """Finished fit of the small problem that passes all checks; not to be changed."""
    return fit(
        small_problem.experiment,
        small_problem.priors,
        out=tmp_path_factory.mktemp("long_fit") / "run",
        options=LONG_RUN,
    )
