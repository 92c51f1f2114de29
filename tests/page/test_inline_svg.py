"""Pictures in a page: ids, letters, colours."""

import base64
import io
import json
import re
from pathlib import Path

import numpy as np
import pytest
from matplotlib.figure import Figure
from matplotlib.image import imread as read_png

from pyburgers.drawing.style import BLUE, image
from pyburgers.page import page
from pyburgers.page.illustrations import InlineSvg, dark_colours, inline_svg

CSS = Path(page.__file__).parent.parent / "templates" / "report.css"


def drawn(text: str) -> str:
    """A figure with a clipped line, markers, letters and a formula."""
    figure = Figure(figsize=(4.0, 3.0))
    axes = figure.subplots()
    axes.plot([0, 1, 2], [0.1, 0.7, 0.2], color=BLUE, alpha=0.04, marker="o")
    axes.set_xlim(0.5, 1.5)
    axes.set_title(f"{text} $\\eta_K^{{-1}}$")
    return image(figure, "svg").decode("utf-8")


@pytest.fixture(scope="module")
def pictures() -> list[InlineSvg]:
    return [inline_svg(drawn(text), f"f{k}") for k, text in enumerate(("same", "Squares"))]


def test_ids_of_pictures_do_not_meet_and_every_reference_leads_somewhere(
    pictures: list[InlineSvg],
) -> None:
    seen: set[str] = set()
    for picture in pictures:
        own = re.findall(r' id="([^"]+)"', picture.content)
        assert len(set(own)) == len(own)
        assert not seen & set(own)
        seen |= set(own)
        used = set(re.findall(r'(?:href="|url\()#([^")]+)', picture.content))
        assert used <= set(own)
        assert set(own) <= used


def test_letters_are_words_of_the_page_in_its_font(pictures: list[InlineSvg]) -> None:
    for picture, text in zip(pictures, ("same", "Squares"), strict=True):
        words = re.sub(r"<[^>]*>", "", picture.content)
        assert text in words
        assert "0.7" in words  # a tick
        assert "font-family" not in picture.content
    assert inline_svg(drawn("same"), "f0").content == pictures[0].content


def test_panels_have_their_scales_and_series_their_names() -> None:
    figure = Figure(figsize=(4.0, 3.0))
    left, right = figure.subplots(1, 2)
    left.plot([1, 2, 3], [10.0, 1000.0, 100.0], "o", label='"a" & b')
    left.set(xlim=(0, 4), ylim=(1, 1e4), yscale="log", xlabel="strain (%)", ylabel="ratio (–)")
    right.plot([0, 1], [0, 1])
    right.set(xlabel=r"rate (10$^{-5}$ s$^{-1}$)", ylabel="density (1/(kJ/mol))")
    vector = image(figure, "svg").decode("utf-8")
    picture = inline_svg(vector, "f0")
    first, second = json.loads(picture.panels)
    assert first[4:] == [[0, 4, 0, "%"], [0, 4, 1, ""]]
    assert [axis[3] for axis in second[4:]] == ["10^-5 s^-1", "1/(kJ/mol)"]
    tag = 'data-panel="0" data-series="\'a\' &amp; b"'
    assert tag in picture.content
    assert tag in vector
    (x, y), *_ = re.findall(
        r'<use href="#[^"]*" x="([\d.]+)" y="([\d.]+)"', picture.content.partition(tag)[2]
    )
    across = (float(x) / picture.width - first[0]) / (first[2] - first[0])
    above = (first[3] - float(y) / picture.height) / (first[3] - first[1])
    assert (4 * across, 10 ** (4 * above)) == pytest.approx((1.0, 10.0), rel=1e-3)


def test_colours_are_those_of_the_page(pictures: list[InlineSvg]) -> None:
    for picture in pictures:
        assert "var(--blue)" in picture.content
        assert "var(--paper)" in picture.content
        assert BLUE.lower() not in picture.content
        assert "0.04" in picture.content  # only coordinates are rounded
        assert "<style" not in picture.content


@pytest.mark.parametrize("digits", ["2a0593", "de5f65", "e6e6e6", "00224e"])
def test_colours_without_a_name_keep_their_contrast_on_a_dark_ground(digits: str) -> None:
    figure = Figure()
    figure.subplots().plot([0, 1], color=f"#{digits}")
    picture = inline_svg(image(figure, "svg").decode("utf-8"), "f0")
    assert f"var(--c-{digits}, #{digits})" in picture.content
    (dark,) = dark_colours([picture]).values()
    dark_ground = re.findall(r"--paper: #([0-9a-f]{6})", CSS.read_text(encoding="utf-8"))[1]
    on_white = contrast(digits, "ffffff")
    assert contrast(dark[1:], dark_ground) == pytest.approx(min(on_white, 17.8), rel=0.05)


def contrast(digits: str, ground: str) -> float:
    """Contrast of two colours as the rules of accessibility count it."""
    lower, upper = sorted(luminance(colour) for colour in (digits, ground))
    return (upper + 0.05) / (lower + 0.05)


def luminance(digits: str) -> float:
    parts = [int(digits[k : k + 2], 16) / 255 for k in (0, 2, 4)]
    linear = [c / 12.92 if c <= 0.04045 else ((c + 0.055) / 1.055) ** 2.4 for c in parts]
    return 0.2126 * linear[0] + 0.7152 * linear[1] + 0.0722 * linear[2]


@pytest.mark.parametrize("height", [6.4, 5.6, 4.37])
def test_what_lies_as_a_picture_is_where_it_would_be_as_lines(height: float) -> None:
    figure = Figure(figsize=(8.0, height))
    axes = figure.subplots()
    axes.axhline(0.4, color="#010203", linewidth=8.0, snap=False)
    axes.axhline(0.4, color=BLUE, linewidth=8.0, rasterized=True, snap=False)
    axes.set_ylim(0, 1)
    size = figure.get_size_inches().tolist()
    text = image(figure, "svg").decode("utf-8")
    assert figure.get_size_inches().tolist() == size
    line = re.search(r'<path d="M [\d.]+ ([\d.]+)[^"]*"[^>]*stroke: #010203', text)
    picture = re.search(r"<image[^>]*>", text)
    assert line is not None
    assert picture is not None
    found = dict(re.findall(r'([\w:]+)="([^"]*)"', picture[0]))
    pixels = read_png(io.BytesIO(base64.b64decode(found["xlink:href"].partition(",")[2])))
    weights = pixels[:, pixels.shape[1] // 2, 3]
    middle = float(weights @ (np.arange(len(weights)) + 0.5) / weights.sum()) / len(weights)
    scale, top, shift = placed(found)
    assert shift + scale * (top + middle * float(found["height"])) == pytest.approx(
        float(line[1]), abs=0.1
    )


def placed(image_tag: dict[str, str]) -> tuple[float, float, float]:
    """Scale, top and shift (points) along the vertical of a picture in a vector file."""
    numbers = re.findall(r"(\w+)\(([^)]*)\)", image_tag.get("transform", ""))
    scale, shift = 1.0, 0.0
    for name, values in numbers:
        last = float(re.split(r"[ ,]+", values.strip())[-1])
        if name == "scale":
            scale *= last
        else:
            shift += scale * last
    return scale, float(image_tag.get("y", 0.0)), shift


def test_curves_keep_their_commands() -> None:
    picture = inline_svg(
        '<svg viewBox="0 0 10 20"><path d="M 1 2 \nL 3.456 4 \nQ 5 6 7 8 \nL 9 10 \nz\n"/></svg>',
        "f0",
    )
    assert (picture.width, picture.height) == (10, 20)
    assert 'd="M1 2L3.456 4Q5 6 7 8L9 10z"' in picture.content
    with pytest.raises(ValueError, match="picture f0: found no svg element"):
        inline_svg("<p>", "f0")
