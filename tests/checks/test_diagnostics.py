"""Checks of a fit on made-up draws: each passes on good ones and fails on its own defect."""

from collections.abc import Callable
from pathlib import Path

import numpy as np
import numpy.typing as npt
import pytest
import xarray as xr
from scipy.stats import norm

from pyburgers.checks import fit_checks
from pyburgers.checks.description import check_coverage
from pyburgers.checks.fit_checks import (
    CheckedDraws,
    CheckKind,
    CheckResult,
    Outcome,
    check_chains,
    check_divergences,
    check_effective_sample_size,
    check_energy,
    check_rhat,
    check_solver,
    check_treedepth,
    coverage,
    run_checks,
)
from pyburgers.checks.modes import check_other_modes
from pyburgers.checks.registry import CHECKS
from pyburgers.checks.verdicts import verdicts
from pyburgers.kinds.coordinates import OtherMode
from pyburgers.posterior.labelled_draws import DRIVING_ERRORS, convergence_table, free_parameters
from pyburgers.sampling.manifest import ChainFailure

FloatArray = npt.NDArray[np.float64]
CHAINS, DRAWS, POINTS = 4, 500, 60
MAX_TREEDEPTH = 10


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


def assert_fails(check: CheckResult, *remedies: str) -> None:
    assert not check.passed
    assert check.sentence.endswith(".")
    for remedy in remedies:
        assert remedy in check.sentence


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
    failure = ChainFailure(5, "Chain 5 was killed by the system (SIGKILL).")
    check = check_chains(CheckedDraws(good(), (failure,)))
    assert_fails(check, "1 of 5 chains", failure.reason)
    assert check.table["chain"].tolist() == [1, 2, 3, 4, 5]


def test_one_chain_is_not_called_all_chains() -> None:
    tree = good()
    alone = tree.sel(chain=[1])
    assert check_chains(CheckedDraws(tree)).sentence == "All 4 chains finished."
    assert check_chains(CheckedDraws(alone)).sentence == "The only chain finished."


def one_elsewhere(draws: FloatArray) -> None:
    draws[2] += 0.2


def one_wider(draws: FloatArray) -> None:
    draws[1] = 3.5 + 4 * (draws[1] - 3.5)


def never_moved(draws: FloatArray) -> None:
    draws[:] = 3.5


@pytest.mark.parametrize("spoil", [one_elsewhere, one_wider, never_moved])
def test_chains_that_differ_or_never_moved_fail_rhat(spoil: Callable[[FloatArray], None]) -> None:
    tree = good()
    spoil(values(tree, "posterior", "stress_exponent"))
    assert_fails(check_rhat(CheckedDraws(tree)), "stress_exponent", "--draws")


def test_one_chain_cannot_be_compared() -> None:
    assert_fails(check_rhat(CheckedDraws(good(chains=1))), "--chains")


def test_few_draws_fail_the_effective_sample_size() -> None:
    assert_fails(check_effective_sample_size(CheckedDraws(good(draws=60))), "--draws")


def test_slowly_mixing_draws_fail_the_effective_sample_size() -> None:
    tree = good()
    noise = values(tree, "posterior", "stress_noise")
    steps = np.random.default_rng(1).standard_normal(noise.shape)
    for k in range(1, DRAWS):
        steps[:, k] += 0.97 * steps[:, k - 1]
    noise[:] = 1e5 + 1e3 * steps
    assert_fails(check_effective_sample_size(CheckedDraws(tree)), "stress_noise", "--draws")


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
    assert_fails(check_effective_sample_size(CheckedDraws(tree)), "stress_noise", "--draws")


def test_a_divergence_fails() -> None:
    tree = good()
    values(tree, "sample_stats", "diverging")[3, 17] = True
    check = check_divergences(CheckedDraws(tree))
    assert_fails(check, f"1 of {CHAINS * DRAWS}", "--adapt-delta")
    assert check.table["divergences"].tolist() == [0, 0, 0, 1]


def test_divergences_of_draws_put_aside_are_told() -> None:
    tree = good()
    check = check_divergences(CheckedDraws(tree, diverged_before=(3, 1)))
    assert check.passed
    assert "3 and 1 had" in check.sentence
    values(tree, "sample_stats", "diverging")[3, 17] = True
    check = check_divergences(CheckedDraws(tree, diverged_before=(3, 1)))
    assert_fails(check, f"1 of {CHAINS * DRAWS}", "3 and 1 with longer steps", "--adapt-delta")


def test_a_saturated_treedepth_fails() -> None:
    tree = good()
    values(tree, "sample_stats", "tree_depth")[0, :3] = MAX_TREEDEPTH
    check = check_treedepth(CheckedDraws(tree, max_treedepth=MAX_TREEDEPTH))
    assert_fails(check, "3 of", "--max-treedepth")
    assert check.table["saturated"].tolist() == [3, 0, 0, 0]


def test_energy_that_wanders_fails() -> None:
    tree = good()
    energy = values(tree, "sample_stats", "energy")
    energy[1] = np.cumsum(energy[1])
    check = check_energy(CheckedDraws(tree))
    assert_fails(check, "E-BFMI", "warm-up")
    assert (check.table["ebfmi"] < 0.3).tolist() == [False, True, False, False]


def test_heavy_tailed_ratios_fail_the_solver_check() -> None:
    tree = good()
    ratios = values(tree, "sample_stats", "solver_log_ratio")
    ratios[:] = np.random.default_rng(2).standard_exponential(ratios.shape) * 1.5
    assert_fails(check_solver(CheckedDraws(tree)), "Pareto k", "--tolerance")


def test_a_draw_without_solution_fails_the_solver_check() -> None:
    tree = good()
    values(tree, "sample_stats", "solver_log_ratio")[0, 0] = np.nan
    check = check_solver(CheckedDraws(tree))
    assert_fails(check, f"1 of {CHAINS * DRAWS} draws have no solution", "--tolerance")
    assert check.table["unsolved_draws"].item() == 1


def test_equal_ratios_pass_the_solver_check() -> None:
    tree = good()
    values(tree, "sample_stats", "solver_log_ratio")[:] = 0.0
    check = check_solver(CheckedDraws(tree))
    assert check.passed
    assert "inf" not in check.sentence


@pytest.mark.parametrize(("outside", "passes"), [(0, True), (6, True), (30, False)])
def test_coverage_counts_the_data_in_the_band(outside: int, passes: bool) -> None:
    tree = good()
    observed = values(tree, "observed_data", "stress")
    observed[:] = 5e6
    observed[:outside] += 1e6
    assert coverage(tree) == pytest.approx(1 - outside / POINTS)
    check = check_coverage(CheckedDraws(tree))
    assert check.passed == passes
    if not passes:
        assert_fails(check, "50%", "residuals")


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
    assert "for driving_error[2]" in result.sentence
    assert convergence_table(tree).index[-2:].tolist() == list(names)
    # They are no parameters of the rock.
    assert free_parameters(tree) == ["stress_exponent", "stress_noise"]


def other_mode(weight: float, exponent: float, noise: float = 1e5) -> CheckedDraws:
    """Good draws, and a mode beside the one where their chains began."""
    values = {"stress_exponent": exponent, "stress_noise": noise}
    return CheckedDraws(good(), other_modes=(OtherMode(np.log(weight), {"twin": values}),))


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
    assert_fails(found, "0.2 times", "stress_noise is 0.002 MPa", "prior of stress_noise")
    assert not found.unusable


def test_draws_of_the_lesser_mode_say_nothing_of_the_data() -> None:
    checks = run_checks(other_mode(3e3, 5.0), CHECKS)
    both = verdicts(checks)
    assert both[CheckKind.SAMPLING].outcome is Outcome.NO
    assert "3e+03 times" in both[CheckKind.SAMPLING].sentence
    assert both[CheckKind.DESCRIPTION].outcome is Outcome.CANNOT_TELL
