"""Checks of a fit on made-up draws: each passes on good ones and fails on its own defect."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import pytest
import xarray as xr
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import norm

from pyburgers.checks import fit_checks
from pyburgers.checks.description import check_coverage
from pyburgers.checks.fit_checks import (
    ESS_LIMIT,
    MAX_INFLUENCE,
    MISSED_DRAWS,
    RHAT_LIMIT,
    CheckedDraws,
    CheckKind,
    CheckResult,
    Outcome,
    beyond,
    check_chains,
    check_divergences,
    check_effective_sample_size,
    check_energy,
    check_rhat,
    check_solver,
    check_treedepth,
    coverage,
    influence,
    run_checks,
)
from pyburgers.checks.modes import check_other_modes
from pyburgers.checks.verdicts import CHECKS, verdicts
from pyburgers.common.array_types import FloatArray
from pyburgers.posterior.labelled_draws import DRIVING_ERRORS, convergence_table, free_parameters
from pyburgers.sampling.manifest import ChainFailure, OtherMode

CHAINS, DRAWS, POINTS = 4, 500, 60
FEW = 9
MAX_TREEDEPTH = 10

CheckFunction = Callable[[CheckedDraws], CheckResult]
Defect = Callable[[xr.DataTree], None]
Numbers = dict[str, list[int]]


def good(chains: int = CHAINS, draws: int = DRAWS) -> xr.DataTree:
    """Draws that no check finds fault with."""
    rng = np.random.default_rng(7)
    shape = (chains, draws)
    labels = ("chain", "draw")
    coords = {"chain": np.arange(1, chains + 1), "draw": np.arange(draws)}
    posterior = xr.Dataset(
        {
            "stress_exponent": (labels, 3.5 + 0.1 * rng.standard_normal(shape), {"fixed": 0}),
            "stress_noise": (labels, rng.gamma(20, 5e3, shape), {"fixed": 0}),
            "beta": (labels, np.full(shape, -7.29e-4), {"fixed": 1}),
        },
        coords,
    )
    stats = xr.Dataset(
        {
            "diverging": (labels, np.zeros(shape, dtype=bool)),
            "tree_depth": (labels, rng.integers(3, 6, shape)),
            "n_steps": (labels, rng.integers(7, 32, shape)),
            "energy": (labels, rng.standard_normal(shape)),
            "solver_log_ratio": (labels, 1e-3 * rng.standard_normal(shape)),
        },
        coords,
    )
    noise = 1e5
    quantiles = rng.permutation((np.arange(POINTS) + 0.5) / POINTS)
    observed = 5e6 + noise * norm.ppf(quantiles)
    replicated = 5e6 + noise * rng.standard_normal((*shape, POINTS))
    return xr.DataTree.from_dict(
        {
            "/": xr.Dataset(attrs={"protocol": "constant_rate"}),
            "posterior": posterior,
            "sample_stats": stats,
            "model_response": xr.Dataset(
                {"stress": ((*labels, "point"), np.full_like(replicated, 5e6))}, coords
            ),
            "posterior_predictive": xr.Dataset(
                {"stress": ((*labels, "point"), replicated)}, coords
            ),
            "predictions": xr.Dataset({"stress": ((*labels, "strain"), replicated)}, coords),
            "observed_data": xr.Dataset({"stress": ("point", observed)}),
            "constant_data": xr.Dataset({"strain": ("point", 1e-3 * np.arange(POINTS))}),
        }
    )


def values(tree: xr.DataTree, group: str, name: str) -> FloatArray:
    """Array of a variable, to be changed in place."""
    array: FloatArray = tree[group].to_dataset()[name].values
    return array


def test_good_draws_pass_every_check() -> None:
    checks = run_checks(CheckedDraws(good()), CHECKS)
    assert [check.name for check in checks if not check.passed] == []
    assert len({check.name for check in checks}) == len(CHECKS)
    in_order = sorted(checks, key=lambda one: list(CheckKind).index(one.check.kind))
    assert list(checks) == in_order
    written = Path(fit_checks.__file__).parent.glob("*.py")
    assert len(CHECKS) == sum(file.read_text().count("\n@check(") for file in written)
    assert all(check.sentence.endswith(".") and len(check.table) > 0 for check in checks)


def test_a_missing_chain_fails_with_its_reason() -> None:
    failure = ChainFailure(chain=5, reason="Chain 5 was killed by the system (SIGKILL).")
    check = check_chains(CheckedDraws(good(), (failure,)))
    assert not check.passed
    assert "1 of 5 chains" in check.sentence
    assert failure.reason in check.sentence
    assert check.table["chain"].tolist() == [1, 2, 3, 4, 5]


def one_elsewhere(tree: xr.DataTree) -> None:
    values(tree, "posterior", "stress_exponent")[2] += 0.2


def one_wider(tree: xr.DataTree) -> None:
    draws = values(tree, "posterior", "stress_exponent")
    draws[1] = 3.5 + 4 * (draws[1] - 3.5)


def never_moved(tree: xr.DataTree) -> None:
    values(tree, "posterior", "stress_exponent")[:] = 3.5


def slow(tree: xr.DataTree) -> None:
    noise = values(tree, "posterior", "stress_noise")
    steps = np.random.default_rng(1).standard_normal(noise.shape)
    for k in range(1, DRAWS):
        steps[:, k] += 0.97 * steps[:, k - 1]
    noise[:] = 1e5 + 1e3 * steps


def divergences_in_a_tail(tree: xr.DataTree) -> None:
    """So few in the bulk would be no defect (`test_divergences_matter_by_place_and_number`)."""
    diverge(tree, FEW)
    values(tree, "posterior", "stress_exponent")[3, :FEW] = 3.5 + 0.1 * 4


def diverge(tree: xr.DataTree, n: int) -> None:
    values(tree, "sample_stats", "diverging")[3, :n] = True


def saturated(tree: xr.DataTree) -> None:
    values(tree, "sample_stats", "tree_depth")[0, : CHAINS * DRAWS // 100 + 1] = MAX_TREEDEPTH


def saturated_and_slow(tree: xr.DataTree) -> None:
    saturated(tree)
    slow(tree)


def wandering(tree: xr.DataTree) -> None:
    energy = values(tree, "sample_stats", "energy")
    energy[1] = np.cumsum(energy[1])


def heavy_tailed(tree: xr.DataTree) -> None:
    ratios = values(tree, "sample_stats", "solver_log_ratio")
    ratios[:] = np.random.default_rng(2).standard_exponential(ratios.shape) * 1.5


def one_unsolved(tree: xr.DataTree) -> None:
    values(tree, "sample_stats", "solver_log_ratio")[0, 0] = np.nan


def as_they_are(tree: xr.DataTree) -> None:
    """Too few of them are their only defect."""


DEFECTS: dict[str, tuple[CheckFunction, xr.DataTree, Defect, tuple[str, ...], Numbers]] = {
    "one chain elsewhere": (check_rhat, good(), one_elsewhere, ("stress exponent", "--warmup"), {}),
    "one wider chain": (check_rhat, good(), one_wider, ("stress exponent", "--warmup"), {}),
    "never moved": (check_rhat, good(), never_moved, ("stress exponent", "--warmup"), {}),
    "one chain": (check_rhat, good(chains=1), as_they_are, ("--chains",), {}),
    "few": (check_effective_sample_size, good(draws=60), as_they_are, ("--more-draws",), {}),
    "slow": (check_effective_sample_size, good(), slow, ("stress residual", "--more-draws"), {}),
    "divergence": (
        check_divergences,
        good(),
        divergences_in_a_tail,
        (f"{FEW} of {CHAINS * DRAWS}", "3 and 1 with longer", "stress exponent", "--adapt-delta"),
        {"divergences": [0, 0, 0, FEW]},
    ),
    "tree depth": (
        check_treedepth,
        good(),
        saturated_and_slow,
        ("21 of", "may not have reached", "--max-treedepth"),
        {"saturated": [21, 0, 0, 0]},
    ),
    "energy": (check_energy, good(), wandering, ("E-BFMI", "--warmup"), {}),
    "heavy tail": (check_solver, good(), heavy_tailed, ("Pareto k", "--tolerance"), {}),
    "unsolved": (
        check_solver,
        good(),
        one_unsolved,
        (f"1 of {CHAINS * DRAWS} draws have no solution", "--tolerance"),
        {"unsolved_draws": [1]},
    ),
}


def test_nothing_is_told_of_the_data_by_draws_without_a_solution() -> None:
    tree = good()
    one_unsolved(tree)
    for group in ("model_response", "posterior_predictive"):
        values(tree, group, "stress")[0, 0] = np.nan
    checks = run_checks(CheckedDraws(tree), CHECKS)
    told = {one.outcome for one in checks if one.check.kind is CheckKind.DESCRIPTION}
    assert told == {Outcome.CANNOT_TELL}
    assert verdicts(checks)[CheckKind.DESCRIPTION].outcome is Outcome.CANNOT_TELL


@pytest.mark.parametrize(
    ("check", "tree", "spoil", "words", "numbers"), DEFECTS.values(), ids=DEFECTS
)
def test_each_check_fails_on_its_own_defect_and_says_what_helps(
    check: CheckFunction,
    tree: xr.DataTree,
    spoil: Defect,
    words: tuple[str, ...],
    numbers: Numbers,
) -> None:
    tree = tree.copy(deep=True)
    spoil(tree)
    found = check(CheckedDraws(tree, max_treedepth=MAX_TREEDEPTH, diverged_before=(3, 1)))
    assert not found.passed
    assert found.sentence.endswith(".")
    assert [word for word in words if word not in found.sentence] == []
    assert {name: found.table[name].tolist() for name in numbers} == numbers
    if spoil is wandering:
        assert (found.table["ebfmi"] < 0.3).tolist() == [False, True, False, False]


def test_what_is_no_defect_passes() -> None:
    tree = good()
    assert check_chains(CheckedDraws(tree)).sentence == "All 4 chains finished."
    assert check_chains(CheckedDraws(tree.sel(chain=[1]))).sentence == "The only chain finished."
    values(tree, "sample_stats", "tree_depth")[0, : CHAINS * DRAWS // 100] = MAX_TREEDEPTH
    few_cut = check_treedepth(CheckedDraws(tree, max_treedepth=MAX_TREEDEPTH))
    assert few_cut.passed
    assert "20 of 2000" in few_cut.sentence
    saturated(tree)
    many_cut = check_treedepth(CheckedDraws(tree, max_treedepth=MAX_TREEDEPTH))
    assert many_cut.passed
    assert "21 of 2000" in many_cut.sentence
    assert "slow but not wrong" in many_cut.sentence
    put_aside = check_divergences(CheckedDraws(tree, diverged_before=(3, 1)))
    assert put_aside.passed
    assert "3 and 1 had" in put_aside.sentence
    values(tree, "sample_stats", "solver_log_ratio")[:] = 0.0
    equal = check_solver(CheckedDraws(tree))
    assert equal.passed
    assert "inf" not in equal.sentence


def test_divergences_matter_by_place_and_number() -> None:
    """In a normal sample those of `n` draws at `z` standard deviations move the mean as weighed."""
    tree = good()
    diverge(tree, 1)
    found = check_divergences(CheckedDraws(tree))
    assert found.passed
    assert f"1 of {CHAINS * DRAWS} trajectories diverged, but no number" in found.sentence
    assert found.table["divergences"].tolist() == [0, 0, 0, 1]
    diverge(tree, DRAWS)
    assert not check_divergences(CheckedDraws(tree)).passed

    rng = np.random.default_rng(5)
    draws = xr.Dataset({"x": (("chain", "draw"), rng.standard_normal((4, 1000)))})
    diverging = xr.zeros_like(draws["x"], dtype=bool)
    diverging[0, :8] = True
    # At one standard deviation the mean alone moves.
    draws["x"][0, :8] = 1.0
    standard = (draws["x"] - draws["x"].mean()) / draws["x"].std()
    share = MISSED_DRAWS * 8 / (4000 + MISSED_DRAWS * 8)
    expected = share * float(standard[0, 0])
    assert influence(draws, diverging)["x"] == pytest.approx(expected, rel=1e-6)
    # On both sides the mean stays, and the width tells.
    draws["x"][0, :4], draws["x"][0, 4:8] = 3.0, -3.0
    assert influence(draws, diverging)["x"] > MAX_INFLUENCE


def test_ends_of_intervals_that_chains_reach_but_once_fail_the_effective_sample_size() -> None:
    """Draws beyond 95 % lie in one half of each chain, those beyond 90 % anywhere."""
    tree = good(chains=2)
    noise = values(tree, "posterior", "stress_noise")
    for chain in noise:
        places = np.flatnonzero(chain > np.quantile(chain, 0.9))
        chain[places] = np.sort(chain[places])[::-1]
    table = convergence_table(tree).loc["stress_noise"]
    assert table["rhat"] < 1.01
    assert table["ess_bulk"] > 800
    found = check_effective_sample_size(CheckedDraws(tree))
    assert not found.passed
    assert "stress residual" in found.sentence


@pytest.mark.parametrize(("outside", "passes"), [(0, True), (6, True), (30, False)])
def test_coverage_counts_the_data_in_the_band(outside: int, passes: bool) -> None:
    tree = good()
    observed = values(tree, "observed_data", "stress")
    observed[:] = 5e6
    observed[:outside] += 1e6
    assert coverage(tree) == pytest.approx(1 - outside / POINTS)
    check = check_coverage(CheckedDraws(tree))
    assert check.passed == passes
    assert ("50%" in check.sentence) is not passes


def test_errors_of_the_driving_strain_are_checked_like_parameters() -> None:
    tree = good()
    names = ("driving_error[1]", "driving_error[2]")
    errors = np.random.default_rng(11).standard_normal((len(names), CHAINS, DRAWS))
    errors[1, 0] += 1.0
    labels = ("chain", "draw")
    tree[DRIVING_ERRORS] = xr.DataTree(
        xr.Dataset({name: (labels, own) for name, own in zip(names, errors, strict=True)})
    )
    result = check_rhat(CheckedDraws(tree))
    assert not result.passed
    assert "for driving error[2]" in result.sentence
    assert convergence_table(tree).index[-2:].tolist() == list(names)
    # They are no parameters of the rock.
    assert free_parameters(tree) == ["stress_exponent", "stress_noise"]


def other_mode(weight: float, exponent: float, noise: float = 1e5) -> CheckedDraws:
    """Good draws, and a mode beside the one where their chains began."""
    values = {"stress_exponent": exponent, "stress_noise": noise}
    return CheckedDraws(
        good(), other_modes=(OtherMode(log_weight=np.log(weight), values={"twin": values}),)
    )


@pytest.mark.parametrize(
    ("weight", "exponent", "noise"),
    [
        pytest.param(0.2, 3.6, 1e5, id="draws are there"),
        pytest.param(1e-3, 5.0, 1e5, id="too light to count"),
        pytest.param(0.2, 3.9, 1e5, id="at the edge of the draws"),
    ],
)
def test_modes_that_do_no_harm(weight: float, exponent: float, noise: float) -> None:
    found = check_other_modes(other_mode(weight, exponent, noise))
    assert found.passed
    assert found.sentence.startswith("Draws come near every mode of some weight")
    assert found.table.loc[2, "weight"] == pytest.approx(weight)


def test_a_mode_that_no_draw_comes_near_fails() -> None:
    found = check_other_modes(other_mode(0.2, 3.5, noise=2e3))
    assert not found.passed
    assert not found.unusable
    for words in ("0.2 times", "stress_noise is 0.002 MPa", "prior of stress_noise"):
        assert words in found.sentence


def test_draws_of_the_lesser_mode_say_nothing_of_the_data() -> None:
    checks = run_checks(other_mode(3e3, 5.0), CHECKS)
    both = verdicts(checks)
    assert both[CheckKind.SAMPLING].outcome is Outcome.NO
    assert "3e+03 times" in both[CheckKind.SAMPLING].sentence
    assert both[CheckKind.DESCRIPTION].outcome is Outcome.CANNOT_TELL


def test_too_few_effective_draws_name_the_draws_that_a_chain_lacks() -> None:
    tree = good()
    slow(tree)
    found = check_effective_sample_size(CheckedDraws(tree))
    least = convergence_table(tree)[["ess_bulk", "ess_tail"]].to_numpy().min()
    more = int(found.remedy.partition("--more-draws ")[2].partition(")")[0])
    assert least * (DRAWS + more) / DRAWS == pytest.approx(1.15 * ESS_LIMIT, rel=0.01)


@given(st.floats(min_value=1e-9, max_value=0.1))
def test_a_number_beyond_its_limit_is_printed_beyond_it(excess: float) -> None:
    assert float(beyond(RHAT_LIMIT + excess, RHAT_LIMIT, 3)) > RHAT_LIMIT
    assert float(beyond(ESS_LIMIT - 1000 * excess, ESS_LIMIT, 0)) < ESS_LIMIT


@pytest.mark.parametrize(
    ("value", "limit", "digits", "text"),
    [
        (1.0102, 1.01, 3, "1.011"),
        (1.04322, 1.01, 3, "1.043"),
        (399.7, 400, 0, "399"),
        (61.9, 400, 0, "62"),
        (float("nan"), 1.01, 3, "nan"),
    ],
)
def test_numbers_are_rounded_away_from_their_limit_where_they_would_reach_it(
    value: float, limit: float, digits: int, text: str
) -> None:
    assert beyond(value, limit, digits) == text
