"""Who decides a number: exact linear models, bounds, conflicts by simulation, a real fit."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from conftest import ICE, SMALL_RUN, write_problem
from linear_priors import (
    NAMES,
    flow_law,
    labelled,
    normal_fits,
    prior_set,
    standard_normal,
    uniform,
    uniform_fits,
)
from scipy import stats

from pyburgers.checks.prior_influence import (
    Bound,
    Influence,
    Origin,
    conflict_sentence,
    conflicts,
    decision_columns,
    decision_sentences,
    decision_text,
    influence_numbers,
    prior_influence,
)
from pyburgers.common.array_types import FloatArray
from pyburgers.fitting.fit import fit
from pyburgers.fitting.prior_draws import scores_beside
from pyburgers.kinds.attenuation.files import load_attenuation
from pyburgers.kinds.constant_rate.files import load_constant_rate
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.problem import one_test, problem_of
from pyburgers.kinds.together import default_priors_for, pooling_for
from pyburgers.model.flow_law_prior import PRIOR_QUANTITIES, Conditions
from pyburgers.model.parameters import PARAMETER_BY_NAME
from pyburgers.model.prior_families import Prior, normal_scores
from pyburgers.model.priors import JOINT_PRIOR, PriorSet, with_flow_law
from pyburgers.posterior.labelled_draws import groups_of_tests

N_DRAWS = 4000


def influence_of(reading: float, deviation: float) -> Influence:
    """Influence on beta, whose prior is N(0, 1), where the data are one reading of it."""
    left = 1 / (1 + deviation**-2)
    quantiles = stats.norm.ppf((np.arange(N_DRAWS) + 0.5) / N_DRAWS)
    draws = (1 - left) * reading + np.sqrt(left) * np.random.default_rng(1).permutation(quantiles)
    (found,) = prior_influence(
        labelled(draws[:, None], priors := prior_set(standard_normal("beta"))), priors
    ).values()
    return found


@pytest.mark.parametrize("deviation", [0.1, 1.0, 3.0])
def test_the_share_of_a_prior_is_what_it_has_of_the_information(deviation: float) -> None:
    found = influence_of(0.3, deviation)
    assert found.prior_share == pytest.approx(1 / (1 + deviation**-2), rel=0.01)
    assert found.chance == 0.0


def test_a_move_is_how_far_the_mean_goes_if_a_prior_goes_by_one_sd() -> None:
    """Of a linear model with two priors the move of the mean is known in closed form."""
    design = np.array([[1.0, 4.0], [0.2, 0.1]])
    covariance = np.linalg.inv(np.eye(2) + design.T @ design)
    draws = np.random.default_rng(1).multivariate_normal([0.2, -0.1], covariance, 100_000)
    priors = prior_set(standard_normal("stress_exponent"), standard_normal("beta"))
    found = prior_influence(labelled(draws, priors), priors)
    for k, name in enumerate(found):
        exact = covariance[k] / np.sqrt(covariance[k, k])
        assert list(found[name].moves.values()) == pytest.approx(list(exact), abs=0.01)
        by_data = covariance[k] @ design.T @ design @ covariance[k] / covariance[k, k]
        assert found[name].prior_share == pytest.approx(1 - by_data, abs=0.01)


def trade_off() -> tuple[xr.DataTree, PriorSet]:
    """Draws of data that fix n + z: n has a wide uniform prior, z = (Q_M - 65)/2 a normal one."""
    rng = np.random.default_rng(5)
    score = rng.standard_normal(N_DRAWS)
    exponent = 3.6 - 0.15 * score + 0.05 * rng.standard_normal(N_DRAWS)
    wide = Prior("stress_exponent", "uniform", 3.6, 0.9, 2.7, 4.5, "1", "test")
    enthalpy = Prior("activation_enthalpy", "normal", 65e3, 2e3, -np.inf, np.inf, "J/mol", "test")
    priors = prior_set(wide, enthalpy)
    return labelled(np.stack([exponent, 65e3 + 2e3 * score], axis=1), priors), priors


def test_n_on_a_trade_off_is_decided_by_the_prior_of_the_enthalpy() -> None:
    """Its width is a third of that of its own prior, which says nothing of who decides it."""
    found = prior_influence(*trade_off())
    exponent = found["stress_exponent"]
    assert exponent.origin is Origin.PRIOR
    assert exponent.priors == ("activation_enthalpy",)
    assert exponent.moves["activation_enthalpy"] == pytest.approx(-0.95, abs=0.02)
    decided = decision_columns(exponent)
    assert decided["decided_by"] == "prior"
    assert decided["by_prior_of"] == "activation_enthalpy"
    assert decision_text("stress_exponent", "prior", "activation_enthalpy") == "prior (of Q_M)"
    assert decision_text("beta", "prior", "beta") == "prior"
    assert decision_text("beta", "data", "") == "data"
    # Its own prior alone needs no brackets, but for what it was read off.
    assert decision_text("beta", "prior", "beta [read off these data]") == (
        "prior [read off these data]"
    )
    (sentence,) = decision_sentences(found)
    assert sentence.startswith(
        "The prior of activation enthalpy decides stress exponent, not the data. If that prior"
    )
    assert "n would move by 0.95 of its own" in sentence


@pytest.mark.parametrize(
    ("reading", "deviation", "origin"),
    [
        (0.0, 30.0, Origin.PRIOR),
        (0.5, 0.05, Origin.DATA),
        (0.5, 1.0, Origin.BOTH),
        (8.0, 1.0, Origin.CONFLICT),
        (4.0, 0.05, Origin.CONFLICT),
        (2.0, 0.05, Origin.DATA),
    ],
)
def test_words_for_one_reading(reading: float, deviation: float, origin: Origin) -> None:
    assert influence_of(reading, deviation).origin is origin


def test_draws_of_no_use_decide_nothing() -> None:
    found = replace(influence_of(8.0, 1.0), usable=False)
    assert found.origin is Origin.CANNOT_TELL
    assert not found.is_conflict
    assert conflict_sentence({"beta": found}) is None


def test_few_draws_that_chance_correlates_with_many_priors_cannot_tell() -> None:
    priors = prior_set(*map(standard_normal, NAMES))
    draws = np.random.default_rng(1).standard_normal((60, len(NAMES)))
    draws[:, 0] *= 0.01
    found = prior_influence(labelled(draws, priors), priors)[NAMES[0]]
    assert found.origin is Origin.CANNOT_TELL
    more = np.random.default_rng(1).standard_normal((2000, len(NAMES)))
    more[:, 0] *= 0.01
    assert prior_influence(labelled(more, priors), priors)[NAMES[0]].origin is Origin.DATA


def test_priors_that_other_tests_alone_have_count_too() -> None:
    """Each test reads a shared number plus one of its own exactly: the priors decide all."""
    n_tests = 5
    covariance = np.eye(1 + n_tests)
    design = np.hstack([np.ones((n_tests, 1)), np.eye(n_tests)])
    gain = covariance @ design.T @ np.linalg.inv(design @ design.T)
    left = covariance - gain @ design
    draws = np.random.default_rng(1).multivariate_normal(np.zeros(1 + n_tests), left, N_DRAWS)
    priors = prior_set(standard_normal("beta"), standard_normal("stress_exponent"))
    of_test = labelled(draws[:, :2], priors)
    others = {f"stress_exponent[{k}]": draws[:, k, None] for k in range(2, 1 + n_tests)}
    assert prior_influence(of_test, priors)["beta"].origin is Origin.BOTH
    found = prior_influence(of_test, priors, scores_beside=others)["beta"]
    assert found.prior_share == pytest.approx(1.0, abs=0.02)
    assert found.origin is Origin.PRIOR


def test_a_flow_rate_over_many_powers_of_ten_counts_by_its_logarithm() -> None:
    draws = np.random.default_rng(1).standard_normal(N_DRAWS)
    priors = prior_set(standard_normal("beta"))
    found = prior_influence(
        labelled(draws[:, None], priors), priors, derived={"reference_flow_rate": np.exp(9 * draws)}
    )
    assert found["reference_flow_rate"].prior_share == pytest.approx(1.0, abs=0.02)


def piled(bound: float, draws: FloatArray) -> Influence:
    """Influence on a quantity with a uniform prior of which one bound is given, the other 10."""
    name = "kelvin_modulus"
    lower, upper = sorted((bound, 10.0))
    middle, half = 0.5 * (lower + upper), 0.5 * (upper - lower)
    unit = PARAMETER_BY_NAME[name].si_unit
    priors = prior_set(Prior(name, "uniform", middle, half, lower, upper, unit, "test"))
    return prior_influence(labelled(draws[:, None], priors), priors)[name]


def test_a_posterior_piled_against_a_bound_is_no_measurement() -> None:
    draws = 0.5 + 0.016 * np.random.default_rng(1).exponential(size=N_DRAWS)
    found = piled(0.5, draws)
    assert found.origin is Origin.BOUND
    assert found.bound is not None
    assert (found.bound.side, found.bound.value) == ("lower", 0.5)
    assert found.bound.share == pytest.approx(1 - np.exp(-0.5), abs=0.03)
    (sentence,) = decision_sentences({"kelvin_modulus": found})
    assert sentence.endswith(
        "Check the data and their units first; then widen the prior, or say in its 'source' why it "
        "ends there."
    )
    assert influence_numbers({"kelvin_modulus": found})["decided_by"].tolist() == ["bound"]
    # A bound of the model is a limit.
    found = piled(0.0, draws - 0.5)
    assert found.bound is not None
    assert found.bound.is_physical
    (sentence,) = decision_sentences({"kelvin_modulus": found})
    assert "as a limit" in sentence
    assert "widen" not in sentence


@pytest.mark.parametrize(("n", "physical", "told"), [(2, 0, False), (3, 0, True), (2, 1, False)])
def test_several_numbers_at_bounds_point_to_a_wrong_input(
    n: int, physical: int, told: bool
) -> None:
    draws = 0.016 * np.random.default_rng(1).exponential(size=N_DRAWS)
    found = {f"stress_exponent[{k}]": piled(0.5, 0.5 + draws) for k in range(n)}
    found |= {f"beta[{k}]": piled(0.0, draws) for k in range(physical)}
    first, *others = decision_sentences(found)
    assert told == first.startswith(f"{n} numbers lie at bounds of their priors")
    assert len(others) == n + physical - 1 + told


def test_a_noise_that_is_larger_than_its_prior_asks_for_the_second_verdict() -> None:
    far = influence_of(6.0, 0.01)
    noise, both = (
        conflict_sentence(dict.fromkeys(names, far))
        for names in (("stress_noise[A]",), ("stress_noise[A]", "beta"))
    )
    assert "noise takes up what the model misses" in str(noise)
    assert "a compromise of the two" in str(both)


def test_priors_that_decide_together_are_all_named() -> None:
    two = Influence("beta", {"activation_enthalpy": 0.58, "beta": -0.55, "stress_exponent": 0.3})
    assert two.origin is Origin.PRIOR
    (sentence,) = decision_sentences({"beta[A]": two})
    assert sentence == (
        "The priors of activation enthalpy and pre-exponent ln(A)/Q together decide "
        "pre-exponent ln(A)/Q[A], not the data. If one of them moved by one of its standard "
        "deviations, β[A] would move by 0.58 or 0.55 of its own."
    )


def test_a_bound_does_not_hide_the_prior_that_would_decide_without_it() -> None:
    exponent = prior_influence(*trade_off())["stress_exponent"]
    at_bound = replace(exponent, bound=Bound("upper", 4.5, 0.2, is_physical=False))
    assert at_bound.origin is Origin.BOUND
    assert at_bound.priors == ("stress_exponent", "activation_enthalpy")
    by = str(decision_columns(at_bound)["by_prior_of"])
    assert "," not in by  # it stands in CSV files
    assert decision_text("stress_exponent", "bound", by) == "bound (of n, Q_M)"


def test_sentences_about_a_test_of_a_joint_fit_name_the_test() -> None:
    own = prior_influence(*trade_off())["activation_enthalpy"]
    assert decision_sentences({"activation_enthalpy[A]": own}) == ()
    draws = 0.5 + 0.016 * np.random.default_rng(1).exponential(size=N_DRAWS)
    (sentence,) = decision_sentences({"kelvin_modulus[A]": piled(0.5, draws)})
    assert "decides Kelvin modulus[A]: " in sentence


@pytest.mark.parametrize(("at", "is_bound"), [(-1.5, False), (-0.5, True), (0.5, True)])
def test_a_bound_decides_where_it_cuts_off_a_good_part(at: float, *, is_bound: bool) -> None:
    law = stats.truncnorm(at, np.inf, loc=1.0 - 0.1 * at, scale=0.1)
    found = piled(1.0, law.rvs(N_DRAWS, random_state=1))
    assert (found.bound is not None) == is_bound


def test_a_posterior_that_hardly_leans_towards_a_bound_is_not_piled_there() -> None:
    """A density that rises to the bound all the way from the other end: most is the prior's."""
    found = piled(0.5, 10.0 - 9.5 * (1.0 - np.sqrt(np.random.default_rng(2).uniform(size=N_DRAWS))))
    assert found.bound is None
    assert found.origin in (Origin.PRIOR, Origin.BOTH)
    flat = piled(0.5, np.random.default_rng(2).uniform(0.5, 10.0, N_DRAWS))
    assert (flat.bound, flat.origin) == (None, Origin.PRIOR)


def counted(
    fits: Iterator[tuple[xr.DataTree, PriorSet]], name: str | None = None
) -> tuple[int, int]:
    """Return in how many fits prior and data are said to disagree, about a quantity if named."""
    found = [prior_influence(*one) for one in fits]
    telling = [conflicts({name: one[name]} if name else one) for one in found]
    return sum(map(bool, telling)), len(found)


@pytest.mark.parametrize(
    ("n", "most", "most_uniform"), [(20, 2, 1), pytest.param(200, 6, 3, marks=pytest.mark.slow)]
)
def test_correct_models_hardly_ever_report_a_conflict(n: int, most: int, most_uniform: int) -> None:
    """4 of 200 are 1 in 50; at the level of 0.01 more than 6 come once in 250 times."""
    told, of = counted(normal_fits(n, 11, draws=200))
    assert told <= most
    assert of == n
    assert counted(uniform_fits(n * 3 // 10, 12, draws=200, noise=0.1))[0] <= most_uniform


def test_a_truth_four_standard_deviations_out_is_told() -> None:
    told, of = counted(normal_fits(20, 13, draws=200, away=4.0), NAMES[0])
    assert told >= 0.8 * of


def test_a_conflict_says_how_far_and_which_comes_first() -> None:
    near, far = influence_of(4.0, 0.01), influence_of(-6.0, 0.01)
    assert near.distance == pytest.approx(4.0, abs=0.01)
    found = {"stress_exponent": near, "beta": far}
    assert conflicts(found) == ["beta", "stress_exponent"]
    text = conflict_sentence(found)
    assert text is not None
    assert text.startswith(
        "Prior and data disagree about pre-exponent ln(A)/Q (-6.0 sd of a normal prior), "
    )


def test_more_quantities_of_a_fit_need_more_of_a_conflict() -> None:
    draws = 3.0 + 1e-3 * np.random.default_rng(1).standard_normal((N_DRAWS, 1))
    priors = prior_set(standard_normal("beta"))
    alone, among_many = (
        prior_influence(labelled(draws, priors), priors, family=family)["beta"]
        for family in (None, 12)
    )
    assert alone.is_conflict
    assert not among_many.is_conflict
    assert among_many.conflict_probability == pytest.approx(12 * alone.conflict_probability)


def test_a_lognormal_prior_counts_in_its_logarithm() -> None:
    draws = np.exp(3.0 + 1e-3 * np.random.default_rng(1).standard_normal((N_DRAWS, 1)))
    priors = prior_set(Prior("kelvin_modulus", "lognormal", 1.0, 1.0, 0.0, np.inf, "Pa", "test"))
    found = prior_influence(labelled(draws, priors), priors)["kelvin_modulus"]
    assert found.distance == pytest.approx(3.0, abs=0.01)
    assert found.bound is None


def test_the_distance_from_a_prior_that_is_cut_counts_by_probability() -> None:
    """0.54 is 1.73 standard deviations below the middle of N(4, 2) cut at 0."""
    law = Prior("maxwell_modulus", "normal", 4.0, 2.0, 0.0, np.inf, "Pa", "test")
    below, cut = (float(stats.norm.cdf((x - 4.0) / 2.0)) for x in (0.54, 0.0))
    exact = stats.norm.ppf((below - cut) / (1 - cut))
    assert normal_scores(law.distribution(), np.array([0.54])) == pytest.approx(exact)
    # Scores reach far into both tails and are finite at a bound.
    normal_law = standard_normal("beta").distribution()
    assert normal_scores(normal_law, np.array([-30.0, 30.0])) == pytest.approx([-30.0, 30.0])
    assert np.isfinite(normal_scores(uniform("beta").distribution(), np.array([1.0, 2.0]))).all()


def test_a_prior_that_was_read_off_the_data_is_named() -> None:
    posterior, priors = trade_off()
    enthalpy = replace(priors["activation_enthalpy"], read_off=("sample 4581", "10.1/other"))
    marked = priors.exchanging(enthalpy)
    read_off = marked.read_off(["mine, digitised from sample 4581 10.1/abc"])
    found = prior_influence(posterior, marked, read_off=read_off)
    decided = decision_columns(found["stress_exponent"])
    assert decided["by_prior_of"] == "activation_enthalpy [read off these data]"
    assert (
        decision_text("stress_exponent", "prior", str(decided["by_prior_of"]))
        == "prior (of Q_M [read off these data])"
    )
    sentence = decision_sentences(found)[-1]
    assert sentence.startswith("Priors that were read off these data: Q_M. ")
    assert "agreement of prior and data means nothing" in sentence
    assert marked.read_off(["4580, sample 4580 10.1/abc"]) == frozenset()
    elsewhere = prior_influence(posterior, marked)
    assert "read off" not in " ".join(decision_sentences(elsewhere))


def test_a_joint_prior_counts_as_one() -> None:
    law = flow_law([4.0, 0.5, -10.0, -7e-4], [0.3, 0.1, 0.2, 1e-6], Conditions(260.0, 9e6, 2e-4))
    single = prior_set(*map(standard_normal, NAMES))
    priors = with_flow_law(single, law, "test")
    rng = np.random.default_rng(1)
    drawn = [law.sample(rng) for _ in range(N_DRAWS)]
    columns = [
        np.array([one[name] for one in drawn]) if name in drawn[0] else rng.standard_normal(N_DRAWS)
        for name in priors.free
    ]
    found = prior_influence(labelled(np.transpose(columns), priors), priors)
    exponent = found["stress_exponent"]
    assert exponent.origin is Origin.PRIOR
    assert exponent.priors == (JOINT_PRIOR,)
    assert exponent.moves[JOINT_PRIOR] == pytest.approx(1.0, abs=0.05)
    assert decision_text("stress_exponent", "prior", JOINT_PRIOR) == "prior (of the flow law)"


GRAIN_SIZE, CURVES = "steady_state_grain_size", ("PIL40", "PIL72")


def dataset(draws: Mapping[str, FloatArray]) -> xr.Dataset:
    """Return draws of shape (n,) as those of one chain."""
    return xr.Dataset(
        {name: (("chain", "draw"), one[None], {"fixed": 0}) for name, one in draws.items()}
    )


@pytest.mark.parametrize(
    ("away", "known", "spread", "origin", "deciders"),
    [
        (0.0, 1.0, 0.1, Origin.PRIOR, ("[centre]",)),
        (0.0, 0.01, 0.4, Origin.PRIOR, ("[PIL40]",)),
        (4.0, 0.01, 0.9, Origin.BOUND, ("", "[PIL40]")),
    ],
)
def test_a_pooled_parameter_is_decided_by_the_prior_of_its_centre_or_of_its_deviation(
    away: float, known: float, spread: float, origin: Origin, deciders: Sequence[str]
) -> None:
    """Of a curve whose data say nothing of it; a table, which has none, has one of the curves."""
    tests: list[Experiment] = [load_constant_rate(ICE / f"{name}.toml") for name in CURVES]
    tests.append(load_attenuation(ICE / "attenuation_twin.toml"))
    problem = problem_of(tests, default_priors_for(tests), pooling_for(tests))
    rng = np.random.default_rng(1)
    plain = problem.coordinates[0]
    k = plain.quantities.index(GRAIN_SIZE)
    real = away + known * rng.logistic(size=N_DRAWS)

    def grain_sizes(numbers: FloatArray) -> FloatArray:
        return np.array([plain.value(k, one) for one in numbers])

    of_all = {
        f"{GRAIN_SIZE}[centre]": grain_sizes(real),
        f"{GRAIN_SIZE}[spread]": spread * np.exp(0.01 * rng.standard_normal(N_DRAWS)),
    }
    groups = {}
    for test, priors in zip(problem.experiments, problem.priors, strict=True):
        own = {
            name: priors[name].distribution().rvs(N_DRAWS, random_state=rng) for name in priors.free
        }
        deviation = of_all[f"{GRAIN_SIZE}[spread]"] * rng.standard_normal(N_DRAWS)
        own[GRAIN_SIZE] = grain_sizes(real + deviation)
        groups[f"tests/{test.id}/posterior"] = dataset(own)
        of_all[f"{GRAIN_SIZE}[{test.id}]"] = own[GRAIN_SIZE]
    groups["posterior"] = dataset(of_all)
    of_tests = groups_of_tests(xr.DataTree.from_dict(groups))
    parts = [*map(one_test, problem.experiments, problem.by_effect())]
    beside = scores_beside(problem, parts, of_tests)
    curve, _, table = (
        prior_influence(of_tests[part.name], part.priors[0], scores_beside=beside[part.name])
        for part in parts
    )
    found = curve[GRAIN_SIZE]
    assert found.origin is origin
    assert found.priors == tuple(f"{GRAIN_SIZE}{one}" for one in deciders)
    assert abs(found.moves[f"{GRAIN_SIZE}[PIL72]"]) < 0.1
    pooled = {f"{GRAIN_SIZE}[{owner}]" for owner in (*CURVES, "centre", "spread")}
    assert pooled < table["maxwell_modulus"].moves.keys()
    assert decision_text("beta", "prior", "beta[centre]") == "prior (of β[centre])"


def test_who_decides_the_numbers_of_a_short_curve(programs: None, tmp_path: Path) -> None:
    problem = write_problem(
        tmp_path / "inputs",
        free={"maxwell_modulus", "activation_enthalpy", "beta", "stress_noise"},
        max_strain=0.02,
        stride=2,
    )
    one = fit(problem.experiment, problem.priors, out=tmp_path / "run", options=SMALL_RUN)
    found = prior_influence(one.posterior, one.priors)
    assert set(found) == {*one.priors.free, "reference_stress"}
    assert found["beta"].origin is Origin.PRIOR
    assert found["beta"].priors[0] == "beta"
    assert found["stress_noise"].origin is Origin.DATA
    assert found["reference_stress"].distance is None


def test_a_joint_prior_whose_flow_rate_the_data_exclude_is_a_conflict() -> None:
    """Each quantity by itself lies within its own prior: Q_M is uncertain through beta."""
    deviations = [1.0, 0.02, 1.0, 1.2e-7**0.5]
    law = flow_law([4.5, 0.2, -23.5, -1.319e-3], deviations, Conditions(294.0, 16e6, 5e-3))
    priors = with_flow_law(prior_set(*map(standard_normal, NAMES)), law, "test")
    rng = np.random.default_rng(1)
    drawn = {name: rng.standard_normal(N_DRAWS) for name in priors.free}
    for name, k in (("stress_exponent", 0), ("grain_size_exponent", 1), ("beta", 3)):
        drawn[name] = law.mean[k] + 0.5 * np.sqrt(law.covariance[k, k]) * drawn[name]
    n, p, beta = (drawn[PRIOR_QUANTITIES[k]] for k in (0, 1, 3))
    log_rate = -18.7 + 0.1 * rng.standard_normal(N_DRAWS)
    drawn["activation_enthalpy"] = law.activation_enthalpy(n, p, log_rate, beta)
    found = prior_influence(labelled(np.transpose([*drawn.values()]), priors), priors)
    assert conflicts(found) == [JOINT_PRIOR]
    assert found["activation_enthalpy"].distance is None
    sentence = conflict_sentence(found)
    assert sentence is not None
    assert "disagree about the flow rate of the flow law (+4.8 sd of a normal prior)" in sentence
    assert not any("flow law" in text for text in decision_sentences(found))
