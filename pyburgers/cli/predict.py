"""`pyburgers predict`: what a fit says about other experiments."""

import argparse
from collections.abc import Sequence
from pathlib import Path

from pyburgers.cli.shared import writing
from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import InputError
from pyburgers.common.units import UNITS
from pyburgers.drawing.style import write_images
from pyburgers.fitting.fit import Fit
from pyburgers.predictions.attenuation import (
    DEFAULT_FREQUENCIES,
    overview_table,
    predict_attenuation,
    quantile_table,
    save_spectrum,
)
from pyburgers.predictions.attenuation_figures import attenuation
from pyburgers.predictions.stress_cycles import PAPER_REGIMES, Regime, regimes_named


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    predictions = command.add_subparsers(title="predictions", required=True, metavar="WHAT")
    command = predictions.add_parser(
        "attenuation", help="tan(delta) of stress cycles about a median stress"
    )
    command.add_argument("directory", type=Path, metavar="RUN")
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
        ("--median-stress-MPa", "M", "median stress of each regime"),
        ("--amplitude-MPa", "A", "amplitude of each regime, as many"),
        ("--frequencies-Hz", "F", "default: 60 from 1e-4 to 1"),
    ):
        command.add_argument(option, type=float, nargs="+", metavar=metavar, help=what)
    for option, metavar, what in (
        ("--temperature-K", "T", "default: the experiment's"),
        ("--grain-size-um", "D", "default: by --microstructure"),
        ("--fabric-factor", "F", "default: by --microstructure"),
    ):
        command.add_argument(option, type=float, metavar=metavar, help=what)
    command.add_argument(
        "--microstructure", default="initial", help="initial (default) or steady-state"
    )


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    if options.out.suffix != ".csv":
        raise InputError(f"--out {options.out}: expected a file name that ends in .csv.")
    regimes = _regimes(options)
    grain_size = options.grain_size_um
    spectrum = predict_attenuation(
        Fit.load(options.directory),
        options.frequencies_Hz or DEFAULT_FREQUENCIES,
        regimes,
        microstructure=options.microstructure.replace("-", "_"),
        temperature=options.temperature_K,
        grain_size=None if grain_size is None else grain_size * UNITS["length"]["um"],
        fabric_factor=options.fabric_factor,
    )
    table = quantile_table(spectrum)
    figure = attenuation(spectrum, spectrum.attrs["title"])
    with writing(options.out):
        write_text(options.out, table.to_csv(index=False))
        save_spectrum(spectrum, options.out.with_suffix(".nc"))
        write_images(figure, options.out)
    print(f"{spectrum.attrs['title']}: tan(delta), median and 90 % of the draws")
    print(overview_table(spectrum).to_string(index=False))
    for suffix in (".csv", ".nc", ".png", ".svg"):
        print(options.out.with_suffix(suffix))
    return 0


def _regimes(options: argparse.Namespace) -> Sequence[Regime]:
    """Imposed stresses as asked for: the paper's, some of them, or given ones."""
    medians, amplitudes = options.median_stress_MPa, options.amplitude_MPa
    if options.regimes is not None and (medians is not None or amplitudes is not None):
        raise InputError(
            "--regimes: found it beside --median-stress-MPa or --amplitude-MPa, expected either "
            "the paper's regimes or given ones."
        )
    if options.regimes is not None:
        return regimes_named(options.regimes)
    if medians is None and amplitudes is None:
        return PAPER_REGIMES
    if len(medians or []) != len(amplitudes or []):
        raise InputError(
            f"--median-stress-MPa, --amplitude-MPa: found {len(medians or [])} and "
            f"{len(amplitudes or [])} numbers, expected as many of one as of the other."
        )
    factor = UNITS["stress"]["MPa"]
    pairs = zip(medians, amplitudes, strict=True)
    return tuple(Regime(median * factor, amplitude * factor) for median, amplitude in pairs)
