"""Fit the measured creep of rock salt that comes with the package, and write a page about it.

    python fit_measured_creep.py --out halite

The page has the fit, both verdicts on it, and where in the loading history the model misses the
record. It is slow: while the sampler warms up an iteration takes about a second. The posterior has
several modes, so that chains may disagree; the page says so then (docs/loading_history.md).
"""

import argparse
import logging
from dataclasses import replace
from pathlib import Path

import pyburgers
from pyburgers.report.page import write_report
from pyburgers.studies.halite import RUN, halite_section, halite_tasks
from pyburgers.studies.maor.reproduce import shipped_data_directory


def main() -> None:
    """Fit, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path(RUN), help="folder of run and page")
    parser.add_argument("--warmup", type=int)
    parser.add_argument("--draws", type=int)
    given = parser.parse_args()
    logging.basicConfig(format="%(message)s")
    logging.getLogger("pyburgers").setLevel(logging.INFO)

    task = halite_tasks(shipped_data_directory() / "halite")[RUN]
    numbers = {name: getattr(given, name) for name in ("warmup", "draws")}
    options = replace(
        task.options, **{name: value for name, value in numbers.items() if value is not None}
    )
    problem = task.problem
    fit = pyburgers.fit(
        problem.experiments[0], problem.given_priors, out=given.out / "run", options=options
    )
    page = write_report(
        [fit],
        given.out,
        title="Measured creep of rock salt",
        command="python fit_measured_creep.py",
        extras=[halite_section(fit)],
    )
    print(page)


if __name__ == "__main__":
    main()
