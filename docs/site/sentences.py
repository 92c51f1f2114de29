"""Lists sentences of the documents and public docstrings that are hard to read at once.

    python docs/site/sentences.py [FILE.md ...]

A sentence is listed if it has more than `MAX_WORDS` words, or if a clause with "What" or "Where"
is its subject. Without arguments the script reads all documents and the public docstrings.
"""

import inspect
import re
import subprocess
import sys
from collections.abc import Iterator
from pathlib import Path

import pyburgers

ROOT = Path(__file__).parents[2]
MAX_WORDS = 25

ABBREVIATIONS = re.compile(r"\b(et al|Eqs?|Figs?|e\.g|i\.e|vs)\.(?=\s)")
END_OF_SENTENCE = re.compile(r"(?<=[.?!])[)*\"”]*\s+|(?<=:)\**\s+(?=[^a-z])")
SUBJECT_CLAUSE = re.compile(r"What\b[^?]*$|Where\b[^,?]*$")
NO_PROSE = re.compile(
    r"^```.*?^```$|<!--.*?-->"
    r"|^(?: {4,}|\||#|:::|---|[\w, *]+ : |:[a-z]+:|\$\$)[^\n]*$",
    re.DOTALL | re.MULTILINE,
)
"""Code, comments, tables, headings; of docstrings the underlines and names of parameters."""


def sentences(text: str) -> Iterator[tuple[int, str]]:
    """Yield each sentence of a Markdown text with the number of its first line."""
    text = NO_PROSE.sub(lambda match: "\n" * match[0].count("\n"), text)
    text = re.sub(r"!?\[([^]]*)\]\([^)]*\)|`+([^`]+)`+", _as_read, text)
    for block in re.finditer(r"(?:[^\n]+\n?(?![ \t]*(?:[-*]|\d+\.) ))+", text):
        paragraph = ABBREVIATIONS.sub(r"\1", block[0]).rstrip()
        line, start = text.count("\n", 0, block.start()) + 1, 0
        ends = [match.span() for match in END_OF_SENTENCE.finditer(paragraph)]
        for end, following in [*ends, (len(paragraph), 0)]:
            sentence = re.sub(r"^[\s>*-]+|[\s*]+$", "", paragraph[start:end])
            yield line + paragraph.count("\n", 0, start), sentence
            start = following


def _as_read(match: re.Match[str]) -> str:
    """Return the text of a link, or one word for a piece of code."""
    return match[1] if match[1] is not None else "CODE" + "\n" * match[2].count("\n")


def fault(sentence: str) -> str | None:
    """Say why a sentence is hard to read, or None."""
    words = len(re.findall(r"\S*\w\S*", sentence))
    if words > MAX_WORDS:
        return f"{words} words"
    return "a clause as subject" if SUBJECT_CLAUSE.match(sentence) else None


def public_docstrings() -> Iterator[tuple[str, str]]:
    """Yield the public names with their docstrings, those of methods included."""
    for name in pyburgers.__all__:
        thing = getattr(pyburgers, name)
        members = vars(thing) if inspect.isclass(thing) else {}
        own = {f"{name}.{key}": getattr(thing, key) for key in members if not key.startswith("_")}
        for place, value in {name: thing, **own}.items():
            if callable(value) or isinstance(value, property):
                yield f"pyburgers.{place}", re.sub(r"(?m)^ {4}", "", inspect.getdoc(value) or "")


def documents() -> list[Path]:
    """Return the Markdown files that people write, of the repository."""
    listed = subprocess.run(
        ["git", "ls-files", "*.md"], cwd=ROOT, capture_output=True, text=True, check=True
    ).stdout.split()
    written_by_programs = ("reports/calibration/", "benchmarks/results/")
    return [ROOT / name for name in listed if not name.startswith(written_by_programs)]


def main(paths: list[str]) -> None:
    """Print the sentences that are hard to read, and how many each text has."""
    files = [Path(path).resolve() for path in paths] or documents()
    texts = [(str(path.relative_to(ROOT)), path.read_text(encoding="utf-8")) for path in files]
    counts: dict[str, int] = {}
    for name, text in texts + ([] if paths else list(public_docstrings())):
        for line, sentence in sentences(text):
            if reason := fault(sentence):
                print(f"{name}:{line}: {reason}: {' '.join(sentence.split()[:9])} ...")
                counts[name] = counts.get(name, 0) + 1
    for name, count in counts.items():
        print(f"{count:4} {name}")
    print(f"{sum(counts.values()):4} sentences to shorten")


if __name__ == "__main__":
    main(sys.argv[1:])
