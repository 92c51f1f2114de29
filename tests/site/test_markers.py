"""Pages are plain Markdown on a code host, and the site finds its directives in them."""

import re
from pathlib import Path

import pytest
from conftest import ICE
from markers import with_directives

DOCS = ICE.parents[1] / "docs"
PLAIN = [DOCS / "index.md", *DOCS.glob("tutorials/*.md"), *DOCS.glob("gallery/*.md")]


@pytest.mark.parametrize(
    ("written", "read"),
    [
        ("<!-- run -->\n```shell\nls\n```", "```{run} shell\nls\n```"),
        (
            "<!-- run\n:exit: 0 3\n:lines: 9\n-->\n```python\n1\n```",
            "```{run} python\n:exit: 0 3\n:lines: 9\n1\n```",
        ),
        ("<!-- write-file a.toml -->\n```toml\nb = 1\n```", "```{write-file} a.toml\nb = 1\n```"),
        ("```shell\nnot run\n```", "```shell\nnot run\n```"),
        ("a\n\n<!-- site\n```{page} p\n```\n-->\n\nb", "a\n\n```{page} p\n```\n\nb"),
        ("<!-- site instead\nA\n\nB\n-->\n- c\n- d\n\ne", "A\n\nB\n\ne"),
        ("<!-- site instead\nA\n-->\nlast", "A\n"),
        ("<!-- a note -->\n```shell\nls\n```", "<!-- a note -->\n```shell\nls\n```"),
    ],
)
def test_markers_become_directives(written: str, read: str) -> None:
    assert with_directives(written) == read


@pytest.mark.parametrize("page", PLAIN, ids=lambda page: page.stem)
def test_a_code_host_shows_no_directive(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    shown = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    assert not re.search(r"^(```|:::+)\{|^:[a-z-]+:", shown, re.MULTILINE)
    assert "<!-- run" not in with_directives(text)


def test_files_and_pictures_of_the_tutorials_are_there() -> None:
    """Commands run in a folder of the checkout, in which the data are `../data`."""
    texts = "".join(page.read_text(encoding="utf-8") for page in PLAIN)
    data = set(re.findall(r"\.\./(data/\S+?\.\w+)", texts))
    assert len(data) > 5
    assert not [name for name in data if not (DOCS.parent / name).is_file()]
