"""`pyburgers export`: flow law and elements of a fit, for use in other codes."""

import argparse
from pathlib import Path

from pyburgers.cli.outputs import check_output
from pyburgers.cli.shared import writing
from pyburgers.common.errors import InputError
from pyburgers.common.paths import shown
from pyburgers.common.units import UNITS
from pyburgers.flow_law_tables.fit import RateFit, fit_of_run
from pyburgers.predictions.exported import is_exported
from pyburgers.predictions.exports import FORMATS, AnyFit, export, export_files
from pyburgers.predictions.stress_cycles import Regime


def add_options(command: argparse.ArgumentParser) -> None:
    """Add the arguments of the command."""
    what = "run directory of fit or fit-rates"
    command.add_argument("directory", type=Path, metavar="RUN", help=what)
    command.add_argument("--format", choices=sorted(FORMATS), default="json", help="of the output")
    command.add_argument("--test", metavar="ID", help="test of a joint fit")
    command.add_argument(
        "--out", type=Path, metavar="FILE", help="of the mean; default standard output"
    )
    command.add_argument(
        "--draws",
        type=int,
        default=0,
        metavar="N",
        help="an ensemble of N draws, each in a file of its own beside --out (json: in the file)",
    )
    command.add_argument("--seed", type=int, default=1, help="of the choice of draws")
    command.add_argument(
        "--microstructure",
        choices=("initial", "steady-state"),
        help="state of a material that evolves, which other codes hold",
    )
    for option, metavar, what in (
        ("--grain-size-um", "D", "in place of that of --microstructure"),
        ("--fabric-factor", "F", "in place of that of --microstructure"),
        ("--median-stress-MPa", "M", "axial median stress of cycles (specfem, tidalpy)"),
        ("--amplitude-MPa", "A", "axial amplitude of cycles (specfem, tidalpy)"),
        ("--poisson-ratio", "NU", "turns E_M into a shear modulus (specfem, tidalpy)"),
        ("--elastic-modulus-Pa", "E", "in place of E_M (specfem, tidalpy)"),
    ):
        command.add_argument(option, type=float, metavar=metavar, help=what)
    for option, metavar, what in (
        ("--temperature-K", "T", "default that of the test (icepack, specfem, tidalpy)"),
        ("--frequencies-Hz", "F", "default 60 from 1e-4 to 1 (specfem, tidalpy)"),
    ):
        command.add_argument(option, type=float, nargs="+", default=[], metavar=metavar, help=what)


def run(options: argparse.Namespace) -> int:
    """Run the command; return its exit code."""
    n_texts = 1 if options.format == "json" else 1 + max(0, options.draws)
    if options.out is None and n_texts > 1:
        raise InputError("--draws: found no --out, expected the file beside which the draws go.")
    files = [] if options.out is None else export_files(options.out, n_texts)
    for file in files:
        check_output(file, options.directory)
        # No input tells which files somebody else has written.
        if file.is_file() and file.stat().st_size and not is_exported(file):
            raise InputError(
                f"--out {file}: holds something else than an export, expected a new file or an "
                "earlier export."
            )
    grain_size, stress = options.grain_size_um, UNITS["stress"]["MPa"]
    cycles = (options.median_stress_MPa, options.amplitude_MPa)
    if cycles.count(None) == 1:
        raise InputError("--median-stress-MPa, --amplitude-MPa: found one, expected both or none.")
    fit = _loaded(options.directory, options.test)
    with writing(options.out):
        texts = export(
            fit,
            options.format,
            out=options.out,
            draws=options.draws,
            seed=options.seed,
            microstructure=options.microstructure and options.microstructure.replace("-", "_"),
            grain_size=None if grain_size is None else grain_size * UNITS["length"]["um"],
            fabric_factor=options.fabric_factor,
            temperatures=options.temperature_K,
            frequencies=options.frequencies_Hz,
            regime=None if None in cycles else Regime(*(one * stress for one in cycles)),
            poisson_ratio=options.poisson_ratio,
            elastic_modulus=options.elastic_modulus_Pa,
        )
    if options.out is None:
        print(texts[0], end="")
    for file in files:
        print(shown(file))
    return 0


def _loaded(directory: Path, test: str | None) -> AnyFit:
    """Return a fit, what a joint one says of a test, or a fit of tables of rates."""
    fit = fit_of_run(directory)
    if test is None:
        return fit
    if isinstance(fit, RateFit):
        raise InputError(
            f"--test: found {test}, expected none: {directory} is a fit of tables of rates."
        )
    return fit[test]
