"""The docstring of each public name has a short example, and the example runs.

Examples take these variables as given: `test` and `priors` of a small fit, `fit` and a fit `other`
of the same material, both together in `joint` and with nothing shared in `separate`, a fit
`oscillation`, the fit `peaks` of the table `table`, `options` of short chains, `values` of all
parameters, and `data`, the folder of the shipped data.
"""

import doctest
import inspect
import json
import re
from collections.abc import Callable, Iterator
from pathlib import Path
from typing import Any

import numpy as np
import pandas as pd
import pytest
from conftest import SMALL_RUN, Problem
from matplotlib import pyplot as plt
from synthetic_olivine_fit import make_olivine_fit

import pyburgers

REFERENCE = Path(__file__).parents[2] / "docs" / "reference" / "python.md"
MEMBERS = re.compile(r"autoclass:: (\w+)\n +:members:([^\n]*)(\n +:inherited-members:)?")
MAX_LINES = 7


def public_things() -> Iterator[tuple[str, Any]]:
    """Public names and the members of classes that the reference shows, with their objects."""
    for name in pyburgers.__all__:
        yield name, getattr(pyburgers, name)
    for name, members, inherited in MEMBERS.findall(REFERENCE.read_text(encoding="utf-8")):
        owner = getattr(pyburgers, name)
        every = [key for key in (dir(owner) if inherited else vars(owner)) if key[0] != "_"]
        shown = members.split(",") if members.strip() else every
        for member in map(str.strip, shown):
            if inspect.isroutine(getattr(owner, member)):
                yield f"{name}.{member}", getattr(owner, member)


THINGS = dict(public_things())


def example_of(name: str) -> doctest.DocTest:
    text = inspect.getdoc(THINGS[name]) or ""
    return doctest.DocTestParser().get_doctest(text, {}, name, name, 0)


@pytest.fixture(scope="module")
def variables(request: pytest.FixtureRequest) -> Callable[[str], dict[str, Any]]:
    """Make the variables that the text of an example speaks of."""
    problem: Problem = request.getfixturevalue("small_problem")
    data = pyburgers.shipped_folder("data")
    given: dict[str, Any] = {"pyburgers": pyburgers, "np": np, "pd": pd, "plt": plt}
    given |= {"Path": Path, "json": json, "data": data, "options": SMALL_RUN}
    given |= {"test": problem.experiment, "priors": problem.priors}
    given |= {"values": problem.experiment.true_parameters}
    fixtures = {"fit": "small_fit", "other": "other_fit", "joint": "joint"}
    fixtures |= {"separate": "separate_joint", "peaks": "peaks", "creep": "creep"}

    def named(text: str) -> dict[str, Any]:
        words = set(re.findall(r"\w+", text))
        own = {
            word: request.getfixturevalue(name) for word, name in fixtures.items() if word in words
        }
        if "oscillation" in words:
            folder = request.getfixturevalue("tmp_path_factory").mktemp("olivine") / "run"
            own["oscillation"] = make_olivine_fit(folder)
        if "rates" in words:
            own["rates"] = pyburgers.load_rate_table(data / "ice" / "rates" / "fan_2020.toml")
        if "law" in words:
            own["law"] = pyburgers.rate_law("ice_power_law")
        return given | own

    return named


@pytest.mark.parametrize("name", THINGS)
def test_the_example_of_a_public_name_runs(
    name: str,
    variables: Callable[[str], dict[str, Any]],
    tmp_path: Path,
    monkeypatch: pytest.MonkeyPatch,
    sketched: None,
    in_this_process: None,
) -> None:
    example = example_of(name)
    lines = "".join(part.source for part in example.examples).splitlines()
    assert 0 < len(lines) <= MAX_LINES, f"{name}: expected an example of at most {MAX_LINES} lines"
    assert "SKIP" not in (example.docstring or "")
    monkeypatch.chdir(tmp_path)
    example.globs = variables("\n".join(lines))
    said: list[str] = []
    flags = doctest.ELLIPSIS | doctest.NORMALIZE_WHITESPACE
    found = doctest.DocTestRunner(optionflags=flags).run(example, out=said.append)
    plt.close("all")
    assert found.failed == 0, "".join(said)
