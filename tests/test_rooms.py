"""The plan of the house: imports run down, none in a circle, and files stay short."""

import ast
import inspect
import re
from collections.abc import Mapping
from functools import cache
from pathlib import Path

from pyburgers.drawing.view import View, views
from pyburgers.kinds.experiment_file import Kind
from pyburgers.kinds.kind import kinds
from pyburgers.kinds.likelihood import NAMES, Likelihood, likelihoods
from pyburgers.sampling.options import COORDINATES

PACKAGE = Path(__file__).parents[1] / "pyburgers"

ROOMS = (
    "cli",
    "page",
    "predictions",
    "comparison",
    "sbc",
    "flow_law_tables",
    "fitting",
    "drawing",
    "checks",
    "posterior",
    "kinds",
    "model",
    "sampling",
    "cmdstan",
    "common",
)
"""From top to bottom; a room imports from itself and from those below it."""

EXAMPLE = re.compile(r'^\n +Examples\n +-+\n.*?(?=^ +""")', re.DOTALL | re.MULTILINE)
"""The end of the docstring of a public name."""

LONGEST_FILE, DEEPEST_CHAIN = 450, 15
"""Lines of a file, without the examples of docstrings; modules in a chain of imports, which were
24 before there were rooms; what has been reached is the limit: no chain may get longer again."""


def module_name(file: Path) -> str:
    parts = file.relative_to(PACKAGE.parent).with_suffix("").parts
    return ".".join(parts).removesuffix(".__init__")


FILES = {module_name(file): file for file in PACKAGE.rglob("*.py")}


@cache
def nodes_of(name: str) -> tuple[ast.AST, ...]:
    """All parts of a module's syntax."""
    return tuple(ast.walk(ast.parse(FILES[name].read_text(encoding="utf-8"))))


@cache
def imported(name: str) -> set[str]:
    """Modules that a module imports, wherever in its text."""
    found = set()
    for node in nodes_of(name):
        if isinstance(node, ast.Import):
            found |= {alias.name for alias in node.names}
        elif isinstance(node, ast.ImportFrom):
            assert node.level == 0, f"{name}: relative import"
            assert node.module is not None
            members = {f"{node.module}.{alias.name}" for alias in node.names}
            modules = members & FILES.keys()
            found |= modules if modules else {node.module}
    return found - {name}


IMPORTS: Mapping[str, set[str]] = {name: imported(name) & FILES.keys() for name in FILES}


def room(name: str) -> str | None:
    """Room of a module; the package itself, imported or run, is above all rooms."""
    place = name.removesuffix(".__main__")
    return place.split(".")[1] if "." in place else None


def test_every_module_is_in_a_room() -> None:
    assert {room(name) for name in FILES} == {None, *ROOMS}


def test_imports_run_down() -> None:
    up = [
        f"{name} imports {other}"
        for name, others in IMPORTS.items()
        for other in others
        if room(name) is not None
        and (room(other) is None or ROOMS.index(room(other)) < ROOMS.index(room(name)))
    ]
    assert not up, "\n".join(sorted(up))


def test_no_imports_run_in_a_circle() -> None:
    circles = []
    for start in IMPORTS:
        reached, waiting = set[str](), list(IMPORTS[start])
        while waiting:
            name = waiting.pop()
            if name not in reached:
                reached.add(name)
                waiting += IMPORTS[name]
        if start in reached:
            circles.append(start)
    assert not circles


def test_chains_of_imports_are_short() -> None:
    @cache
    def chain(name: str) -> tuple[str, ...]:
        """Longest chain of imports from a module."""
        return (name, *max((chain(other) for other in IMPORTS[name]), key=len, default=()))

    longest = max(map(chain, IMPORTS), key=len)
    assert len(longest) <= DEEPEST_CHAIN, " -> ".join(longest)


KINDS_OF_TEST = frozenset(NAMES) - {"attenuation"}
"""Names that decide something where they stand; attenuation is a quantity and a command as well."""


def decisions(name: str) -> list[str]:
    """Where a module asks what kind of test it has: by the kind's name, or by its class."""
    nodes = nodes_of(name)
    classes = {
        alias.name
        for node in nodes
        if isinstance(node, ast.ImportFrom)
        and (node.module or "").startswith(tuple(f"pyburgers.kinds.{kind}" for kind in NAMES))
        for alias in node.names
    }
    return [
        f"{name}, line {node.lineno}"
        for node in nodes
        if (isinstance(node, ast.Constant) and node.value in KINDS_OF_TEST)
        or (
            isinstance(node, ast.Call)
            and ast.unparse(node.func) == "isinstance"
            and any(ast.unparse(part) in classes for part in ast.walk(node.args[1]))
        )
    ]


def test_only_protocols_know_what_kind_of_test_there_is() -> None:
    assert not [place for name in FILES if room(name) != "kinds" for place in decisions(name)]


def test_only_the_posterior_knows_arviz() -> None:
    knowing = {
        room(name)
        for name in FILES
        if any(other.split(".")[0] == "arviz" for other in imported(name))
    }
    assert knowing == {"posterior"}


def test_protocols_draw_nothing() -> None:
    drawing = [
        f"{name} imports {other}"
        for name in FILES
        if room(name) == "kinds"
        for other in imported(name)
        if other.split(".")[0] == "matplotlib" or other.startswith("pyburgers.drawing")
    ]
    assert not drawing


def test_every_kind_has_one_kind_one_likelihood_and_one_view_of_its_name() -> None:
    folders = {file.parent.name for file in (PACKAGE / "kinds").glob("*/__init__.py")}
    assert folders == set(NAMES)
    for objects, structure in (
        (kinds(), Kind),
        (likelihoods(), Likelihood),
        (views(), View),
    ):
        assert tuple(objects) == NAMES
        assert all(isinstance(one, structure) for one in objects.values())
    assert tuple(one.name for one in likelihoods().values()) == NAMES
    assert len(Likelihood.__subclasses__()) == len(NAMES)


MOST_METHODS = 12
"""Methods of the likelihood of a kind: more of them belong to the test itself."""


def test_likelihoods_are_small() -> None:
    methods = [one for one in vars(Likelihood).values() if inspect.isfunction(one)]
    assert len(methods) <= MOST_METHODS


def test_files_are_short() -> None:
    files = [*FILES.values(), *(PACKAGE.parent / "stan").rglob("*.stan")]
    texts = {file: EXAMPLE.sub("", file.read_text(encoding="utf-8")) for file in files}
    lengths = {file: len(text.splitlines()) for file, text in texts.items()}
    assert {file: n for file, n in lengths.items() if n > LONGEST_FILE} == {}


def test_every_chart_can_be_asked_for_by_its_name() -> None:
    charts = {likelihood.chart.name for likelihood in likelihoods().values()}
    assert {"auto", "plain", *charts} == {*COORDINATES}
