"""Markers of plain Markdown, which a code host does not show, become directives of the site.

``<!-- run`` or ``<!-- write-file NAME`` with the directive's options, before a block of code
    The block becomes that directive.
``<!-- site``
    The lines up to ``-->`` are shown on the site alone.
``<!-- site instead``
    They take the place of the paragraph that follows.
"""

import re

BLOCK = re.compile(r"^<!-- (run|write-file)(.*?)((?:\n:.*)*)(?:\n| )-->\n```(\w+)$", re.MULTILINE)
SITE_ONLY = re.compile(
    r"^<!-- site( instead)?\n(.*?)\n-->(?(1)\n(?:[^\n]+(?:\n|\Z))+)", re.DOTALL | re.MULTILINE
)


def with_directives(text: str) -> str:
    """Return the text of a page as the site reads it."""
    text = SITE_ONLY.sub(lambda match: match[2] + ("\n" if match[1] else ""), text)
    return BLOCK.sub(lambda match: f"```{{{match[1]}}}{match[2] or ' ' + match[4]}{match[3]}", text)
