"""Fit a stress-strain curve and look at the posterior.

    python fit_your_own_curve.py my_test.toml --out runs/my_test

The TOML file describes the test and names the text file that holds the curve; the README shows
one. Without it the synthetic test PIL40 is fitted, which comes with the package. A fit with the
default numbers takes about a minute; running the same command again continues where it stopped.
"""

import argparse
import logging
from pathlib import Path

from matplotlib import pyplot as plt

import pyburgers


def main() -> None:
    """Fit, print the posterior and the checks, draw a figure."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument(
        "experiment",
        type=Path,
        nargs="?",
        default=Path(__file__).parents[1] / "data" / "ice" / "PIL40.toml",
    )
    parser.add_argument("--priors", type=Path, help="prior file (default: the material's)")
    parser.add_argument("--out", type=Path, help="run directory (default: runs/ID)")
    parser.add_argument("--chains", type=int, default=4)
    parser.add_argument("--warmup", type=int, default=300)
    parser.add_argument("--draws", type=int, default=500)
    options = parser.parse_args()

    # Long calls report progress to the logger of the package.
    logging.basicConfig(format="%(message)s")
    logging.getLogger("pyburgers").setLevel(logging.INFO)

    # Everything is checked and converted to SI units here; what was mended is said in a notice.
    experiment = pyburgers.load_experiment(options.experiment)
    for notice in experiment.notices:
        print("note:", notice)

    # Priors are files too. Copy one of data/priors, change it and name it with --priors.
    if options.priors is None:
        priors = pyburgers.priors(experiment.material)
    else:
        priors = pyburgers.load_priors(options.priors)

    fit = pyburgers.fit(
        experiment,
        priors,
        out=options.out or Path("runs") / experiment.id,
        options=pyburgers.SamplerOptions(
            chains=options.chains, warmup=options.warmup, draws=options.draws
        ),
    )

    # A row for each parameter, SI units. A small sd does not say that the curve taught us a number:
    # decided_by does, and by_prior_of names the priors that took part.
    summary = fit.summary("SI")
    columns = ["unit", "mean", "sd", "q5", "q95", "decided_by", "by_prior_of", "rhat"]
    print(summary[columns].to_string())
    for sentence in (*fit.prior_conflicts(), *fit.prior_decisions()):
        print(sentence)

    # Two questions; do not use the numbers before both are a yes.
    for verdict in fit.verdicts().values():
        print(verdict.kind.value, verdict.outcome.value.upper())
        for check in fit.checks():
            if check.check.kind is verdict.kind:
                print(f"  {check.outcome.value}: {check.sentence}")

    # The draws themselves are labelled arrays (chain, draw).
    draws = fit.posterior["posterior"].to_dataset()
    steep = float((draws["stress_exponent"] > 3.5).mean())
    print(f"probability that the stress exponent is above 3.5: {steep:.2f}")

    figure, (left, right) = plt.subplots(1, 2, figsize=(9, 4), layout="constrained")
    fit.plot.stress_strain(left)
    fit.plot.posterior("maxwell_modulus", right)
    file = fit.directory.path / "fit.png"
    figure.savefig(file)
    print(file)


if __name__ == "__main__":
    main()
