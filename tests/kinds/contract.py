"""What holds for every kind; `tests/support/kind_examples.py` has tests of each."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import replace
from functools import cache
from pathlib import Path

import numpy as np
import pytest
from conftest import search_little, sketch_pictures, with_fixed
from kind_examples import EXAMPLES
from log_density import Program, assert_gradient_is_slope, program_with
from page import page_of
from refusals import refusal
from same_contents import assert_equal
from scipy import stats
from stan_data import one_test_data, parameters_in
from truth_as_mode import at_truth
from truths import truth_of

from pyburgers.checks.fit_checks import Outcome
from pyburgers.common.array_types import FloatArray
from pyburgers.drawing.view import views
from pyburgers.fitting.charts_at_modes import at_mode, find_mode
from pyburgers.fitting.fit import Fit, fit
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.kind import kinds, load_experiment, save_experiment
from pyburgers.kinds.likelihood import AtMode, likelihood_of, likelihoods
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import density_of
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.parameters import PROGRAM_PARAMETERS
from pyburgers.model.priors import default_priors
from pyburgers.page.posterior_figures import figures_for
from pyburgers.page.tables import truth_table
from pyburgers.sampling.options import SamplerOptions

RecordProperty = Callable[[str, object], None]
pytestmark = pytest.mark.usefixtures("programs")


def cases(*groups: str, of: Callable[[str], Sequence[str]] | None = None) -> pytest.MarkDecorator:
    """Run over the tests of some kinds of every kind, and over what `of` gives for it."""
    params = []
    for kind, example in EXAMPLES.items():
        for name in (name for group in groups for name in getattr(example, group)):
            params += [
                pytest.param(kind, name, *more, id="-".join([name, *more]))
                for more in ([(one,) for one in of(kind)] if of else [()])
            ]
    names = ["kind", "name", *(["what"] if of else [])]
    return pytest.mark.parametrize(names, params)


def test_every_kind_is_tested() -> None:
    assert set(EXAMPLES) == set(kinds())


@cases("twins", "measured")
def test_a_copy_reads_back_exactly_and_its_copy_is_the_same_file(
    kind: str, name: str, tmp_path: Path
) -> None:
    experiment = EXAMPLES[kind].load(name)
    assert experiment.protocol == kind
    written = []
    for folder in (tmp_path / "one", tmp_path / "two"):
        folder.mkdir()
        read = load_experiment(save_experiment(experiment, folder))
        assert_equal(read, experiment)
        written.append({file.name: file.read_bytes() for file in folder.iterdir()})
        experiment = read
    assert written[0] == written[1]
    assert "experiment.toml" in written[0]
    inside = tmp_path / "inside.toml"
    experiment.to_toml(inside)
    assert [file for file in tmp_path.iterdir() if file.is_file()] == [inside]
    assert_equal(load_experiment(inside), experiment)


BAD_TABLES: Mapping[str, Callable[[list[str]], list[str]]] = {
    "empty": lambda lines: [],
    "header alone": lambda lines: lines[:1],
    "no header": lambda lines: lines[1:],
    "a word": lambda lines: [*lines[:3], "high," + lines[3].split(",", 1)[1], *lines[4:]],
    "an empty cell": lambda lines: [*lines[:3], "," + lines[3].split(",", 1)[1], *lines[4:]],
    "a short row": lambda lines: [*lines[:3], lines[3].split(",")[0], *lines[4:]],
    "not a number": lambda lines: [*lines[:3], "nan," + lines[3].split(",", 1)[1], *lines[4:]],
    "infinite": lambda lines: [*lines[:3], lines[3].rsplit(",", 1)[0] + ",inf", *lines[4:]],
    "too large": lambda lines: [*lines[:3], lines[3].rsplit(",", 1)[0] + ",-1e200", *lines[4:]],
    "too small": lambda lines: [lines[0], *(f"{x.rsplit(',', 1)[0]},1e-300" for x in lines[1:])],
    "backwards": lambda lines: [lines[0], *lines[:0:-1]],
}


def bad_tables(kind: str) -> tuple[str, ...]:
    """Kinds of bad tables of a kind: rows of tables of attenuation may be in any order."""
    return tuple(what for what in BAD_TABLES if (kind, what) != ("attenuation", "backwards"))


@cases("twins", of=bad_tables)
def test_a_bad_table_is_refused_by_name_in_one_sentence(
    kind: str, name: str, what: str, tmp_path: Path
) -> None:
    path = save_experiment(EXAMPLES[kind].load(name), tmp_path)
    tables = sorted(tmp_path.glob("*.csv"))
    assert tables
    for table in tables:
        good = table.read_text(encoding="utf-8")
        lines = BAD_TABLES[what](good.splitlines())
        table.write_text("".join(f"{line}\n" for line in lines), encoding="utf-8")
        refusal(path)
        table.unlink()
        refusal(path)
        table.write_text(good, encoding="utf-8")
    assert load_experiment(path).n_points > 0


@cases("twins", "stepped", of=lambda kind: tuple(EXAMPLES[kind].materials))
def test_the_solution_agrees_with_an_independent_solver(kind: str, name: str, what: str) -> None:
    example = EXAMPLES[kind]
    experiment = example.load(name)
    values = {**truth_of(experiment), **example.materials[what]}
    clock = likelihoods()[kind].clock.column
    wanted = likelihoods()[kind].grid(experiment)
    solution = simulate(experiment, values, at=wanted)
    assert tuple(solution) == example.columns
    at = solution[clock].to_numpy()
    np.testing.assert_allclose(at[np.isin(at, wanted)], wanted, rtol=1e-12)
    expected = example.solution(experiment, values, at)
    read = {quantity.column for quantity in likelihoods()[kind].read}
    assert {*read, "kelvin_strain"} & set(example.columns) <= set(expected)
    for column, found in expected.items():
        swings = column in ("stress_Pa", "kelvin_strain")
        np.testing.assert_allclose(
            solution[column],
            found,
            rtol=0.0 if swings else 1e-5,
            atol=5e-7 * np.ptp(found) if swings else 0.0,
            err_msg=column,
        )


@cache
def at_truth_or_mode(kind: str, name: str) -> AtMode[Experiment]:
    """The search for a mode takes seconds, and several tests start there."""
    experiment = EXAMPLES[kind].load(name)
    priors = default_priors(experiment.material, experiment.protocol)
    solver = SolverOptions(tolerance=1e-6)
    if experiment.true_parameters is not None:
        return at_truth(experiment, priors, solver)
    problem = problem_of([experiment], priors)
    (mode,) = find_mode(problem, density_of(problem, solver), seed=1).tests
    return at_mode(problem, mode, solver)


def program_in(
    name_of_protocol: str, name: str, system: str, folder: Path
) -> tuple[Program, FloatArray]:
    """The program of a test in some coordinates, and those of its truth or mode."""
    experiment = EXAMPLES[name_of_protocol].load(name)
    own, test = likelihood_of(experiment), at_truth_or_mode(name_of_protocol, name)
    reference, centre = None, test.mode.coordinate
    if system == own.chart.name:
        reference, centre = own.chart.reference(test)
        # Whatever the covariance, the posterior is the same.
        reference = own.chart.rescaled(reference, test, 0.04 * np.eye(centre.size))
    data = one_test_data(
        experiment, test.priors, solver=EXAMPLES[experiment.protocol].tight, reference=reference
    )
    return program_with(own.program, data, folder), np.append(centre, test.mode.driving_error)


def vector(columns: Mapping[str, float], name: str, size: int) -> FloatArray:
    return np.array([columns[f"{name}.{k + 1}"] for k in range(size)])


def charts(kind: str) -> Sequence[str]:
    return "plain", likelihoods()[kind].chart.name


@cases("twins", "measured", of=charts)
def test_the_density_is_prior_likelihood_and_jacobian(
    kind: str, name: str, what: str, tmp_path: Path
) -> None:
    """The density less the Jacobian's logarithm does not depend on the coordinates."""
    example = EXAMPLES[kind]
    experiment = example.load(name)
    (priors,) = problem_of(
        [experiment], default_priors(experiment.material, experiment.protocol)
    ).priors
    program, centre = program_in(kind, name, what, tmp_path)
    rng = np.random.default_rng(5)
    # From close by to as far away as the prior reaches.
    for width in np.geomspace(0.1, 1.5, 3):
        point = centre + width * rng.standard_normal(centre.size)
        columns = program.columns_at({"coordinate": point.tolist()})
        values = parameters_in(columns)
        prior = sum(priors[free].distribution().logpdf(values[free]) for free in priors.free)
        response = vector(columns, "response_model", experiment.n_points)
        likelihood = example.log_likelihood(experiment, values, response)
        np.testing.assert_allclose(
            vector(columns, "log_lik", experiment.n_points), likelihood, rtol=1e-8, atol=1e-8
        )
        assert columns["lprior"] == pytest.approx(prior, rel=1e-8)
        errors = stats.norm.logpdf(point[point.size - experiment.n_driving_errors :])
        expected = prior + np.sum(likelihood) + columns["log_jacobian"] + np.sum(errors)
        assert columns["lp__"] == pytest.approx(expected, rel=1e-7)


@cases("quick", of=charts)
def test_the_gradient_is_the_slope_of_the_density(
    kind: str, name: str, what: str, tmp_path: Path
) -> None:
    program, centre = program_in(kind, name, what, tmp_path)
    point = centre + 0.1 * np.random.default_rng(8).standard_normal(centre.size)
    assert_gradient_is_slope(program, point)


@cases("quick")
def test_a_fit_is_kept_and_shown(
    kind: str, name: str, monkeypatch: pytest.MonkeyPatch, tmp_path: Path
) -> None:
    sketch_pictures(monkeypatch, drawn_once=True)
    search_little(monkeypatch)
    example = EXAMPLES[kind]
    experiment = example.load(name)
    priors = default_priors(experiment.material, experiment.protocol)
    truth = truth_of(experiment)
    known = {name: truth[name] for name in priors.free if name not in example.few}
    result = fit(
        experiment,
        with_fixed(priors, known),
        out=tmp_path / "run",
        options=SamplerOptions(chains=2, warmup=20, draws=20, seed=1, adapt_delta=0.8),
    )
    kept = Fit.load(result.directory.path)
    assert_equal(kept.experiment, experiment)
    assert kept.summary("SI").equals(result.summary("SI"))
    assert_draws_are_labelled(kept, example.few)
    assert kept.posterior.attrs["protocol"] == kind
    page = page_of([kept], tmp_path / "page")
    assert not page.open
    recipes = figures_for(kept)
    assert page.alternatives == [f"{recipe.title}, run: {recipe.result}" for recipe in recipes]
    for recipe in recipes:
        assert recipe.result.endswith(".")
        assert (tmp_path / "page" / "figures" / f"run_{recipe.name}.svg").is_file()
    assert experiment.temperature_text in page.text
    for fact, _ in views()[kind].facts(experiment):
        assert fact in page.text
    for table in views()[kind].tables(kept):
        assert table.title in page.text
        assert (tmp_path / "page" / "tables" / f"run_{table.name}.csv").is_file()


def assert_draws_are_labelled(result: Fit, free: Sequence[str]) -> None:
    """By the protocol's names, with one column for each point and position."""
    own, experiment = likelihood_of(result.experiment), result.experiment
    posterior = result.posterior["posterior"].to_dataset()
    assert {p.name for p in PROGRAM_PARAMETERS} | {own.reference.name} >= set(posterior)
    assert own.reference.name in posterior
    for name in free:
        assert np.ptp(posterior[name].to_numpy()) > 0
    response = own.response.name
    for group in ("log_likelihood", "posterior_predictive"):
        assert result.posterior[group][response].sizes["point"] == experiment.n_points
    predictions = result.posterior["predictions"].to_dataset()
    assert {name for name, _ in own.grid_quantities.values()} <= set(predictions)
    np.testing.assert_allclose(predictions[own.clock.name], own.grid(experiment))


@pytest.mark.slow
@cases("twins")
def test_the_truth_of_a_twin_is_recovered(
    kind: str, name: str, tmp_path: Path, record_property: RecordProperty
) -> None:
    """The truth lies inside the simultaneous 95 % interval of the k parameters.

    That is a central interval of 1 - 0.05/k for each (Bonferroni): a right program misses it for at
    most 5 % of data sets, however the parameters hang together. Every truth inside its own 95 %
    is more than a right program does: it misses that for up to 1 - 0.95^k, 43 % for eleven.
    """
    example = EXAMPLES[kind]
    experiment = example.load(name)
    priors = default_priors(experiment.material, experiment.protocol)
    # As many draws as are asked for, also where the machine is slow or busy.
    options = replace(example.options, max_minutes=60.0)
    result = fit(experiment, priors, out=tmp_path / "run", options=options)
    assert result.manifest["coordinates"]["system"] == likelihoods()[kind].chart.name
    truth = truth_table(result)
    assert truth is not None
    assert len(truth) == len(result.problem.free)
    print(truth.drop(columns="unit").to_string())
    for share in (50, 90):
        inside = int(truth[f"inside_{share}"].sum())
        record_property(f"inside_{share}", inside)
        print(f"{name}: {inside} of {len(truth)} true values inside the central {share} % interval")
    draws = result.posterior["posterior"].to_dataset()[list(truth.index)].to_dataframe()
    below = (draws < truth["truth"]).mean()
    record_property("quantiles", below.to_dict())
    tail = 2 * below.where(below < 0.5, 1 - below)
    assert tail[tail < 0.05 / len(tail)].to_dict() == {}
    # A correlated share of 0.6 cannot be told from a misfit, and the size of residuals says so.
    unsure = (
        ("size of residuals", Outcome.CANNOT_TELL) if result.variant.residuals_correlate else None
    )
    wrong = [one for one in result.checks() if not one.passed and (one.name, one.outcome) != unsure]
    assert [check.sentence for check in wrong] == []
