"""A page as a reader meets it."""

from collections.abc import Sequence
from html.parser import HTMLParser
from pathlib import Path
from typing import Any

from pyburgers.fitting.fit import Fit
from pyburgers.page.page import write_report


class Page(HTMLParser):
    """Collects what a page refers to, its text, and whether elements are closed."""

    VOID = frozenset({"meta", "img", "br", "wbr", "link", "hr", "input"})

    def __init__(self, text: str) -> None:
        super().__init__()
        self.references: list[tuple[str, str]] = []
        self.tags: list[str] = []
        self.open: list[str] = []
        self.ids: list[str] = []
        self.alternatives: list[str] = []
        self.labels: list[str] = []
        self.words: list[str] = []
        self.shown: list[str] = []
        self.feed(text)
        self.close()
        self.text = " ".join(" ".join(self.words).split())
        self.text_without_marks = " ".join("".join(self.words).split())
        self.unfolded = " ".join("".join(self.shown).split())

    def handle_starttag(self, tag: str, attrs: list[tuple[str, str | None]]) -> None:
        self.tags.append(tag)
        if tag not in self.VOID:
            self.open.append(tag)
        for name, value in attrs:
            if name in {"src", "href"}:
                self.references.append((tag, value or ""))
            if name == "id":
                self.ids.append(value or "")
            if name == "aria-label":
                self.labels.append(value or "")
            if name == "aria-label" and tag == "svg":
                self.alternatives.append(value or "")

    def handle_endtag(self, tag: str) -> None:
        assert self.open.pop() == tag

    def handle_data(self, data: str) -> None:
        if not self.open or self.open[-1] not in {"style", "script"}:
            self.words.append(data)
            if not self.is_folded:
                self.shown.append(data)

    @property
    def is_folded(self) -> bool:
        """Whether what comes now is unseen until a reader unfolds it."""
        parts = [tag for tag in self.open if tag in {"details", "summary"}]
        summary = bool(parts) and parts[-1] == "summary"
        return "nav" not in self.open and "details" in (parts[:-2] if summary else parts)


def html_of(fits: Sequence[Fit], out: Path, **parts: Any) -> str:
    """The text of a page about fits."""
    file = write_report(fits, out, **{"title": "T", "command": "x", **parts})
    return file.read_text(encoding="utf-8")


def page_of(fits: Sequence[Fit], out: Path, **parts: Any) -> Page:
    """A page about fits, read."""
    return Page(html_of(fits, out, **parts))
