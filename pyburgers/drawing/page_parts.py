"""Parts of a page: figures, tables and sections."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field
from functools import partial
from string import Formatter
from typing import Any

import pandas as pd
from markupsafe import Markup
from matplotlib.figure import Figure

from pyburgers.kinds.kind import FittedTest


@dataclass(frozen=True)
class PageFigure:
    """A figure.

    Attributes
    ----------
    name : str
        Part of file names.
    title : str
        Heading.
    caption : str
        One paragraph about what is shown and how to read it.
    draw : callable
        Draws it.
    result : str
        Its content in a sentence, for readers who cannot see it; by default its title.

    Examples
    --------
    >>> figure = pyburgers.PageFigure("mine", "My curve", "Stress.", lambda: plt.figure())
    """

    name: str
    title: str
    caption: str
    draw: Callable[[], Figure]
    result: str = ""


@dataclass(frozen=True)
class FigureRecipe:
    """A figure of the fits of a kind, with its caption, or what returns it for a fit.

    `draw`, `result`: they take a fit and, if it shows only a part of a posterior, the part.
    `suits`: whether the section of a fit holds it; else it is drawn where it is asked for.
    """

    name: str
    title: str
    caption: str | Callable[[FittedTest], str]
    draw: Callable[..., Figure]
    result: Callable[..., str]
    suits: Callable[[FittedTest], bool] = lambda _: True

    def __call__(self, fit: FittedTest, *part: object) -> Figure:
        """Draw the figure."""
        return self.draw(fit, *part)

    def of(self, fit: FittedTest, *part: object) -> PageFigure:
        """Return the figure of a fit, or of a part of its posterior."""
        caption = self.caption if isinstance(self.caption, str) else self.caption(fit)
        draw, result = partial(self.draw, fit, *part), self.result(fit, *part)
        return PageFigure(self.name, self.title, caption, draw, result)


def recipe(
    name: str,
    title: str,
    caption: str | Callable[[FittedTest], str],
    result: Callable[..., str],
    **suits: Callable[[FittedTest], bool],
) -> Callable[[Callable[..., Figure]], FigureRecipe]:
    """Make a `FigureRecipe` of the function below, which draws the figure of a fit."""
    return lambda draw: FigureRecipe(name, title, caption, draw, result, **suits)


def text_table(table: pd.DataFrame, columns: Mapping[str, str]) -> pd.DataFrame:
    """Return text by heading from formats of the row's columns; a cell with a NaN is empty."""
    rows = table.to_dict("records")
    cells = [{heading: _cell(form, row) for heading, form in columns.items()} for row in rows]
    return pd.DataFrame(cells, columns=list(columns))


def _cell(form: str, row: Mapping[Any, Any]) -> str:
    """Fill a format, unless a number is NaN."""
    names = [name for _, name, _, _ in Formatter().parse(form) if name]
    is_known = all(row[name] == row[name] for name in names)
    return form.format_map(row) if is_known else ""


@dataclass(frozen=True, eq=False)
class PageTable:
    """A table.

    Attributes
    ----------
    name : str
        Part of the file name.
    title : str
        Heading.
    shown : DataFrame
        Cells on the page, as text.
    saved : DataFrame
        Content of the CSV file, numbers at full precision.
    words : tuple of str
        Columns of short texts.
    sentences : tuple of str
        Columns of whole sentences.
    bad : mapping of str to sequence of bool
        Columns, and whether what each row says there is bad news.
    text : Markup
        An explanation below it.
    in_files : bool
        Whether it is for those who look closer: a file, and not on the page.
    folded : bool
        Whether figures or sentences of its part say already what a reader needs of it.

    Examples
    --------
    >>> numbers = pd.DataFrame({"stress (MPa)": [1.5]})
    >>> table = pyburgers.PageTable("mine", "My table", numbers.astype(str), numbers)
    """

    name: str
    title: str
    shown: pd.DataFrame
    saved: pd.DataFrame
    words: tuple[str, ...] = ()
    sentences: tuple[str, ...] = ()
    bad: Mapping[str, Sequence[bool]] = field(default_factory=dict)
    text: Markup = field(default_factory=Markup)
    in_files: bool = False
    folded: bool = False


@dataclass(frozen=True, eq=False)
class PageSection:
    """A part of the page that is not about one fit alone.

    Attributes
    ----------
    key : str
        Name of its files and its anchor, unique on the page.
    title : str
        Heading.
    paragraphs : tuple of str
        Plain text below the first figure: what was found.
    tables : tuple of PageTable
        Tables.
    figures : tuple of PageFigure
        Figures.
    details : tuple of str
        Plain text that is folded: how it was found, and what to mind.
    after_fits : bool
        Whether it stands after the fits rather than between overview and fits.
    alarms : tuple of str
        Sentences of it that nobody should miss; they stand at the top of the page as well.

    Examples
    --------
    >>> section = pyburgers.PageSection("mine", "My part", ("A finding.",))
    >>> page = pyburgers.write_report(
    ...     [fit], Path("page"), title="Ice", command="my_script.py", extras=[section]
    ... )
    """

    key: str
    title: str
    paragraphs: tuple[str, ...]
    tables: tuple[PageTable, ...] = ()
    figures: tuple[PageFigure, ...] = ()
    details: tuple[str, ...] = ()
    after_fits: bool = False
    alarms: tuple[str, ...] = ()
