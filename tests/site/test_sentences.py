"""Sentences that are hard to read at once are found, and nothing else."""

from pathlib import Path

import pytest
import sentences
from sentences import documents, fault, main, public_docstrings

LONG = "A " + "long " * 25 + "sentence."


@pytest.mark.parametrize(
    ("sentence", "found"),
    [
        (LONG, "27 words"),
        (LONG.replace("long long ", "", 1), None),
        ("What takes long tells of its progress.", "a clause as subject"),
        ("Where the data come from is told.", "a clause as subject"),
        ("Where strain is imposed, stress is read.", None),
        ("What does a page show?", None),
        ("Whatever the rate is, stress rises.", None),
    ],
)
def test_a_sentence_is_judged(sentence: str, found: str | None) -> None:
    assert fault(sentence) == found


def test_sentences_are_those_that_a_reader_sees() -> None:
    text = f"""# What a heading may say

Tests of et al. (1984) and
others. A [link of words](that/counts/as/its/text.md) stands here.

```shell
{LONG}
```

| table | {LONG} |

<!-- {LONG} -->

- one point
- `{LONG}`
"""
    assert list(sentences.sentences(text)) == [
        (3, "Tests of et al (1984) and\nothers."),
        (4, "A link of words stands here."),
        (14, "one point"),
        (15, "CODE"),
    ]


def test_files_are_listed_with_line_and_count(
    tmp_path: Path, capsys: pytest.CaptureFixture[str], monkeypatch: pytest.MonkeyPatch
) -> None:
    monkeypatch.setattr(sentences, "ROOT", tmp_path)
    (tmp_path / "a.md").write_text(f"Short.\n\n{LONG}\n", encoding="utf-8")
    main([str(tmp_path / "a.md")])
    assert capsys.readouterr().out.splitlines() == [
        "a.md:3: 27 words: A long long long long long long long long ...",
        "   1 a.md",
        "   1 sentences to shorten",
    ]


def test_docstrings_hold_their_descriptions_of_parameters() -> None:
    docstrings = dict(public_docstrings())
    assert "pyburgers.Fit.load" in docstrings
    assert not any(line.startswith("    ") for line in docstrings["pyburgers.fit"].splitlines()[:9])
    assert "README.md" in {path.name for path in documents()}
