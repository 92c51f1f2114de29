"""The fast solver beside Stan's at random parameters of the priors, for every kind and law.

Flow rates are drawn about those of the tests: priors of Q_M and beta that do not know of each other
also have specimens that never flow. Readings are those of the parameters themselves, with noise.
"""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import partial
from pathlib import Path
from typing import Any

import numpy as np
import numpy.typing as npt
import pytest

from pyburgers import SolverOptions, load_experiment, load_priors, with_variant
from pyburgers.cmdstan.program import Density, Program, load_program
from pyburgers.common.array_types import FloatArray
from pyburgers.common.errors import SamplingError
from pyburgers.fitting.charts_at_modes import draw_priors
from pyburgers.kinds.problem import Problem, problem_of
from pyburgers.kinds.program_data import density_of, program_data
from pyburgers.kinds.stan_data import REFERENCE_SOLVER, StanData, solver_block
from pyburgers.model.arrhenius import GAS_CONSTANT
from pyburgers.model.parameters import PROGRAM_PARAMETERS

VALUES = Path(__file__).parent / "solver_values.stan"
REPOSITORY = Path(__file__).parents[2]
NAMES = [parameter.name for parameter in PROGRAM_PARAMETERS]

MAX_ERROR = 1e-3
"""Of a log density, and of a gradient over its norm."""

MAX_ABOVE = 0.02
"""Share of parameter sets with a larger error: thresholds that are reached, transients of 1e-9."""

MAX_ELEMENTS = 5
"""Of a Kelvin part, evenly spaced among all: each one more slows the tight solver much."""

MAX_HANDED_OVER = 0.01
"""Share of parameter sets that the fast solver leaves to Stan's."""


@dataclass(frozen=True)
class Case:
    """A test and the laws that it is solved with."""

    test: str
    priors: str
    variant: Mapping[str, str] = field(default_factory=dict)
    constants: Mapping[str, float] = field(default_factory=dict)

    @property
    def name(self) -> str:
        """Test, laws, and what is constant beside them."""
        return " ".join([Path(self.test).stem, *self.variant.values(), *self.constants])


ICE, DUNITE, HALITE = (f"data/priors/{name}.toml" for name in ("ice", "dunite", "halite"))
LAWS: tuple[Mapping[str, str], ...] = (
    {},
    {"kelvin": "power_law"},
    {"maxwell": "hyperbolic_sine"},
    {"maxwell": "threshold_stress"},
)
MANY_TIMES = ("two_elements", "extended", "andrade")
HARDENING = {"hardening": "backstress"}
DISLOCATIONS = {"hardening": "dislocations"}
# The first also says that there is a piezometer: at 5 MPa grains of 60 micrometres are wanted.
PIEZOMETER = {
    "piezometer_reference_grain_size": 5e-4,
    "piezometer_exponent": 1.3,
    "piezometer_stress_floor": 1e5,
}
COMPLIANT = {"apparatus_compliance": 5e-11}
MECHANISMS = tuple(
    {"second_mechanism": second, "third_mechanism": third}
    for second, third in (
        ("diffusion", "none"),
        ("in_series", "none"),
        ("power_law", "in_series"),
        ("in_series", "diffusion"),
    )
)
ICE_TESTS = ("ice/PIL40", "calibration/ice_creep", "calibration/ice_mixed")
# With an element of a time a millionth as long, the tight solver takes minutes for these.
FASTER_ELEMENT = {"peak_time_decades": 1.5}
CASES = (
    *(Case("data/ice/PIL40.toml", ICE, laws) for laws in LAWS),
    *(Case("data/dunite/dunite_4581.toml", DUNITE, laws) for laws in LAWS),
    *(Case("data/calibration/ice_creep.toml", ICE, laws) for laws in (*LAWS, HARDENING)),
    *(Case("data/calibration/ice_mixed.toml", ICE, laws) for laws in (*LAWS, HARDENING)),
    *(Case("data/halite/halite_z3.toml", HALITE, laws) for laws in ({}, HARDENING)),
    *(
        Case("data/calibration/ice_mixed.toml", ICE, {**HARDENING, **laws}, PIEZOMETER | COMPLIANT)
        for laws in LAWS
    ),
    Case("data/dunite/dunite_4581.toml", DUNITE, {"kelvin": "two_elements"}, FASTER_ELEMENT),
    *(Case("data/dunite/dunite_4581.toml", DUNITE, {"kelvin": law}) for law in MANY_TIMES[1:]),
    Case("data/calibration/ice_creep.toml", ICE, {"kelvin": "extended_peak"}),
    *(Case("data/calibration/ice_creep.toml", ICE, {"kelvin": law}) for law in MANY_TIMES),
    Case("data/halite/halite_z3.toml", HALITE, {"kelvin": "two_elements"}, FASTER_ELEMENT),
    *(Case("data/halite/halite_z3.toml", HALITE, {"kelvin": law}) for law in MANY_TIMES[1:]),
    *(Case(f"data/{test}.toml", ICE, laws) for test in ICE_TESTS for laws in MECHANISMS),
    *(
        Case(
            "data/calibration/ice_mixed.toml",
            ICE,
            {"kelvin": "two_elements", **laws},
            FASTER_ELEMENT | PIEZOMETER | COMPLIANT,
        )
        for laws in ({}, HARDENING)
    ),
    *(
        Case(
            "data/calibration/ice_mixed.toml",
            ICE,
            {**laws, **MECHANISMS[2], **HARDENING},
            PIEZOMETER | COMPLIANT,
        )
        for laws in LAWS
    ),
    *(
        Case(f"data/{test}.toml", ICE, DISLOCATIONS)
        for test in ("ice/PIL40", "calibration/ice_creep")
    ),
    *(
        Case(
            "data/calibration/ice_mixed.toml",
            ICE,
            {**laws, **MECHANISMS[2], **DISLOCATIONS},
            PIEZOMETER | COMPLIANT,
        )
        for laws in ({}, {"kelvin": "power_law", "maxwell": "hyperbolic_sine"})
    ),
    Case("data/ice/PIL40.toml", ICE, constants=PIEZOMETER),
    Case("data/calibration/ice_mixed.toml", ICE, constants=COMPLIANT),
    Case("data/calibration/ice_mixed.toml", ICE, {"kelvin": "power_law"}, PIEZOMETER | COMPLIANT),
    Case("data/halite/halite_z3.toml", HALITE, {"kelvin": "power_law"}, PIEZOMETER),
)


def values_data(case: Case, n_sets: int) -> StanData:
    """Return data of `solver_values.stan` without readings: a test, parameters drawn for it."""
    experiment = load_experiment(REPOSITORY / case.test)
    priors = with_variant(load_priors(REPOSITORY / case.priors), experiment, case.variant)
    problem = problem_of([experiment], priors)
    data = program_data(problem, solver=REFERENCE_SOLVER)
    drawn = parameters_about(problem, case.constants, n_sets)
    free = [k for k, name in enumerate(NAMES) if np.ptp(drawn[:, k]) > 0 and "noise" not in name]
    time = data["output_time_in_leg"]
    is_strain = np.repeat([leg[0] > 0 for leg in data["leg"]], data["n_outputs_in_leg"])
    elements = [data["element"][k] for k in some_places(data["n_elements"], MAX_ELEMENTS)]
    noise = [drawn[:, [NAMES.index(f"{name}_noise")]] for name in ("strain", "stress")]
    return {
        "n_sets": n_sets,
        "parameter": drawn,
        "n_free": len(free),
        "free": [k + 1 for k in free],
        # About a tenth of the priors' widths; Q_M has a coordinate of its own.
        "unit": [
            0.0 if NAMES[k] == "activation_enthalpy" else 0.1 * np.std(drawn[:, k]) for k in free
        ],
        "temperature": experiment.temperature,
        "initial_grain_size": experiment.initial_grain_size,
        "kelvin_law": data["kelvin_law"],
        "n_elements": len(elements),
        "element": elements,
        "n_outputs": len(time),
        "observed": np.zeros((n_sets, len(time))),
        "noise": np.where(is_strain, *noise),
        "is_strain": is_strain.astype(int).tolist(),
        "stress_scale": data["stress_scale"][0],
        "strain_scale": data["strain_scale"][0],
        "time": time,
        "n_legs": len(data["leg"]),
        "leg": data["leg"],
        "n_in_leg": data["n_outputs_in_leg"],
    }


def some_places(number: int, most: int) -> list[int]:
    """Return places from 0 to the last, evenly spaced, at most `most`."""
    return [int(place) for place in np.linspace(0, number - 1, min(number, most))]


def parameters_about(problem: Problem, constants: Mapping[str, float], n_sets: int) -> FloatArray:
    """Draw parameters from the priors, flow rates about that of the test; (n_sets, n)."""
    (experiment,), rng = problem.experiments, np.random.default_rng(1)
    data = program_data(problem, solver=REFERENCE_SOLVER)
    constant = dict(zip(NAMES, data["prior_location"][0], strict=True))
    origin, size = problem.likelihood.reference_origin(experiment)
    found = []
    for _ in range(n_sets):
        own = {**constant, **draw_priors(problem, rng)[0], **constants}
        # ln S_0 at the first rate, or ln of the flow rate at the stress of the test
        reference = origin + size * rng.standard_normal()
        if data["reference_stress_rate"][0] > 0:
            log_stress, log_rate = reference, np.log(data["reference_stress_rate"][0])
        else:
            log_stress, log_rate = np.log(data["stress_scale"][0]), reference
        log_grains = own["grain_size_exponent"] * np.log(experiment.initial_grain_size)
        flow = log_rate + log_grains - own["stress_exponent"] * log_stress
        inverse = 1 / (GAS_CONSTANT * experiment.temperature)
        own["activation_enthalpy"] = flow / (own["beta"] - inverse)
        found.append([own[name] for name in NAMES])
    return np.array(found)


@dataclass(frozen=True)
class Sets:
    """Parameter sets of a case that Stan's solver can solve, with readings of their own."""

    program: Program
    data: StanData

    def with_solver(self, solver: SolverOptions) -> Density:
        """Log density with a solver; its points have all coordinates of all sets."""
        return Density(self.program, {**self.data, **solver_block(solver)})

    @property
    def origin(self) -> FloatArray:
        """Coordinates of the parameters, (n_sets * n_free,)."""
        return np.zeros(self.data["n_sets"] * self.data["n_free"])

    def log_densities(self, solver: SolverOptions) -> FloatArray:
        """Log density of each set, (n_sets,)."""
        found: FloatArray = self.with_solver(solver).variables_at(self.origin)["log_density"]
        return found

    def gradients(self, solver: SolverOptions) -> FloatArray:
        """Gradient of each set, (n_sets, n_free)."""
        (found,) = self.with_solver(solver).gradients(self.origin[np.newaxis])
        return np.reshape(found, (self.data["n_sets"], -1))

    def errors(self, solver: SolverOptions, exact: FloatArray) -> tuple[FloatArray, FloatArray]:
        """Errors of log densities, and of gradients over the norms of exact ones."""
        density = np.abs(self.log_densities(solver) - self.log_densities(REFERENCE_SOLVER))
        away = np.linalg.norm(self.gradients(solver) - exact, axis=1)
        return density, away / np.linalg.norm(exact, axis=1)

    def part(self, places: npt.NDArray[np.int64]) -> "Sets":
        """Some of the sets."""
        own = {name: self.data[name][places] for name in ("parameter", "observed", "noise")}
        return Sets(self.program, {**self.data, **own, "n_sets": len(places)})

    def solved(self, solver: SolverOptions) -> npt.NDArray[np.int64]:
        """Places of the sets that a solver can solve: halves, until one is alone."""
        places = np.arange(self.data["n_sets"])
        try:
            self.log_densities(solver)
        except SamplingError:
            if len(places) == 1:
                return places[:0]
            halves = np.array_split(places, 2)
            return np.concatenate([half[self.part(half).solved(solver)] for half in halves])
        return places


def sets_of(case: Case, n_sets: int) -> Sets:
    """Return parameter sets of a case with readings: the solution and noise.

    Solutions whose strain grows beyond 1 are left out.
    """
    sets = Sets(load_program(VALUES), values_data(case, n_sets))
    sets = sets.part(sets.solved(REFERENCE_SOLVER))
    response = sets.with_solver(REFERENCE_SOLVER).variables_at(sets.origin)["response"]
    strain = np.abs(response[:, np.array(sets.data["is_strain"]) == 1]).max(axis=1, initial=0.0)
    sets.data["observed"] = response + sets.data["noise"] * np.random.default_rng(
        2
    ).standard_normal(response.shape)
    return sets.part(np.flatnonzero(strain < 1.0))


@pytest.fixture(params=[3, pytest.param(1000, marks=pytest.mark.slow)])
def n_sets(request: pytest.FixtureRequest) -> int:
    """Number of parameter sets: few, and many in the slow suite."""
    number: int = request.param
    return number


@pytest.mark.parametrize("case", CASES, ids=lambda case: case.name)
def test_densities_and_gradients_are_those_of_a_tight_solver(
    case: Case, n_sets: int, record_property: Any
) -> None:
    sets = sets_of(case, n_sets)
    exact = sets.gradients(REFERENCE_SOLVER)
    error, relative = sets.errors(SolverOptions(), exact)
    # Stan's solver may take no step: sets that need it have no solution.
    handed_over = 1 - len(sets.solved(SolverOptions(max_num_steps=1))) / len(error)
    record_property("largest error of a log density", float(error.max()))
    record_property("largest error of a gradient", float(relative.max()))
    record_property("share handed over", float(handed_over))
    assert len(error) > 0.2 * n_sets
    assert handed_over <= MAX_HANDED_OVER
    assert_accurate(
        error,
        relative,
        lambda far: sets.part(far).errors(SolverOptions(method="bdf"), exact[far]),
        at_most=max(1, MAX_ABOVE * len(error)),
    )


def assert_accurate(
    density: FloatArray,
    gradient: FloatArray,
    of_stan: Callable[[npt.NDArray[np.int64]], tuple[FloatArray, FloatArray]],
    *,
    at_most: float,
) -> None:
    """Refuse more large errors, and the largest unless those of Stan's solver are larger."""
    for one in (density, gradient):
        assert np.sum(one > MAX_ERROR) <= at_most
    far = np.flatnonzero(np.maximum(density, gradient) > 30 * MAX_ERROR)
    if far.size:
        # Noise as small as the tolerance, for instance: Stan's solver errs by more.
        stan_density, stan_gradient = of_stan(far)
        assert np.all(density[far] < stan_density)
        assert np.all(gradient[far] < stan_gradient)


OSCILLATION_LAWS = (*LAWS, {"kelvin": "power_law", "maxwell": "hyperbolic_sine"}, *MECHANISMS)


@pytest.mark.parametrize("laws", OSCILLATION_LAWS, ids=lambda laws: " ".join(laws.values()))
@pytest.mark.parametrize("background", ["kept", "removed"])
def test_those_of_oscillations_are_as_well(
    background: str, laws: Mapping[str, str], n_sets: int, record_property: Any
) -> None:
    experiment = load_experiment(REPOSITORY / f"data/calibration/olivine_{background}.toml")
    priors = with_variant(load_priors(REPOSITORY / "data/priors/olivine.toml"), experiment, laws)
    problem = problem_of([experiment], priors)
    exact = density_of(problem, REFERENCE_SOLVER)
    solved, readings = [], []
    for point in np.random.default_rng(1).standard_normal((n_sets, problem.layout.size)):
        try:
            # Readings have the noise of their set.
            readings.append(exact.variables_at(point)["response_replicated"])
        except SamplingError:  # as in `Sets.solved`, the tight solver cannot judge
            continue
        solved.append(point)
    assert len(solved) >= (1 - MAX_ABOVE) * n_sets
    points = np.array(solved)

    def errors(
        solver: SolverOptions, places: npt.NDArray[np.int64]
    ) -> tuple[FloatArray, FloatArray]:
        """Errors of log densities, and of gradients over the norms of exact ones."""
        found = []
        for k in places:
            own, other = (
                exact.with_data({**solver_block(one), "stress_observed": readings[k]})
                for one in (REFERENCE_SOLVER, solver)
            )
            point = points[k : k + 1]
            gradient = own.gradients(point)
            away = np.linalg.norm(other.gradients(point) - gradient)
            density = (other.at(point) - own.at(point)).item()
            found.append((abs(density), away / np.linalg.norm(gradient)))
        return np.array(found)[:, 0], np.array(found)[:, 1]

    error, relative = errors(SolverOptions(), np.arange(len(points)))
    record_property("largest error of a log density", float(error.max()))
    record_property("largest error of a gradient", float(relative.max()))
    of_stan = partial(errors, SolverOptions(method="bdf"))
    assert_accurate(error, relative, of_stan, at_most=MAX_ABOVE * len(error))
    # Stan's solver may take no step: sets that need it have no solution.
    none = exact.with_data(solver_block(SolverOptions(max_num_steps=1)))
    assert np.isfinite(none.at(points)).all()
