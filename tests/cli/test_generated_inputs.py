"""Generated inputs: every reader and option says a sentence or works, soon, and writes nothing.

The fast suite looks at a sample, the slow one at 10,000; both are the same at every run.
"""

import json
import os
import signal
import tempfile
import tomllib
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager, suppress
from dataclasses import asdict, dataclass
from functools import partial
from pathlib import Path
from typing import Any

import pytest
import tomli_w
from hypothesis import HealthCheck, assume, given, seed, settings
from hypothesis import strategies as st
from mutations import NAMES as ODD_NAMES
from mutations import NUMBERS, TEXT, changed_bytes, changed_tables, text_tables

from pyburgers.cli.check_file import check as check_file
from pyburgers.cli.main import COMMANDS, main
from pyburgers.common.errors import PyburgersError
from pyburgers.common.text_tables import look_at
from pyburgers.fitting.campaign import load_campaign
from pyburgers.fitting.fit import Fit
from pyburgers.flow_law_tables.laws import load_rate_law
from pyburgers.flow_law_tables.table_files import load_rate_table
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forward import load_parameters
from pyburgers.kinds.guessed_columns import guess_columns
from pyburgers.kinds.kind import load_experiment
from pyburgers.kinds.likelihood import NAMES
from pyburgers.kinds.problem import problem_of
from pyburgers.kinds.program_data import program_data
from pyburgers.kinds.stan_data import SolverOptions
from pyburgers.model.priors import default_priors, load_priors
from pyburgers.predictions.design_plans import load_design_plan
from pyburgers.predictions.measured_attenuation import load_measured_attenuation
from pyburgers.sampling.manifest import FitManifest, missing_chains, recorded_modes, sealed
from pyburgers.sampling.options import SamplerOptions
from pyburgers.sampling.run_directory import RunDirectory
from pyburgers.sbc.replication import read_replication_table

DATA = Path(__file__).parents[2] / "data"
LIMIT_S = 10.0
FEW_AND_ALL = pytest.mark.parametrize(
    "share", [0.03, pytest.param(1.0, marks=pytest.mark.slow)], ids=["few", "all"]
)


@dataclass(frozen=True)
class Reader:
    """A shipped input file, the files beside it, and what reads it."""

    file: Path
    read: Callable[[Path], object]

    @property
    def beside(self) -> list[Path]:
        named = "*.toml" if self.read is load_design_plan else "*.csv"
        return [path for path in self.file.parent.glob(named) if path != self.file]


def _experiment_for_a_fit(path: Path) -> object:
    """Read a test and go on with it as far as a fit does without Stan."""
    experiment: Experiment = load_experiment(path)
    problem = problem_of([experiment], default_priors(experiment.material))
    return program_data(problem, solver=SolverOptions())


def _readers() -> Iterator[Reader]:
    for path in sorted(DATA.rglob("*.toml")):
        content = tomllib.loads(path.read_text(encoding="utf-8"))
        if content.get("protocol") in NAMES:
            yield Reader(path, _experiment_for_a_fit)
        elif content.get("protocol") == "rates":
            yield Reader(path, load_rate_table)
        elif "candidates" in content:
            yield Reader(path, load_design_plan)
        elif "mechanisms" in content:
            yield Reader(path, load_rate_law)
        elif path.parent.name in ("priors", "calibration"):
            yield Reader(path, load_priors)


def _data_of(reader: Reader) -> dict[str, Any] | None:
    table: dict[str, Any] = tomllib.loads(reader.file.read_text(encoding="utf-8"))
    return table.get("data")


READERS = tuple(_readers())
WITH_DATA = [reader for reader in READERS if _data_of(reader) is not None]
WITH_ONE_TABLE = {
    reader.file.name: reader for reader in WITH_DATA if "file" in (_data_of(reader) or {})
}
PARAMETERS = {
    name: value
    for reader in READERS
    if reader.file.stem == "PIL40"
    for name, value in tomllib.loads(reader.file.read_text("utf-8"))["true_parameters"].items()
}
PLAN = f"""
id = "laws"
seeds = [1, 2]
tests.alone = ["{DATA / "ice" / "PIL40.toml"}"]
tests.two = ["{DATA / "ice" / "PIL40.toml"}", "{DATA / "ice" / "PIL72.toml"}"]
variants.standard = {{}}
variants.power = {{ kelvin = "power_law" }}
priors.shipped = "default"
priors.own = "{DATA / "priors" / "ice.toml"}"
pool.stress_noise = "separate"
sampler.draws = 500
"""
MANIFEST = {
    "fingerprint": "0" * 64,
    "status": "complete",
    "experiment": "PIL40",
    "experiments": ["PIL40"],
    "data_kind": "synthetic",
    "command": "pyburgers fit PIL40.toml",
    "started": "2024-03-01T09:00:00+00:00",
    "versions": {"pyburgers": "0.1.0", "cmdstan": None},
    "hashes": {"stan_data.json": "0" * 64},
    "chains": {"1": {"wall_seconds": 2.5, "sha256": "0" * 64, "extension": 0}},
    "sampler": asdict(SamplerOptions()),
    "use_likelihood": True,
    "failures": [{"chain": 2, "reason": "the system ended it"}],
    "pooling": {"kinds": {"beta": "shared"}, "spread_scales": {}},
    "variant": {"kelvin": "linear"},
    "solver": {"tolerance": 1e-5, "max_num_steps": 20000, "method": "bdf"},
    "refits": [],
    "coordinates": {"system": "plain", "reason": "nothing is free"},
    "other_modes": [{"log_weight": -3.0, "values": {"PIL40": {"beta": -0.1}}}],
}
POINTS = b"# somebody\nfrequency_Hz,tan_delta,tan_delta_sd,series\n0.001,0.41,0.03,a\n0.01,0.3,,b\n"


@contextmanager
def bounded() -> Iterator[None]:
    """Stop what takes more processor time than `LIMIT_S`."""

    def stop(*_: object) -> None:
        raise TimeoutError(f"took more than {LIMIT_S:g} s")

    before = signal.signal(signal.SIGPROF, stop)
    signal.setitimer(signal.ITIMER_PROF, LIMIT_S)
    try:
        yield
    finally:
        signal.setitimer(signal.ITIMER_PROF, 0.0)
        signal.signal(signal.SIGPROF, before)


def check(read: Callable[[Path], object], folder: Path, name: str, content: bytes) -> None:
    """Read a file; nothing but an error of the package's own may come of it."""
    (folder / name).write_bytes(content)
    before = sorted(folder.rglob("*"))
    with bounded(), suppress(PyburgersError):
        read(folder / name)
    assert sorted(folder.rglob("*")) == before
    assert (folder / name).read_bytes() == content


def run_examples(function: Callable[[st.DataObject], None], number: float) -> None:
    """Run a function of drawn data so many times, the same at every run."""
    examples = settings(
        max_examples=int(number),
        deadline=None,
        database=None,
        suppress_health_check=list(HealthCheck),
    )(given(st.data())(function))
    seed(20)(examples)()


@contextmanager
def folder_with(files: Sequence[Path]) -> Iterator[Path]:
    """Give a folder that looks as if it held some files."""
    with tempfile.TemporaryDirectory() as name:
        for file in files:
            (Path(name) / file.name).symlink_to(file)
        yield Path(name)


def changed_keys(data: st.DataObject) -> None:
    reader = data.draw(st.sampled_from(READERS))
    table = tomllib.loads(reader.file.read_text(encoding="utf-8"))
    changed = data.draw(changed_tables(table))
    try:
        text = tomli_w.dumps(changed)
    except (ValueError, TypeError):  # not what TOML holds
        assume(False)
    with folder_with(reader.beside) as folder:
        read = data.draw(st.sampled_from([reader.read, check_file]))
        check(read, folder, reader.file.name, text.encode())


def changed_files(data: st.DataObject) -> None:
    reader = data.draw(st.sampled_from(READERS))
    content = data.draw(changed_bytes(reader.file.read_bytes()))
    with folder_with(reader.beside) as folder:
        check(reader.read, folder, reader.file.name, content)


def changed_columns(data: st.DataObject) -> None:
    reader = data.draw(st.sampled_from(WITH_DATA))
    text = reader.file.read_text(encoding="utf-8")
    named = [file for file in reader.beside if f'"{file.name}"' in text]
    assume(named)
    changed = data.draw(st.sampled_from(named))
    content = data.draw(changed_bytes(changed.read_bytes()))
    others = [file for file in reader.beside if file != changed]
    with folder_with([*others, reader.file]) as folder:
        read = data.draw(st.sampled_from([reader.read, check_file]))
        check(lambda _: read(folder / reader.file.name), folder, changed.name, content)


def _read_table(path: Path) -> None:
    """Look at a table as a command does that is to describe it, and take its numbers."""
    table = look_at(path)
    guess_columns(table)
    assert all(isinstance(note, str) for note in table.notes)
    for column in table.columns:
        cells = table.cleaned(table.columns.index(column))
        assert len(table.numbers(column)) <= len(cells) == len(table.rows)
        assert isinstance(table.described(column), str)


def tables(data: st.DataObject) -> None:
    """Tables of any layout, read by themselves and as the columns that a test names."""
    alone: dict[str, Callable[[Path], object]] = {
        "table.csv": _read_table,
        "points.csv": load_measured_attenuation,
        "ranks.csv": partial(read_replication_table, n_draws=19),
    }
    columns, content = data.draw(text_tables())
    name = data.draw(st.sampled_from([*alone, *WITH_ONE_TABLE]))
    if name in alone:
        with folder_with([]) as folder:
            check(alone[name], folder, name, content)
        return
    reader = WITH_ONE_TABLE[name]
    table = tomllib.loads(reader.file.read_text(encoding="utf-8"))
    described = {
        key: data.draw(st.sampled_from(columns)) for key in table["data"] if "_column" in key
    }
    table["data"] |= {"file": "table.csv", **described}
    for key in data.draw(st.sets(st.sampled_from(["separator", "header"]))):
        table["data"].pop(key, None)
    with folder_with(reader.beside) as folder:
        (folder / "table.csv").write_bytes(content)
        read = data.draw(st.sampled_from([reader.read, check_file]))
        check(read, folder, name, tomli_w.dumps(table).encode())


def manifests(data: st.DataObject) -> None:
    """Manifests of runs that were damaged, and strange ones that fit their seals."""

    def read(path: Path) -> None:
        manifest = RunDirectory(path.parent).read_manifest(FitManifest)
        assert missing_chains([], manifest)
        recorded_modes(manifest, None)
        Fit.load(path.parent)

    changed = data.draw(changed_tables(MANIFEST))
    shown = json.dumps(sealed(json.loads(json.dumps(changed, default=str)))).encode()
    if data.draw(st.booleans()):
        shown = data.draw(changed_bytes(shown))
    with folder_with([]) as folder:
        check(read, folder, "manifest.json", shown)


def other_files(data: st.DataObject) -> None:
    files = {
        "parameters.json": (load_parameters, json.dumps(PARAMETERS, indent=1).encode()),
        "points.csv": (load_measured_attenuation, POINTS),
        "plan.toml": (load_campaign, PLAN.encode()),
    }
    name = data.draw(st.sampled_from(sorted(files)))
    read, content = files[name]
    with folder_with([]) as folder:
        check(read, folder, name, data.draw(changed_bytes(content)))


OPTIONS = {
    "fit": (
        *("--pool", "--variant", "--priors", "--priors-from", "--out", "--chains", "--warmup"),
        *("--draws", "--seed", "--adapt-delta", "--max-treedepth", "--coordinates"),
        *("--chain-timeout", "--parallel-chains", "--tolerance", "--prior-only", "--more-draws"),
    ),
    "check": (),
    "check-file": (),
    "export": (
        *("--format", "--test", "--out", "--draws", "--microstructure", "--grain-size-um"),
        *("--temperature-K", "--median-stress-MPa", "--poisson-ratio"),
    ),
    "new": ("--protocol", "--material", "--temperature-K", "--grain-size-m", "--strain-rate-per-s"),
    "simulate": ("--parameters", "--out"),
    "design": ("--candidates", "--against", "--choose", "--draws", "--seed", "--out"),
    "fit-rates": (
        *("--law", "--hold-out", "--curve-priors", "--without", "--out", "--chains", "--seed"),
        "--more-draws",
    ),
    "compare": ("--out", "--leave-out", "--no-refit"),
    "sbc": (
        *("--priors", "--out", "--simulations", "--ranked-draws", "--refits", "--stress-range"),
        *("--results-of", "--jobs", "--chains", "--warmup", "--draws", "--seed", "--variant"),
    ),
    "campaign": ("--out", "--status", "--jobs", "--part"),
    "report": ("--out", "--title"),
    "predict": ("--out", "--test", "--elastic-modulus-Pa", "--measured", "--evolving"),
}
TESTS = tuple(str(reader.file) for reader in READERS if "data/priors" not in str(reader.file))
WORDS = st.one_of(
    NUMBERS.map(str),
    TEXT,
    ODD_NAMES,
    st.sampled_from([*TESTS, "all=shared", "kelvin=power_law", "beta=partial:2", "out", "points"]),
    st.sampled_from(
        [str(DATA), str(DATA / "priors" / "ice.toml"), str(DATA / "ice" / "PIL40.csv")]
    ),
)


def options(data: st.DataObject) -> None:
    command = data.draw(st.sampled_from(sorted(OPTIONS)))
    arguments = [command]
    if command == "predict":
        arguments.append(data.draw(st.sampled_from(["attenuation", "test"])))
    arguments.append(data.draw(st.sampled_from(TESTS) | WORDS))
    for _ in range(data.draw(st.integers(0, 4))):
        named = st.sampled_from(OPTIONS[command]) if OPTIONS[command] else WORDS
        arguments += [data.draw(named), data.draw(WORDS)]
    with folder_with([]) as folder, bounded():
        os.chdir(folder)
        try:
            code = main(arguments)
        except SystemExit as end:  # how argparse refuses
            code = int(end.code or 0)
        finally:
            os.chdir(DATA)
        assert code in (0, 1, 2)
        assert not list(folder.iterdir())


@FEW_AND_ALL
@pytest.mark.parametrize(
    ("generate", "number"),
    [
        pytest.param(changed_keys, 4000, id="keys"),
        pytest.param(changed_files, 1500, id="files"),
        pytest.param(changed_columns, 1500, id="columns"),
        pytest.param(tables, 1700, id="tables"),
        pytest.param(manifests, 300, id="manifests"),
        pytest.param(other_files, 500, id="others"),
    ],
)
def test_files_are_read_or_refused(
    generate: Callable[[st.DataObject], None], number: int, share: float
) -> None:
    run_examples(generate, share * number)


@pytest.fixture
def without_stan(monkeypatch: pytest.MonkeyPatch, tmp_path: Path) -> None:
    """What needs Stan ends where it would begin."""
    monkeypatch.setenv("CMDSTAN", str(tmp_path / "nothing"))
    monkeypatch.chdir(tmp_path)


@FEW_AND_ALL
def test_options_work_or_are_refused(
    share: float, without_stan: None, capsys: pytest.CaptureFixture[str]
) -> None:
    run_examples(options, share * 2000)


def test_every_command_is_tried_that_reads_files() -> None:
    others = {"completion", "doctor", "install-cmdstan", "priors"}
    assert set(COMMANDS) - set(OPTIONS) <= others
