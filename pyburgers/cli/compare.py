"""`pyburgers compare`: which of several fits of the same data predicts best."""

import argparse
from collections.abc import Mapping, Sequence
from dataclasses import asdict
from pathlib import Path
from typing import Any

from pyburgers.cli.shared import command_line, exit_code, writing
from pyburgers.cli.workers import add_worker_options, require_no_worker_options, workers_of
from pyburgers.common.atomic_files import write_json, write_text
from pyburgers.common.csv_tables import csv_text
from pyburgers.common.errors import InputError
from pyburgers.common.paths import shown
from pyburgers.comparison.by_points import compare
from pyburgers.comparison.by_tests import check_several_tests, compare_by_test, fit_without_tests
from pyburgers.comparison.conclusions import (
    MOVED,
    comparison_table,
    pairs_by_test,
    parameter_shifts,
    pointwise_table,
    sentences,
    sentences_by_test,
    table_of_fits,
    table_of_tests,
)
from pyburgers.comparison.figures import left_out_tests, pointwise_differences
from pyburgers.comparison.results import Comparison, ComparisonByTest, LogIntegral, Pair
from pyburgers.comparison.same_data import origins
from pyburgers.drawing.style import write_images
from pyburgers.fitting.fit import Fit
from pyburgers.page.names import names_of_runs
from pyburgers.sampling.run_directory import RunDirectory


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    command.add_argument(
        "directories",
        type=Path,
        nargs="+",
        metavar="RUN",
        help="run directory of fit; at least two of the same data",
    )
    command.add_argument("--out", type=Path, default="comparison", metavar="DIR", help="folder")
    command.add_argument(
        "--leave-out",
        choices=["points", "tests"],
        default="points",
        help="what is predicted from the rest: points, or whole tests of joint fits and "
        "temperatures of tables of attenuation, for which each is fitted again without each of "
        "them, in RUN/leave_out; then one RUN will do",
    )
    command.add_argument(
        "--no-refit",
        action="store_true",
        help="only flag points whose Pareto k is above 0.7, do not fit again without them; points "
        "of joint fits are only flagged anyway",
    )
    add_worker_options(command, "with --leave-out tests: ")


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    by_test = options.leave_out == "tests"
    if by_test and options.no_refit:
        raise InputError(
            "--no-refit: goes with --leave-out points, because a test is left out by fitting again."
        )
    if not by_test:
        require_no_worker_options(options, "--leave-out points, which hands no fits out")
    if RunDirectory(options.out).manifest_file.exists():
        raise InputError(
            f"--out {options.out}: holds the manifest.json of a run, expected another folder."
        )
    directories: list[Path] = options.directories
    fits = {
        name: Fit.load(directory)
        for name, directory in zip(names_of_runs(directories), directories, strict=True)
    }
    return _compare_by_test(options, fits) if by_test else _compare_by_point(options, fits)


def _compare_by_point(options: argparse.Namespace, fits: Mapping[str, Fit]) -> int:
    comparison = compare(fits, refits=None if options.no_refit else options.out / "refits")
    with writing(options.out):
        options.out.mkdir(parents=True, exist_ok=True)
        save_comparison(comparison, fits, options.out, command=command_line())
        write_images(pointwise_differences(comparison), options.out / "comparison.png")
    print(comparison_table(comparison).round(2).to_string())
    for sentence in sentences(comparison):
        print(sentence)
    one = next(iter(fits))
    print(
        f"\nHow far each parameter moves from {one}, in its sd there, if it means the same in all:"
    )
    print(parameter_shifts(fits).filter(like=MOVED).round(2).to_string())
    print(shown(f"numbers and figure: {options.out}"))
    return exit_code(comparison.reliable)


def _compare_by_test(options: argparse.Namespace, joints: Mapping[str, Fit]) -> int:
    for joint in joints.values():
        check_several_tests(joint)
    command = command_line()
    with workers_of(options) as workers:
        if options.part is not None:
            fit_without_tests(joints, workers=workers, command=command)
            print("fits of part {}/{} are done".format(*options.part))
            return 0
        with writing(options.out):
            # Ahead of the fits, which take long.
            options.out.mkdir(parents=True, exist_ok=True)
        comparison = compare_by_test(joints, workers=workers, command=command)
    with writing(options.out):
        save_comparison_by_test(comparison, joints, options.out, command=command)
        write_images(left_out_tests(comparison), options.out / "comparison.png")
    print(table_of_tests(comparison).round(2).to_string())
    print(table_of_fits(comparison).round(2).to_string())
    for sentence in sentences_by_test(comparison):
        print(sentence)
    print(shown(f"numbers and figure: {options.out}"))
    return exit_code(comparison.reliable)


def save_comparison(
    comparison: Comparison, fits: Mapping[str, Fit], folder: Path, *, command: str
) -> None:
    """Write ``comparison.csv``, ``pointwise.csv`` and ``comparison.json``."""
    write_text(folder / "comparison.csv", csv_text(comparison_table(comparison), index=True))
    write_text(folder / "pointwise.csv", csv_text(pointwise_table(comparison), index=True))
    record = {
        **origins(fits, command=command),
        "reliable": comparison.reliable,
        "pairs": _pair_records(comparison.pairs()),
        "sentences": list(sentences(comparison)),
        "parameters": parameter_shifts(fits).reset_index().to_dict("records"),
    }
    write_json(folder / "comparison.json", record)


def save_comparison_by_test(
    comparison: ComparisonByTest, joints: Mapping[str, Fit], folder: Path, *, command: str
) -> None:
    """Write ``comparison.csv``, ``left_out_tests.csv`` and ``comparison.json``."""
    write_text(folder / "comparison.csv", csv_text(table_of_fits(comparison), index=True))
    write_text(folder / "left_out_tests.csv", csv_text(table_of_tests(comparison), index=True))
    integrals = {
        name: {
            "all": _record(result.all_tests),
            "without": dict(zip(result.tests, map(_record, result.without), strict=True)),
        }
        for name, result in comparison.results.items()
    }
    record = {
        **origins(joints, command=command),
        "marginal_likelihoods": integrals,
        "reliable": comparison.reliable,
        "pairs": _pair_records(pairs_by_test(comparison)),
        "sentences": list(sentences_by_test(comparison)),
    }
    write_json(folder / "comparison.json", record)


def _record(integral: LogIntegral) -> dict[str, float]:
    return {"log": integral.value, "error": integral.error}


def _pair_records(compared: Sequence[Pair]) -> list[dict[str, Any]]:
    return [{**asdict(pair), "outcome": pair.outcome} for pair in compared]
