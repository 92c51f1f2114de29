"""Figures on a page: their files, what stands in the page, and each caption once."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

from pyburgers.common.tasks import Workers, run_tasks
from pyburgers.drawing.inline_svg import InlineSvg, inline_svg
from pyburgers.drawing.page_parts import PageFigure
from pyburgers.drawing.style import write_page_images
from pyburgers.page.names import file_key

CSS_PIXELS_PER_POINT = 100 / 72

FIGURES_A_PROCESS = 4
"""Figures that take as long to write as a process takes to start."""


@dataclass(frozen=True, eq=False)
class Illustration:
    """A figure for a page: its `file` as PNG, beside it as SVG, and its `result` in a sentence."""

    text: PageFigure
    file: Path
    result: str

    @property
    def anchor(self) -> str:
        """Its anchor on the page."""
        return f"figure-{self.file.stem}"


def illustrate(
    figures: Iterable[PageFigure], out: Path, key: str, of: str = ""
) -> tuple[Illustration, ...]:
    """Name figures of a part of a page by its key; `of` names a fit for readers who see nothing."""
    return tuple(
        Illustration(
            one,
            out / "figures" / f"{key}_{file_key(one.name)}.png",
            ": ".join(filter(None, (", ".join(filter(None, (one.title, of))), one.result))),
        )
        for one in figures
    )


@dataclass(frozen=True, eq=False)
class Picture:
    """A figure in a page, numbered from 1, and an earlier one with the same caption or None."""

    svg: InlineSvg
    number: int
    explained_by: Illustration | None

    @property
    def width(self) -> int:
        """Width on the page (CSS pixels), the same size of letters for every figure."""
        return round(CSS_PIXELS_PER_POINT * self.svg.width)


def write_figures(
    illustrations: Sequence[Illustration], out: Path, jobs: int | None, by_file: dict[Path, str]
) -> dict[str, Picture]:
    """Write figures, add them to `by_file`, and return those in the page by anchor."""
    missing = [one for one in illustrations if one.file not in by_file]
    workers = Workers(jobs=jobs)
    if workers.processes(len(missing) // FIGURES_A_PROCESS) == 1:
        by_file |= {one.file: write_page_images(one.text.draw(), one.file) for one in missing}
    else:
        calls = {one.file: (one.text.draw(), one.file) for one in missing}
        with run_tasks(write_page_images, calls, workers=workers, out=out) as drawn:
            by_file |= dict(drawn)
    found: dict[str, Picture] = {}
    explained: dict[str, Illustration] = {}
    for number, one in enumerate(illustrations, start=1):
        first = explained.setdefault(one.text.caption, one)
        svg = inline_svg(by_file[one.file], f"f{number}")
        found[one.anchor] = Picture(svg, number, None if first is one else first)
    return found
