"""A page of fits that finish one after the other."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from pyburgers import Fit, PageSection, RateFit, write_report


@dataclass(eq=False)
class GrowingPage:
    """A page that is written again after each of its fits (`pyburgers.write_report`).

    `tests`: names of the tests of all fits, by the name of the fit.
    `shown`: fits that have a section of their own, in the order of the page.
    `at_the_end`: what is still to come besides fits, in words; empty if nothing is.
    `extras`: parts beside the fits that are there already.
    `told`: fits that one of the extras is about, by its key.
    """

    out: Path
    title: str
    command: str
    tests: Mapping[str, str]
    shown: Sequence[str]
    at_the_end: str
    extras: Sequence[PageSection] = ()
    told: Mapping[str, Sequence[RateFit]] = field(default_factory=dict)
    _found: dict[str, Fit] = field(default_factory=dict, init=False)
    _drawn: dict[Path, str] = field(default_factory=dict, init=False)

    @property
    def file(self) -> Path:
        """The page itself."""
        return self.out / "index.html"

    def add(self, name: str, fit: Fit) -> None:
        """Write the page with one more fit, and with what is still to come."""
        self._found[name] = fit
        fits = [self._found[one] for one in self.shown if one in self._found]
        if fits:
            missing = {one: test for one, test in self.tests.items() if one not in self._found}
            more = {self.at_the_end: ""} if self.at_the_end else {}
            self.write(fits, to_come={**missing, **more}, extras=self.extras, told=self.told)

    def write(self, fits: Sequence[Fit], **parts: Any) -> Path:
        """Write the page, with parts as for `pyburgers.write_report`, and return it."""
        return write_report(
            fits, self.out, title=self.title, command=self.command, drawn=self._drawn, **parts
        )
