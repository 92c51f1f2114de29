"""At which positions of a test a solution can be asked for, the same in every protocol."""

from typing import Any

import numpy as np
import pytest
from kind_examples import EXAMPLES
from truths import truth_of

from pyburgers.common.errors import InputError
from pyburgers.kinds.experiment import Experiment
from pyburgers.kinds.forward import simulate
from pyburgers.kinds.kind import kinds
from pyburgers.kinds.likelihood import likelihoods


def example(protocol: str) -> Experiment:
    """Return a test of a protocol with true parameters."""
    test: Experiment = EXAMPLES[protocol].load(EXAMPLES[protocol].twins[0])
    return test


SPANS = {
    "constant_rate": "strain .* from 1e-12 to 0.2.",
    "forced_oscillation": "time .* from 0 to 1805.3 s.",
    "loading_history": "time .* from 0 to 4000 s.",
    "attenuation": "place .* from 0 to 8.",
}


def test_every_protocol_is_tested() -> None:
    assert set(SPANS) == set(kinds())


@pytest.mark.parametrize("protocol", SPANS)
@pytest.mark.parametrize(
    ("at", "found"),
    [
        ([-1.0], "found -1"),
        ([0.1, 1e9], r"found 1e\+09"),
        ([0.15, 0.1], "found 0.1 behind 0.15"),
        ([], r"found an array of shape \(0,\)"),
        ([np.nan], "found nan"),
        ([[0.1, 0.15]], r"found an array of shape \(1, 2\)"),
        (["late"], r"found \['late'\]"),
    ],
)
def test_positions_that_a_test_does_not_have_are_refused(
    protocol: str, at: list[Any], found: str
) -> None:
    test = example(protocol)
    with pytest.raises(InputError, match=f"^{test.id}: at: {found}.* {SPANS[protocol]}$"):
        simulate(test, truth_of(test), at=at)


@pytest.mark.usefixtures("programs")
@pytest.mark.parametrize("protocol", SPANS)
def test_a_test_has_a_solution_up_to_its_ends(protocol: str) -> None:
    test, kind = example(protocol), likelihoods()[protocol]
    curve = simulate(test, truth_of(test))
    again = simulate(test, truth_of(test), at=kind.output_grid(test))
    np.testing.assert_array_equal(again, curve)
    ends = simulate(test, truth_of(test), at=np.array(test.span))
    np.testing.assert_array_equal(ends[kind.clock.column], test.span)
    low, high = (ends[kind.read[0].column].iloc[k] for k in (0, -1))
    assert np.isfinite([low, high]).all()
    # Rounding beside an end is that end.
    beside = simulate(test, truth_of(test), at=np.array([test.span[1] * (1 + 1e-12)]))
    assert beside[kind.read[0].column].iloc[-1] == pytest.approx(high, rel=1e-9)
