"""What draws of a fit say of another test: its response, solved for every draw.

The discrepancy of a law in a test that was not fitted is the same share of the response.
"""

from collections.abc import Collection, Mapping, Sequence
from dataclasses import dataclass
from numbers import Integral

import numpy as np
import numpy.typing as npt
import xarray as xr

from pyburgers.cmdstan.draw_files import Draws
from pyburgers.cmdstan.program import load_program
from pyburgers.common.draws import FloatArray, all_draws
from pyburgers.common.errors import InputError, SamplingError, require_type
from pyburgers.fitting.new_test import (
    Source,
    add_condition_errors,
    add_noises,
    apparatus_values,
    bounds_around,
    draw_values,
    require_same_material,
    transfer_laws,
    with_modulus_there,
)
from pyburgers.kinds.conditions import (
    beyond_sentences,
    conditions_of,
    longer_history,
    longer_than_tests,
    unlikely_in,
)
from pyburgers.kinds.experiment import A_TEST, Experiment
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import Problem, one_test
from pyburgers.kinds.program_data import program_data, solve
from pyburgers.kinds.stan_data import REFERENCE_SOLVER
from pyburgers.model.environment import acting_environment
from pyburgers.model.hardening import extension_sentences
from pyburgers.model.laws import DISLOCATIONS_SWITCH
from pyburgers.model.parameters import PROGRAM_PARAMETERS, STANDARD_VALUES
from pyburgers.model.priors import PriorSet
from pyburgers.model.read_quantities import BY_NOISE
from pyburgers.posterior.groups import drawn_at_points, grid_group, groups_at_points
from pyburgers.posterior.labelled_draws import label_draws

MODULUS_OF_MACHINE = (
    "The elastic modulus is E_M of the fit. If strain was read off the machine, as in most "
    "tests at constant rate, E_M is mostly the stiffness of the apparatus."
)
NONE_HERE = " have none here, and their bands are too narrow."


def carry_discrepancy(
    values: Mapping[str, FloatArray], fitted: Problem, experiment: Experiment
) -> tuple[dict[str, FloatArray], list[str]]:
    """Return values with the discrepancy of a new test over its reading errors, and notes.

    A discrepancy stays the same share of the response, and correlates over the same share of the
    test. It is carried over only to quantities that the fit reads, because the misfit of another
    one depends on the law. It is a multiple of all noises, so others must have none. `values`
    (n_draws,): parameters by name (SI), the discrepancy as `draw_values` has it.
    """
    found = dict(values)
    if not values.get("discrepancy", np.zeros(1)).any():
        return found, []
    likelihood, first = likelihood_of(experiment), fitted.experiments[0]
    here, there = experiment.residual_correlation, first.residual_correlation
    known = {name for test in fitted.experiments for name in test.noises}
    unknown = [name for name in experiment.noises if name not in known]
    takes_one = "discrepancy" in experiment.laws.get("residuals", ("discrepancy",))
    why = f"The fit knows the discrepancy of its law in readings of {_names_of(known)} alone"
    if not takes_one:
        why = f"Tests of the protocol {experiment.protocol} take no discrepancy of the law"
    stays_apart = len(unknown) < len(experiment.noises) and all(
        experiment.noises[name] is None for name in unknown
    )
    if not (takes_one and stays_apart):
        for name in ("discrepancy", here):
            found[name] = np.full_like(values["discrepancy"], STANDARD_VALUES[name])
        return found, [f"{why}: new readings{NONE_HERE}"]
    at = np.unique(experiment.position) if experiment.n_points else likelihood.grid(experiment)
    mean = {name: float(own.mean()) for name, own in values.items()}
    solution = solve(experiment, {**mean, "discrepancy": 0.0}, at, solver=REFERENCE_SOLVER)
    squares = [
        (solution[f"grid_{one.name}"][places] / values[one.noise][:, np.newaxis]) ** 2
        for one, places in zip(likelihood.read, likelihood.is_read(experiment, at), strict=True)
        if places.any() and one.noise in known
    ]
    found["discrepancy"] = values["discrepancy"] * np.sqrt(
        np.mean(np.concatenate(squares, axis=1), axis=1)
    )
    if here != there:
        spans = [one.span[1] - one.span[0] for one in (experiment, first)]
        found[here] = values[there] * (spans[0] / spans[1])
        found[there] = np.full_like(values[there], STANDARD_VALUES[there])
    notes = [f"{why}: new readings of {_names_of(unknown)}{NONE_HERE}"] if unknown else []
    return found, notes


def _names_of(noises: Collection[str]) -> str:
    return " and ".join(sorted(BY_NOISE[name].name for name in noises))


def discrepancy_sentences(
    experiment: Experiment,
    values: Mapping[str, FloatArray],
    fitted: Problem,
    predictions: xr.Dataset,
) -> list[str]:
    """Say how much of the variance of new readings the discrepancy makes, for each quantity read.

    `values` (n_draws,): parameters by name (SI), those of the draws with a solution.
    """
    discrepancy = values.get("discrepancy", np.zeros(1))
    if not discrepancy.any():
        return []
    likelihood = likelihood_of(experiment)
    known = {name for test in fitted.experiments for name in test.noises}
    at = predictions[likelihood.clock.name].to_numpy()
    said = []
    for one, places in zip(likelihood.read, likelihood.is_read(experiment, at), strict=True):
        if places.any() and one.noise in known:
            solved = all_draws(predictions[one.name]).astype(np.float64)[:, places]
            noise = values[one.noise]
            parts = np.array(
                [np.mean((discrepancy * noise) ** 2), solved.var(axis=0).mean(), np.mean(noise**2)]
            )
            shares = 100 * parts / parts.sum()
            size, whole = np.sqrt([parts[0], np.mean(solved**2)])
            said.append(
                f"The discrepancy of the law is carried over as a share of the {one.name}, "
                f"{100 * size / whole:.2g} %: {size * one.display_factor:.3g} {one.display_unit}. "
                f"It makes {shares[0]:.0f} % of the variance of new readings along the test, "
                f"parameters make {shares[1]:.0f} %, reading errors {shares[2]:.0f} %; bands of "
                "the solution hold parameters alone."
            )
    return said


@dataclass(frozen=True, eq=False, repr=False)
class Prediction:
    """A test as draws of a fit predict it, with the interface of a fit.

    Attributes
    ----------
    experiment : Experiment
        The test.
    priors : PriorSet
        Parameters of the test and whether they vary between draws, in the form of priors.
    posterior : DataTree
        Groups posterior (the parameters of the test, SI) and predictions (along its clock). If the
        test has data, also model_response, posterior_predictive, log_likelihood, observed_data and
        constant_data. There is one chain; ``fit_draw`` counts the draws of all chains of the fit.
        The attributes hold `cautions` and `notes`.
    fitted_to : str
        Names of the tests behind the draws, joined.
    cautions : tuple of str
        Doubts: verdicts on the fit that are not yes, extrapolation.
    notes : tuple of str
        Sources of parameters and noise; notices of the test's file.

    Examples
    --------
    >>> prediction = fit.predict(test)
    >>> prediction.posterior["posterior_predictive"].sizes["point"] == test.n_points
    True
    """

    experiment: Experiment
    priors: PriorSet
    posterior: xr.DataTree
    fitted_to: str
    cautions: tuple[str, ...]
    notes: tuple[str, ...]

    def __repr__(self) -> str:
        """Return a line: of which test, from which fit."""
        return f"<prediction of {self.experiment.id} from {self.fitted_to}>"

    @property
    def title(self) -> str:
        """The test, and the fit that predicts it."""
        about = f"{self.experiment.id} ({self.experiment.material}"
        return f"{about}, {self.experiment.temperature_text}) predicted from {self.fitted_to}"


def predict_test(
    source: Source,
    experiment: Experiment,
    draws: int | None = None,
    separate_from: str | None = None,
    seed: int = 1,
    *,
    new_sample: bool = False,
) -> Prediction:
    """Solve a test for draws of a fit.

    `source`: the draws.
    `experiment`: what is driven; without data there are bands and no points.
    `draws`: how many, evenly spaced; default all.
    `separate_from`: of a joint fit, the test that separate parameters are taken from; default each
        in turn.
    `seed`: of noise, and of the values of partially pooled parameters.
    `new_sample`: whether the test is one of another sample, whose microstructure is as a joint fit
        knows it beforehand: from priors, unless it is pooled.

    Raise InputError if the test is of another material, cannot have the laws of the fit, or
    `separate_from` is no test of the fit. Raise SamplingError if no draw has a solution.
    """
    require_type("experiment", experiment, Experiment, A_TEST)
    fitted = source.problem
    require_same_material(fitted.experiments[0], experiment)
    if draws is not None:
        require_type("draws", draws, Integral, "a whole number")
        if draws < 1:
            raise InputError(f"draws: found {draws}, expected at least 1.")
    rng = np.random.default_rng(seed)
    likelihood = likelihood_of(experiment)
    kept, values, notes = draw_values(source, draws, separate_from, rng, new_sample=new_sample)
    of_the_test, apparatus_notes = apparatus_values(source, experiment, kept, rng)
    values = {**values, **of_the_test}
    values, condition_notes = add_condition_errors(source, experiment, kept, values, rng)
    values, noise_notes = add_noises(values, fitted, experiment, separate_from)
    values, modulus_notes = with_modulus_there(values, fitted.experiments, experiment)
    values, discrepancy_notes = carry_discrepancy(values, fitted, experiment)
    priors, law_notes = transfer_laws(bounds_around(values, fitted.priors[0]), fitted, experiment)
    problem = one_test(experiment, priors)
    (coordinates,) = problem.coordinates
    places = [coordinates.of_quantity(k, values[name]) for k, name in enumerate(priors.free)]
    errors = rng.standard_normal((kept.size, experiment.n_driving_errors))
    rows = np.column_stack([*places, errors])
    grid = likelihood.grid(experiment)
    data = program_data(problem, solver=REFERENCE_SOLVER, grids=[grid])
    solved, drawn = load_program(likelihood.program).generate_at(
        data, "coordinate", rows, seed=seed
    )
    if solved.any():
        drawn, solved[solved] = drawn.finite_in(likelihood.grid_quantities)
    if not solved.any():
        raise SamplingError(
            f"{experiment.id}: no solution at any of {kept.size} draws, expected one; the "
            "conditions of the test may lie too far from those that were fitted."
        )
    posterior = _tree(drawn, kept[solved], values, solved, experiment, priors)
    cautions = [*source.cautions]
    if any(map(experiment.has_readings_of, fitted.experiments)):
        cautions.append(
            f"{experiment.id} is part of the fit, so that its data are no test of the prediction."
        )
    cautions += [*_beyond(source, experiment, posterior), *_extended(posterior)]
    if n_unsolved := np.count_nonzero(~solved):
        cautions.append(f"{n_unsolved} of {kept.size} draws have no solution and are left out.")
    if draws is not None and draws > kept.size:
        taken = f"The fit has {kept.size} draws, which are all taken; {draws} were asked for."
        notes = [taken, *notes]
    notes += [*apparatus_notes, *condition_notes, *modulus_notes, *law_notes]
    notes += [*noise_notes, *discrepancy_notes, *experiment.notices]
    of_solved = {name: own[solved] for name, own in values.items()}
    predictions = posterior["predictions"].to_dataset()
    notes += discrepancy_sentences(experiment, of_solved, fitted, predictions)
    prediction = Prediction(
        experiment, priors, posterior, fitted.name, tuple(cautions), tuple(notes)
    )
    posterior.attrs = {
        "title": prediction.title,
        "experiment": experiment.id,
        "fitted_to": prediction.fitted_to,
        "which_draws": source.which_draws,
        "cautions": "\n".join(prediction.cautions),
        "notes": "\n".join(prediction.notes),
        "clock": likelihood.clock.name,
    }
    return prediction


def _tree(
    drawn: Draws,
    kept: npt.NDArray[np.int64],
    values: Mapping[str, FloatArray],
    solved: npt.NDArray[np.bool_],
    experiment: Experiment,
    priors: PriorSet,
) -> xr.DataTree:
    """Label what was solved as the draws of a fit are."""
    likelihood = likelihood_of(experiment)
    labels = {"chain": [1], "draw": np.arange(kept.size), "fit_draw": ("draw", kept)}
    own = {
        name: np.full(kept.size, prior.location) if prior.is_fixed else values[name][solved]
        for name, prior in priors.priors.items()
    }
    parameters = xr.Dataset(
        {name: (("chain", "draw"), one[np.newaxis]) for name, one in own.items()}, labels
    )
    label_draws(parameters, (p for p in PROGRAM_PARAMETERS if p.name in own), priors)
    on_grid = drawn.dataset(list(likelihood.grid_quantities))
    groups = {"posterior": parameters, "predictions": grid_group(on_grid, experiment)}
    if experiment.n_points > 0:
        groups |= groups_at_points(drawn_at_points(drawn), experiment)
    return xr.DataTree.from_dict(groups)


def _beyond(source: Source, experiment: Experiment, posterior: xr.DataTree) -> tuple[str, ...]:
    """Say where a test leaves what was fitted, or is unlikely."""
    drawn = posterior["posterior"].to_dataset()
    acting = acting_environment({str(name): one.to_numpy() for name, one in drawn.items()})
    passed = conditions_of(experiment, posterior)
    return (
        *beyond_sentences(passed, source.conditions, acting),
        *unlikely_in(experiment),
        *longer_history(experiment, source.problem.experiments, source.conditions),
        *longer_than_tests(passed, source.problem.experiments),
        *_modulus_of_machine(source.problem.experiments, experiment),
    )


def _modulus_of_machine(fitted: Sequence[Experiment], experiment: Experiment) -> list[str]:
    """Say where a table of cycles takes its modulus from tests that saw it with the apparatus."""
    compliance = "apparatus_compliance"
    is_known = any(compliance in one.without_effect or compliance in one.stated for one in fitted)
    if is_known or compliance not in experiment.without_effect:
        return []
    return [
        f"{MODULUS_OF_MACHINE} Then modulus and tan δ of fast cycles are too small; `pyburgers "
        "predict attenuation` has --elastic-modulus-Pa."
    ]


def _extended(posterior: xr.DataTree) -> list[str]:
    """Say where the median solution leaves the stresses that dislocations take."""
    solved = posterior["predictions"].to_dataset()
    if "stress" not in solved:
        return []
    reference = posterior["posterior"].to_dataset().get(DISLOCATIONS_SWITCH, xr.DataArray(0.0))
    return extension_sentences(reference, solved["stress"].median(("chain", "draw")).to_numpy())
