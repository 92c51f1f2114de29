"""Pictures in a page: ids, letters, colours."""

import re

import pytest
from matplotlib.figure import Figure

from pyburgers.drawing.inline_svg import InlineSvg, glyph_library, inline_svg
from pyburgers.drawing.style import BLUE, image


def drawn(text: str) -> str:
    """A figure with a clipped line, markers, letters and a formula."""
    figure = Figure(figsize=(4.0, 3.0))
    axes = figure.subplots()
    axes.plot([0, 1, 2], [0.1, 0.7, 0.2], color=BLUE, alpha=0.04, marker="o")
    axes.set_xlim(0.5, 1.5)
    axes.set_title(f"{text} $\\eta_K^{{-1}}$")
    return image(figure, "page").decode("utf-8")


@pytest.fixture(scope="module")
def pictures() -> list[InlineSvg]:
    return [inline_svg(drawn(text), f"f{k}") for k, text in enumerate(("same", "Squares"))]


def test_ids_of_pictures_do_not_meet_and_every_reference_leads_somewhere(
    pictures: list[InlineSvg],
) -> None:
    library = set(re.findall(r' id="([^"]+)"', glyph_library(pictures)))
    seen: set[str] = set()
    for picture in pictures:
        own = re.findall(r' id="([^"]+)"', picture.content)
        assert len(set(own)) == len(own)
        assert not seen & set(own)
        seen |= set(own)
        used = set(re.findall(r'(?:href="|url\()#([^")]+)', picture.content))
        assert used <= set(own) | library
        assert set(own) <= used


def test_letters_are_drawn_once_and_are_no_words_of_the_page(pictures: list[InlineSvg]) -> None:
    library = glyph_library(pictures)
    paths = re.findall(r'<path id="([^"]+)"', library)
    assert len(set(paths)) == len(paths)
    for picture in pictures:
        assert not re.sub(r"<[^>]*>", "", picture.content).strip()
        assert "<text" not in picture.content


def test_colours_are_those_of_the_page(pictures: list[InlineSvg]) -> None:
    for picture in pictures:
        assert "var(--blue)" in picture.content
        assert "var(--paper)" in picture.content
        assert BLUE.lower() not in picture.content
        assert "0.04" in picture.content  # only coordinates are rounded
        assert "<style" not in picture.content


def test_curves_keep_their_commands() -> None:
    picture = inline_svg(
        '<svg viewBox="0 0 10 20"><path d="M 1 2 \nL 3.456 4 \nQ 5 6 7 8 \nL 9 10 \nz\n"/></svg>',
        "f0",
    )
    assert (picture.width, picture.height) == (10, 20)
    assert 'd="M1 2 3.4 4 Q5 6 7 8 L9 10 z"' in picture.content


def test_what_is_no_picture_is_refused() -> None:
    with pytest.raises(ValueError, match="picture f0: found no svg element"):
        inline_svg("<p>", "f0")


def test_the_same_figure_gives_the_same_picture(pictures: list[InlineSvg]) -> None:
    assert inline_svg(drawn("same"), "f0").content == pictures[0].content
