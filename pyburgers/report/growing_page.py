"""A page of several fits that is there after the first one and written again after each."""

from collections.abc import Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pyburgers.fitting.fit import Fit
from pyburgers.report.page import write_report


@dataclass(eq=False)
class GrowingPage:
    """A page of fits that finish one after the other.

    Attributes
    ----------
    out, title, command
        As for `pyburgers.report.page.write_report`.
    names : sequence of str
        All fits, by name.
    shown : sequence of str
        Those of them that have a section of their own, in the order of the page.
    at_the_end : str
        What comes when all fits are done, in words.
    """

    out: Path
    title: str
    command: str
    names: Sequence[str]
    shown: Sequence[str]
    at_the_end: str
    _found: dict[str, Fit] = field(default_factory=dict, init=False)
    _drawn: dict[Path, str] = field(default_factory=dict, init=False)

    def add(self, name: str, fit: Fit) -> None:
        """Write the page with one more fit, and with what is still to come."""
        self._found[name] = fit
        fits = [self._found[one] for one in self.shown if one in self._found]
        if fits:
            missing = [one for one in self.names if one not in self._found]
            self._write(fits, to_come=[*missing, self.at_the_end])

    def finish(self, fits: Sequence[Fit], **parts: Any) -> Path:
        """Write the whole page and return it.

        Parameters
        ----------
        fits, parts
            As for `pyburgers.report.page.write_report`.
        """
        return self._write(fits, **parts, jobs=None)

    def _write(self, fits: Sequence[Fit], **parts: Any) -> Path:
        return write_report(
            fits, self.out, title=self.title, command=self.command, drawn=self._drawn, **parts
        )
