"""Vector pictures that stand in a page: letters and colours of the page, ids of their own.

What matplotlib writes is a file of its own. In a page its ids would meet those of other figures,
its style sheet would hold for everything, and its black lines would vanish on a dark ground.
"""

import html
import re
from collections.abc import Iterable
from dataclasses import dataclass

import numpy as np

from pyburgers.drawing.style import (
    BLACK,
    BLUE,
    GREEN,
    GREY,
    ORANGE,
    PURPLE,
    SKY_BLUE,
    VERMILION,
)

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
    """A picture as a part of a page: its size in points, and what stands in the svg element.

    `panels`: JSON for the page's script. `colours`: six digits each, written as ``--c-DIGITS``.
    """

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
