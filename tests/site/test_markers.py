"""Pages are plain Markdown on a code host, and the site finds its directives in them."""

import re
from pathlib import Path
from urllib.parse import unquote

import pytest
from conftest import ICE
from markers import with_directives
from sentences import documents

ROOT = ICE.parents[1]
DOCS = ROOT / "docs"
PLAIN = documents()
CODE = re.compile(r"^```.*?^```$|<!--.*?-->|`[^`\n]+`", re.DOTALL | re.MULTILINE)
LINK = re.compile(r"\]\(([^)\s]+)\)")


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


@pytest.mark.parametrize("page", PLAIN, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_a_code_host_shows_no_directive(page: Path) -> None:
    text = page.read_text(encoding="utf-8")
    shown = re.sub(r"<!--.*?-->", "", text, flags=re.DOTALL)
    assert not re.search(r"^(```|:::+)\{|^:[a-z-]+:", shown, re.MULTILINE)
    assert "\n<!-- run" not in with_directives(text)


@pytest.mark.parametrize("page", PLAIN, ids=lambda page: page.relative_to(ROOT).as_posix())
def test_links_lead_to_files_and_headings_of_the_checkout(page: Path) -> None:
    links = LINK.findall(CODE.sub("", page.read_text(encoding="utf-8")))
    inside = [unquote(link) for link in links if not re.match(r"[a-z]+:", link)]
    assert not [link for link in inside if not leads_somewhere(page, link)]


def leads_somewhere(page: Path, link: str) -> bool:
    """Whether the file of a relative link exists, and has its heading."""
    name, _, anchor = link.partition("#")
    target = page.parent / name if name else page
    return target.exists() and (not anchor or anchor in anchors(target))


def anchors(page: Path) -> set[str]:
    """The anchors that a code host makes of the headings of a page."""
    text = re.sub(r"^```.*?^```$", "", page.read_text(encoding="utf-8"), flags=re.DOTALL | re.M)
    headings = re.findall(r"^#+ (.+)$", text, re.MULTILINE)
    return {re.sub(r"[^\w\- ]", "", heading.lower()).replace(" ", "-") for heading in headings}


@pytest.mark.parametrize(
    ("link", "found"),
    [
        ("checks.md", True),
        ("checks.md#checks-two-questions", True),
        ("checks.md#no-such-heading", False),
        ("no_such_page.md", False),
    ],
)
def test_a_broken_link_is_found(link: str, found: bool) -> None:
    assert leads_somewhere(DOCS / "model.md", link) == found


def test_files_and_pictures_of_the_tutorials_are_there() -> None:
    """Commands run in a folder of the checkout, in which the data are `../data`."""
    texts = "".join(page.read_text(encoding="utf-8") for page in DOCS.glob("**/*.md"))
    data = set(re.findall(r"\.\./(data/\S+?\.\w+)", texts))
    assert len(data) > 5
    assert not [name for name in data if not (ROOT / name).is_file()]
