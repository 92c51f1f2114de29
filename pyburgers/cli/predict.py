"""`pyburgers predict`: what a fit says about other experiments."""

import argparse
from collections.abc import Sequence
from pathlib import Path
from typing import Any

import pandas as pd

from pyburgers.cli.outputs import check_output
from pyburgers.cli.shared import writing
from pyburgers.common.atomic_files import write_text
from pyburgers.common.csv_tables import csv_text
from pyburgers.common.errors import InputError
from pyburgers.common.netcdf_files import write_netcdf
from pyburgers.common.paths import shown
from pyburgers.common.units import UNITS
from pyburgers.drawing.style import write_images
from pyburgers.fitting.fit import Fit
from pyburgers.fitting.prediction import Prediction
from pyburgers.kinds.kind import load_experiment
from pyburgers.predictions.attenuation import (
    DEFAULT_FREQUENCIES,
    overview_table,
    predict_attenuation,
    quantile_table,
    save_spectrum,
)
from pyburgers.predictions.evolving import (
    EVOLVING_FREQUENCIES,
    evolving_attenuation,
    evolving_overview,
    evolving_sentence,
    evolving_table,
)
from pyburgers.predictions.figures import attenuation, prediction_figure
from pyburgers.predictions.material import (
    CRITICAL_SHARE,
    elastic_modulus_sentence,
    fitted_material,
    frozen_sentence,
)
from pyburgers.predictions.measured_attenuation import load_measured_attenuation
from pyburgers.predictions.other_tests import band_table, reading_table, score_sentence, score_table
from pyburgers.predictions.other_tests import overview_table as overview_of_test
from pyburgers.predictions.stress_cycles import HOLD_TIME, PAPER_REGIMES, Regime, regimes_named

TEST, ATTENUATION = "test", "attenuation"
"""What can be predicted."""


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    predictions = command.add_subparsers(title="predictions", required=True, metavar="WHAT")
    of_test = predictions.add_parser(
        TEST, help="RUN EXPERIMENT.toml: the response of another test (the word may be left out)"
    )
    _add_test_options(of_test)
    of_test.set_defaults(predict=_test)
    of_attenuation = predictions.add_parser(
        ATTENUATION, help="tan(delta) of axial stress cycles about a median stress"
    )
    _add_attenuation_options(of_attenuation)
    of_attenuation.set_defaults(predict=_attenuation)


def _add_test_options(command: argparse.ArgumentParser) -> None:
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


def _add_attenuation_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("directory", type=Path, metavar="RUN", help="run directory of fit")
    command.add_argument(
        "--test",
        metavar="ID",
        help="test of a joint fit; default: all, each with files FILE_ID.csv and so on",
    )
    command.add_argument(
        "--out",
        type=Path,
        required=True,
        metavar="FILE.csv",
        help="quantiles; beside it FILE.nc (all draws), FILE.png and FILE.svg",
    )
    command.add_argument(
        "--regimes", nargs="+", metavar="M", help="some of the paper's: 1, 1.5, 2, 4 (median, MPa)"
    )
    for option, metavar, what in (
        (
            "--median-stress-MPa",
            "M",
            "axial median stress of each regime (sqrt(3) times one of shear)",
        ),
        ("--amplitude-MPa", "A", "axial amplitude of each regime, as many"),
        ("--frequencies-Hz", "F", "default: 60 from 1e-4 to 1"),
    ):
        command.add_argument(option, type=float, nargs="+", metavar=metavar, help=what)
    for option, metavar, what in (
        ("--temperature-K", "T", "default: the experiment's"),
        ("--grain-size-um", "D", "default: by --microstructure"),
        ("--fabric-factor", "F", "default: by --microstructure"),
        ("--pressure-MPa", "P", "default: the experiment's, as of the next two"),
        ("--water-fugacity-MPa", "F", "for fits whose rates depend on it"),
        ("--melt-fraction", "PHI", "the same"),
        ("--hold-time-h", "H", "time at the median stress before the cycles"),
        (
            "--critical-share",
            "S",
            "frozen microstructure counts as failing where the hold or a cycle strains by more "
            "than this share of the smaller critical strain",
        ),
    ):
        command.add_argument(option, type=float, metavar=metavar, help=what)
    hold_time = HOLD_TIME / UNITS["time"]["h"]
    command.set_defaults(hold_time_h=hold_time, critical_share=CRITICAL_SHARE)
    command.add_argument(
        "--microstructure",
        choices=("initial", "steady-state"),
        default="initial",
        help="grain size and fabric",
    )
    command.add_argument(
        "--evolving",
        type=float,
        nargs="*",
        metavar="F",
        help="solve in time with evolving microstructure at these frequencies (Hz; default 1e-4, "
        "1e-3, 1e-2), for 100 draws, and compare; also writes FILE_evolving.csv and .nc",
    )
    command.add_argument(
        "--elastic-modulus-Pa",
        type=float,
        nargs="+",
        metavar=("E", "SD"),
        help="elastic modulus, and its standard deviation, in place of E_M of the fit; E_M of a "
        "test at constant rate is mostly the stiffness of the apparatus (ice has about 9.3e9)",
    )
    command.add_argument(
        "--measured",
        type=Path,
        metavar="POINTS.csv",
        help="measured attenuation to draw over it: columns frequency_Hz, tan_delta and, if you "
        "like, tan_delta_sd and series",
    )
    command.add_argument("--seed", type=int, default=1, help="seed of draws of the elastic modulus")


def with_default(arguments: Sequence[str]) -> list[str]:
    """Return the arguments with what is predicted: a test unless another word says so."""
    named = arguments[:1] and arguments[0] in (TEST, ATTENUATION, "-h", "--help")
    if named or not arguments:
        return list(arguments)
    first, *others = arguments
    if not others and not first.startswith("-") and not Path(first).exists():
        raise InputError(
            f"{first}: found neither a run directory nor a prediction of that name, expected "
            f"RUN EXPERIMENT.toml --out FILE.csv, or {ATTENUATION} RUN."
        )
    return [TEST, *arguments]


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    code: int = options.predict(options)
    return code


def _attenuation(options: argparse.Namespace) -> int:
    """Predict attenuation from all tests that were asked for; return the exit code."""
    if options.out.suffix != ".csv":
        raise InputError(f"--out {options.out}: expected a file name that ends in .csv.")
    whole = Fit.load(options.directory)
    fits = [whole[options.test]] if options.test is not None else [*whole.tests().values()]
    for fit in fits:
        out = options.out
        if len(fits) > 1:
            out = out.with_name(f"{out.stem}_{fit.experiment.id}.csv")
        _predict(fit, options, out)
    return 0


def _predict(fit: Fit, options: argparse.Namespace, out: Path) -> None:
    """Predict from a test; write the files and print them."""
    beside = (".nc", ".png", ".svg", "_evolving.csv", "_evolving.nc")
    check_output(out, options.directory, options.measured, beside=beside)
    grain_size, stress = options.grain_size_um, UNITS["stress"]["MPa"]
    modulus, deviation = _elastic_modulus(options)
    hold_time = options.hold_time_h * UNITS["time"]["h"]
    regimes = _regimes(options)
    stated = (
        ("pressure", options.pressure_MPa, stress),
        ("water_fugacity", options.water_fugacity_MPa, stress),
        ("melt_fraction", options.melt_fraction, 1.0),
    )
    environment = {name: value * unit for name, value, unit in stated if value is not None}
    material: dict[str, Any] = {
        "microstructure": options.microstructure.replace("-", "_"),
        "temperature": options.temperature_K,
        "grain_size": None if grain_size is None else grain_size * UNITS["length"]["um"],
        "fabric_factor": options.fabric_factor,
        "elastic_modulus": modulus,
        "elastic_modulus_sd": deviation,
        "environment": environment,
        "seed": options.seed,
    }
    frequencies, share = options.frequencies_Hz or DEFAULT_FREQUENCIES, options.critical_share
    spectrum = predict_attenuation(
        fit, frequencies, regimes, **material, hold_time=hold_time, critical_share=share
    )
    comparison = None
    if options.evolving is not None:
        evolved, at = fitted_material(fit, **material), options.evolving or EVOLVING_FREQUENCIES
        comparison = evolving_attenuation(evolved, at, regimes, hold_time=hold_time)
    measured = None if options.measured is None else load_measured_attenuation(options.measured)
    figure = attenuation(spectrum, comparison, measured)
    files = [out.with_suffix(suffix) for suffix in (".csv", ".nc", ".png", ".svg")]
    spectra, tables = {out: spectrum}, {out: quantile_table(spectrum)}
    if comparison is not None:
        beside_it = out.with_name(f"{out.stem}_evolving.csv")
        spectra[beside_it] = comparison.assign_attrs(which_draws=fit.which_draws)
        tables[beside_it] = evolving_table(comparison)
        files += [beside_it, beside_it.with_suffix(".nc")]
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        # Draws first: where the disk is full, an older set stays whole.
        for file, one in spectra.items():
            save_spectrum(one, file.with_suffix(".nc"))
        for file, rows in tables.items():
            write_text(file, csv_text(rows))
        write_images(figure, out)
    print(f"{spectrum.attrs['title']}: tan(delta), median and 90 % of the draws")
    if spectrum.attrs["cautions"]:
        print(spectrum.attrs["cautions"])
    print(overview_table(spectrum).to_string(index=False))
    print(frozen_sentence(spectrum))
    print(elastic_modulus_sentence(spectrum))
    if comparison is not None:
        print(evolving_overview(comparison).to_string(index=False))
        print(evolving_sentence(comparison))
    for file in files:
        print(shown(file))


def _elastic_modulus(options: argparse.Namespace) -> tuple[float | None, float]:
    """Mean and standard deviation (Pa) of a given elastic modulus."""
    given = options.elastic_modulus_Pa or [None]
    if len(given) > 2:
        raise InputError(
            f"--elastic-modulus-Pa: found {len(given)} numbers, expected the modulus and, if it "
            "has one, its standard deviation."
        )
    return given[0], given[1] if len(given) == 2 else 0.0


def _regimes(options: argparse.Namespace) -> Sequence[Regime]:
    """Imposed stresses as asked for: the paper's, some of them, or given ones."""
    medians, amplitudes = options.median_stress_MPa or [], options.amplitude_MPa or []
    if options.regimes is not None and (medians or amplitudes):
        raise InputError(
            "--regimes: found it beside --median-stress-MPa or --amplitude-MPa, expected either "
            "the paper's regimes or given ones."
        )
    if options.regimes is not None:
        return regimes_named(options.regimes)
    if not medians and not amplitudes:
        return PAPER_REGIMES
    if len(medians) != len(amplitudes):
        raise InputError(
            f"--median-stress-MPa, --amplitude-MPa: found {len(medians)} and {len(amplitudes)} "
            "numbers, expected as many of one as of the other."
        )
    factor = UNITS["stress"]["MPa"]
    pairs = zip(medians, amplitudes, strict=True)
    return tuple(Regime(median * factor, amplitude * factor) for median, amplitude in pairs)


def _test(options: argparse.Namespace) -> int:
    """Predict the response of a test; return the exit code."""
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
    files = _write_prediction(prediction, scores, out)
    print(prediction.title)
    for sentence in (*prediction.cautions, *prediction.notes):
        print(sentence)
    print(overview_of_test(prediction).to_string(index=False))
    if scores is not None:
        print(score_sentence(prediction, scores))
    for file in files:
        print(shown(file))
    return 0


def _write_prediction(prediction: Prediction, scores: pd.DataFrame | None, out: Path) -> list[Path]:
    """Write the files; return their names."""
    files = [out.with_suffix(suffix) for suffix in (".csv", ".nc", ".png", ".svg")]
    tables = {out: band_table(prediction)}
    if scores is not None:
        tables[out.with_name(f"{out.stem}_readings.csv")] = reading_table(prediction)
        tables[out.with_name(f"{out.stem}_scores.csv")] = scores.reset_index()
    with writing(out):
        out.parent.mkdir(parents=True, exist_ok=True)
        # Draws first: where the disk is full, an older set stays whole.
        write_netcdf(out.with_suffix(".nc"), prediction.posterior)
        for file, table in tables.items():
            write_text(file, csv_text(table))
        write_images(prediction_figure(prediction), out)
    return [*files, *(file for file in tables if file != out)]
