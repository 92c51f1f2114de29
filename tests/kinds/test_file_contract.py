"""Files of every kind: what is saved reads back, and each wrong key is refused by its name."""

import tempfile
import tomllib
from collections.abc import Iterator, Mapping
from copy import deepcopy
from dataclasses import replace
from pathlib import Path
from types import MappingProxyType
from typing import Any

import numpy as np
import pytest
import tomli_w
from hypothesis import HealthCheck, given, settings
from hypothesis import strategies as st
from kind_examples import EXAMPLES
from refusals import refusal
from same_contents import assert_equal

from pyburgers.common.errors import InputError
from pyburgers.kinds.attenuation.experiment import AttenuationExperiment
from pyburgers.kinds.constant_rate.experiment import ConstantRateExperiment
from pyburgers.kinds.experiment import (
    Experiment,
    MeasuredMicrostructure,
    Provenance,
    Stated,
    UncertainCondition,
)
from pyburgers.kinds.kind import load_experiment, save_experiment
from pyburgers.kinds.loading_history.experiment import HistoryExperiment

TEXT = st.text(st.characters(exclude_categories=["Cs"]), min_size=1, max_size=20)
MAYBE_TEXT = st.none() | TEXT
NAMES = st.from_regex(r"[A-Za-z0-9_][A-Za-z0-9._-]{0,20}", fullmatch=True)
SIZES = st.floats(1e-6, 1e-3)
APPARATUS = st.none() | NAMES


@st.composite
def uncertain_conditions(draw: st.DrawFn) -> tuple[UncertainCondition, ...]:
    """Errors of temperature and load cell, either or both."""
    sizes = {"temperature_error": 20.0, "stress_calibration_error": 0.2}
    return tuple(
        UncertainCondition(name, draw(st.floats(1e-3, largest)), draw(APPARATUS))
        for name, largest in sizes.items()
        if draw(st.booleans())
    )


@st.composite
def sections(draw: st.DrawFn, last: float) -> tuple[MeasuredMicrostructure, ...]:
    """Up to three sections along the strain of a test."""
    strains = draw(st.lists(st.floats(1e-3, 1), max_size=3, unique=True).map(sorted))
    found = []
    for strain in strains:
        size = draw(SIZES)
        fabric = (0.7, draw(st.floats(1e-3, 0.1))) if draw(st.booleans()) else (None, None)
        found.append(MeasuredMicrostructure(last * strain, size, 0.1 * size, *fabric))
    return tuple(found)


@st.composite
def drawn_tests(draw: st.DrawFn, kind: str) -> Experiment:
    """A test of a kind: names, texts, errors, sections and readings drawn."""
    test: Any = EXAMPLES[kind].load(EXAMPLES[kind].quick[0])
    origin = Provenance("synthetic", draw(TEXT), *(draw(MAYBE_TEXT) for _ in range(3)))
    values = TEXT | st.booleans() | st.integers(-(2**62), 2**62) | st.floats(allow_nan=False)
    more: dict[str, Any] = {"initial_grain_size": draw(SIZES)}
    if test.may_be_uncertain:
        more["uncertain"] = draw(uncertain_conditions())
    rng = np.random.default_rng(draw(st.integers(0, 2**32)))
    if isinstance(test, ConstantRateExperiment):
        size = draw(st.sampled_from([0, test.n_points]))
        more["strain"], more["stress"] = test.strain[:size], rng.lognormal(16, size=size)
        # A file states the error of readings beside them.
        more["stress_uncertainty"] = draw(st.floats(1.0, 1e6)) if size else None
        more["microstructure"] = draw(sections(test.final_strain))
    elif isinstance(test, HistoryExperiment):
        more["reading"] = test.reading * rng.lognormal(size=test.n_points)
        more["apparatus_compliance"] = draw(st.none() | st.just(Stated(1e-11 / 3, 1e-12)))
        more["strain_offset"] = draw(st.none() | st.just(Stated(1e-4 / 3, 0.0)))
        more["strain_uncertainty"] = draw(st.none() | st.floats(1e-7, 1e-3))
    elif isinstance(test, AttenuationExperiment):
        larger = np.where(test.readings.is_limit, 1.0, 1 + rng.random(test.readings.tan_delta.size))
        tan_delta = larger * test.readings.tan_delta
        more["readings"] = replace(test.readings, tan_delta=tan_delta)
    metadata = MappingProxyType(draw(st.dictionaries(NAMES, values, max_size=3)))
    found: Experiment = replace(test, id=draw(NAMES), provenance=origin, metadata=metadata, **more)
    return found


@pytest.mark.parametrize("kind", EXAMPLES)
def test_a_saved_test_is_read_back_whatever_it_holds(kind: str) -> None:
    @settings(
        max_examples=20,
        deadline=None,
        database=None,
        derandomize=True,
        suppress_health_check=list(HealthCheck),
    )
    @given(drawn_tests(kind))
    def run(test: Experiment) -> None:
        with tempfile.TemporaryDirectory() as folder:
            assert_equal(load_experiment(save_experiment(test, Path(folder))), test)

    run()


FREE_TABLES = ("metadata", "true_parameters")
"""Tables whose keys a user chooses."""

REQUIRED = ("id", "material", "protocol", "initial_grain_size_m", "kind", "source")


def keys_of(table: Mapping[str, Any], *above: str | int) -> Iterator[tuple[str | int, ...]]:
    """Places of every key of a file, those of its tables included."""
    for key, value in table.items():
        if key in FREE_TABLES:
            continue
        yield (*above, key)
        if isinstance(value, dict):
            yield from keys_of(value, *above, key)
        elif isinstance(value, list):
            for number, one in enumerate(value):
                if isinstance(one, dict):
                    yield from keys_of(one, *above, key, number)


def wrong_values(key: str, value: object) -> Iterator[object]:
    """Values that a key may not have: another type, no number, no unit, no column, no file."""
    if key != "notices":
        yield [[1]]
    if isinstance(value, float):
        yield float("nan")
        yield "much"
    if key.endswith("_unit"):
        yield "furlong"
    if key.endswith(("_column", "file")):
        yield "nowhere"


@pytest.mark.parametrize(
    ("kind", "name"), [(kind, name) for kind in EXAMPLES for name in EXAMPLES[kind].quick]
)
def test_every_wrong_key_is_refused_by_its_name(kind: str, name: str, tmp_path: Path) -> None:
    path = save_experiment(EXAMPLES[kind].load(name), tmp_path)
    content = tomllib.loads(path.read_text(encoding="utf-8"))

    def changed(place: tuple[str | int, ...], *new: tuple[str, object]) -> str:
        whole = deepcopy(content)
        table: Any = whole
        for part in place[:-1]:
            table = table[part]
        del table[place[-1]]
        table.update(new)
        path.write_text(tomli_w.dumps(whole), encoding="utf-8")
        try:
            load_experiment(path)
        except InputError:
            return refusal(path)
        return ""

    refused = set()
    for place in keys_of(content):
        key: str = str(place[-1])
        value: Any = content
        for part in place:
            value = value[part]
        if changed(place):
            refused.add(key)
        unknown = "missing" if key == "protocol" else f"unknown key '{key}x'"
        assert unknown in changed(place, (f"{key}x", value)), place
        for wrong in wrong_values(key, value):
            said = changed(place, (key, wrong))
            assert key in said or str(wrong) in said, (place, wrong, said)
    assert refused.issuperset(REQUIRED)
