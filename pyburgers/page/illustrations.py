"""Figures on a page: their files, what stands in the page, and each caption once.

What matplotlib writes is a file of its own. In a page its ids would meet those of other figures,
its style sheet would hold for everything, and its black lines would vanish on a dark ground.
"""

import html
import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np

from pyburgers.common.tasks import Workers, run_tasks
from pyburgers.drawing.page_parts import PageFigure
from pyburgers.drawing.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILION,
    write_page_images,
)
from pyburgers.page.names import file_key

PAGE_COLOURS = {
    BLACK: "ink",
    "#ffffff": "paper",
    GREY: "grey",
    "#777777": "soft-line",
    BLUE: "blue",
    ORANGE: "orange",
    GREEN: "green",
    VERMILION: "vermilion",
    PURPLE: "purple",
    SKY_BLUE: "sky",
}
"""Names of the page's colours that take the place of those of a figure."""

DARK_PAPER = 0.009
"""Luminance of the page's dark ground, `--paper` of its style sheet."""

LUMINANCE = np.array([0.2126, 0.7152, 0.0722])
"""Shares of linear red, green and blue in it."""

_COLOUR = re.compile("|".join(PAGE_COLOURS), re.IGNORECASE)
_OTHER_COLOUR = re.compile("(?<=: )#([0-9a-f]{6})")
_NAMES = {colour.lower(): name for colour, name in PAGE_COLOURS.items()}
_DROPPED = re.compile(r"<!--.*?-->|<metadata>.*?</metadata>|<style.*?</style>", re.DOTALL)
_ROOT = re.compile(r'.*?<svg([^>]*)viewBox="0 0 ([\d.]+) ([\d.]+)"([^>]*)>(.*)</svg>', re.DOTALL)
_PANELS = re.compile(r'data-panels="([^"]*)"')
_ID, _REFERENCE = re.compile(r' id="([^"]+)"'), re.compile(r'(url\(#|xlink:href="#)([^")]+)')
_TAG, _FONT = re.compile(r"<[^>]*>"), re.compile(r"font-family: [^;\"]*;? ?")
_COMMAND, _PATH = re.compile(r"\s*([A-Za-z])\s*"), re.compile(r' d="[^"]*"')
_BETWEEN = re.compile(r">\s+<")


@dataclass(frozen=True, eq=False)
class InlineSvg:
    """A picture in a page: size in points, content, panels as JSON, colours of six digits each."""

    width: float
    height: float
    content: str
    panels: str = "[]"
    colours: frozenset[str] = frozenset()


def inline_svg(picture: str, key: str) -> InlineSvg:
    """Make a part of a page, whose ids begin with `key`, of a picture (`style.image`)."""
    found = _ROOT.fullmatch(_DROPPED.sub("", picture).strip())
    if found is None:
        raise ValueError(f"picture {key}: found no svg element with a view box.")
    content = found[5].replace("<defs></defs>", "")
    panels = _PANELS.search(found[1] + found[4])
    names: dict[str, str] = {}
    for _, name in _REFERENCE.findall(content):
        names.setdefault(name, f"{key}-{len(names)}")
    content = _ID.sub(lambda own: f' id="{names[own[1]]}"' if own[1] in names else "", content)
    content = _REFERENCE.sub(lambda to: to[1].removeprefix("xlink:") + names[to[2]], content)
    content = _TAG.sub(lambda tag: _page_tag(tag[0]), content)
    return InlineSvg(
        float(found[2]),
        float(found[3]),
        _BETWEEN.sub("><", content).strip(),
        html.unescape(panels[1]) if panels else "[]",
        frozenset(re.findall(r"var\(--c-([0-9a-f]{6})", content)),
    )


def dark_colours(pictures: Iterable[InlineSvg]) -> dict[str, str]:
    """Return what stands on a dark ground for the colours that the page has no name for."""
    found = set().union(*(picture.colours for picture in pictures))
    return {digits: on_dark(digits) for digits in sorted(found)}


def on_dark(digits: str) -> str:
    """Return the colour of the hue of six digits with the contrast on dark that it has on white."""
    coded = np.array([int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)])
    linear = np.where(coded <= 0.04045, coded / 12.92, ((coded + 0.055) / 1.055) ** 2.4)
    before = float(linear @ LUMINANCE)
    after = min(1.0, 1.05 / (before + 0.05) * (DARK_PAPER + 0.05) - 0.05)
    if after > before:
        linear = linear + (after - before) / (1 - before) * (1 - linear)
    else:
        linear = linear * after / before
    coded = np.where(linear <= 0.0031308, 12.92 * linear, 1.055 * linear ** (1 / 2.4) - 0.055)
    return "#" + "".join(f"{round(255 * part):02x}" for part in coded.tolist())


def _page_tag(tag: str) -> str:
    """Give a tag letters and colours of the page, and the commands of a path no blanks."""
    if tag.startswith("<image"):
        return tag.replace("xlink:href", "href")
    tag = _COLOUR.sub(lambda colour: f"var(--{_NAMES[colour[0].lower()]})", _FONT.sub("", tag))
    tag = _OTHER_COLOUR.sub(r"var(--c-\1, #\1)", tag)
    return _PATH.sub(lambda path: ' d="' + _COMMAND.sub(r"\1", path[0][4:-1]) + '"', tag)


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
