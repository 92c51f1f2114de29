"""Sphinx extension: pages that run what they show, and tables that come from the code.

Pages are plain Markdown, in which `markers` finds their directives. Their folders lie beside a link
``data`` to the shipped data, as a folder of the checkout does.

Directives
----------
write-file NAME
    Shows a file and writes it into the folder of the page.
run shell, run python
    Shows and runs lines there, then shows what they print. Options: ``exit`` (codes that are
    expected), ``lines`` (of output that are shown), ``messages`` (shows standard error, too),
    ``images`` (files to show) with ``alt``.
example SCRIPT
    Shows and runs a script of ``examples/`` or of ``docs/gallery/`` with ``arguments``; ``fold``
    puts what it shows first and folds its text.
page FOLDER
    Embeds a page that ``pyburgers report`` has written.
file-keys NAME, all-parameters, prior-families, combinations, commands
    Tables of `file_keys`, `combinations` and the command line.
"""

import shutil
import sys
from collections.abc import Sequence
from pathlib import Path
from typing import Any, ClassVar

from docutils import nodes
from docutils.parsers.rst import directives
from docutils.statemachine import StringList
from execution import ExecutionError, Result, run, run_python, run_shell, shortened
from generated_tables import TABLES, key_lines
from markers import with_directives
from sphinx.application import Sphinx
from sphinx.util import logging
from sphinx.util.docutils import SphinxDirective

logger = logging.getLogger(__name__)

ROOT = Path(__file__).parents[2]
WORK = ROOT / "build" / "docs" / "work"
"""Folders of the pages, in which their commands run."""

EXTRA = ROOT / "build" / "docs" / "extra"
"""What is copied beside the pages."""

LINES = 40
"""Lines of output that are shown where a page does not say how many."""

LANGUAGES = {".py": "python", ".stan": "text", ".toml": "toml", ".csv": "text"}


class PageDirective(SphinxDirective):
    """A directive that writes into the folder of its page."""

    @property
    def folder(self) -> Path:
        """Where the commands of the page run."""
        return WORK / self.env.docname

    def failed(self, message: str) -> list[nodes.Node]:
        """Report an error of the page, which ends the build."""
        logger.warning(message, location=self.get_location())
        return []

    def markdown(self, lines: Sequence[str]) -> list[nodes.Node]:
        """Return what Markdown stands for."""
        container = nodes.Element()
        self.state.nested_parse(StringList(list(lines), source=self.env.docname), 0, container)
        return container.children

    def code(self, text: str, language: str, *names: str) -> nodes.Node:
        """Return a block of code."""
        return nodes.literal_block(text, text, language=language, classes=list(names))

    def shown(self, result: Result) -> list[nodes.Node]:
        """Return what a command printed, with the images that the page asks for."""
        found: list[nodes.Node] = []
        printed = result.output + (result.messages if "messages" in self.options else "")
        text = shortened(printed.replace(str(self.folder), "."), self.options["lines"])
        if text:
            found.append(self.code(text, "text", "output"))
        for name in self.options.get("images", "").split():
            image = self.folder / name
            if not image.is_file():
                return self.failed(f"{name} was not written by the commands of the page.")
            uri = f"/{image.relative_to(ROOT).as_posix()}"
            alt = self.options.get("alt", f"{image.stem.replace('_', ' ')}, as just computed")
            found.append(nodes.image(uri=uri, candidates={}, alt=alt))
        return found


class WriteFile(PageDirective):
    """``write-file NAME``."""

    required_arguments = 1
    has_content = True

    def run(self) -> list[nodes.Node]:
        """Write the file, show it."""
        target = self.folder / self.arguments[0]
        target.parent.mkdir(parents=True, exist_ok=True)
        text = "\n".join(self.content)
        target.write_text(text + "\n", encoding="utf-8")
        title = nodes.caption("", "", nodes.literal("", self.arguments[0]))
        block = nodes.container("", literal_block=True, classes=["literal-block-wrapper"])
        block += [title, self.code(text, LANGUAGES.get(target.suffix, "text"))]
        return [block]


def _numbers(text: str) -> tuple[int, ...]:
    return tuple(int(part) for part in text.split())


class Run(PageDirective):
    """``run shell`` and ``run python``."""

    required_arguments = 1
    has_content = True
    option_spec: ClassVar[dict[str, Any]] = {
        "exit": _numbers,
        "lines": directives.nonnegative_int,
        "images": directives.unchanged,
        "alt": directives.unchanged,
        "messages": directives.flag,
    }

    def run(self) -> list[nodes.Node]:
        """Run the lines, show them and what they print."""
        self.options.setdefault("lines", LINES)
        kind = self.arguments[0]
        runner = {"shell": run_shell, "python": run_python}[kind]
        text = "\n".join(self.content)
        try:
            result = runner(text, self.folder, self.options.get("exit", (0,)))
        except ExecutionError as error:
            return self.failed(str(error))
        logger.info(f"{self.env.docname}: {result.seconds:.1f} s")
        return [self.code(text, kind), *self.shown(result)]


class Example(PageDirective):
    """``example SCRIPT``."""

    required_arguments = 1
    option_spec: ClassVar[dict[str, Any]] = {
        **Run.option_spec,
        "arguments": directives.unchanged,
        "fold": directives.flag,
    }

    def run(self) -> list[nodes.Node]:
        """Run the script, show it and what it prints."""
        self.options.setdefault("lines", LINES)
        script = ROOT / self.arguments[0]
        self.env.note_dependency(str(script))
        arguments = self.options.get("arguments", "").split()
        try:
            result = run(
                [sys.executable, str(script), *arguments],
                self.folder,
                self.options.get("exit", (0,)),
            )
        except ExecutionError as error:
            return self.failed(str(error))
        logger.info(f"{self.env.docname}: {script.name} {result.seconds:.1f} s")
        command = " ".join(["python", self.arguments[0], *arguments])
        script_nodes: list[nodes.Node] = [
            self.code(script.read_text(encoding="utf-8"), "python"),
            self.code(command, "shell"),
        ]
        if "fold" not in self.options:
            return [*script_nodes, *self.shown(result)]
        head = f"<details><summary><code>{self.arguments[0]}</code></summary>"
        before, after = (nodes.raw("", text, format="html") for text in (head, "</details>"))
        return [*self.shown(result), before, *script_nodes, after]


class EmbeddedPage(PageDirective):
    """``page FOLDER``."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Copy the page beside the site, and show it in a frame."""
        source = self.folder / self.arguments[0]
        if not (source / "index.html").is_file():
            return self.failed(f"{source} has no index.html.")
        target = Path("pages", *Path(self.env.docname).parts[1:])
        shutil.copytree(source, EXTRA / target, dirs_exist_ok=True)
        up = "../" * self.env.docname.count("/")
        address = f"{up}{target.as_posix()}/index.html"
        frame = (
            f'<p><a href="{address}">Open the page by itself</a></p>'
            f'<iframe class="page" src="{address}" title="A page of pyburgers report"></iframe>'
        )
        return [nodes.raw("", frame, format="html")]


class FileKeys(PageDirective):
    """``file-keys NAME``."""

    required_arguments = 1

    def run(self) -> list[nodes.Node]:
        """Show the keys of a kind of file."""
        return self.markdown(key_lines(self.arguments[0]))


class GeneratedTable(PageDirective):
    """A directive that is called after one of `generated_tables.TABLES`."""

    def run(self) -> list[nodes.Node]:
        """Show the table."""
        return self.markdown(TABLES[self.name]())


def _start_afresh(app: Sphinx, docname: str, source: list[str]) -> None:
    """Read the markers of a page, and empty its folder for its commands."""
    source[0] = with_directives(source[0])
    folder = WORK / docname
    shutil.rmtree(folder, ignore_errors=True)
    folder.parent.mkdir(parents=True, exist_ok=True)
    data = folder.with_name("data")
    if not data.is_symlink():
        data.symlink_to(ROOT / "data")


def setup(app: Sphinx) -> dict[str, Any]:
    """Register the directives."""
    for name, directive in {
        "write-file": WriteFile,
        "run": Run,
        "example": Example,
        "page": EmbeddedPage,
        "file-keys": FileKeys,
        **dict.fromkeys(TABLES, GeneratedTable),
    }.items():
        app.add_directive(name, directive)
    app.connect("source-read", _start_afresh)
    # Pages run one after the other: the processors are for their commands.
    return {"version": "1", "parallel_read_safe": False, "parallel_write_safe": True}
