"""Command line: which command, what its errors and an interrupt come to."""

import argparse
import errno
import io
import os
import resource
import signal
import sys
import tempfile
import threading
import traceback
from collections.abc import Callable, Iterable, Iterator, Sequence
from contextlib import ExitStack, contextmanager, redirect_stdout, suppress
from importlib import import_module
from pathlib import Path
from types import FrameType, ModuleType

from pyburgers.cli.parser import OneLineParser, ShowVersion
from pyburgers.common.errors import InputError, PyburgersError, nearest
from pyburgers.common.messages import PrintableStream, message_text, messages_to
from pyburgers.common.paths import shown
from pyburgers.common.scratch import scratch_folder

LEAST_MEMORY = 600_000_000
"""Limit of memory (bytes) below which libraries of linear algebra wait for more without an end."""

INTERRUPTED = "interrupted; the same command continues with what is missing."

COMMANDS = {
    "doctor": "what is installed, what is missing",
    "install-cmdstan": "get and build CmdStan",
    "new": "an experiment file for a text file of readings, after asking",
    "check-file": "all that is wrong with an input file, and hints",
    "priors": "the prior file of a material, to be copied and changed",
    "fit": "fit an experiment, or several in a joint fit",
    "check": "the checks of a run again",
    "simulate": "forward solution at given parameters",
    "predict": "what a fit says about other experiments",
    "fit-rates": "fit a composite flow law to tables of steady rates",
    "design": "which test would decide a parameter, or between two laws",
    "compare": "which of several fits, or joint fits, of the same data predicts best",
    "campaign": "many fits: tests by laws, priors and seeds, and one page about them",
    "sbc": "is the fit calibrated: truths from the prior, data, fits, ranks",
    "export": "flow law and elements of a fit, for use in other codes",
    "report": "one HTML page about one or several runs, joint fits among them",
    "completion": "a script with which a shell completes commands and options",
}
"""Purpose of each; its module in this folder has ``add_options`` and ``run``."""


EXIT_CODES = (
    "exit codes: 0 done, and of a fit both verdicts are yes; 1 it could not run; 2 bad input; 3 a "
    "posterior was not sampled well, or a check of another kind failed or had too little to tell; "
    "4 it was sampled well, but the model is not shown to describe the data; 130 interrupted; 143 "
    "or 129 ended by the signal TERM or HUP"
)

ENDING = (signal.SIGINT, signal.SIGTERM, signal.SIGHUP)
"""Signals that end a command, which stops all that it has started."""


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command line, of the process by default; return what `EXIT_CODES` says."""
    _open_streams()
    try:
        return _answered(arguments)
    except Exception as error:  # the last resort: nothing above expects it
        fault = f"the program has a fault ({type(error).__name__}: {error})"
        return _ended(f"{fault}; {_kept_traceback()}.", 1)


def _answered(arguments: Sequence[str] | None) -> int:
    """Run a command; say in a sentence what it comes to, if that is an error that may happen."""
    try:
        try:
            with _signals_heard(), _temporary_files(), redirect_stdout(PrintableStream(sys.stdout)):
                return _run(sys.argv[1:] if arguments is None else arguments)
        finally:
            sys.stdout.flush()
    except PyburgersError as error:
        more = len(error.sentences) - 1 if isinstance(error, InputError) else 0
        told = f" `pyburgers check-file` tells {more} more." if more else ""
        return _ended(f"{error}{told}", error.exit_code)
    except ModuleNotFoundError as error:
        return _ended(f"{error}; `pyburgers doctor` says what to do.", 1)
    except BrokenPipeError:
        _drop_output()
        return 1
    except OSError as error:
        _drop_output()
        wrong_name = error.errno in (errno.ENAMETOOLONG, errno.ELOOP)
        return _ended(
            f"{_place(error)}: {error.strerror or error}; mend that, then run the same command "
            "again.",
            InputError.exit_code if wrong_name else 1,
        )
    except RuntimeError as error:
        if os.path.expanduser("~") != "~":  # noqa: PTH111 - pathlib's raises where there is none
            raise
        return _ended(f"there is no home folder ({error}); set HOME to one.", 1)
    except MemoryError:
        return _ended("memory is full; free some, then run the same command again.", 1)
    except KeyboardInterrupt as error:
        return _ended(INTERRUPTED, 128 + (error.args[0] if error.args else signal.SIGINT))


def _run(arguments: Sequence[str]) -> int:
    """Run a command; return its exit code."""
    if any("\0" in argument for argument in arguments):
        raise InputError("found a zero byte in an argument, expected text.")
    limit, _ = resource.getrlimit(resource.RLIMIT_AS)
    if limit != resource.RLIM_INFINITY and limit < LEAST_MEMORY:
        raise InputError(
            f"memory is limited to {limit / 1e6:.0f} MB, expected at least "
            f"{LEAST_MEMORY / 1e6:.0f} MB; raise the limit (ulimit -v)."
        )
    if {*arguments[:1]} & (COMMANDS.keys() - {"doctor"}):  # which tells of folders itself
        _make_cache()
    options = _parse(arguments)
    _hear((one for one in ENDING if signal.getsignal(one) is _end_at_once), _interrupt)
    with messages_to(sys.stderr):
        code: int = options.run(options)
        return code


def _make_cache() -> None:
    """Make the user's cache, which libraries need when they are imported."""
    import platformdirs  # here, where its absence is told

    folder = Path(platformdirs.user_cache_dir())
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise InputError(
            f"{folder} could not be made ({error.strerror}), but libraries keep files there; set "
            "HOME, or XDG_CACHE_HOME, to a folder that you can write to."
        ) from error


@contextmanager
def _signals_heard() -> Iterator[None]:
    """Have signals end the command at once until it runs, then by an interrupt of what it does.

    Modules that are interrupted while they are imported swallow that or break.
    """
    if threading.current_thread() is not threading.main_thread():
        yield
        return
    before = {one: signal.getsignal(one) for one in ENDING}
    heard = [one for one in ENDING if before[one] not in (signal.SIG_IGN, None)]
    _hear(heard, _end_at_once)
    try:
        yield
    finally:
        for one in heard:
            signal.signal(one, before[one])


def _hear(signals: Iterable[int], handler: Callable[[int, FrameType | None], None]) -> None:
    for one in signals:
        signal.signal(one, handler)


def _end_at_once(number: int, frame: FrameType | None) -> None:
    """End this process; guards end all programs that it has started."""
    with suppress(OSError):
        os.write(2, f"pyburgers: {INTERRUPTED}\n".encode())  # printing may be under way
    os._exit(128 + number)


def _interrupt(number: int, frame: FrameType | None) -> None:
    """Interrupt what the command does."""
    _hear((one for one in ENDING if signal.getsignal(one) is _interrupt), _end_at_once)
    raise KeyboardInterrupt(number)


@contextmanager
def _temporary_files() -> Iterator[None]:
    """Have temporary files of libraries lie in a folder that is cleared after a kill."""
    before = tempfile.tempdir, os.environ.get("TMPDIR")
    with ExitStack() as folders:
        with suppress(OSError):
            tempfile.tempdir = os.environ["TMPDIR"] = str(folders.enter_context(scratch_folder()))
        try:
            yield
        finally:
            tempfile.tempdir = before[0]
            os.environ.pop("TMPDIR", None)
            os.environ.update({} if before[1] is None else {"TMPDIR": before[1]})


def _ended(sentence: str, code: int) -> int:
    """Say why a command has ended, as far as there is someone to say it to."""
    with suppress(OSError):
        print(message_text(shown(f"pyburgers: {sentence}")), file=sys.stderr)
    return code


def _kept_traceback() -> str:
    """Write the traceback of the error that is handled to a file; say where it is."""
    try:
        with tempfile.NamedTemporaryFile(
            "w", prefix="pyburgers-error-", suffix=".txt", delete=False, encoding="utf-8"
        ) as file:
            file.write(traceback.format_exc().encode("utf-8", "backslashreplace").decode())
    except OSError as error:
        return f"its traceback could not be written ({error.strerror})"
    return f"please report it with its traceback, which is in {file.name}"


def _place(error: OSError) -> str:
    """Say what the system did not let the command use."""
    if error.filename is not None:
        return str(error.filename)
    try:
        os.getcwd()  # noqa: PTH109 - only whether there is one
    except OSError:
        return "the working directory was deleted"
    return "standard output or a file"


def _open_streams() -> None:
    """Give streams that were closed somewhere to go, and write any text in any encoding."""
    for name in ("stdout", "stderr"):
        if getattr(sys, name) is None:
            nowhere = os.open(os.devnull, os.O_WRONLY)
            setattr(sys, name, open(nowhere, "w", encoding="utf-8", closefd=False))  # noqa: SIM115
    if isinstance(sys.stdout, io.TextIOWrapper):
        sys.stdout.reconfigure(errors="backslashreplace")


def _drop_output() -> None:
    """Give up output that cannot be written, so that the interpreter does not try again."""
    try:
        sys.stdout.flush()
    except OSError:
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())


def parser_with(commands: Iterable[str]) -> OneLineParser:
    """Return the parser of the command line; it knows the arguments of some commands."""
    parser = OneLineParser(
        prog="pyburgers",
        description="Fit a nonlinear Burgers model to deformation tests, one by one or together.",
        epilog=EXIT_CODES,
    )
    parser.add_argument("--version", action=ShowVersion)
    below = parser.add_subparsers(title="commands", required=True, metavar="COMMAND")
    for name, purpose in COMMANDS.items():
        command = below.add_parser(name, help=purpose, description=purpose, epilog=EXIT_CODES)
        if name in commands:
            module = _module_of(name)
            module.add_options(command)
            command.set_defaults(run=module.run)
    return parser


def _module_of(command: str) -> ModuleType:
    return import_module(f"pyburgers.cli.{command.replace('-', '_')}")


def _parse(arguments: Sequence[str]) -> argparse.Namespace:
    """Parse the command line, with no other module than that of the command."""
    parser = parser_with(arguments[:1])
    for name in arguments[:1]:
        if name.startswith("-"):
            parser.require_own(name)
        elif name not in COMMANDS:
            raise InputError(f"unknown command {name!r}, {nearest(name, COMMANDS)}")
        elif hasattr(module := _module_of(name), "with_default"):
            arguments = [name, *module.with_default(arguments[1:])]
    return parser.parse_all(arguments)
