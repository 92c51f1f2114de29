"""`pyburgers predict RUN EXPERIMENT.toml`: the response of a test, from a fit of others."""

import argparse
from pathlib import Path

import pandas as pd

from pyburgers.cli.outputs import check_output
from pyburgers.cli.shared import writing
from pyburgers.common.atomic_files import write_text
from pyburgers.common.csv_tables import csv_text
from pyburgers.common.errors import InputError
from pyburgers.common.netcdf_files import write_netcdf
from pyburgers.common.paths import shown
from pyburgers.drawing.style import write_images
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.prediction import Prediction
from pyburgers.kinds.kind import load_experiment
from pyburgers.predictions.figures import prediction_figure
from pyburgers.predictions.other_tests import (
    band_table,
    overview_table,
    reading_table,
    score_sentence,
    score_table,
)


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument("directory", type=Path, metavar="RUN", help="run directory of fit")
    command.add_argument(
        "experiment", type=Path, metavar="EXPERIMENT.toml", help="file of the other test"
    )
    command.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE.csv",
        help="bands along the test; beside it FILE.nc (all draws), FILE.png and FILE.svg, and "
        "where the experiment has data FILE_readings.csv and FILE_scores.csv",
    )
    command.add_argument("--draws", type=int, metavar="N", help="default: all draws of the fit")
    which = command.add_mutually_exclusive_group()
    which.add_argument(
        "--test",
        metavar="ID",
        help="of a joint fit, the test whose own parameters the new one has, all of them: another "
        "test of the same sample",
    )
    which.add_argument(
        "--separate-from",
        metavar="ID",
        help="of a joint fit, the test that parameters without pooling are taken from; default: "
        "every test in turn",
    )
    command.add_argument(
        "--seed", type=int, default=1, help="seed of noise and of a new test's own values"
    )


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    out: Path = options.out
    if out.suffix != ".csv":
        raise InputError(f"--out {out}: expected a file name that ends in .csv.")
    beside = (".nc", ".png", ".svg", "_readings.csv", "_scores.csv")
    check_output(out, options.directory, options.experiment, beside=beside)
    fit = Fit.load(options.directory)
    prediction = (fit if options.test is None else fit[options.test]).predict(
        load_experiment(options.experiment),
        draws=options.draws,
        separate_from=options.separate_from,
        seed=options.seed,
    )
    scores = score_table(prediction) if prediction.experiment.n_points > 0 else None
    files = _write(prediction, scores, out)
    print(prediction.title)
    for sentence in (*prediction.cautions, *prediction.notes):
        print(sentence)
    print(overview_table(prediction).to_string(index=False))
    if scores is not None:
        print(score_sentence(prediction, scores))
    for file in files:
        print(shown(file))
    return 0


def _write(prediction: Prediction, scores: pd.DataFrame | None, out: Path) -> list[Path]:
    """Write the files; return their names."""
    files = [out.with_suffix(suffix) for suffix in (".csv", ".nc", ".png", ".svg")]
    tables = {out: band_table(prediction)}
    if scores is not None:
        tables[out.with_name(f"{out.stem}_readings.csv")] = reading_table(prediction)
        tables[out.with_name(f"{out.stem}_scores.csv")] = scores.reset_index()
    with writing(out):
        for file, table in tables.items():
            write_text(file, csv_text(table))
        write_netcdf(out.with_suffix(".nc"), prediction.posterior)
        write_images(prediction_figure(prediction), out)
    return [*files, *(file for file in tables if file != out)]
