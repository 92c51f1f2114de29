"""Parameters of a test that was not fitted, from draws of a fit: values, noise, laws."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass

import numpy as np
import numpy.typing as npt
import xarray as xr

from pyburgers.common.draws import FloatArray, all_draws, evenly_spaced
from pyburgers.common.errors import InputError
from pyburgers.fitting.new_sample import microstructure_of_new_sample, of_new_test
from pyburgers.kinds.conditions import Ranges
from pyburgers.kinds.experiment import Experiment, UncertainCondition
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.likelihood import likelihood_of
from pyburgers.kinds.problem import Problem, stated_priors
from pyburgers.model.closed_forms import MODULUS_CHANGE, maxwell_modulus_at, with_maxwell_modulus
from pyburgers.model.display import unit_after_number
from pyburgers.model.parameters import (
    CONDITIONS,
    ENVIRONMENT,
    PARAMETER_BY_NAME,
    RESIDUAL_CORRELATION,
    STANDARD_VALUES,
)
from pyburgers.model.prior_families import Prior, fixed_prior, is_fixed_at
from pyburgers.model.priors import PriorSet
from pyburgers.model.read_quantities import BY_NOISE
from pyburgers.model.variants import ModelVariant, variant_of, with_variant
from pyburgers.posterior.labelled_draws import response_in

BOX_MARGIN = 0.5
"""Range of a parameter's draws by which the bounds of its coordinate lie outside them."""

TEST_PARAMETERS = ("apparatus_compliance", "strain_offset")
"""Parameters of a test and its apparatus, which say nothing of another one."""


@dataclass(frozen=True, eq=False)
class Source:
    """Draws that a prediction is made from: those of each fitted test, and of all together.

    `conditions` are those that each fitted test passed.
    """

    problem: Problem
    tests: Mapping[str, FittedTest]
    posterior: xr.DataTree
    conditions: Sequence[Ranges]
    cautions: tuple[str, ...]
    which_draws: str = ""


def draw_values(
    source: Source,
    draws: int | None,
    separate_from: str | None,
    rng: np.random.Generator,
    *,
    new_sample: bool = False,
) -> tuple[npt.NDArray[np.int64], dict[str, FloatArray], list[str]]:
    """Return numbers of draws, every parameter of a new test in them (SI), and where they are from.

    A shared parameter has the value of all tests, a partially pooled one is drawn from centre and
    spread, a separate one is that of a test of the fit, all separate ones of a draw of the same.
    `draws`, `separate_from`, `new_sample` are as of `predict_test`. Numbers count from 0 through
    all chains; numbers and values have the shape (n_kept,). A discrepancy of the law is a share of
    the response of its test.
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
        if all(name in group for group in groups)
    }
    if "discrepancy" in problem.free:
        shares: list[FloatArray] = []
        for k, test in enumerate(tests.values()):
            own_values = {name: own[k] for name, own in by_test.items()}
            # Tables stand behind histories, and have none.
            has_none = "discrepancy" in test.experiment.without_effect
            shares.append(shares[0] if has_none else _over_response(test, own_values))
        by_test["discrepancy"] = np.stack(shares)
    every = np.arange(kept.size)
    values = {}
    for name, own in by_test.items():
        # A test that does not read a quantity has only the prior of its noise.
        readers = [k for k, test in enumerate(tests.values()) if name in test.experiment.noises]
        among = np.asarray(readers or range(len(tests)))
        if separate_from is not None:
            among = np.array([list(tests).index(separate_from)])
        values[name] = own[among[every % among.size], every]
    if new_sample:
        values |= microstructure_of_new_sample(problem, values, rng)
    if problem.is_single:
        return kept, values, []
    for name in problem.partial:
        values[name] = of_new_test(problem, source.posterior, name, kept, rng)
    notes = []
    if problem.partial:
        partial = _listed(problem.partial)
        notes.append(f"A new test's own {partial} drawn from the centre and spread of the tests.")
    elsewhere = {*problem.shared, *problem.partial, *TEST_PARAMETERS, *CONDITIONS}
    separate = [name for name in problem.free if name not in elsewhere]
    if separate:
        notes.append(
            f"Separate between the tests, and here of {separate_from or 'each test in turn'}: "
            f"{_listed(separate)}."
        )
    return kept, values, notes


def _over_response(test: FittedTest, values: Mapping[str, FloatArray]) -> FloatArray:
    """Return the discrepancy of a fitted test as a share of its response, (n_draws,).

    The response is the root mean square over all readings, each in its reading errors.
    """
    read = likelihood_of(test.experiment).read
    response = all_draws(response_in(test.posterior, "model_response")).mean(axis=0)
    in_errors = [
        one / values[read[k].noise]
        for one, k in zip(response, test.experiment.quantity, strict=True)
    ]
    return np.asarray(values["discrepancy"] / np.sqrt(np.mean(np.square(in_errors), axis=0)))


def apparatus_values(
    source: Source,
    experiment: Experiment,
    kept: npt.NDArray[np.int64],
    rng: np.random.Generator,
) -> tuple[dict[str, FloatArray], list[str]]:
    """Return `TEST_PARAMETERS` of a test by name (SI), and where they are from.

    Those of a test which was fitted itself are what the fit inferred for it. Those of any other one
    are as its file states them, or none.
    """
    fitted = _that_was_fitted(source, experiment)
    drawn = xr.Dataset() if fitted is None else fitted.posterior["posterior"].to_dataset()
    same = [] if fitted is None else _same_of_a_test(fitted.experiment, experiment)
    stated = stated_priors(experiment)
    values = {}
    for name in TEST_PARAMETERS:
        if name in same and name in drawn:
            values[name] = all_draws(drawn[name])[kept].astype(np.float64)
        elif name in stated:
            values[name] = np.array([stated[name].sample(rng) for _ in kept])
        else:
            values[name] = np.full(kept.size, STANDARD_VALUES[name])
    inferred = [name for name in same if name in drawn and np.ptp(drawn[name].to_numpy()) > 0]
    if fitted is None or not inferred:
        return values, []
    return values, [f"As the fit inferred it for {fitted.experiment.id}: {_listed(inferred)}."]


def _that_was_fitted(source: Source, experiment: Experiment) -> FittedTest | None:
    """Return what a fit says of a test that was fitted: the one of its name, or of its readings."""
    tests = [one for one in source.tests.values() if _is_same_test(one.experiment, experiment)]
    named = [one for one in tests if one.experiment.id == experiment.id]
    return next(iter([*named, *tests]), None)


def _is_same_test(fitted: Experiment, experiment: Experiment) -> bool:
    """Whether two tests are of a kind and have the same name, or the same readings."""
    same = fitted.id == experiment.id or experiment.has_readings_of(fitted)
    return same and fitted.protocol == experiment.protocol


def _same_of_a_test(fitted: Experiment, experiment: Experiment) -> list[str]:
    """Return which of `TEST_PARAMETERS` the file of the same test states as when it was fitted."""
    if not _is_same_test(fitted, experiment):
        return []
    none, same = (np.nan, np.nan), []
    for name in TEST_PARAMETERS:
        before, now = (
            (test.stated[name].value, test.stated[name].sd) if name in test.stated else none
            for test in (fitted, experiment)
        )
        if np.allclose(before, now, rtol=1e-9, atol=0.0, equal_nan=True):
            same.append(name)
    return same


def with_modulus_there(
    values: Mapping[str, FloatArray], fitted: Sequence[Experiment], experiment: Experiment
) -> tuple[dict[str, FloatArray], list[str]]:
    """Return values with E_M at the temperature of a test that knows no change, if fits have one.

    `values` (n_kept,): parameters by name (SI).
    """
    is_felt = all(MODULUS_CHANGE not in one.without_effect for one in fitted)
    is_felt_here = MODULUS_CHANGE not in experiment.without_effect
    if not is_felt or is_felt_here or not np.any(values.get(MODULUS_CHANGE, 0.0)):
        return dict(values), []
    there = maxwell_modulus_at(values, experiment.temperature)
    note = f"The Maxwell modulus is that at {experiment.temperature:g} K in the whole test."
    return with_maxwell_modulus(values, there), [note]


def parameters_for_other_test(
    values: Mapping[str, float], fitted: Experiment, experiment: Experiment
) -> tuple[dict[str, float], list[str]]:
    """Return parameters of a fitted test (SI) as predictions of another one take them, and notes.

    What belongs to the apparatus of the fitted test is left out, where the other one is not known
    to have the same.
    """
    require_same_material(fitted, experiment)
    alike = {*_same_of_a_test(fitted, experiment)}
    alike |= {
        one.parameter for one in experiment.uncertain if _same_apparatus(fitted, experiment, one)
    }
    others = {*TEST_PARAMETERS, *CONDITIONS, *ENVIRONMENT} - alike
    own = {name: np.asarray(value) for name, value in values.items() if name not in others}
    there, notes = with_modulus_there(own, [fitted], experiment)
    return {name: float(value) for name, value in there.items()}, notes


def require_same_material(fitted: Experiment, experiment: Experiment) -> None:
    """Raise InputError if a test is not of the material of a fitted one."""
    if experiment.material != fitted.material:
        raise InputError(
            f"{experiment.id}: is of the material {experiment.material}, expected "
            f"{fitted.material} like {fitted.id}, which the draws are fitted to."
        )


def _same_apparatus(
    fitted: Experiment, experiment: Experiment, condition: UncertainCondition
) -> bool:
    """Whether a fitted test has the error of a condition that another test has."""
    return any(
        one.parameter == condition.parameter
        and one.apparatus == condition.apparatus
        and (one.apparatus is not None or fitted.id == experiment.id)
        for one in fitted.uncertain
    )


def add_condition_errors(
    source: Source,
    experiment: Experiment,
    kept: npt.NDArray[np.int64],
    values: Mapping[str, FloatArray],
    rng: np.random.Generator,
) -> tuple[dict[str, FloatArray], list[str]]:
    """Return values with the conditions of a new test, and where their errors are from.

    Its environment is as its file states it. The errors of a fitted test are another's, save where
    both were made with the same apparatus.
    `kept` (n_kept,): numbers of the draws. `values` (n_kept,): parameters by name (SI).
    """
    left_out = {*CONDITIONS, *ENVIRONMENT}
    others = {name: own for name, own in values.items() if name not in left_out}
    others |= {name: np.full(kept.size, value) for name, value in experiment.environment.items()}
    notes = []
    for condition in experiment.uncertain:
        name = condition.parameter
        label = PARAMETER_BY_NAME[name].label
        tests = source.problem.experiments
        same = [test.id for test in tests if _same_apparatus(test, experiment, condition)]
        if same:
            fitted = source.tests[same[0]].posterior["posterior"].to_dataset()[name]
            others[name] = all_draws(fitted)[kept].astype(np.float64)
            notes.append(f"The {label} is that of {same[0]}.")
        else:
            others[name] = condition.sd * rng.standard_normal(kept.size)
            notes.append(f"The {label} is drawn anew, as the file states it.")
    notes += [
        f"The {PARAMETER_BY_NAME[name].label} is taken as none, because the file states no error."
        for name in source.problem.free
        if name in CONDITIONS and name not in others
    ]
    return others, notes


def add_noises(
    values: Mapping[str, FloatArray],
    fitted: Problem,
    experiment: Experiment,
    separate_from: str | None = None,
) -> tuple[dict[str, FloatArray], list[str]]:
    """Return values with the noise of new readings: that of the fit, a stated one, or none.

    `values` (n_kept,): parameters by name (SI). `separate_from`: the test that those which tests
    do not share are of; None if they are of all. Quantities that are not read have no noise.
    """
    found, notes = dict(values), []
    n_draws = len(next(iter(values.values())))
    own = [test for test in fitted.experiments if separate_from in (None, test.id)]
    read = {name for test in own for name in test.noises}
    unread = found.keys() & BY_NOISE.keys() - experiment.noises.keys()
    found |= {name: np.full(n_draws, BY_NOISE[name].negligible_noise) for name in unread}
    for name, stated in experiment.noises.items():
        noise = PARAMETER_BY_NAME[name]
        if name in read and name in values:
            size, origin = float(values[name].mean()), "of the fit"
        elif stated == 0 and experiment.n_points > 0:
            found[name] = np.zeros(n_draws)
            notes.append(f"New readings have no {noise.label} beside their stated errors.")
            continue
        elif stated:
            size, origin = stated, "that the file of the test states"
            found[name] = np.full(n_draws, stated)
        elif experiment.n_points > 0:
            raise InputError(
                f"{experiment.id}: the fit has no {noise.label} and the file states none, expected "
                "an uncertainty of the readings in [data]."
            )
        else:
            found[name] = np.full(n_draws, BY_NOISE[name].negligible_noise)
            notes.append(f"The fit has no {noise.label}, so that new readings have no noise here.")
            continue
        shown = f"{size * noise.display_factor:.3g}{unit_after_number(noise)}"
        notes.append(f"New readings scatter by the {noise.label} {origin}, {shown} on average.")
    return found, notes


def bounds_around(values: Mapping[str, FloatArray], fitted: PriorSet) -> PriorSet:
    """Return bounds around draws, so that every draw has coordinates; what was fixed stays so.

    Parameters between two bounds keep coordinates of their own, none is that of a point of the
    flow law.
    """
    return PriorSet(
        material=fitted.material,
        title=f"draws of a fit with {fitted.title}",
        priors={name: _box(fitted[name], own) for name, own in values.items()},
        name="draws",
    )


def _box(fitted: Prior, values: FloatArray) -> Prior:
    parameter = PARAMETER_BY_NAME[fitted.parameter]
    low, high = float(values.min()), float(values.max())
    # One draw alone does not vary either, but needs coordinates.
    width = high - low if high > low else abs(low)
    if low == high and (fitted.is_fixed or width == 0):
        return fixed_prior(parameter, low, "fixed in the fit")
    lower, upper = low - BOX_MARGIN * width, high + BOX_MARGIN * width
    ends, unit = {"lower": lower, "upper": upper}, parameter.si_unit
    return Prior.of_family(parameter.name, "uniform", ends, unit=unit, source="draws of a fit")


def laws_of_grains(fitted: ModelVariant) -> dict[str, str]:
    """Return what a variant is told of grains that evolve otherwise than in the standard law."""
    return {} if fitted.grain_size == "evolving" else {"grain_size": fitted.grain_size}


def transfer_laws(
    priors: PriorSet, fitted: Problem, experiment: Experiment
) -> tuple[PriorSet, list[str]]:
    """Return priors that give a test the laws of a fit, as far as it can have them, and notes."""
    laws = fitted.variant
    if laws.residuals not in experiment.laws.get("residuals", (laws.residuals,)):
        standard = (
            fixed_prior(PARAMETER_BY_NAME[name], STANDARD_VALUES[name], "not of such tests")
            for name in RESIDUAL_CORRELATION
        )
        priors = priors.exchanging(*standard)
    grains = laws_of_grains(laws)
    is_piezometric = variant_of(priors, experiment).grain_size == "piezometric"
    if not grains and is_piezometric and is_fixed_at(priors["piezometer_reference_grain_size"], 0):
        raise InputError(
            f"{experiment.id}: the grain size of tests of the protocol {experiment.protocol} "
            "follows a piezometer, which the fit has not, expected a fit with priors of a "
            "piezometer, or pyburgers simulate with --from RUN --variant grain_size=constant."
        )
    priors = with_variant(priors, experiment, grains)
    here = variant_of(priors, experiment).record()
    return priors, [
        f"{part.replace('_', ' ').capitalize()}: {here[part]} in such a test, {law} in the fit."
        for part, law in laws.record().items()
        if here[part] != law
    ]


def _listed(names: Sequence[str]) -> str:
    return ", ".join(PARAMETER_BY_NAME[name].label for name in names)
