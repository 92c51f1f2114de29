"""How the page shows a kind of test: figures, curve, facts and tables, joined to it by its name.

To show a new kind: a module of its name in the folder ``views`` with an object ``VIEW`` (`View`).
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass
from functools import cache
from importlib import import_module
from types import MappingProxyType
from typing import Any

from markupsafe import Markup

from pyburgers.drawing.page_parts import FigureRecipe, PageFigure, PageTable
from pyburgers.drawing.panels import FittedCurve, ReadCurve
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.kind import FittedTest
from pyburgers.kinds.likelihood import NAMES


@dataclass(frozen=True)
class View:
    """How the page shows a kind of test; its functions take a test or a fit of one.

    `figures`: those beside the posterior's, the curve first. `read`, `curve`: readings along the
    clock, and with the response of the fit. `reference_text`: about `Likelihood.reference`.
    """

    figures: tuple[FigureRecipe, ...]
    read: Callable[[Any], ReadCurve]
    curve: Callable[[FittedTest], FittedCurve]
    facts: Callable[[Any], Sequence[tuple[str, str]]]
    reference_text: Markup
    tables: Callable[[FittedTest], tuple[PageTable, ...]] = lambda _: ()
    joint_figures: Callable[[Sequence[FittedTest]], tuple[PageFigure, ...]] = lambda _: ()


@cache
def views() -> Mapping[str, View]:
    """Return the view of every kind of test by the name of the kind."""
    return MappingProxyType(
        {name: import_module(f"pyburgers.drawing.views.{name}").VIEW for name in NAMES}
    )


def view_of(experiment: Experiment) -> View:
    """Return the view of a test's kind."""
    return views()[experiment.protocol]


def marks_text(fits: Sequence[FittedTest]) -> str:
    """Return what a caption says of dotted vertical lines, nothing if the fits have none."""
    if not any(view_of(fit.experiment).read(fit.experiment).marks for fit in fits):
        return ""
    return "Dotted vertical lines mark where the imposed load or rate changes. "
