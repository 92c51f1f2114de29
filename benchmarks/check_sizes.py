"""How often the checks of the description fail a correct model: at most in 1 of 100 fits.

The model is linear, so that the posterior of every data set is exact: the responses vary as those
of finished runs do, about one solution each. `docs/checks.md` holds what came out.

    PYTHONPATH=tests/support python benchmarks/check_sizes.py 2000 RUN...
"""

import argparse
from collections import Counter
from pathlib import Path

import xarray as xr
from linear_fits import LinearModel

from pyburgers.checks.fit_checks import CheckKind, Outcome
from pyburgers.checks.registry import CHECKS

DESCRIPTION = [one for one in CHECKS if one.kind is CheckKind.DESCRIPTION]


def failures(model: LinearModel, n_fits: int, seed: int) -> Counter[str]:
    """Count fits that fail each check, and any of them."""
    counts: Counter[str] = Counter()
    for draws in model.fits(n_fits, seed):
        failed = [one.name for one in DESCRIPTION if one(draws).outcome is Outcome.NO]
        counts.update(failed)
        counts["any"] += bool(failed)
    return counts


def main() -> None:
    """Print a line for each run."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("fits", type=int)
    parser.add_argument("runs", type=Path, nargs="+")
    options = parser.parse_args()
    for number, run in enumerate(options.runs):
        with xr.open_datatree(run / "posterior.nc", engine="h5netcdf") as posterior:
            model = LinearModel.like(posterior.load())
        counts = failures(model, options.fits, number)
        print(run.name, options.fits, dict(counts), flush=True)


if __name__ == "__main__":
    main()
