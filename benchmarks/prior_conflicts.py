"""How often prior and data are said to disagree: at most in 1 of 50 fits of correct models.

The models are linear, so that the posterior of every data set is exact, and truths come from the
priors. Then one truth lies outside: the share of fits that report it is the power. What came out
stands in `docs/checks.md`; run directories of real fits can be counted as well.

    PYTHONPATH=tests/support python benchmarks/prior_conflicts.py 2000 [RUN...]
"""

import argparse
from collections.abc import Iterator
from pathlib import Path

import xarray as xr
from check_sizes import upper_limit
from linear_priors import NAMES, normal_fits, uniform_fits

from pyburgers import Fit, PriorSet
from pyburgers.checks.prior_influence import Origin, prior_influence

AWAY = (2.0, 3.0, 4.0, 5.0)
NOISE = (0.01, 0.1, 0.3)


def count(
    fits: Iterator[tuple[xr.DataTree, PriorSet]], name: str | None = None
) -> tuple[int, int, int]:
    """Return fits with a conflict (about a quantity, if named), with a bound, and all of them."""
    conflicting, at_bound, n_fits = 0, 0, 0
    for posterior, priors in fits:
        found = prior_influence(posterior, priors)
        shown = [found[name]] if name else [*found.values()]
        conflicting += any(one.is_conflict for one in shown)
        at_bound += any(one.origin is Origin.BOUND for one in shown)
        n_fits += 1
    return conflicting, at_bound, n_fits


def main() -> None:
    """Print a line for each kind of model, and one for each run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("fits", type=int)
    parser.add_argument("runs", type=Path, nargs="*")
    parser.add_argument("--draws", type=int, default=400)
    options = parser.parse_args()
    n, draws = options.fits, options.draws
    kinds = {"12 normal priors": normal_fits(n, 1, draws=draws)}
    kinds |= {
        f"12 uniform priors, reading known to {noise:g} of the range": uniform_fits(
            n, 2, draws=draws, noise=noise
        )
        for noise in NOISE
    }
    for kind, fits in kinds.items():
        found, at_bound, of = count(fits)
        limit = upper_limit(found, of)
        print(f"{kind}: {found} of {of}, upper limit {limit:.2%}; at a bound {at_bound}")
    for away in AWAY:
        found, _, of = count(normal_fits(n // 10, 3, draws=draws, away=away), NAMES[0])
        print(f"truth {away:g} prior sd away: told in {found} of {of}")
    for beyond in AWAY:
        fits = uniform_fits(n // 10, 4, draws=draws, noise=0.03, beyond=beyond)
        found, at_bound, of = count(fits, NAMES[0])
        print(f"reading {beyond:g} sd beyond a bound: conflict {found}, bound {at_bound}, {of}")
    for path in options.runs:
        fit = Fit.load(path)
        print(f"{path}: {fit.prior_conflicts()}")


if __name__ == "__main__":
    main()
