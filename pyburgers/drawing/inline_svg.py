"""Vector pictures that stand in a page: letters drawn once, colours of the page, ids of their own.

What matplotlib writes is a file of its own. In a page its ids would meet those of other figures,
its style sheet would hold for everything, and its black lines would vanish on a dark ground.
"""

import re
from collections.abc import Iterable
from dataclasses import dataclass, field

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
_ROOT = re.compile(r'.*?<svg[^>]*viewBox="0 0 ([\d.]+) ([\d.]+)"[^>]*>(.*)</svg>', re.DOTALL)
_GLYPH = re.compile(r'<path id="([^"]+)" d="([^"]*)" transform="(scale\([^"]*\))"/>')
_LETTER = re.compile(r'<use xlink:href="#([^"]+)" transform="translate\(([-\d.]+) ([-\d.]+)\)"/>')
_ID, _REFERENCE = re.compile(r' id="([^"]+)"'), re.compile(r'(url\(#|xlink:href="#)([^")]+)')
_TAG, _DECIMALS = re.compile(r"<[^>]*>"), re.compile(r"(-?\d+)\.(\d)\d*")
_COORDINATES = re.compile(r' (?:d|x|y|points|transform)="[^"]*"')
_PATH, _COMMAND = re.compile(r' d="([^"]*)"'), re.compile(r"([A-Za-z])([^A-Za-z]*)")
_BETWEEN = re.compile(r">\s+<")


@dataclass(frozen=True, eq=False)
class InlineSvg:
    """A picture as a part of a page.

    `width`, `height`: its size in points.
    `content`: what stands inside the svg element, without letters.
    `glyphs`: path elements of the letters it uses, by id; those of several pictures have the same
        ids.
    `colours`: six digits of colours that the page has no name for; they stand as ``--c-DIGITS``.
    """

    width: float
    height: float
    content: str
    glyphs: dict[str, str] = field(repr=False)
    colours: frozenset[str] = frozenset()


def inline_svg(picture: str, key: str) -> InlineSvg:
    """Make a part of a page of a picture whose letters are paths (`pyburgers.drawing.style.image`).

    `picture` is what matplotlib wrote; the ids of the part begin with `key`, unique on the page.
    Raise ValueError if it is not such a picture.
    """
    found = _ROOT.fullmatch(_DROPPED.sub("", picture).strip())
    if found is None:
        raise ValueError(f"picture {key}: found no svg element with a view box.")
    width, height, content = float(found[1]), float(found[2]), found[3]
    glyphs = {
        f"g-{name}": f'<path id="g-{name}" d="{_short_path(path)}" transform="{scale}"/>'
        for name, path, scale in _GLYPH.findall(content)
    }
    content = _GLYPH.sub("", content).replace("<defs></defs>", "")
    names: dict[str, str] = {}
    content = _LETTER.sub(lambda use: _letter(*use.groups()), content)
    for _, name in _REFERENCE.findall(content):
        shared = f"g-{name}" in glyphs
        names.setdefault(name, f"g-{name}" if shared else f"{key}-{len(names)}")
    content = _ID.sub(lambda own: f' id="{names[own[1]]}"' if own[1] in names else "", content)
    content = _REFERENCE.sub(lambda to: to[1].removeprefix("xlink:") + names[to[2]], content)
    content = _TAG.sub(lambda tag: _short_tag(tag[0]), content)
    colours = frozenset(re.findall(r"var\(--c-([0-9a-f]{6})", content))
    return InlineSvg(width, height, _BETWEEN.sub("><", content).strip(), glyphs, colours)


def glyph_library(pictures: Iterable[InlineSvg]) -> str:
    """Return the letters of all pictures as path elements, each once."""
    found: dict[str, str] = {}
    for picture in pictures:
        found |= picture.glyphs
    return "".join(found.values())


def dark_colours(pictures: Iterable[InlineSvg]) -> dict[str, str]:
    """Return what stands on a dark ground for the colours that the page has no name for."""
    found = set().union(*(picture.colours for picture in pictures))
    return {digits: on_dark(digits) for digits in sorted(found)}


def on_dark(digits: str) -> str:
    """Return a colour of the same hue whose contrast with the dark ground is that with white.

    Its `digits` are two hexadecimal ones each of red, green and blue.
    """
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


def _letter(name: str, x: str, y: str) -> str:
    """Place a letter of a line of text, the commonest element by far, in few characters."""
    moved = (f' {axis}="{value}"' for axis, value in (("x", x), ("y", y)) if value != "0")
    return f'<use xlink:href="#{name}"{"".join(moved)}/>'


def _short_path(path: str) -> str:
    """Leave out the command of a line that goes on."""
    parts, before = [], ""
    for command, numbers in _COMMAND.findall(path):
        named = "" if command == "L" and before in {"M", "L"} else command
        parts.append(named + " ".join(numbers.split()))
        before = command
    return " ".join(parts)


def _short_tag(tag: str) -> str:
    """Shorten a tag: a tenth of a point is enough, but not in pictures of dots and in scales."""
    if tag.startswith("<image"):
        return tag.replace("xlink:href", "href")
    tag = _COLOUR.sub(lambda colour: f"var(--{_NAMES[colour[0].lower()]})", tag)
    tag = _OTHER_COLOUR.sub(r"var(--c-\1, #\1)", tag)
    tag = _PATH.sub(lambda path: f' d="{_short_path(path[1])}"', tag)
    return tag if "scale(" in tag else _COORDINATES.sub(_tenths, tag)


def _tenths(coordinates: re.Match[str]) -> str:
    return _DECIMALS.sub(_rounded, coordinates[0])


def _rounded(number: re.Match[str]) -> str:
    return number[1] if number[2] == "0" else f"{number[1]}.{number[2]}"
