"""How often the checks of the description fail a correct model: at most in 1 of 100 fits.

The model is linear, so that the posterior of every data set is exact. The responses vary as those
of finished runs do, about one solution each, or are straight lines: few parameters, many readings,
where a posterior follows the data least. For each level of the family probability
(`pyburgers.checks.discrepancies.LEVEL`) the share of fits that it fails is printed with its upper
confidence limit. `docs/checks.md` holds what came out.

    PYTHONPATH=tests/support python benchmarks/check_sizes.py 1500 RUN...
"""

import argparse
from collections import Counter
from pathlib import Path

import numpy as np
from linear_fits import LinearModel
from scipy.stats import beta

from pyburgers.checks.discrepancies import OVER_SCATTER, discrepancies_of
from pyburgers.common.array_types import FloatArray
from pyburgers.common.netcdf_files import read_netcdf

LEVELS = (0.003, 0.005, 0.01, 0.02, 0.05, 0.1)
DRAWS = 400
CONFIDENCE = 0.975


def family_probabilities(
    model: LinearModel, n_fits: int, seed: int
) -> tuple[FloatArray, Counter[str]]:
    """Least family probability of each fit, and which discrepancies are beyond their limits."""
    least, beyond = [], Counter[str]()
    for draws in model.fits(n_fits, seed, draws=DRAWS):
        table = discrepancies_of(draws).table
        beyond.update(table.query("found > at_most").index.get_level_values("discrepancy"))
        own = table.drop(OVER_SCATTER, level="discrepancy", errors="ignore")
        least.append(float(own["family_probability"].min()))
    return np.array(least), beyond


def upper_limit(count: int, n: int) -> float:
    """Clopper and Pearson's upper confidence limit of a share."""
    return 1.0 if count == n else float(beta.ppf(CONFIDENCE, count + 1, n - count))


def models(runs: list[Path]) -> dict[str, LinearModel]:
    """Linear models like those of runs, and polynomials."""
    parabola = LinearModel.of_polynomials(60, steps=0, degree=2)
    found = {
        "a straight line": LinearModel.of_polynomials(60, steps=0, degree=1),
        "a polynomial of degree 4": LinearModel.of_polynomials(30, steps=0, degree=4),
        "a cubic in each of two segments": LinearModel.of_polynomials(50, steps=1, degree=3),
        "a parabola, half correlates": parabola.with_correlation(0.5, 3.0),
        "a parabola, most correlates": parabola.with_correlation(0.8, 8.0),
    }
    for run in runs:
        found[run.name] = LinearModel.like(read_netcdf(run / "posterior.nc"))
    return found


def main() -> None:
    """Print a line for each model and level."""
    parser = argparse.ArgumentParser(description=__doc__)
    parser.add_argument("fits", type=int)
    parser.add_argument("runs", type=Path, nargs="*")
    options = parser.parse_args()
    for number, (name, model) in enumerate(models(options.runs).items()):
        least, beyond = family_probabilities(model, options.fits, number)
        print(f"{name}: {model.position.size} readings, beyond: {dict(beyond)}")
        for level in LEVELS:
            count = int(np.sum(least <= level))
            limit = upper_limit(count, least.size)
            print(f"  {level}: {count} of {least.size}, upper limit {limit:.2%}")


if __name__ == "__main__":
    main()
