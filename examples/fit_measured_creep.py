"""Fit four laws to the measured creep of rock salt that comes with the package, and write a page.

    python fit_measured_creep.py --out halite

The page has the fits, both verdicts on each, and where in the loading history they miss the record
(docs/loading_history.md says what came out). Those that harden take long to sample.
"""

import argparse
import logging
from dataclasses import replace
from pathlib import Path

from pyburgers.common.shipped_files import shipped_folder
from pyburgers.fitting.side_by_side import fit_side_by_side
from pyburgers.report.page import write_report
from pyburgers.studies.halite import halite_section, halite_tasks


def main() -> None:
    """Fit, and write the page."""
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--out", type=Path, default=Path("halite"), help="folder of runs and page")
    parser.add_argument("--warmup", type=int)
    parser.add_argument("--draws", type=int)
    given = parser.parse_args()
    logging.basicConfig(format="%(message)s")
    logging.getLogger("pyburgers").setLevel(logging.INFO)

    numbers = {name: getattr(given, name) for name in ("warmup", "draws")}
    changes = {name: value for name, value in numbers.items() if value is not None}
    tasks = {
        name: replace(task, options=replace(task.options, **changes))
        for name, task in halite_tasks(shipped_folder("data") / "halite").items()
    }
    command = "python fit_measured_creep.py"
    fits = fit_side_by_side(tasks, given.out / "runs", command=command)
    page = write_report(
        list(fits.values()),
        given.out,
        title="Measured creep of rock salt",
        command=command,
        extras=[halite_section(fits)],
    )
    print(page)


if __name__ == "__main__":
    main()
