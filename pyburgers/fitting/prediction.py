"""What draws of a fit say of another test: its response, solved for every draw."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import xarray as xr

from pyburgers.cmdstan.draw_files import Draws
from pyburgers.cmdstan.program import load_program
from pyburgers.common.draws import all_draws, evenly_spaced
from pyburgers.common.errors import InputError, SamplingError
from pyburgers.model.parameters import (
    CONDITIONS,
    PARAMETER_BY_NAME,
    PROGRAM_PARAMETERS,
    STANDARD_VALUES,
)
from pyburgers.model.prior_families import Prior, fixed_prior
from pyburgers.model.priors import PriorSet
from pyburgers.model.variants import variant_of, with_variant
from pyburgers.posterior.groups import drawn_at_points, grid_group, groups_at_points
from pyburgers.posterior.labelled_draws import label_draws, own_name
from pyburgers.protocols.conditions import conditions, outside
from pyburgers.protocols.coordinates import CENTRE, SPREAD
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.problem import Problem, one_test
from pyburgers.protocols.program_data import program_data
from pyburgers.protocols.protocol import FittedTest, protocol_of
from pyburgers.protocols.stan_data import REFERENCE_SOLVER

FloatArray = npt.NDArray[np.float64]

BOX_MARGIN = 0.5
"""Range of a parameter's draws by which the bounds of its coordinate lie outside them."""

RESIDUAL_CORRELATION = ("residual_correlation_strain", "residual_correlated_share")


@dataclass(frozen=True, eq=False)
class Source:
    """Draws that a prediction is made from.

    Attributes
    ----------
    problem : Problem
        What was fitted.
    tests : mapping of str to FittedTest
        What the fit says of each test, by its name.
    posterior : DataTree
        Labelled draws of all tests together.
    cautions : tuple of str
        What is wrong with the fit: sentences.
    """

    problem: Problem
    tests: Mapping[str, FittedTest]
    posterior: xr.DataTree
    cautions: tuple[str, ...]


@dataclass(frozen=True, eq=False)
class Prediction:
    """A test as draws of a fit predict it, to be looked at as a fit is.

    Attributes
    ----------
    experiment : Experiment
        The test.
    priors : PriorSet
        Which parameters have a value, and which of them vary between draws; no prior of anything.
    posterior : DataTree
        Groups posterior (the parameters of the test, SI) and predictions (along its clock); where
        the test has data, model_response, posterior_predictive, log_likelihood, observed_data and
        constant_data as of a fit. One chain; ``fit_draw`` counts the draws of all chains of the
        fit. The attributes say what `cautions` and `notes` do.
    fitted_to : str
        Names of the tests behind the draws, joined.
    cautions : tuple of str
        What may make it worthless: verdicts on the fit that are not yes, extrapolation.
    notes : tuple of str
        Where parameters and noise come from.
    """

    experiment: Experiment
    priors: PriorSet
    posterior: xr.DataTree
    fitted_to: str
    cautions: tuple[str, ...]
    notes: tuple[str, ...]

    @property
    def title(self) -> str:
        """What is predicted from what."""
        about = f"{self.experiment.id} ({self.experiment.material}"
        return f"{about}, {self.experiment.temperature:g} K) predicted from {self.fitted_to}"


def predict_test(
    source: Source,
    experiment: Experiment,
    *,
    draws: int | None = None,
    separate_from: str | None = None,
    seed: int = 1,
) -> Prediction:
    """Solve a test for draws of a fit.

    Parameters
    ----------
    source : Source
        The draws.
    experiment : Experiment
        What is driven; without data there are bands and no points.
    draws : int, optional
        How many, evenly spaced; default all.
    separate_from : str, optional
        Of a joint fit, the test that separate parameters are taken from; default each in turn.
    seed : int
        Of noise, and of the values of partially pooled parameters.

    Raises
    ------
    InputError
        If the test is of another material, cannot have the laws of the fit, or `separate_from` is
        no test of the fit.
    SamplingError
        If no draw has a solution.
    """
    first = source.problem.experiments[0]
    if experiment.material != first.material:
        raise InputError(
            f"{experiment.id}: is of the material {experiment.material}, expected "
            f"{first.material} like {first.id}, which the draws are fitted to."
        )
    if draws is not None and draws < 1:
        raise InputError(f"draws: found {draws}, expected at least 1.")
    rng = np.random.default_rng(seed)
    protocol = protocol_of(experiment)
    kept, values, notes = _values(source, draws, separate_from, rng)
    values, condition_notes = _under_conditions(source, experiment, kept, values, rng)
    priors, law_notes = _with_laws(
        _holding(values, source.problem.priors[0]), source.problem, experiment
    )
    problem = one_test(experiment, priors)
    (coordinates,) = problem.coordinates
    rows = np.column_stack(
        [
            *(coordinates.of_quantity(k, values[name]) for k, name in enumerate(priors.free)),
            rng.standard_normal((kept.size, experiment.n_driving_errors)),
        ]
    )
    grid = protocol.prediction_grid(experiment)
    data = program_data(problem, solver=REFERENCE_SOLVER, grids=[grid])
    solved, found = load_program(protocol.program).generate_at(data, "coordinate", rows, seed=seed)
    drawn, solved = _finite(found, solved, next(iter(protocol.grid_quantities)))
    if not solved.any():
        raise SamplingError(
            f"{experiment.id}: no solution at any of {kept.size} draws, expected one; the "
            "conditions of the test may lie too far from those that were fitted."
        )
    posterior = _tree(drawn, kept[solved], values, solved, experiment, priors)
    noise = PARAMETER_BY_NAME[protocol.noise]
    scatter = float(posterior["posterior"][protocol.noise].mean()) * noise.display_factor
    prediction = Prediction(
        experiment=experiment,
        priors=priors,
        posterior=posterior,
        fitted_to=source.problem.name,
        cautions=(
            *source.cautions,
            *_fitted_itself(source, experiment),
            *_beyond(source, experiment, posterior),
            *_unsolved(int(np.sum(~solved)), kept.size),
        ),
        notes=(
            *notes,
            *condition_notes,
            *law_notes,
            f"New readings scatter by the {noise.label} of the fit, {scatter:.3g} "
            f"{noise.display_unit} on average.",
        ),
    )
    posterior.attrs = {
        "title": prediction.title,
        "experiment": experiment.id,
        "fitted_to": prediction.fitted_to,
        "cautions": "\n".join(prediction.cautions),
        "notes": "\n".join(prediction.notes),
        "clock": protocol.clock.name,
    }
    return prediction


def _values(
    source: Source, draws: int | None, separate_from: str | None, rng: np.random.Generator
) -> tuple[npt.NDArray[np.int64], dict[str, FloatArray], list[str]]:
    """Return numbers of draws, every parameter of a new test in them (SI), and where they are from.

    A shared parameter has the value of all tests, a partially pooled one is drawn from centre and
    spread, a separate one is that of a test of the fit, all separate ones of a draw of the same.
    """
    problem, tests = source.problem, source.tests
    if separate_from is not None and separate_from not in tests:
        raise InputError(
            f"test {separate_from!r}: is not one of the fit, expected one of {', '.join(tests)}."
        )
    groups = [test.posterior["posterior"].to_dataset() for test in tests.values()]
    numbers = np.arange(groups[0].sizes["chain"] * groups[0].sizes["draw"])
    kept = numbers if draws is None else evenly_spaced(numbers, draws)
    by_test = {
        name: np.stack([all_draws(group[name])[kept] for group in groups]).astype(np.float64)
        for name in problem.priors[0].priors
    }
    turn = np.arange(kept.size) % len(tests)
    if separate_from is not None:
        turn = np.full(kept.size, list(tests).index(separate_from))
    values = {name: own[turn, np.arange(kept.size)] for name, own in by_test.items()}
    if problem.is_single:
        return kept, values, []
    for name in problem.partial:
        values[name] = _of_a_new_test(source, name, kept, rng)
    notes = []
    if problem.partial:
        notes.append(
            f"A new test's own {_listed(problem.partial)} drawn from the centre and spread of the "
            "tests."
        )
    separate = [n for n in problem.free if n not in (*problem.shared, *problem.partial)]
    if separate:
        notes.append(
            f"Separate between the tests, and here of {separate_from or 'each test in turn'}: "
            f"{_listed(separate)}."
        )
    return kept, values, notes


def _under_conditions(
    source: Source,
    experiment: Experiment,
    kept: npt.NDArray[np.int64],
    values: Mapping[str, FloatArray],
    rng: np.random.Generator,
) -> tuple[dict[str, FloatArray], list[str]]:
    """Return values with the errors of the conditions of a new test, and where they are from.

    The errors of a fitted test are another's, save where both were made with the same apparatus.
    """
    others = {name: own for name, own in values.items() if name not in CONDITIONS}
    notes = []
    for condition in experiment.uncertain:
        name = condition.parameter
        label = PARAMETER_BY_NAME[name].label
        same = [
            test.id
            for test in source.problem.experiments
            for one in test.uncertain
            if one.parameter == name
            and one.apparatus == condition.apparatus
            and (one.apparatus is not None or test.id == experiment.id)
        ]
        if same:
            fitted = source.tests[same[0]].posterior["posterior"].to_dataset()[name]
            others[name] = all_draws(fitted)[kept].astype(np.float64)
            notes.append(f"The {label} is that of {same[0]}.")
        else:
            others[name] = condition.sd * rng.standard_normal(kept.size)
            notes.append(f"The {label} is drawn anew, as the file states it.")
    return others, notes


def _of_a_new_test(
    source: Source, name: str, kept: npt.NDArray[np.int64], rng: np.random.Generator
) -> FloatArray:
    """Draw a partially pooled parameter (SI) of a test that was not fitted, for kept draws."""
    group = source.posterior["posterior"].to_dataset()
    centre, spread = (all_draws(group[own_name(name, owner)])[kept] for owner in (CENTRE, SPREAD))
    plain = source.problem.coordinates[0]
    k = plain.quantities.index(name)
    real = plain.of_quantity(k, centre) + spread * rng.standard_normal(kept.size)
    return np.array([plain.value(k, position) for position in real])


def _holding(values: Mapping[str, FloatArray], fitted: PriorSet) -> PriorSet:
    """Return bounds around draws, so that every draw has coordinates; what never varies is fixed.

    Parameters between two bounds keep coordinates of their own, none is that of a point of the
    flow law.
    """
    return PriorSet(
        material=fitted.material,
        title=f"draws of a fit with {fitted.title}",
        priors={name: _box(name, own) for name, own in values.items()},
        name="draws",
    )


def _box(name: str, values: FloatArray) -> Prior:
    low, high = float(values.min()), float(values.max())
    if low == high:
        return fixed_prior(PARAMETER_BY_NAME[name], low, "fixed in the fit")
    margin = BOX_MARGIN * (high - low)
    lower, upper = low - margin, high + margin
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    unit = PARAMETER_BY_NAME[name].si_unit
    return Prior(name, "uniform", middle, half, lower, upper, unit, "draws of a fit")


def _with_laws(
    priors: PriorSet, fitted: Problem, experiment: Experiment
) -> tuple[PriorSet, list[str]]:
    """Return priors that give a test the laws of a fit, as far as such a test has them, and notes.

    Raises
    ------
    InputError
        If the test needs a law that the fit has not.
    """
    notes = []
    laws = variant_of(fitted.priors[0], fitted.experiments[0])
    if laws.residuals not in experiment.laws.get("residuals", (laws.residuals,)):
        standard = (
            fixed_prior(PARAMETER_BY_NAME[name], STANDARD_VALUES[name], "not of such tests")
            for name in RESIDUAL_CORRELATION
        )
        priors = priors.exchanging(*standard)
        notes.append("Noise of new readings is independent here, in the fit it is correlated.")
    own = {} if laws.grain_size == "evolving" else {"grain_size": laws.grain_size}
    priors = with_variant(priors, experiment, own)
    here = variant_of(priors, experiment).record()
    notes += [
        f"The {part.replace('_', ' ')} is {here[part]} in such a test, {law} in the fit."
        for part, law in laws.record().items()
        if part != "residuals" and here[part] != law
    ]
    return priors, notes


def _finite(
    parts: Sequence[Draws], solved: npt.NDArray[np.bool_], response: str
) -> tuple[Draws, npt.NDArray[np.bool_]]:
    """Put parts together without draws that have no finite response on the grid."""
    if not parts:
        return Draws({}, np.empty((1, 0, 0))), solved
    joined = Draws(parts[0].variables, np.concatenate([part.values for part in parts], axis=1))
    finite = np.isfinite(joined[response][0]).all(axis=-1)
    solved = solved.copy()
    solved[solved] = finite
    return Draws(joined.variables, joined.values[:, finite]), solved


def _tree(
    drawn: Draws,
    kept: npt.NDArray[np.int64],
    values: Mapping[str, FloatArray],
    solved: npt.NDArray[np.bool_],
    experiment: Experiment,
    priors: PriorSet,
) -> xr.DataTree:
    """Label what was solved as the draws of a fit are."""
    protocol = protocol_of(experiment)
    labels = {"chain": [1], "draw": np.arange(kept.size), "fit_draw": ("draw", kept)}
    fixed = {name: prior.location for name, prior in priors.priors.items() if prior.is_fixed}
    own = {
        name: np.full(kept.size, fixed[name]) if name in fixed else values[name][solved]
        for name in priors.priors
    }
    parameters = xr.Dataset(
        {name: (("chain", "draw"), one[np.newaxis]) for name, one in own.items()}, labels
    )
    label_draws(parameters, (p for p in PROGRAM_PARAMETERS if p.name in own), priors)
    on_grid = drawn.dataset(list(protocol.grid_quantities)).assign_coords(chain=[1])
    groups = {"posterior": parameters, "predictions": grid_group(on_grid, experiment)}
    if experiment.n_points > 0:
        at_points = drawn_at_points(drawn, {"chain": [1]}, protocol.response)
        groups |= groups_at_points(at_points, experiment)
    return xr.DataTree.from_dict(groups)


def _fitted_itself(source: Source, experiment: Experiment) -> list[str]:
    """Say whether the data of a test took part in the fit."""
    fitted = any(
        experiment.n_points > 0 and np.array_equal(experiment.response, one.response)
        for one in source.problem.experiments
    )
    if not fitted:
        return []
    return [f"{experiment.id} is part of the fit, so that its data are no test of the prediction."]


def _beyond(source: Source, experiment: Experiment, posterior: xr.DataTree) -> list[str]:
    """Say where a test leaves the conditions that were fitted."""
    fitted = [
        conditions(test.experiment, test.posterior["predictions"].to_dataset())
        for test in source.tests.values()
    ]
    beyond = outside(conditions(experiment, posterior["predictions"].to_dataset()), fitted)
    return [f"Beyond what was fitted: {'; '.join(beyond)}."] if beyond else []


def _unsolved(number: int, total: int) -> list[str]:
    return [f"{number} of {total} draws have no solution and are left out."] if number else []


def _listed(names: Sequence[str]) -> str:
    return ", ".join(PARAMETER_BY_NAME[name].label for name in names)
